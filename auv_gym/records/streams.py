"""Channels that share their times: rows in order of time, and the parts of a clock that was set back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

_SHUFFLED = 0.1  # share of rows that are earlier than the previous one; above it, the log was not written in order


@dataclass(frozen=True, eq=False)
class Stream:
    """Channels that share their times: a group of a log after its mapping.

    time: (n,), s, in the order of the file.  values: (n,) each, by channel, NaN if missing.
    labels: of segments, one per row, or None.  near: see `Group.near`.  dated: whether the times are dates.
    part: (n,), increases where the clock was set back; filled in by `in_order`.
    """

    time: np.ndarray
    values: Mapping[str, np.ndarray]
    name: str = ""
    labels: np.ndarray | None = None
    near: float | None = None
    dated: bool = False
    part: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=int))

    def rows(self, kept: np.ndarray) -> Stream:
        """The stream with only these rows, by mask or index."""
        return replace(
            self,
            time=self.time[kept],
            values={name: column[kept] for name, column in self.values.items()},
            labels=None if self.labels is None else self.labels[kept],
            part=self.part[kept] if self.part.size else self.part,
        )


def in_order(stream: Stream, notes: list[str]) -> Stream:
    """The rows in order of time: late rows sorted in, equal times merged, a new part where the clock was set back.

    Dated rows, many of which are earlier than the previous one, count as shuffled and are all sorted.
    A line on each of these goes to the notes.
    """
    known = np.isfinite(stream.time)
    where = f" of {stream.name}" if stream.name else ""
    if not known.all():
        notes.append(f"{counted(np.sum(~known), 'row')}{where} without a time left out.")
        stream = stream.rows(known)
    n = stream.time.size
    if n > 2 and (np.diff(stream.time) < 0.0).all():
        notes.append(f"The rows{where} run backwards in time and were reversed.")
        stream = stream.rows(np.arange(n)[::-1])
    earlier = np.diff(stream.time) < 0.0
    if stream.dated and n > 2 and earlier.mean() > _SHUFFLED:
        notes.append(f"The rows{where} were in no order and were sorted by their dates.")
        stream = stream.rows(np.argsort(stream.time, kind="stable"))
    runs = np.zeros(n, dtype=int)
    if stream.labels is not None:
        runs[1:] = np.cumsum(stream.labels[1:] != stream.labels[:-1])
    steps = np.diff(stream.time)
    inside = np.diff(runs) == 0
    if not ((steps <= 0.0) & inside).any():
        return replace(stream, part=runs)
    part = _parts(stream.time, runs)
    order = np.lexsort((np.arange(n), stream.time, part))
    late = int(np.sum((np.diff(stream.time) < 0.0) & (np.diff(part) == 0)))
    back = int(part[-1] - runs[-1])
    stream = replace(stream, part=part).rows(order)
    if late:
        notes.append(f"{counted(late, 'row')}{where} came late or out of order and {_were(late)} sorted into place.")
    if back:
        notes.append(f"The clock{where} went back {_times(back)}; the record is cut there.")
    same = np.r_[False, (np.diff(stream.time) == 0.0) & (np.diff(stream.part) == 0)]
    if same.any():
        count = int(same.sum())
        rounded = "; the times may be rounded" if count > n // 4 else _on_conflicts(stream, same)
        notes.append(
            f"{counted(count, 'row')}{where} {_had(count)} the time of the row before and {_were(count)} merged with "
            f"it{rounded}."
        )
        stream = _merged_rows(stream, same)
    return stream


def typical_interval(time: np.ndarray, part: np.ndarray) -> float:
    """Median time between rows of one part, s; 0 if there are none."""
    steps = np.diff(time)[np.diff(part) == 0] if part.size == time.size else np.diff(time)
    return float(np.median(steps)) if steps.size else 0.0


def _parts(time: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """The number of each row's part; it increases with each run of labels, and where the clock was set back.

    A row earlier than the previous one is late if time then jumps forward again.  The clock was set back if time
    continues from it at the usual pace until it has caught up, or never catches up.
    """
    part = np.zeros(time.size, dtype=int)
    forward = np.diff(time)
    forward = forward[forward > 0.0]
    usual = float(np.median(forward)) if forward.size else 0.0
    count = 0
    edges = [0, *(np.flatnonzero(np.diff(runs)) + 1), time.size]
    for first, last in pairwise(edges):
        start = first
        while True:
            part[start:last] = count
            back = _set_back(time[start:last], usual)
            if back is None:
                break
            start, count = start + back, count + 1
        count += 1
    return part


def _set_back(time: np.ndarray, usual: float) -> int | None:
    """The first row after the clock was set back, or None."""
    highest = np.maximum.accumulate(time)
    late = time < highest
    if not late.any():
        return None
    edges = np.diff(np.r_[False, late, False].astype(int))
    for first, stop in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)):
        behind = highest[first] - time[first]
        if behind <= 1.5 * usual:
            continue
        if stop == time.size:
            # at the end of a file: a single late row, or a clock that has not caught up
            if stop - first > 1:
                return int(first)
            continue
        if time[stop] - time[stop - 1] < 1.5 * usual + 1e-9:
            return int(first)
    return None


def _merged_rows(stream: Stream, same: np.ndarray) -> Stream:
    """Merge rows of one time into one, with the last value of each channel."""
    group = np.cumsum(~same) - 1
    first = np.flatnonzero(~same)
    values = {}
    for name, column in stream.values.items():
        result = np.full(first.size, np.nan)
        there = np.isfinite(column)
        result[group[there]] = column[there]  # of several, the last one counts
        values[name] = result
    return replace(stream.rows(first), values=values)


def _on_conflicts(stream: Stream, same: np.ndarray) -> str:
    """Words on channels in which rows of one time contradict each other; '' if there are none."""
    at = np.flatnonzero(same)
    counts = {name: int(np.sum(np.abs(column[at] - column[at - 1]) > 0.0)) for name, column in stream.values.items()}
    listed = ", ".join(f"{name} in {count:,}" for name, count in counts.items() if count)
    return f"; they differ in {listed} of these rows, where the last value is kept" if listed else ""


def counted(count: int | np.integer, noun: str) -> str:
    return f"{int(count):,} {noun}{'s' * (int(count) != 1)}"


def _were(count: int) -> str:
    return "was" if count == 1 else "were"


def _had(count: int) -> str:
    return "has" if count == 1 else "have"


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")
