"""The windows of free runs in a record, and which of them are held out from the fit."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from auv_gym.model import inputs_of
from auv_gym.param import value_at
from auv_gym.physics.actuators import travel
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.fit.shooting import unknown_states

LEAST_SAMPLES = 8
LEAST_LEFT = 4  # windows that must remain of a segment if its first seconds are left out
UNTOLD = 0.01  # share of an actuator's travel within which its position counts as determined by the commands
_BEYOND = 1e6  # a command beyond any stop


def free_run_windows(plant: Plant, record: Record, seconds: float) -> list[slice]:
    """Windows of at most `seconds`: consecutive ones, or for inputs that move in steps the stretches between the steps.

    The sample at which an input has moved is left out: the log may have been written during the move.  Stretches with
    fewer than `LEAST_SAMPLES` samples are dropped.  A vehicle that is `afloat` near the surface is judged below that
    depth only, in equal parts of each stretch there.  No log holds the positions of the actuators before its first row,
    and a wrong guess would look like an effect: windows begin where they no longer matter (`_commanded`).  For other
    vehicles they also begin a settling time after the start of their segment, if at least `LEAST_LEFT` remain.
    """
    family = plant.family
    inputs, time = inputs_of(plant, record), record.time
    begin = [s.start + _commanded(plant, inputs[s], time[s]) for s in record.segments]
    if family.stepped:
        return _between_steps(record, family.stepped, seconds, begin)
    if family.afloat is not None:
        return _submerged(record, family.afloat, seconds, begin)
    return _settled(record, record.windows(seconds), plant.settle, begin)


def stretches_of(plant: Plant, record: Record) -> list[slice]:
    """The stretches that a filter follows without a break: `free_run_windows` of any length, without remainders."""
    family, time = plant.family, record.time
    inputs = inputs_of(plant, record)
    begin = [s.start + _commanded(plant, inputs[s], time[s]) for s in record.segments]
    if family.stepped:
        return _between_steps(record, family.stepped, np.inf, begin)
    if family.afloat is not None:
        return _under(record, family.afloat, begin)
    found = []
    for segment, first in zip(record.segments, begin, strict=True):
        settled = segment.start + int(np.searchsorted(time[segment], time[segment.start] + plant.settle))
        enough = time[segment.stop - 1] - time[segment.start] >= LEAST_LEFT * 2 * plant.settle
        found.append(slice(max(first, settled) if enough else first, segment.stop))
    return [s for s in found if s.stop - s.start >= LEAST_SAMPLES]


def _commanded(plant: Plant, inputs: np.ndarray, time: np.ndarray) -> int:
    """The first row of a segment at which the commands determine the actuators' positions, whatever these were before.

    inputs: (n, n_inputs).  time: (n,) s.  The actuators are run from both ends of their travel, backlash included,
    until the two agree; the first row if they never do, since nothing would remain.
    """
    family, p = plant.family, plant.family.view(plant.derived)
    shape, times, count = family.hooks.shape, family.hooks.actuator_times, len(family.actuators)
    if not count:  # a vehicle that only drifts
        return 0
    dead_times, lags, slownesses = zip(*(times(j, p) for j in range(count)), strict=True)
    at, plays, shaped = np.zeros((2, count)), np.zeros((2, count)), np.zeros((2, count))
    for side in (0, 1):
        before = inputs[0].copy()
        before[:count] = [_ends(plant, name)[side] for name in family.actuators]
        plays[side] = before[:count]
        shape(before, plays[side], p, at[side])
    travel_of = np.abs(at[1] - at[0])
    for k in range(len(time)):
        for side in (0, 1):
            shape(inputs[k], plays[side], p, shaped[side])
            for j in range(count):
                if lags[j] <= 0.0 and slownesses[j] <= 0.0:
                    at[side, j] = shaped[side, j]
        apart = np.maximum(np.abs(at[1] - at[0]), np.abs(shaped[1] - shaped[0]))
        if np.all(apart <= UNTOLD * travel_of):
            clock = p.effects.clock
            return int(np.searchsorted(time, time[k] + (1.0 + clock.rate) * max(dead_times) + clock.delay))
        if k + 1 < len(time):
            for side in (0, 1):
                for j in range(count):
                    target = shaped[side, j]
                    at[side, j] = travel(at[side, j], target, lags[j], slownesses[j], time[k + 1] - time[k])[2]
    return 0


def _ends(plant: Plant, name: str) -> tuple[float, float]:
    """The least and the greatest command of an actuator before a record; its stops limit it further."""
    low, high = plant.family.ranges.get(name, (-_BEYOND, _BEYOND))
    low, high = (value_at(plant, end) if isinstance(end, str) else end for end in (low, high))
    return low, high


def _between_steps(record: Record, stepped: Sequence[str], seconds: float, begin: Sequence[int]) -> list[slice]:
    """Windows of at most `seconds` between the steps of inputs, from the rows `begin` of the segments on."""
    inputs = np.stack([record[name] for name in stepped], axis=1)
    found = []
    for segment, first in zip(record.segments, begin, strict=True):
        moved = np.r_[True, np.any(np.diff(inputs[segment], axis=0) != 0.0, axis=1)]
        edges = segment.start + np.r_[np.flatnonzero(moved), segment.stop - segment.start]
        for before, after in pairwise(edges):
            found += cut(record.time, max(before + 1, first), after, seconds)
    return [w for w in found if w.stop - w.start >= LEAST_SAMPLES]


def held_out(plant: Plant, record: Record, windows: Sequence[slice]) -> tuple[list[slice], list[slice]]:
    """Windows to fit and windows to judge by: every other one, or every other whole segment.

    Whole segments if each has an unknown constant of its own (`Family.shared`), which its windows have in common.
    """
    windows = list(windows)
    if not unknown_states(plant):
        return windows[0::2], windows[1::2]
    starts = [segment.start for segment in record.segments]
    segments = [int(np.searchsorted(starts, w.start, side="right")) for w in windows]
    used = list(dict.fromkeys(segments))
    if len(used) < 2:
        return windows[0::2], windows[1::2]
    fitted = set(used[0::2])
    return (
        [w for w, segment in zip(windows, segments, strict=True) if segment in fitted],
        [w for w, segment in zip(windows, segments, strict=True) if segment not in fitted],
    )


def _settled(record: Record, windows: Sequence[slice], settle: float, begin: Sequence[int]) -> list[slice]:
    """The windows from the rows `begin` of their segments on, without the first `settle` seconds if enough remain."""
    time, found = record.time, []
    for segment, first in zip(record.segments, begin, strict=True):
        here = [w for w in windows if segment.start <= w.start < segment.stop]
        settled = segment.start + int(np.searchsorted(time[segment], time[segment.start] + settle))
        late = _from(here, max(settled, first))
        found += late if len(late) >= LEAST_LEFT else _from(here, first)
    return found


def _from(windows: Sequence[slice], row: int) -> list[slice]:
    """The windows from a row on, without those of which less than half remains."""
    return [slice(max(w.start, row), w.stop) for w in windows if 2 * (w.stop - row) >= w.stop - w.start]


def _submerged(record: Record, depth: float, seconds: float, begin: Sequence[int]) -> list[slice]:
    """Windows of half to all of `seconds` in the stretches below a depth, m, from the segments' rows `begin` on."""
    time, under = record.time, _under(record, depth, begin)
    found = [w for s in under for w in cut(time, s.start, s.stop, seconds)]
    return [w for w in found if time[w.stop - 1] - time[w.start] >= 0.5 * seconds]


def _under(record: Record, depth: float, begin: Sequence[int]) -> list[slice]:
    """The stretches below a depth, m, from the segments' rows `begin` on."""
    under, found = record["depth_m"] > depth, []
    for segment, first in zip(record.segments, begin, strict=True):
        changes = np.flatnonzero(np.diff(under[segment])) + 1
        edges = segment.start + np.r_[0, changes, segment.stop - segment.start]
        found += [slice(max(int(a), first), int(b)) for a, b in pairwise(edges) if under[a]]
    return [s for s in found if s.stop - s.start >= LEAST_SAMPLES]


def cut(time: np.ndarray, start: int, stop: int, seconds: float) -> list[slice]:
    """The rows from start to stop in equal parts of at most `seconds`."""
    if stop - start < 2:
        return []
    parts = int(np.ceil((time[stop - 1] - time[start]) / seconds))
    if parts <= 1:
        return [slice(int(start), int(stop))]
    edges = time[start] + (time[stop - 1] - time[start]) * np.arange(1, parts) / parts
    rows = [int(start), *(start + np.searchsorted(time[start:stop], edges)).tolist(), int(stop)]
    return [slice(a, b) for a, b in pairwise(rows) if b > a]
