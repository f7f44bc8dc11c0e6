"""A drawing surface in pixels, with x to the right and y down, painted directly, without figure, axes or ticks.

It uses matplotlib's Agg rasteriser.  A figure with axes takes several times as long for a frame, most of it on ticks.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from math import ceil
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import to_rgb
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.transforms import Affine2D, Bbox, TransformedPath

# Okabe and Ito's palette, distinguishable with every common colour blindness; lines also differ in style.
INK, QUIET, LINE, GRID, PANEL, PAPER = "#22303c", "#5b6b78", "#b4bfc8", "#dfe5ea", "#f7f9fb", "#ffffff"
VEHICLE, MODEL, TARGET, COMMAND, WATER = "#0072b2", "#a8558a", "#d55e00", "#00785a", "#2b83a6"
UP, DOWN = "#dcedf7", "#7fa3b8"  # the two halves of the horizon: towards the surface and the bottom
DASHED, DOTTED = (6.0, 4.0), (2.0, 3.0)  # pixels on and off
Colour = str | tuple[float, float, float]
Point = Sequence[float] | np.ndarray
Points = Sequence[Point] | np.ndarray
_RIM = 2  # device pixels free around a text
_CIRCLE = np.column_stack([np.cos(np.linspace(0.0, 2.0 * np.pi, 73)), np.sin(np.linspace(0.0, 2.0 * np.pi, 73))])


class Box(NamedTuple):
    """A rectangle, pixels."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def width(self) -> float:
        return self.right - self.left

    @property
    def height(self) -> float:
        return self.bottom - self.top

    @property
    def middle(self) -> tuple[float, float]:
        return 0.5 * (self.left + self.right), 0.5 * (self.top + self.bottom)

    def shrunk(self, by: float) -> Box:
        return Box(self.left + by, self.top + by, self.right - by, self.bottom - by)

    def holds(self, points: np.ndarray) -> np.ndarray:
        """Which points, shape (n, 2), lie inside."""
        x, y = points[..., 0], points[..., 1]
        return (self.left <= x) & (x <= self.right) & (self.top <= y) & (y <= self.bottom)


class Letters(NamedTuple):
    """A rendered text: the coverage of each device pixel, the row of the base line, and the width, pixels."""

    cover: np.ndarray
    base: int
    width: float


class Sheet:
    """A drawing surface of a size in pixels, `scale` device pixels per unit of length; colours are matplotlib's."""

    def __init__(self, width: int, height: int, scale: float):
        self._agg = RendererAgg(width, height, 72.0)  # at 72 dpi a point of a font is a pixel
        self._scale = scale
        self._height = height
        self._paper = Box(0.0, 0.0, width / scale, height / scale)
        self._to_device = Affine2D().scale(scale, -scale).translate(0.0, height)
        self._clip: tuple[Bbox | None, TransformedPath | None] = (None, None)
        # Shaping text takes longer than all other drawing, and most of it is the same on the next sheet.
        self._letters = lru_cache(maxsize=1024)(self._written)

    def clear(self) -> None:
        """Paint the surface white."""
        self._agg.clear()
        self._clip = (None, None)
        self.box(self._paper, PAPER)

    def pixels(self) -> np.ndarray:
        """A copy of what is drawn, shape (height, width, 3), uint8."""
        return np.asarray(self._agg.buffer_rgba())[..., :3].copy()

    @contextmanager
    def inside(self, box: Box) -> Generator[None]:
        """Clip drawing to a rectangle."""
        corners = self._to_device.transform([(box.left, box.bottom), (box.right, box.top)])
        before, self._clip = self._clip, (Bbox(corners), None)
        yield
        self._clip = before

    @contextmanager
    def inside_circle(self, middle: Point, radius: float) -> Generator[None]:
        """Clip drawing to a circle."""
        path = Path(_CIRCLE * radius + np.asarray(middle), closed=True)
        before, self._clip = self._clip, (None, TransformedPath(path, self._to_device))
        yield
        self._clip = before

    def line(self, points: Points, colour: Colour, width: float = 1.0, dash: tuple[float, float] | None = None) -> None:
        """Draw a line through points x, y."""
        self._agg.draw_path(self._gc(colour, width, dash=dash), Path(np.asarray(points, dtype=float)), self._to_device)

    def polygon(
        self, points: Points, fill: Colour | None, edge: Colour | None = None, width: float = 1.0, opacity: float = 1.0
    ) -> None:
        """Draw a closed outline, filled or not."""
        points = np.asarray(points, dtype=float)
        path = Path(np.vstack([points, points[:1]]), closed=True)
        self._agg.draw_path(
            self._gc(edge, width if edge else 0.0, opacity),
            path,
            self._to_device,
            None if fill is None else to_rgb(fill),
        )

    def box(
        self, box: Box, fill: Colour | None, edge: Colour | None = None, width: float = 1.0, opacity: float = 1.0
    ) -> None:
        """Draw a rectangle."""
        corners = [(box.left, box.top), (box.right, box.top), (box.right, box.bottom), (box.left, box.bottom)]
        self.polygon(corners, fill, edge, width, opacity)

    def circle(self, middle: Point, radius: float, fill: Colour | None, edge: Colour | None = None, width: float = 1.0):
        """Draw a circle, filled or not."""
        self.polygon(_CIRCLE[:-1] * radius + np.asarray(middle), fill, edge, width)

    def arrow(self, start: Point, end: Point, colour: Colour, width: float = 2.0, head: float = 9.0) -> None:
        """Draw a line with a filled head whose tip is at `end`."""
        tip = np.asarray(end, dtype=float)
        along = tip - np.asarray(start, dtype=float)
        along /= max(float(np.hypot(*along)), 1e-9)
        across = np.array([-along[1], along[0]])
        neck = tip - head * along
        self.line([start, neck + 0.2 * head * along], colour, width)
        self.polygon([tip, neck + 0.42 * head * across, neck - 0.42 * head * across], colour)

    def text(
        self,
        at: Point,
        text: str,
        colour: Colour = INK,
        size: float = 12.0,
        align: str = "left",
        *,
        bold: bool = False,
        veil: str | None = None,
    ) -> float:
        """Write text and return its width; `at` is at half the height of the capitals.

        align: the part of the text at this point: left, centre or right.  veil: background colour behind the letters.
        """
        if not text:
            return 0.0
        x, y = at
        letters = self._letters(text, size, bold)
        before = {"left": 0.0, "centre": 0.5, "right": 1.0}[align] * letters.width
        fall = 0.36 * size  # from the middle of the capitals to the base line
        if veil is not None:
            left = x - before - 3.0
            self.box(Box(left, y - 0.68 * size, left + letters.width + 6.0, y + 0.72 * size), veil, opacity=0.8)
        ink = np.empty((*letters.cover.shape, 4), np.uint8)
        ink[..., :3] = np.multiply(to_rgb(colour), 255.0)
        ink[..., 3] = letters.cover
        left, top = (x - before) * self._scale - _RIM, (y + fall) * self._scale - letters.base
        self._agg.draw_image(self._gc(INK, 1.0), round(left), self._height - round(top) - len(ink), ink[::-1])
        return letters.width

    def text_width(self, text: str, size: float, *, bold: bool = False) -> float:
        """The width of a text when written."""
        return self._letters(text, size, bold).width if text else 0.0

    def fitting(self, text: str, size: float, room: float, *, bold: bool = False) -> str:
        """The text, cut with an ellipsis if it does not fit into the room."""

        def width(text: str) -> float:
            return self.text_width(text, size, bold=bold)

        if width(text) <= room:
            return text
        cut = bisect_right(range(len(text)), room, key=lambda kept: width(text[:kept] + "…")) - 1
        return text[:cut].rstrip() + "…" if cut > 0 else ""

    def _written(self, text: str, size: float, bold: bool) -> Letters:
        font = FontProperties(family="DejaVu Sans", size=size * self._scale, weight="bold" if bold else "normal")
        width, height, descent = self._agg.get_text_width_height_descent(text, font, ismath=False)
        base = ceil(height) + _RIM
        scrap = RendererAgg(ceil(width) + 2 * _RIM, base + ceil(descent) + _RIM, 72.0)
        scrap.draw_text(scrap.new_gc(), _RIM, base, text, font, 0.0)
        return Letters(np.asarray(scrap.buffer_rgba())[..., 3].copy(), base, width / self._scale)

    def _gc(self, colour: Colour | None, width: float, opacity: float = 1.0, dash: tuple[float, float] | None = None):
        gc = self._agg.new_gc()
        gc.set_linewidth(width * self._scale if colour else 0.0)
        gc.set_foreground(colour or INK)
        gc.set_alpha(opacity)
        gc.set_joinstyle("round")
        if dash is not None:
            gc.set_dashes(0.0, [part * self._scale for part in dash])
        gc.set_capstyle("butt" if dash else "round")
        rectangle, path = self._clip
        if rectangle is not None:
            gc.set_clip_rectangle(rectangle)
        if path is not None:
            gc.set_clip_path(path)
        return gc


def mixed(colour: Colour, into: str, share: float) -> tuple[float, float, float]:
    """A share of one colour and the rest of another, as red, green, blue."""
    share = min(max(float(share), 0.0), 1.0)
    r, g, b = (share * a + (1.0 - share) * b for a, b in zip(to_rgb(colour), to_rgb(into)))
    return r, g, b
