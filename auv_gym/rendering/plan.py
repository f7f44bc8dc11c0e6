"""The plan view: north up and east right at equal scale, with track, vehicle, route, target and current."""

from __future__ import annotations

from itertools import pairwise
from math import ceil, cos, hypot, log10, sin
from typing import NamedTuple

import numpy as np

from auv_gym.rendering.panel import draw_axes, draw_title, frame
from auv_gym.rendering.scales import distance_text, round_step, tick_text, ticks
from auv_gym.rendering.scene import Scene, Target
from auv_gym.rendering.sheet import (
    DASHED,
    DOTTED,
    INK,
    LINE,
    MODEL,
    PANEL,
    PAPER,
    QUIET,
    TARGET,
    VEHICLE,
    WATER,
    Box,
    Colour,
    Point,
    Sheet,
    mixed,
)

_LEAST_SPAN = 30.0  # m, least height of the view, so that the first steps do not fill it
_ROUTE_SPAN = 1500.0  # m; a route up to this wide is always in view as a whole
_FAR = 8.0  # times the track's own span; a wider route is left out
_MARGIN = 40.0  # pixels free around the content
_GRAIN = 24.0  # pixels, step in which the view moves; less than the margin
_SCALES = 8  # scales in a decade: the view widens in steps, not with each frame
_SHADES = 24  # number of shades of the track, oldest to newest
_POINTS = 1500  # points of a track beyond which it is thinned
_CROWD = 12  # waypoints beyond which only the active one is numbered
_LENGTH = 40.0  # length of the vehicle, pixels; not to scale
_RAY = 80.0  # length of the target heading, pixels
_TORPEDO = np.array(  # half a plan of a torpedo-shaped hull, nose at (0.5, 0), length 1: hull and stern planes
    [(0.5, 0.0), (0.49, 0.03), (0.46, 0.055), (0.40, 0.075), (0.30, 0.085), (-0.20, 0.085), (-0.28, 0.075),
     (-0.42, 0.22), (-0.5, 0.22), (-0.46, 0.035), (-0.5, 0.03)]
)  # fmt: skip
_SILHOUETTE = np.vstack([_TORPEDO, _TORPEDO[::-1] * (1.0, -1.0)])


class View(NamedTuple):
    """Position of north and east, in metres, on a panel."""

    box: Box
    north: float
    east: float
    metres: float  # a pixel

    def place(self, points: np.ndarray) -> np.ndarray:
        """Pixels x, y of points whose first two columns are north and east."""
        x, y = self.box.middle
        return np.column_stack(
            [x + (points[:, 1] - self.east) / self.metres, y - (points[:, 0] - self.north) / self.metres]
        )


def draw_plan(sheet: Sheet, scene: Scene, area: Box) -> None:
    """Draw the plan view with its legend and axes into an area."""
    view = _view(scene, frame(area))
    box, target = view.box, scene.target
    _legend(sheet, scene, area)
    _axes(sheet, view)
    track = view.place(scene.trail[kept(len(scene.trail))])
    marks = []  # points that the current's arrow may not cover
    with sheet.inside(box):
        if target.waypoints is not None and len(target.waypoints):
            begin = np.empty((0, 3)) if target.start is None else np.reshape(target.start, (1, 3))
            marks.append(_route(sheet, target, view.place(target.waypoints), view.place(begin), view.metres))
        if scene.model_trail is not None and len(scene.model_trail):
            other = view.place(scene.model_trail[kept(len(scene.model_trail))])
            sheet.line(other, MODEL, 2.0, DASHED)
            sheet.circle(other[-1], 4.5, PAPER, MODEL, 2.0)
        _track(sheet, track)
        if len(track):
            vehicle = track[-1]
            if target.heading is not None:
                marks.append(_ray(sheet, vehicle, target.heading))
            sheet.polygon(outline(vehicle, scene.attitude[2], _LENGTH), VEHICLE, PAPER, 1.2)
            marks.extend([vehicle[None], _pointer(sheet, scene, view, vehicle)])
    if scene.current is not None:
        _current(sheet, scene.current, box, np.vstack([*marks, np.empty((0, 2))]), track)
    sheet.box(box, None, LINE)


def outline(middle: Point, heading: float, length: float) -> np.ndarray:
    """The outline of a vehicle from above in pixels, its nose along the heading, rad."""
    x, y = middle
    forward, starboard = length * _SILHOUETTE[:, 0], length * _SILHOUETTE[:, 1]
    return np.column_stack(
        [
            x + forward * sin(heading) + starboard * cos(heading),
            y - forward * cos(heading) + starboard * sin(heading),
        ]
    )


def kept(count: int) -> np.ndarray:
    """Indices of at most some 1500 points of a line, including the last; a growing line changes them rarely."""
    stride = 1
    while count > _POINTS * stride:
        stride *= 2
    indices = np.arange(0, count, stride)
    return indices if (count - 1) % stride == 0 else np.append(indices, count - 1)


def _view(scene: Scene, box: Box) -> View:
    """The narrowest view of the stepped scales that includes the tracks, and the route unless it is far away."""
    lines = [scene.trail] if len(scene.trail) else [np.zeros((1, 3))]
    if scene.model_trail is not None:
        lines.append(scene.model_trail)
    shown = np.vstack(lines)[:, :2]
    target = scene.target
    if target.waypoints is not None and len(target.waypoints):
        reach = target.radius or 0.0
        own = max(np.ptp(shown[:, 0]), np.ptp(shown[:, 1]), _LEAST_SPAN)  # by columns: ptp over axis 0 is slow
        wider = np.vstack([shown, target.waypoints[:, :2] - reach, target.waypoints[:, :2] + reach])
        if max(np.ptp(wider[:, 0]), np.ptp(wider[:, 1])) <= max(_ROUTE_SPAN, _FAR * own):
            shown = wider
    view = _around(shown, box)
    if target.heading is None or not len(scene.trail):
        return view
    tip = scene.trail[-1, :2] + _RAY * view.metres * np.array([cos(target.heading), sin(target.heading)])
    return _around(np.vstack([shown, tip]), box)


def _around(points: np.ndarray, box: Box) -> View:
    low = np.array([column.min() for column in points.T])
    high = np.array([column.max() for column in points.T])
    room = box.shrunk(_MARGIN)
    least = max((high[0] - low[0]) / room.height, (high[1] - low[1]) / room.width, _LEAST_SPAN / box.height)
    metres = 10.0 ** (ceil(_SCALES * log10(least) - 1e-9) / _SCALES)
    grain = _GRAIN * metres
    north, east = (grain * round(float(middle) / grain) for middle in 0.5 * (low + high))
    return View(box, north, east, metres)


def _axes(sheet: Sheet, view: View) -> None:
    box, metres = view.box, view.metres
    step = round_step(62.0 * metres)
    half_north, half_east = 0.5 * box.height * metres, 0.5 * box.width * metres
    norths = ticks(view.north - half_north, view.north + half_north, step)
    easts = ticks(view.east - half_east, view.east + half_east, step)
    x, y = box.middle
    draw_axes(
        sheet,
        box,
        [(x + (value - view.east) / metres, tick_text(value, step)) for value in easts],
        [(y - (value - view.north) / metres, tick_text(value, step)) for value in norths],
        "east, m",
    )


def _legend(sheet: Sheet, scene: Scene, area: Box) -> None:
    draw_title(sheet, area, "Plan", "north, m")
    entries: list[tuple[str, Colour, tuple[float, float] | None]] = []
    if scene.model_trail is not None:
        entries += [(scene.labels[0], VEHICLE, None), (scene.labels[1], MODEL, DASHED)]
    if scene.target.heading is not None:
        entries.append(("target heading", TARGET, DASHED))
    if scene.target.waypoints is not None:
        entries.append(("route", TARGET, DOTTED))
    x, y = area.right, area.top + 12.0
    for label, colour, dash in reversed(entries):
        x -= sheet.text((x, y), sheet.fitting(label, 12.0, 118.0), QUIET, 12.0, "right") + 7.0
        sheet.line([(x - 24.0, y), (x, y)], colour, 2.0, dash)
        x -= 24.0 + 16.0


def _track(sheet: Sheet, track: np.ndarray) -> None:
    if len(track) < 2:
        return
    cuts = np.unique(np.linspace(0, len(track) - 1, _SHADES + 1).astype(int))
    for start, end in pairwise(cuts):
        sheet.line(track[start : end + 1], mixed(VEHICLE, PANEL, 0.22 + 0.78 * end / cuts[-1]), 2.2)
    if hypot(*(track[0] - track[-1])) > 0.5 * _LENGTH:
        sheet.circle(track[0], 4.0, PAPER, VEHICLE, 1.5)


def _ray(sheet: Sheet, vehicle: np.ndarray, heading: float) -> np.ndarray:
    """Draw the target heading; return its tip, shape (1, 2)."""
    along, across = np.array([sin(heading), -cos(heading)]), np.array([cos(heading), sin(heading)])
    tip = vehicle + _RAY * along
    sheet.line([vehicle, tip - 9.0 * along], TARGET, 2.0, DASHED)
    sheet.polygon([tip, tip - 11.0 * along + 5.0 * across, tip - 11.0 * along - 5.0 * across], TARGET)
    return tip[None]


def _route(sheet: Sheet, target: Target, places: np.ndarray, begin: np.ndarray, metres: float) -> np.ndarray:
    """Draw the waypoints at their pixels, shape (k, 2), and the legs to them; return the pixels.

    begin: pixels of the route's start, shape (0 or 1, 2).
    """
    pale = mixed(TARGET, PANEL, 0.5)
    sheet.line(np.vstack([begin, places]), pale, 1.6, DOTTED)
    ring = 9.0 if target.radius is None else max(target.radius / metres, 9.0)
    for index, (x, y) in enumerate(places):
        if index == target.active:
            sheet.circle((x, y), ring, None, TARGET, 1.5)
            sheet.circle((x, y), 5.5, TARGET, PAPER, 1.2)
            sheet.text(
                (x + 0.75 * ring + 5.0, y - 0.75 * ring - 6.0), f"{index + 1}", TARGET, 13.0, bold=True, veil=PANEL
            )
        else:
            sheet.circle((x, y), 4.0, pale if index < target.active else PAPER, pale, 1.5)
            if len(places) <= _CROWD:
                sheet.text((x + 9.0, y - 10.0), f"{index + 1}", QUIET, 11.0, veil=PANEL)
    return places


def _pointer(sheet: Sheet, scene: Scene, view: View, vehicle: np.ndarray) -> np.ndarray:
    """Draw an arrow at the edge towards an active waypoint outside the view; return its tip, shape (0 or 1, 2)."""
    waypoint = scene.target.next_waypoint
    if waypoint is None or view.box.holds(place := view.place(waypoint[None])[0]):
        return np.empty((0, 2))
    edge = view.box.shrunk(8.0)
    way = place - vehicle
    corner = np.where(way > 0.0, (edge.right, edge.bottom), (edge.left, edge.top))
    share = min(gap / part for gap, part in zip(corner - vehicle, way) if part != 0.0)
    tip, along = vehicle + share * way, way / hypot(*way)
    sheet.arrow(tip - 26.0 * along, tip, TARGET, 2.5, 12.0)
    text = f"{scene.target.active + 1}: {distance_text(hypot(*(waypoint[:2] - scene.trail[-1, :2])))}"
    half = 0.5 * sheet.text_width(text, 12.0, bold=True)
    x, y = tip - (34.0 + half * abs(along[0])) * along
    x, y = min(max(x, edge.left + half), edge.right - half), min(max(y, edge.top + 8.0), edge.bottom - 8.0)
    sheet.text((x, y), text, TARGET, 12.0, "centre", bold=True, veil=PANEL)
    return tip[None]


def _current(sheet: Sheet, current: tuple[float, float], box: Box, marks: np.ndarray, track: np.ndarray) -> None:
    """Draw an arrow along the flow with its speed, in the corner where it covers least."""
    north, east = (float(part) for part in current)
    speed, width, height = hypot(north, east), 124.0, 50.0
    left, right = box.left + 8.0, box.right - 8.0 - width
    top, bottom = box.top + 8.0, box.bottom - 8.0 - height
    corners = [
        Box(x, y, x + width, y + height) for x, y in ((right, top), (left, top), (right, bottom), (left, bottom))
    ]
    near = [corner.shrunk(-16.0) for corner in corners]
    covered = [(int(corner.holds(marks).sum()), int(corner.holds(track).sum())) for corner in near]
    badge = corners[covered.index(min(covered))]
    sheet.box(badge, PAPER, LINE, opacity=0.9)
    x, y = badge.left + 27.0, badge.middle[1]
    if speed > 0.0:
        way = np.array([east, -north]) / speed
        sheet.arrow((x, y) - 18.0 * way, (x, y) + 18.0 * way, WATER, 3.0, 13.0)
    else:
        sheet.circle((x, y), 4.0, None, WATER, 2.0)
    sheet.text((badge.left + 54.0, y - 9.0), "current", QUIET, 11.0)
    sheet.text((badge.left + 54.0, y + 9.0), f"{speed:.2f} m/s", INK, 12.0, bold=True)
