"""Values of a log that are no readings: those that only repeat the last one, and single spikes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auv_gym.param import listed
from auv_gym.records.record import Record

_FEW = 8  # fewest changes of a signal that tell how it was written
_STEPS = 1.5  # smallest steps; more in half of all changes, or repeated values may just be equal in their last digit
_SLOWER = 1.0 / 3.0  # least share of changes that come two rows or more after the last one, for a sensor that is slower
_AS_TIME = ("elapsed_s",)  # channels that change however still a vehicle is
_SPIKE, _MEDIAN = 6.0, 0.6745  # standard deviations of usual steps; their median size, in standard deviations
_LONG = 10  # rows with the same value, among changing ones, that one reading is taken for


def only_repeated(values: np.ndarray, segments: Sequence[slice]) -> tuple[np.ndarray, bool]:
    """A mask, (n,), of the values that only repeat an earlier reading, and whether they are those of a slower sensor.

    Many loggers write the latest value of each sensor in rows at a fixed rate.  Of a sensor slower than the rows, each
    value is repeated a few times; a sensor that fails goes on with its last one.  Coarse readings also repeat, since
    they change by less than their smallest step from row to row: they are all kept.
    """
    same = np.zeros(len(values), dtype=bool)
    jumps, gaps = [], []
    for s in segments:
        steps = np.abs(np.diff(values[s]))
        same[s][1:] = steps == 0.0
        changes = np.flatnonzero(steps > 0.0)
        jumps.append(steps[changes])
        gaps.append(np.diff(changes))
    jump, gap = np.concatenate(jumps), np.concatenate(gaps)
    if jump.size < _FEW or np.mean(jump > _STEPS * np.quantile(jump, 0.05)) < 0.5:
        return np.zeros(len(values), dtype=bool), False
    if np.mean(gap > 1) >= _SLOWER:
        return same, True
    for begin, end in _runs(same):
        if end - begin < _LONG:
            same[begin:end] = False
    return same, False


def single_spikes(values: np.ndarray) -> np.ndarray:
    """A mask, (n,), of values that are far from the two before and the two after them, which are near each other.

    Far is more than the range of these four, and `_SPIKE` standard deviations of the steps, by their median.  A peak of
    a motion has its nearest neighbours close by, and a step has two on its own side.
    """
    found = np.zeros(len(values), dtype=bool)
    if len(values) < 5:
        return found
    near = np.stack([values[:-4], values[1:-3], values[3:-1], values[4:]])
    aside, steps = np.abs(near - values[2:-2]).min(axis=0), np.abs(np.diff(values))
    usual = max(float(np.median(steps)) / _MEDIAN, float(np.min(steps[steps > 0.0], initial=np.inf)))
    found[2:-2] = (aside > np.ptp(near, axis=0)) & (aside > _SPIKE * usual)
    return found


def only_readings(record: Record, names: Sequence[str]) -> tuple[Record, list[str]]:
    """The record with straight lines between the readings of these channels, and lines on what was no reading.

    The values on the straight lines are marked as no readings.  A vehicle at rest stands still in all channels.
    """
    values, marks, slower, lines = {}, {}, [], []
    moving = np.any([np.diff(record[n], prepend=np.nan) != 0.0 for n in record.names if n not in _AS_TIME], axis=0)
    for name in names:
        read, again, spikes = record.readings(name), *np.zeros((2, len(record)), dtype=bool)
        rows = np.flatnonzero(read)
        repeated, slow = only_repeated(record[name][rows], _among(rows, record.segments))
        longest = 0.0
        for begin, end in _runs(repeated):
            if slow or moving[rows[begin] : rows[end - 1] + 1].any():
                again[rows[begin:end]] = True
                longest = max(longest, record.time[rows[end - 1]] - record.time[rows[begin - 1]])
        for s in record.segments:
            rows = s.start + np.flatnonzero(read[s] & ~again[s])
            spikes[rows] = single_spikes(record[name][rows])
        if not (again | spikes).any():
            continue
        marks[name], values[name] = read & ~again & ~spikes, record[name].copy()
        for s in record.segments:
            kept = ~(again[s] | spikes[s])
            values[name][s] = np.interp(record.time[s], record.time[s][kept], record[name][s][kept])
        if slow:
            slower.append(name)
        elif again.any():
            lines.append(
                f"{name} repeats one value for up to {longest:.3g} s, as a sensor that has failed: the repeated values "
                "are ignored."
            )
        if spikes.any():
            lines.append(_spiked(name, record.time[spikes]))
    if slower:
        repeat = "repeats" if len(slower) == 1 else "repeat"
        lines.append(
            f"{listed(slower)} {repeat} the last value in many rows, as slower sensors do: the repeated values are "
            "ignored."
        )
    return (record.with_channels(values).with_readings(marks) if marks else record), lines


def _spiked(name: str, times: np.ndarray) -> str:
    """A line on the single spikes of a channel at these times, s."""
    if times.size == 1:
        return f"{name} has a single spike at {times[0]:.6g} s, which is ignored."
    return f"{name} has {times.size:,} single spikes, the first at {times[0]:.6g} s: they are ignored."


def _among(rows: np.ndarray, segments: Sequence[slice]) -> list[slice]:
    """The positions, among some rows, of those in each segment."""
    return [slice(*np.searchsorted(rows, (s.start, s.stop)).tolist()) for s in segments]


def _runs(mask: np.ndarray) -> np.ndarray:
    """Where the runs of a mask begin and end, in rows, (k, 2)."""
    return np.flatnonzero(np.diff(np.r_[False, mask, False].astype(int))).reshape(-1, 2)
