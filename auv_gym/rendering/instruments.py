"""The instruments: artificial horizon, heading dial, speed and commands."""

from __future__ import annotations

from math import cos, degrees, hypot, pi, radians, sin

import numpy as np

from auv_gym.channels import channel
from auv_gym.rendering.panel import TITLE, draw_title
from auv_gym.rendering.plan import outline
from auv_gym.rendering.scales import SMALL, number, round_step, shortest
from auv_gym.rendering.scene import Scene, ends
from auv_gym.rendering.sheet import (
    COMMAND,
    DOWN,
    GRID,
    INK,
    LINE,
    PANEL,
    PAPER,
    QUIET,
    TARGET,
    UP,
    VEHICLE,
    Box,
    Colour,
    Sheet,
)

_DIAL = 62.0  # radius, pixels
_PITCH = _DIAL / radians(70.0)  # pixels on the horizon per rad: 70 deg from its centre to its rim
_LADDER = 15  # deg of pitch between the rungs; every second one is long and numbered
_ROW = 46.0  # height of a command, pixels
_BESIDE = 34.0  # pixels; in a lower row the bar is beside the name, not under it


def draw_attitude(sheet: Sheet, scene: Scene, area: Box) -> None:
    """Draw the artificial horizon and the heading dial side by side, with their numbers below."""
    roll, pitch, heading = (float(angle) for angle in scene.attitude)
    wanted = scene.target.heading
    draw_title(sheet, area, "Attitude")
    y, quarter = area.top + TITLE + 18.0 + _DIAL, 0.25 * area.width
    _horizon(sheet, area.left + quarter, y, roll, pitch)
    _dial(sheet, area.right - quarter, y, heading, wanted)
    cells: list[tuple[float, str, str, Colour]] = [
        (0.5, "roll", _turn(roll), INK),
        (1.5, "pitch", _turn(pitch), INK),
        (3.0 if wanted is None else 2.5, "heading", _bearing(heading), INK),
    ]
    if wanted is not None:
        cells.append((3.5, "target", _bearing(wanted), TARGET))
    for place, label, text, colour in cells:
        x, below = area.left + place * quarter, y + _DIAL + 30.0
        sheet.text((x, below), label, QUIET, 12.0, "centre")
        sheet.text((x, below + 18.0), text, colour, 15.0, "centre", bold=True)


def draw_speed(sheet: Sheet, scene: Scene, area: Box) -> None:
    """Draw the speed through the water as a bar on a round scale, with the target's mark."""
    speed, wanted = float(scene.speed), scene.target.speed
    values = [speed] if wanted is None else [speed, wanted]
    high = round_step(max(2.0, 1.1 * max(abs(value) for value in values)))
    low = -high if min(values) < 0.0 else 0.0
    readings: list[tuple[str, str, Colour]] = [("now", f"{number(speed, 2)} m/s", INK)]
    if wanted is not None:
        readings.append(("target", f"{number(wanted, 2)} m/s", TARGET))
    draw_title(sheet, area, "Speed", readings=readings)
    bar = Box(area.left, area.top + TITLE, area.right, area.top + TITLE + 12.0)
    _bar(sheet, bar, speed, low, high, VEHICLE)
    if wanted is not None:
        x = bar.left + (wanted - low) / (high - low) * bar.width
        sheet.line([(x, bar.top - 4.0), (x, bar.bottom + 4.0)], TARGET, 3.0)
    sheet.text((bar.middle[0], bar.bottom + 11.0), "through the water", QUIET, 11.0, "centre")
    sheet.text((bar.left, bar.bottom + 11.0), number(low), QUIET, 11.0)
    sheet.text((bar.right, bar.bottom + 11.0), f"{number(high)} m/s", QUIET, 11.0, "right")


def draw_commands(sheet: Sheet, scene: Scene, area: Box) -> None:
    """Draw a bar for each command between its limits."""
    if not scene.commands:
        return
    draw_title(sheet, area, "Commands")
    row = min(_ROW, (area.height - TITLE) / len(scene.commands))
    for index, (name, (value, limit)) in enumerate(scene.commands.items()):
        top = area.top + TITLE + index * row
        _command(sheet, Box(area.left, top, area.right, top + row), name, float(value), ends(limit))


def _horizon(sheet: Sheet, x: float, y: float, roll: float, pitch: float) -> None:
    """Draw the view ahead: the horizon falls as the nose rises, and rotates against the roll."""
    middle = np.array([x, y])
    across, upward = np.array([cos(roll), -sin(roll)]), np.array([-sin(roll), -cos(roll)])

    def place(side: float, height: float) -> np.ndarray:
        return middle + side * across + height * upward

    with sheet.inside_circle((x, y), _DIAL):
        far, level = 2.0 * _DIAL, -pitch * _PITCH
        sheet.circle((x, y), _DIAL, UP)
        sheet.polygon([place(-far, level), place(far, level), place(far, level - far), place(-far, level - far)], DOWN)
        sheet.line([place(-far, level), place(far, level)], PAPER, 2.5)
        for rung in range(-90, 91, _LADDER):
            height, long = (radians(rung) - pitch) * _PITCH, rung % (2 * _LADDER) == 0
            if rung == 0 or abs(height) > _DIAL - 18.0:
                continue
            half = 16.0 if long else 8.0
            sheet.line([place(-half, height), place(half, height)], INK, 1.0)
            if long and hypot(36.0, height) < _DIAL - 8.0:
                sheet.text(place(-36.0, height), f"{abs(rung)}", INK, 10.0, "centre")
    sheet.circle((x, y), _DIAL, None, LINE, 1.5)
    for mark in (-90, -60, -30, 0, 30, 60, 90):
        way = _direction(radians(mark))
        sheet.line([middle + (_DIAL + 2.0) * way, middle + (_DIAL + (10.0 if mark == 0 else 6.0)) * way], QUIET, 1.5)
    _wedge(sheet, middle + (_DIAL - 2.0) * upward, upward, VEHICLE)
    for side in (-1.0, 1.0):  # the vehicle seen from behind
        sheet.line([(x + 10.0 * side, y), (x + 25.0 * side, y)], VEHICLE, 3.5)
    sheet.circle((x, y), 4.0, VEHICLE, PAPER, 1.0)


def _dial(sheet: Sheet, x: float, y: float, heading: float, wanted: float | None) -> None:
    """Draw the compass from above: the vehicle along its heading, the target as a wedge, the turn to it as an arc."""
    middle = np.array([x, y])
    sheet.circle((x, y), _DIAL, PANEL, LINE, 1.5)
    for mark in range(0, 360, 30):
        way = _direction(radians(mark))
        sheet.line([middle + (_DIAL - 6.0) * way, middle + _DIAL * way], QUIET, 1.5 if mark % 90 == 0 else 1.0)
    for letter, quarter in zip("NESW", range(4)):
        place = middle + (_DIAL + 11.0) * _direction(0.5 * pi * quarter)
        sheet.text(place, letter, INK if letter == "N" else QUIET, 12.0, "centre", bold=letter == "N")
    if wanted is not None:
        error = (wanted - heading + pi) % (2.0 * pi) - pi
        turn = heading + np.linspace(0.0, error, 2 + int(abs(error) / 0.05))
        arc = middle + _DIAL * np.column_stack([np.sin(turn), -np.cos(turn)])
        sheet.line(arc, TARGET, 3.0)
        _wedge(sheet, middle + (_DIAL - 1.0) * _direction(wanted), _direction(wanted), TARGET)
    sheet.polygon(outline((x, y), heading, 1.5 * _DIAL), VEHICLE, PAPER, 1.0)


def _command(sheet: Sheet, row: Box, name: str, value: float, limits: tuple[float, float]) -> None:
    signal = channel(name)
    named = {"rad": ("°", degrees(1.0)), "rad/s": ("°/s", degrees(1.0)), "1": ("", 1.0)} | SMALL
    shown, scale = named.get(signal.unit, (signal.unit, 1.0))
    unit = shown if shown.startswith("°") or not shown else f" {shown}"
    low, high = (scale * limit for limit in limits)
    y, largest = row.top + 11.0, max(abs(low), abs(high))
    scope = f"±{shortest(high)}" if low == -high else f"{shortest(low)} to {shortest(high)}"
    text = number(scale * value, 0 if largest >= 100.0 else 1 if largest >= 10.0 else 2, signed=low < 0.0)
    if row.height < _BESIDE:  # one line: name, bar, value
        y = 0.5 * (row.top + row.bottom)
        label, room = 0.3 * row.width, 0.25 * row.width
        sheet.text((row.right, y), text + unit, INK, 12.0, "right", bold=True)
        sheet.text((row.left, y), sheet.fitting(signal.label, 12.0, label - 8.0), QUIET, 12.0)
        half = min(5.0, 0.5 * row.height - 4.0)
        bar = Box(row.left + label, y - half, row.right - room, y + half)
    else:
        x, scope = row.right, f"of {scope}{unit}"
        needed = sheet.text_width(signal.label, 12.0) + sheet.text_width(text + unit, 12.0, bold=True) + 8.0
        if needed + sheet.text_width(scope, 12.0) + 6.0 <= row.width:  # otherwise the bar alone shows the ends
            x -= sheet.text((x, y), scope, QUIET, 12.0, "right") + 6.0
        x -= sheet.text((x, y), text + unit, INK, 12.0, "right", bold=True) + 8.0
        sheet.text((row.left, y), sheet.fitting(signal.label, 12.0, x - row.left), QUIET, 12.0)
        bar = Box(row.left, row.top + 21.0, row.right, min(row.top + 31.0, row.bottom - 3.0))
    _bar(sheet, bar, scale * value, low, high, COMMAND)
    for end, outward in ((low, -1.0), (high, 1.0)):
        if end != 0.0 and (scale * value - end) * outward >= -1e-6 * largest:
            x = bar.left if end == low else bar.right
            sheet.line([(x, bar.top - 3.0), (x, bar.bottom + 3.0)], INK, 3.0)


def _bar(sheet: Sheet, bar: Box, value: float, low: float, high: float, colour: Colour) -> None:
    """Draw a bar from zero, or the end nearest to it, to the value, cut at the ends."""
    sheet.box(bar, PANEL, GRID)
    zero, end = (bar.left + (min(max(v, low), high) - low) / (high - low) * bar.width for v in (0.0, value))
    if zero != end:
        sheet.box(Box(min(zero, end), bar.top, max(zero, end), bar.bottom), colour)
    if low < 0.0 < high:
        sheet.line([(zero, bar.top - 3.0), (zero, bar.bottom + 3.0)], INK, 1.5)


def _wedge(sheet: Sheet, tip: np.ndarray, way: np.ndarray, colour: Colour) -> None:
    across = np.array([-way[1], way[0]])
    sheet.polygon([tip, tip - 12.0 * way + 6.5 * across, tip - 12.0 * way - 6.5 * across], colour, PAPER, 0.8)


def _direction(bearing: float) -> np.ndarray:
    """A bearing, rad from up and clockwise, as x and y of length 1."""
    return np.array([sin(bearing), -cos(bearing)])


def _turn(angle: float) -> str:
    """An angle within half a turn, in degrees, with its sign."""
    return f"{number(degrees((angle + pi) % (2.0 * pi) - pi), 1, signed=True)}°"


def _bearing(angle: float) -> str:
    """A direction from 0 to 360 deg."""
    return f"{round(degrees(angle) % 360.0, 1) % 360.0:.1f}°"
