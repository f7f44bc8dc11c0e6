"""Where free runs begin and end in a record, and which of them are kept from the fit."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from auv_gym.plant import Plant
from auv_gym.record import Record
from identification.shooting import unknown_states

LEAST_SAMPLES = 8
LEAST_LEFT = 4  # windows that a segment keeps, for its first seconds to be left out


def free_run_windows(plant: Plant, record: Record, seconds: float) -> list[slice]:
    """Windows of at most `seconds`: consecutive ones, or for inputs that move in steps the stretches between the steps.

    The sample at which an input has moved is left out: the log may have been written while it moved.  Stretches with
    fewer than `LEAST_SAMPLES` samples are dropped.  A vehicle that is `afloat` near the surface is judged below that
    depth only, in equal parts of each stretch there.  The others begin a vehicle's settling time after their segment
    where at least `LEAST_LEFT` are left then: where the actuators stood before, no log says, and a wrong guess would
    pass for a lag.
    """
    family = plant.family
    if not family.stepped:
        if family.afloat is not None:
            return _submerged(record, family.afloat, seconds)
        return _settled(record, record.windows(seconds), plant.settle)
    inputs = np.stack([record[name] for name in family.stepped], axis=1)
    found = []
    for segment in record.segments:
        moved = np.r_[True, np.any(np.diff(inputs[segment], axis=0) != 0.0, axis=1)]
        edges = segment.start + np.r_[np.flatnonzero(moved), segment.stop - segment.start]
        for before, after in pairwise(edges):
            found += _cut(record.time, before + 1, after, seconds)
    return [w for w in found if w.stop - w.start >= LEAST_SAMPLES]


def held_out(plant: Plant, record: Record, windows: Sequence[slice]) -> tuple[list[slice], list[slice]]:
    """Windows to fit and windows to judge by: every other one, or every other segment whole.

    Whole segments where each has an unknown of its own (`Family.shared`), which its windows would tell each other.
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


def _settled(record: Record, windows: Sequence[slice], settle: float) -> list[slice]:
    """The windows without the first `settle` seconds of their segment, or without those of which too little is left."""
    time, found = record.time, []
    for segment in record.segments:
        here = [w for w in windows if segment.start <= w.start < segment.stop]
        settled = segment.start + int(np.searchsorted(time[segment], time[segment.start] + settle))
        late = [slice(max(w.start, settled), w.stop) for w in here if 2 * (w.stop - settled) >= w.stop - w.start]
        found += late if len(late) >= LEAST_LEFT else here
    return found


def _submerged(record: Record, depth: float, seconds: float) -> list[slice]:
    """Windows of half to all of `seconds` in the stretches below a depth, m."""
    under, time, found = record["depth_m"] > depth, record.time, []
    for segment in record.segments:
        changes = np.flatnonzero(np.diff(under[segment])) + 1
        edges = segment.start + np.r_[0, changes, segment.stop - segment.start]
        for start, stop in pairwise(edges):
            if under[start]:
                found += _cut(time, start, stop, seconds)
    return [w for w in found if time[w.stop - 1] - time[w.start] >= 0.5 * seconds]


def _cut(time: np.ndarray, start: int, stop: int, seconds: float) -> list[slice]:
    """The rows from start to stop in equal parts of at most `seconds`."""
    if stop - start < 2:
        return []
    parts = int(np.ceil((time[stop - 1] - time[start]) / seconds))
    if parts <= 1:
        return [slice(int(start), int(stop))]
    edges = time[start] + (time[stop - 1] - time[start]) * np.arange(1, parts) / parts
    rows = [int(start), *(start + np.searchsorted(time[start:stop], edges)).tolist(), int(stop)]
    return [slice(a, b) for a, b in pairwise(rows) if b > a]
