"""The times of a record: segments and gaps, and values at other times."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from auv_gym.channels import SEGMENT_COLUMNS

_SLOWEST, _SOON = 10.0, 2.0  # sample intervals; s
SAME = 1e-3  # of a sample interval; times closer than this are equal: seconds since 1970 are rounded to 0.2 us
_SHORTEST_GAP = 0.25  # s
_MOST_SAMPLES = 10_000_000  # that resample may make: 80 MB per channel


def numbered(segment: Any, size: int) -> tuple[np.ndarray, list[str]]:
    """Segments numbered from 0 in order of appearance, and their labels; a label that reappears is a new segment."""
    if segment is None:
        return np.zeros(size, dtype=np.int64), [""] * min(size, 1)
    given = np.asarray(segment)
    if given.shape != (size,):
        raise ValueError(f"`segment` needs one label per sample, shape ({size},), got shape {given.shape}.")
    if given.dtype.kind == "f" and not np.isfinite(given).all():
        raise ValueError(f"`segment` has no label at row {int(np.argmin(np.isfinite(given))) + 1}: fill it in.")
    begins = np.ones(size, dtype=bool)
    begins[1:] = given[1:] != given[:-1]
    return np.cumsum(begins) - 1, [_label(label) for label in given[begins]]


def _label(label: Any) -> str:
    return f"{label:g}" if isinstance(label, (float, np.floating)) else str(label)


def slices(ids: np.ndarray) -> list[slice]:
    """The samples of each segment, given the segment number of each sample, (n,)."""
    edges = np.flatnonzero(np.diff(ids)) + 1
    return [slice(int(a), int(b)) for a, b in zip([0, *edges], [*edges, ids.size])] if ids.size else []


def check_time(time: np.ndarray, ids: np.ndarray) -> None:
    """Raise ValueError if time is missing, or does not rise within a segment."""
    if not np.isfinite(time).all():
        raise ValueError(
            f"Time is missing at row {int(np.argmin(np.isfinite(time))) + 1}: remove the row or fill it in."
        )
    bad = (np.diff(time) <= 0.0) & (np.diff(ids) == 0)
    if bad.any():
        row = int(np.argmax(bad)) + 1
        happens, remedy = "goes backwards", "sort the rows"
        if time[row] == time[row - 1]:
            happens, remedy = "stands still", "remove the repeated row"
        raise ValueError(
            f"Time {happens} at row {row + 1}: {time[row]:.10g} s after {time[row - 1]:.10g} s; {remedy}, or mark a "
            f"restart with a column {' or '.join(SEGMENT_COLUMNS)}."
        )


def near_limit(spacing: float) -> float:
    """The interval between two readings, s, above which a motion is unknown in between; spacing: s, between samples.

    Underwater, little changes in two seconds.
    """
    return max(_SLOWEST * spacing, _SOON)


def gap_limit(intervals: np.ndarray) -> float:
    """The interval between two samples of a signal, s, above which there is a gap, from all of its intervals.

    5 times the median interval, or 3 times the longest of the shorter 90 % if sampling is uneven; at least 0.25 s,
    since messages of fast sensors are often late by that much.
    """
    uneven = 3.0 * float(np.quantile(intervals, 0.9, method="lower"))
    return max(5.0 * float(np.median(intervals)), uneven, _SHORTEST_GAP)


def even_grids(time: np.ndarray, segments: Sequence[slice], dt: float) -> dict[int, np.ndarray]:
    """Times at even steps of dt, s, from the start of each segment that is as long as a step, by the segment's number.

    Raises ValueError if no segment is that long, or if there would be too many samples.
    """
    lengths = [float(time[part.stop - 1] - time[part.start]) for part in segments]
    samples = sum(lengths) / dt
    if samples > _MOST_SAMPLES:
        raise ValueError(
            f"Steps of {dt:g} s make {samples:.3g} samples of a record of {sum(lengths):g} s, and resample makes at "
            f"most {_MOST_SAMPLES}: choose a longer step."
        )
    steps = [int(np.floor(length / dt + 1e-6)) for length in lengths]
    if max(steps) < 1:
        raise ValueError(f"No segment of the record is as long as one step of {dt:g} s: choose a shorter step.")
    return {k: time[segments[k].start] + dt * np.arange(n + 1) for k, n in enumerate(steps) if n >= 1}


def even_windows(time: np.ndarray, segments: Sequence[slice], seconds: float) -> list[slice]:
    """Consecutive windows of this length within each segment; see `Record.windows`."""
    found = []
    for part in segments:
        t = time[part]
        interval = float(np.median(np.diff(t)))
        slack = SAME * interval
        count = int(np.floor((t[-1] - t[0] + interval + slack) / seconds))
        edges = part.start + np.searchsorted(t, t[0] + seconds * np.arange(count + 1) - slack)
        found += [slice(int(a), int(b)) for a, b in pairwise(edges) if b - a >= 2]
    return found


def at_times(grid: np.ndarray, time: np.ndarray, values: np.ndarray, held: bool, dt: float) -> np.ndarray:
    """The values on a time grid with steps dt: the last value if they are held, otherwise linear interpolation."""
    if not held:
        return np.interp(grid, time, values)
    return values[np.searchsorted(time, grid + SAME * dt, side="right") - 1]


def nearest(grid: np.ndarray, time: np.ndarray) -> np.ndarray:
    """A mask of the times on an even grid, (m,), that are nearest to one of the given times."""
    found = np.zeros(grid.size, dtype=bool)
    found[np.clip(np.round((time - grid[0]) / (grid[1] - grid[0])), 0, grid.size - 1).astype(int)] = True
    return found
