"""The picture of a float's dive: depth over time beside the water column, with its speed and engine below."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auv_gym.channels import channel
from auv_gym.rendering.depth import Strip, depth_axis, time_axis
from auv_gym.rendering.panel import draw_title, frame
from auv_gym.rendering.plan import kept
from auv_gym.rendering.scales import SMALL, number, outward, round_step
from auv_gym.rendering.sheet import (
    COMMAND,
    DASHED,
    DOWN,
    INK,
    LINE,
    PAPER,
    TARGET,
    UP,
    VEHICLE,
    Box,
    Colour,
    Sheet,
    mixed,
)

_COLUMN, _BELOW, _GAP = 250.0, 178.0, 22.0  # width of the water column, height of the lower panels, pixels
_BODY, _GIRTH = 46.0, 13.0  # length and half-width of the float, pixels
_ARROW = 34.0  # length of the arrow at the fastest speed so far, pixels
_BANDS = 16  # number of shades of the water
_LEAST_SPEED = 0.05  # m/s, least range of the axis
_COMMANDED = mixed(COMMAND, PAPER, 0.5)


@dataclass(frozen=True, eq=False)
class Dive:
    """One moment of a dive and its history; raises ValueError if it cannot be drawn.

    time, depth, rate, target: s, m, m/s down, m; oldest first, shape (n,), n of 1 or more.  command, position: of the
    engine, in its channel's unit, (n,); limits: the ends of its range.  title, caption: left and right of the head
    line.
    """

    time: np.ndarray
    depth: np.ndarray
    rate: np.ndarray
    target: np.ndarray
    command: np.ndarray
    position: np.ndarray
    engine: str
    limits: tuple[float, float]
    title: str = ""
    caption: str = ""

    def __post_init__(self):
        for name in ("time", "depth", "rate", "target", "command", "position"):
            values = np.asarray(getattr(self, name), dtype=float)
            if values.shape != np.shape(self.time) or values.ndim != 1 or not values.size:
                raise ValueError(f"A dive's {name} needs as many numbers as its time, got shape {values.shape}.")
            if not np.isfinite(values).all():
                raise ValueError(f"A dive's {name} needs finite numbers, got {values[~np.isfinite(values)][0]}.")
            object.__setattr__(self, name, values)
        if (np.diff(self.time) < 0.0).any():
            raise ValueError("A dive's time needs numbers that do not fall.")
        channel(self.engine)
        if not self.limits[0] < self.limits[1]:
            raise ValueError(f"A dive's limits need to differ, the smaller first, got {self.limits!r}.")


def draw_dive(sheet: Sheet, dive: Dive, area: Box) -> None:
    """Draw all panels of a dive into an area."""
    below = area.bottom - _BELOW
    split = area.right - _COLUMN
    left = frame(Box(area.left, area.top, split - _GAP, below - 10.0))
    strip = Strip(left, *time_axis(dive.time), *depth_axis(np.append(dive.depth, dive.target)))
    _depth(sheet, dive, strip, Box(area.left, area.top, split - _GAP, below - 10.0))
    _column(sheet, dive, strip, Box(split, area.top, area.right, below - 10.0))
    middle = area.left + 0.5 * area.width
    _speed(sheet, dive, strip, Box(area.left, below, middle - 0.5 * _GAP, area.bottom))
    _engine(sheet, dive, strip, Box(middle + 0.5 * _GAP, below, area.right, area.bottom))


def _depth(sheet: Sheet, dive: Dive, strip: Strip, area: Box) -> None:
    box = strip.box
    draw_title(
        sheet,
        area,
        "Depth",
        "m",
        [("now", f"{number(dive.depth[-1], 1)} m", INK), ("target", f"{number(dive.target[-1], 1)} m", TARGET)],
    )
    strip.draw_axes(sheet)
    with sheet.inside(box):
        strip.draw_surface(sheet, box)
        sheet.line(strip.place(*_steps(dive.time, dive.target)), TARGET, 1.8, DASHED)
        shown = kept(dive.time.size)
        sheet.line(strip.place(dive.time[shown], dive.depth[shown]), VEHICLE, 2.2)
    sheet.box(box, None, LINE)
    sheet.circle(strip.place(dive.time[-1:], dive.depth[-1:])[0], 4.5, VEHICLE, PAPER, 1.2)


def _column(sheet: Sheet, dive: Dive, strip: Strip, area: Box) -> None:
    """Draw the water from the surface down, with the float at the same height as its depth in the strip."""
    box = Box(area.left, strip.box.top, area.right, strip.box.bottom)
    surface = min(max(strip.y(0.0), box.top), box.bottom)
    draw_title(sheet, area, "Water column", "", [("off by", _signed(dive.depth[-1] - dive.target[-1], 2, "m"), INK)])
    sheet.box(box, PAPER)
    for band in range(_BANDS):
        top, bottom = (surface + (box.bottom - surface) * (band + k) / _BANDS for k in (0, 1))
        sheet.box(Box(box.left, top, box.right, bottom), mixed(DOWN, UP, 0.75 * band / _BANDS))
    target, depth = strip.y(dive.target[-1]), strip.y(dive.depth[-1])
    x = box.left + 0.42 * box.width
    with sheet.inside(box):
        strip.draw_surface(sheet, box)
        sheet.line([(box.left, target), (box.right, target)], TARGET, 1.8, DASHED)
        _float(sheet, (x, depth), _share(dive))
        speed = dive.rate[-1] / max(float(np.abs(dive.rate).max()), _LEAST_SPEED)
        side = x - 2.6 * _GIRTH
        if abs(speed) > 0.05:
            tip = depth + _ARROW * speed + (8.0 if speed > 0.0 else -8.0)
            sheet.arrow((side, depth - 0.3 * _ARROW * speed), (side, tip), INK, 2.2, 9.0)
    room = box.right - 8.0
    apart = max(18.0 - abs(depth - target), 0.0) * (1.0 if depth >= target else -1.0)  # two labels never overlap
    inner = Box(box.left, box.top + 12.0, box.right, box.bottom - 12.0)
    for y, text, colour in (
        (target - 0.5 * apart - (9.0 if apart == 0.0 else 0.0), f"target {number(dive.target[-1], 1)} m", TARGET),
        (depth + 0.5 * apart, f"{number(dive.depth[-1], 1)} m", VEHICLE),
    ):
        y = min(max(y, inner.top), inner.bottom)
        sheet.text((room, y), text, colour, 12.0, "right", bold=True, veil=PAPER)
    sheet.box(box, None, LINE)


def _speed(sheet: Sheet, dive: Dive, strip: Strip, area: Box) -> None:
    most = max(float(np.abs(dive.rate).max()), _LEAST_SPEED)
    step = round_step(most / 2.0)
    panel = _panel(area, strip, -most, most, step)
    draw_title(sheet, area, "Speed", "m/s, down", [("now", _signed(dive.rate[-1], 3, "m/s"), INK)])
    _curves(sheet, panel, dive, [(dive.time, dive.rate, VEHICLE, 2.0)], zero=True)


def _engine(sheet: Sheet, dive: Dive, strip: Strip, area: Box) -> None:
    signal = channel(dive.engine)
    unit, scale = SMALL.get(signal.unit, (signal.unit, 1.0))
    low, high = (scale * limit for limit in dive.limits)
    panel = _panel(area, strip, low, high, round_step((high - low) / 4.0))
    command, position = scale * dive.command, scale * dive.position
    decimals = 0 if high - low >= 200.0 else 1
    title = {"piston_m": "Piston", "oil_volume_m3": "Oil"}.get(dive.engine, signal.label)
    readings = [
        ("at", f"{number(position[-1], decimals)} {unit}", COMMAND),
        ("command", f"{number(command[-1], decimals)} {unit}", _COMMANDED),
    ]
    draw_title(sheet, area, title, f"{unit}, more lifts", readings)
    lines: list[tuple[np.ndarray, np.ndarray, Colour, float]]
    lines = [(*_steps(dive.time, command), _COMMANDED, 1.2), (dive.time, position, COMMAND, 2.0)]
    _curves(sheet, panel, dive, lines, zero=low < 0.0 < high)


def _panel(area: Box, strip: Strip, low: float, high: float, step: float) -> Strip:
    """A panel with the time axis of a strip and a value axis of its own, positive up."""
    low, high = outward(low, high, step)
    return Strip(frame(area), strip.first, strip.last, strip.pace, strip.seconds, high, low, step)


def _curves(
    sheet: Sheet,
    panel: Strip,
    dive: Dive,
    lines: list[tuple[np.ndarray, np.ndarray, Colour, float]],
    *,
    zero: bool,
) -> None:
    panel.draw_axes(sheet)
    box = panel.box
    with sheet.inside(box):
        if zero:
            sheet.line([(box.left, panel.y(0.0)), (box.right, panel.y(0.0))], LINE, 1.4)
        for times, values, colour, width in lines:
            shown = kept(times.size)
            sheet.line(panel.place(times[shown], values[shown]), colour, width)
    sheet.box(box, None, LINE)
    _, values, colour, _ = lines[-1]
    sheet.circle(panel.place(dive.time[-1:], values[-1:])[0], 3.8, colour, PAPER, 1.0)


def _float(sheet: Sheet, middle: tuple[float, float], share: float) -> None:
    """Draw an upright float with its mast up; the part of its engine outside the hull is drawn below."""
    x, y = middle
    top, bottom = y - 0.5 * _BODY, y + 0.5 * _BODY
    turn = np.linspace(0.0, np.pi, 19)
    cap = np.column_stack([_GIRTH * np.cos(turn), -_GIRTH * np.sin(turn)])
    hull = np.vstack([cap + (x, top + _GIRTH), -cap + (x, bottom - _GIRTH)])
    rod = 4.0 + 13.0 * share
    sheet.line([(x, top), (x, top - 16.0)], INK, 2.0)
    sheet.box(Box(x - 0.5 * _GIRTH, bottom - 6.0, x + 0.5 * _GIRTH, bottom + rod), COMMAND, PAPER, 1.0)
    sheet.polygon(hull, VEHICLE, PAPER, 1.2)
    sheet.box(Box(x - _GIRTH, y - 4.0, x + _GIRTH, y + 4.0), mixed(VEHICLE, PAPER, 0.55))


def _share(dive: Dive) -> float:
    """Share of the engine's range that is outside the hull, from 0 to 1."""
    low, high = dive.limits
    return min(max((float(dive.position[-1]) - low) / (high - low), 0.0), 1.0)


def _steps(times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a line that holds each value until the next one."""
    changes = np.flatnonzero(np.diff(values)) + 1
    begins = np.concatenate([[0], changes])
    ends = np.append(times[changes], times[-1])
    return np.column_stack([times[begins], ends]).ravel(), np.repeat(values[begins], 2)


def _signed(value: float, decimals: int, unit: str) -> str:
    return f"{number(float(value), decimals, signed=True)} {unit}"
