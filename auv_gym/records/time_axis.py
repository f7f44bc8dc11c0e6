"""The times of a record: segments and gaps, and values at other times."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.channels import SEGMENT_COLUMNS

SAME = 1e-3  # of a sample interval; times closer than this are equal: seconds since 1970 are rounded to 0.2 us
_SHORTEST_GAP = 0.25  # s


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


def gap_limit(intervals: np.ndarray) -> float:
    """The interval between two samples of a signal, s, above which there is a gap, from all of its intervals.

    5 times the median interval, or 3 times the longest of the shorter 90 % if sampling is uneven; at least 0.25 s,
    since messages of fast sensors are often late by that much.
    """
    uneven = 3.0 * float(np.quantile(intervals, 0.9, method="lower"))
    return max(5.0 * float(np.median(intervals)), uneven, _SHORTEST_GAP)


def at_times(grid: np.ndarray, time: np.ndarray, values: np.ndarray, held: bool, dt: float) -> np.ndarray:
    """The values on a time grid with steps dt: the last value if they are held, otherwise linear interpolation."""
    if not held:
        return np.interp(grid, time, values)
    return values[np.searchsorted(time, grid + SAME * dt, side="right") - 1]


def nearest(grid: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Indices of the times on an even grid, (m,), nearest to the given times."""
    found = np.zeros(grid.size, dtype=bool)
    found[np.clip(np.round((time - grid[0]) / (grid[1] - grid[0])), 0, grid.size - 1).astype(int)] = True
    return found
