"""The depth-averaged current of a dive, from the GPS fixes before and after it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import cos, radians, sin, sqrt
from typing import NamedTuple

import numpy as np

from auv_gym.model import outputs_of
from auv_gym.plant.plant import Plant
from auv_gym.records.log import FIXES
from auv_gym.records.record import Record

_EQUATOR, _FLATTENING = 6378137.0, 1.0 / 298.257223563  # m and 1, of the ellipsoid of WGS 84
_PLACE = ("north_m", "east_m")
_ENDS = 10  # samples at either end of a dive from whose depth rate the time to or from the surface is estimated
_FIX = (
    5.0  # m, standard error of a fix to the north and to the east: 12 m hold 95 %; the GPS standard of 2020 has 8 to 15
)
_DRIFT = 0.15  # m/s, standard error of the drift at the surface: 2 % of a wind of 7 m/s; assumed
_COMPASS = radians(2.0)  # standard error of a calibrated compass's heading over a dive; assumed
_REACH = 1.96  # standard errors in half a 95 % interval


class DiveCurrent(NamedTuple):
    """A depth-averaged current, m/s, over one dive: its label, and the fixes' times, s since the record's start.

    north_error, east_error: standard errors, m/s.
    """

    dive: str
    north: float
    east: float
    start: float
    stop: float
    north_error: float
    east_error: float

    @property
    def words(self) -> str:
        """The current with its name and 95 % intervals, in words."""
        north, east = (
            f"{value:.3f} ± {_REACH * error:.3f}"
            for value, error in ((self.north, self.north_error), (self.east, self.east_error))
        )
        return f"{self.dive + ': ' if self.dive else ''}{north} and {east} m/s"


class _Leg(NamedTuple):
    """A dive between two fixes: its label, the fixes' times, and its displacement over ground and through water, m.

    afloat: s, between the fixes and the dive.
    """

    dive: str
    start: float
    stop: float
    ground: np.ndarray
    water: np.ndarray
    afloat: float


def dive_currents(plant: Plant, record: Record, spread: Sequence[Plant] = ()) -> tuple[DiveCurrent, ...]:
    """The current of each dive of a record that lies between two GPS fixes, from the difference in displacement.

    record: samples that the vehicle's family describes.  The displacement through the water is computed by the plant
    from sample to sample, at the measured depth and heading.  It is interpolated over gaps, and extrapolated from the
    first and last samples to the surface.  Each dive gives one displacement and thus one current.
    spread: the plant moved by one standard error in each independent direction of the fit.  The standard errors include
    these, the fixes, the compass, and a drift at the surface that differs from the dive's current.
    """
    legs, found = _legs(plant, record), []
    moved = [_legs(other, record) for other in spread]
    for k, leg in enumerate(legs):
        current = (leg.ground - leg.water) / (leg.stop - leg.start)
        turned = _COMPASS * leg.water[::-1]
        squares = 2.0 * _FIX**2 + (_DRIFT * leg.afloat) ** 2 + turned**2
        squares += sum((other[k].water - leg.water) ** 2 for other in moved)
        errors = np.sqrt(squares) / (leg.stop - leg.start)
        (north, east), (north_error, east_error) = current.tolist(), errors.tolist()
        found.append(DiveCurrent(leg.dive, north, east, leg.start, leg.stop, north_error, east_error))
    return tuple(found)


def no_currents(plant: Plant, record: Record) -> str:
    """Why the current of no dive can be computed, for a vehicle whose heading is an input; '' if nothing is missing.

    It is '' also for a record with a track under water, in which a current is an effect like others.
    """
    if "heading_rad" not in plant.inputs or any(record.has(name) for name in _PLACE):
        return ""
    if not len(record.attrs.get(FIXES, ())):
        missing = "GPS fixes from before and after its dives (only those in a Seaglider's file are read)"
    elif not record.has("heading_rad"):
        missing = "heading (heading_rad)"
    else:
        return ""
    return f"The log has no {missing}, so the currents of its dives cannot be computed."


def _legs(plant: Plant, record: Record) -> list[_Leg]:
    """The dives of a record that lie between two fixes."""
    fixes = np.reshape(record.attrs.get(FIXES, ()), (-1, 3))
    needed = {"depth_m", "heading_rad"} <= set(record.names) and set(_PLACE) <= set(plant.outputs)
    if not len(fixes) or not needed or "start_epoch_s" not in record.attrs:
        return []
    fixes = fixes[np.argsort(fixes[:, 0])]
    fixes[:, 0] -= float(record.attrs["start_epoch_s"])
    middles, velocities = _through_water(plant, record)
    labels, found = np.repeat(record.labels, [s.stop - s.start for s in record.segments]), []
    for before, after in pairwise(fixes):
        rows = np.flatnonzero((record.time >= before[0]) & (record.time <= after[0]))
        own = (middles >= before[0]) & (middles <= after[0])
        if own.any():
            start, stop = float(before[0]), float(after[0])
            way, afloat = _way(record, rows, middles[own], velocities[own], (start, stop))
            found.append(_Leg(str(labels[rows[0]]), start, stop, _apart(before, after), way, afloat))
    return found


def _through_water(plant: Plant, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Times between samples, s, (n,), and velocities there, north and east, m/s, (n, 2), each from one sample alone."""
    begins = np.concatenate([np.arange(s.start, s.stop - 1) for s in record.segments])
    read = outputs_of(plant, record)
    read[:, [plant.outputs.index(name) for name in _PLACE]] = 0.0
    starts = np.array([plant.initial(read[k])[: len(plant.family.states)] for k in begins])
    ran = plant.run(record, [slice(k, k + 2) for k in begins.tolist()], starts)
    moved = (ran[1::2] - ran[0::2])[:, [plant.outputs.index(name) for name in _PLACE]]
    time = record.time
    return 0.5 * (time[begins] + time[begins + 1]), moved / (time[begins + 1] - time[begins])[:, None]


def _way(
    record: Record, rows: np.ndarray, middles: np.ndarray, velocities: np.ndarray, fixes: tuple[float, float]
) -> tuple[np.ndarray, float]:
    """The displacement through the water between fixes, m north and east, and the remaining time afloat, s."""
    time, depth = record.time[rows], record["depth_m"][rows]
    between, lengths = 0.5 * (time[1:] + time[:-1]), np.diff(time)
    way = np.array([np.interp(between, middles, v) @ lengths for v in velocities.T])
    few, afloat = min(_ENDS, len(rows) - 1), 0.0
    for end, far, limit in ((0, few, time[0] - fixes[0]), (-1, -1 - few, fixes[1] - time[-1])):
        rate = abs((depth[far] - depth[end]) / (time[far] - time[end]))
        under = min(max(depth[end], 0.0) / rate, limit) if rate > 0.0 else 0.0
        way, afloat = way + velocities[end] * under, afloat + float(limit - under)
    return way, afloat


def _apart(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The displacement between two fixes, m north and east; fixes: s, and latitude and longitude in deg."""
    middle, square = radians(0.5 * (before[1] + after[1])), _FLATTENING * (2.0 - _FLATTENING)
    across = _EQUATOR / sqrt(1.0 - square * sin(middle) ** 2)
    along = across * (1.0 - square) / (1.0 - square * sin(middle) ** 2)
    turned = (after[2] - before[2] + 180.0) % 360.0 - 180.0
    return np.array([along * radians(after[1] - before[1]), across * cos(middle) * radians(turned)])
