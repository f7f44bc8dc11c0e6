"""Rendering of a scene: the layout of the panels, and several pictures side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auv_gym.rendering.depth import draw_depth
from auv_gym.rendering.dive import Dive, draw_dive
from auv_gym.rendering.instruments import draw_attitude, draw_commands, draw_speed
from auv_gym.rendering.plan import draw_plan
from auv_gym.rendering.scene import Scene
from auv_gym.rendering.sheet import GRID, INK, QUIET, Box, Sheet

SIZE = (960, 600)  # width and height in pixels for which the layout is designed
_LEAST = (320, 200)
_SMALLEST = 12.0  # letters of a long title, pixels
_EDGE, _SIDE, _HEAD, _STRIP = 18.0, 330.0, 46.0, 172.0  # outer margin, right column, head line, depth strip


class Renderer:
    """Draws scenes at one size, reusing its drawing surface; a scene gives the same picture every time."""

    def __init__(self, size: tuple[int, int] = SIZE):
        width, height = (int(pixels) for pixels in size)
        if width < _LEAST[0] or height < _LEAST[1]:
            raise ValueError(f"A picture needs at least {_LEAST[0]} x {_LEAST[1]} pixels, got {width} x {height}.")
        self.size = (width, height)
        scale = min(width / SIZE[0], height / SIZE[1])
        self._room = Box(0.0, 0.0, width / scale, height / scale)
        self._sheet: Sheet | None = Sheet(width, height, scale)

    def draw(self, scene: Scene | Dive) -> np.ndarray:
        """The picture, shape (height, width, 3), uint8."""
        sheet, room = self._sheet, self._room
        if sheet is None:
            raise ValueError("This renderer is closed: make a new one.")
        sheet.clear()
        _headline(sheet, scene, Box(_EDGE, 0.0, room.right - _EDGE, _HEAD))
        if isinstance(scene, Dive):
            draw_dive(sheet, scene, Box(_EDGE, _HEAD + 4.0, room.right - _EDGE, room.bottom - _EDGE + 10.0))
            return sheet.pixels()
        split = room.right - _EDGE - _SIDE
        bottom = room.bottom - _EDGE + 10.0
        strip = bottom if scene.level else bottom - _STRIP
        draw_plan(sheet, scene, Box(_EDGE, _HEAD + 4.0, split - 26.0, strip - 6.0))
        if not scene.level:
            draw_depth(sheet, scene, Box(_EDGE, strip, split - 26.0, bottom))
        draw_attitude(sheet, scene, Box(split, _HEAD + 4.0, room.right - _EDGE, 276.0))
        draw_speed(sheet, scene, Box(split, 288.0, room.right - _EDGE, 346.0))
        draw_commands(sheet, scene, Box(split, 362.0, room.right - _EDGE, room.bottom - _EDGE))
        return sheet.pixels()

    def close(self) -> None:
        """Free the drawing surface; drawing raises after this."""
        self._sheet = None


def draw(scene: Scene | Dive, size: tuple[int, int] = SIZE) -> np.ndarray:
    """The picture of one scene, shape (height, width, 3), uint8; for many of them a Renderer is faster."""
    return Renderer(size).draw(scene)


def film_strip(frames: Sequence[np.ndarray], columns: int) -> np.ndarray:
    """Pictures of one size in rows of `columns`, shape (h, w, 3), uint8, with white gaps and empty places."""
    if not len(frames) or columns < 1 or len({frame.shape for frame in frames}) > 1:
        shapes = sorted({frame.shape for frame in frames})
        raise ValueError(f"A film strip needs frames of one shape and a column or more, got {shapes} in {columns}.")
    height, width, _ = frames[0].shape
    gap, columns = max(width // 96, 2), min(columns, len(frames))
    rows = -(-len(frames) // columns)
    strip = np.full((rows * (height + gap) - gap, columns * (width + gap) - gap, 3), 255, np.uint8)
    for index, frame in enumerate(frames):
        row, column = divmod(index, columns)
        top, left = row * (height + gap), column * (width + gap)
        strip[top : top + height, left : left + width] = frame
    return strip


def _headline(sheet: Sheet, scene: Scene | Dive, area: Box) -> None:
    y = 0.5 * area.height + 2.0
    caption = sheet.fitting(scene.caption, 13.0, 0.4 * area.width)
    room = area.width - sheet.text((area.right, y), caption, QUIET, 13.0, "right") - 24.0
    size = 17.0 * min(room / max(sheet.text_width(scene.title, 17.0, bold=True), 1.0), 1.0)
    size = max(size, _SMALLEST)
    sheet.text((area.left, y), sheet.fitting(scene.title, size, room, bold=True), INK, size, bold=True)
    sheet.line([(area.left, area.bottom - 2.0), (area.right, area.bottom - 2.0)], GRID)
