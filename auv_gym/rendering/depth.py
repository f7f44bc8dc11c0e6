"""The depth strip: depth over time, positive down, with the target depth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from auv_gym.rendering.panel import draw_axes, draw_title, frame
from auv_gym.rendering.plan import kept
from auv_gym.rendering.scales import distance_text, number, outward, round_step, tick_text, ticks
from auv_gym.rendering.scene import Scene
from auv_gym.rendering.sheet import DASHED, INK, LINE, MODEL, PANEL, PAPER, TARGET, VEHICLE, WATER, Box, Sheet

_LEAST_SPAN = 2.0  # m of depth
_LEAST_TIME = 10.0  # s
_NEAR = 50.0  # m; a target no further from the track is always in view
_FAR = 8.0  # times the track's own span; a target further away is left out
_AIR = 0.05  # share of the strip's height above the surface
_MINUTES = 1200.0  # s; a longer strip counts in minutes


class Strip(NamedTuple):
    """Position of times and depths on a panel, with the steps of the ticks; seconds: length of the unit of time."""

    box: Box
    first: float
    last: float
    pace: float
    seconds: float
    top: float
    bottom: float
    step: float

    def place(self, times: np.ndarray, depths: np.ndarray) -> np.ndarray:
        """Pixels x, y, shape (n, 2)."""
        x = self.box.left + (times - self.first) / (self.last - self.first) * self.box.width
        return np.column_stack([x, self.y(depths)])

    def y(self, depth):
        """Pixels from the top of the panel."""
        return self.box.top + (depth - self.top) / (self.bottom - self.top) * self.box.height

    def draw_axes(self, sheet: Sheet) -> None:
        """Draw the panel's background, its grid and the numbers beside it."""
        times = ticks(self.first, self.last, self.pace)
        depths = ticks(min(self.top, self.bottom), max(self.top, self.bottom), self.step)
        names = [tick_text(time / self.seconds, self.pace / self.seconds) for time in times]
        across = list(zip(self.place(times, times)[:, 0], names))
        down = [(self.y(depth), tick_text(depth, self.step)) for depth in depths]
        draw_axes(sheet, self.box, across, down, "time, s" if self.seconds == 1.0 else "time, min")

    def draw_surface(self, sheet: Sheet, box: Box) -> None:
        """Draw the air and the water surface across a box as high as the panel, if they are in view."""
        if self.top < 0.0:
            surface = self.y(0.0)
            sheet.box(Box(box.left, box.top, box.right, surface), PAPER)
            sheet.line([(box.left, surface), (box.right, surface)], WATER, 2.0)


def draw_depth(sheet: Sheet, scene: Scene, area: Box) -> None:
    """Draw the depth strip with its axes into an area."""
    strip = Strip(frame(area), *time_axis(scene.time), *_depths(scene))
    box, wanted = strip.box, scene.target.next_depth
    readings = [("now", f"{number(float(scene.trail[-1, 2]), 1)} m", INK)] if len(scene.trail) else []
    if wanted is not None:
        readings.append(("target", f"{number(wanted, 1)} m", TARGET))
    draw_title(sheet, area, "Depth", "m", readings)
    strip.draw_axes(sheet)
    with sheet.inside(box):
        _lines(sheet, scene, strip)
    if wanted is not None and not strip.top <= wanted <= strip.bottom:
        _pointer(sheet, wanted, box, below=wanted > strip.bottom)
    sheet.box(box, None, LINE)
    if len(scene.trail):
        x, y = strip.place(scene.time[-1:], scene.trail[-1:, 2])[0]
        sheet.circle((x, y), 4.5, VEHICLE, PAPER, 1.2)


def _lines(sheet: Sheet, scene: Scene, strip: Strip) -> None:
    box, wanted = strip.box, scene.target.next_depth
    strip.draw_surface(sheet, box)
    if wanted is not None:
        sheet.line([(box.left, strip.y(wanted)), (box.right, strip.y(wanted))], TARGET, 1.8, DASHED)
    for trail, colour, width, dash in ((scene.model_trail, MODEL, 2.0, DASHED), (scene.trail, VEHICLE, 2.2, None)):
        if trail is not None and len(trail):
            shown = kept(len(trail))
            sheet.line(strip.place(scene.time[shown], trail[shown, 2]), colour, width, dash)


def time_axis(time: np.ndarray) -> tuple[float, float, float, float]:
    """First and last time of a strip, the step of its ticks, and its unit of time in s."""
    start, end = (float(time[0]), float(time[-1])) if len(time) else (0.0, 0.0)
    seconds = 60.0 if end - start > _MINUTES else 1.0
    end = max(end, start + _LEAST_TIME)
    pace = seconds * round_step((end - start) / seconds / 6.0)
    return *outward(start, end, pace), pace, seconds


def _depths(scene: Scene) -> tuple[float, float, float]:
    """The depth axis that includes the tracks, and the target unless it is far away."""
    wanted = scene.target.next_depth
    shown = np.concatenate([trail[:, 2] for trail in (scene.trail, scene.model_trail) if trail is not None])
    low, high = (float(shown.min()), float(shown.max())) if len(shown) else (0.0, 0.0)
    if wanted is not None and max(wanted - high, low - wanted) <= max(_FAR * (high - low), _NEAR):
        shown = np.append(shown, wanted)
    return depth_axis(shown)


def depth_axis(shown: np.ndarray) -> tuple[float, float, float]:
    """The upper and the lower end of a strip that includes some depths, and the step of its ticks, m."""
    low, high = (float(shown.min()), float(shown.max())) if len(shown) else (0.0, 0.0)
    spare = max(0.5 * (_LEAST_SPAN - (high - low)), 0.05 * (high - low))
    if 0.0 <= low <= 1.5 * (high - low) + _LEAST_SPAN:
        low, high = 0.0, max(high + spare, _LEAST_SPAN)
    else:
        low, high = low - spare, high + spare
    step = round_step((high - low) / 4.0)
    top, bottom = outward(low, high, step)
    return top - (_AIR * (bottom - top) if top == 0.0 else 0.0), bottom, step


def _pointer(sheet: Sheet, wanted: float, box: Box, *, below: bool) -> None:
    """Draw an arrow at the upper or lower edge towards a target outside the strip."""
    x, edge, way = box.left + 18.0, box.bottom if below else box.top, 1.0 if below else -1.0
    text = f"target {distance_text(wanted)}"
    width = sheet.text_width(text, 12.0, bold=True)
    sheet.box(
        Box(x - 10.0, edge - 12.0 - 14.0, x + 20.0 + width, edge)
        if below
        else Box(x - 10.0, edge, x + 20.0 + width, edge + 26.0),
        PANEL,
        opacity=0.8,
    )
    sheet.arrow((x, edge - 24.0 * way), (x, edge - 4.0 * way), TARGET, 2.5, 11.0)
    sheet.text((x + 14.0, edge - 14.0 * way), text, TARGET, 12.0, bold=True)
