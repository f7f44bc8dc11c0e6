"""Merging of separately sampled signals on one time base: commands are held, measurements interpolated if near."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_gym.channels import Channel, channel
from auv_gym.param import listed
from auv_gym.records.attitude import ANGLES, QUATERNION, angles, from_angles, interpolated, turns_far
from auv_gym.records.log import Untimed
from auv_gym.records.record import RARER
from auv_gym.records.streams import Stream, counted, in_order, typical_interval
from auv_gym.records.time_axis import SAME, gap_limit, near_limit

_LEADING = ("heading_rad", "depth_m")  # used if no vehicle states which channel it requires
_BESIDE = 0.6  # share of a channel's readings in rows of the leading one; for a sensor twice as fast it is a half
_REPEATED = 10  # messages of a command, from which on one can tell whether it is sent again and again
# model inputs that change slowly, however rare their readings: of the engine, and of the water
_SLOW = frozenset(["buoyancy_volume_m3", "temperature_C", "salinity_psu", "conductivity_Spm", "density_kgpm3"])


@dataclass(frozen=True, eq=False)
class Merged:
    """Channels on one time base, which rises within each segment.

    intervals: s between readings, for measurements that are rarer than the rows, by channel.
    unread: (n,), rows without a reading of a measurement whose readings are at the times of other rows.
    leading: the channel whose samples are the time base.  notes: a line each on what was done.
    """

    time: np.ndarray
    values: dict[str, np.ndarray]
    intervals: dict[str, float]
    unread: dict[str, np.ndarray]
    segment: np.ndarray | None
    leading: str
    notes: list[str]


def merged(streams: Sequence[Stream], leading: str | None = None) -> Merged:
    """Merge the channels of streams on the times of one of them.

    The time base is that of `leading`, otherwise of heading, of depth, or of the motion channel with the most samples.
    Rows of its table in which only other sensors were read are left out.  Channels with a reading in most of the
    remaining rows are kept as they are; all others are brought to these rows.  Inputs, commands and flags hold their
    last value, unless they are no longer sent, see `_lasts`.  Measurements are interpolated linearly, attitudes along
    the shortest rotation, if two samples are no further apart than the signal's gap limit and `near_limit`; otherwise
    they are missing, except in the row next to a sample.
    Raises Untimed if no row has a time, or if all have the same one.
    """
    notes: list[str] = []
    ordered = [in_order(stream, notes) for stream in streams if stream.time.size]
    ordered = _common_clock([stream for stream in ordered if stream.time.size], notes)
    if not ordered:
        untimed = max((stream.time.size for stream in streams), default=0)
        if untimed:
            raise Untimed(
                f"None of the {untimed} rows has a time. A record needs each sample's time: give another column as "
                "time_s."
            )
        return Merged(np.empty(0), {}, {}, {}, None, "", notes)
    at, name = _base(ordered, leading)
    base = ordered[at]
    rows = max(stream.time.size for stream in streams if stream.name == base.name)
    if base.time.size == 1 < rows:
        raise Untimed(
            f"All {rows} rows have the same time. A record needs each sample's time: give another column as time_s."
        )
    beside = _beside(base, name)
    if channel(name).kind == "motion":
        base = base.rows(_rows_of(base, beside))
    values = {known: base.values[known] for known in beside if not _skips_rows(np.isfinite(base.values[known]))}
    intervals: dict[str, float] = {}
    unread: dict[str, np.ndarray] = {}
    spacing = typical_interval(base.time, base.part)
    for number, stream in enumerate(ordered):
        apart = [known for known in stream.values if number != at or known not in values]
        values |= _brought(stream, apart, base, spacing)
        notes += _on_ended(stream, apart, base, values)
        rarer = _rarer(stream, apart, spacing)
        read = {known: _read_at(stream, known, base, spacing) for known in rarer}
        unread |= {known: ~rows for known, rows in read.items() if rows is not None}
        intervals |= {known: interval for known, interval in rarer.items() if read[known] is None}
    others = ordered[at].time.size - base.time.size
    if len(ordered) > 1 or others:
        rate = f", {1.0 / spacing:.3g} Hz" if 0.0 < spacing < 1.0 else f", every {spacing:.3g} s"
        more = f"; {counted(others, 'other row')} had no reading of it" if others else ""
        notes.append(f"All signals are given at the times of {name or base.name}{rate}{more}.")
    return Merged(base.time, values, intervals, unread, _segments(base), name, notes)


def _common_clock(streams: list[Stream], notes: list[str]) -> list[Stream]:
    """Streams with matching parts: if only some clocks were set back, rows until these have caught up are dropped."""
    counts = {int(stream.part.max()) for stream in streams}
    if len(streams) < 2 or len(counts) == 1:
        return streams
    result = []
    for stream in streams:
        if stream.part.max() > 0:
            highest = np.maximum.accumulate(stream.time)
            rising = np.r_[True, stream.time[1:] > highest[:-1]]
            if not rising.all():
                lost = int(np.sum(~rising))
                notes.append(f"{counted(lost, 'row')} of {stream.name} left out until its clock had caught up.")
            stream = stream.rows(rising)
        result.append(replace(stream, part=np.zeros(stream.time.size, dtype=int)))
    return result


def _base(streams: Sequence[Stream], leading: str | None) -> tuple[int, str]:
    """The stream and the channel whose times are used."""
    for name in (leading, *_LEADING):
        for number, stream in enumerate(streams):
            if name is not None and name in stream.values:
                return number, name
    counts = [
        (channel(name).kind == "motion", int(np.isfinite(column).sum()), -number, name)
        for number, stream in enumerate(streams)
        for name, column in stream.values.items()
    ]
    *_, number, name = max(counts)
    return -number, name


def _beside(base: Stream, leading: str) -> list[str]:
    """The channels of the base that were mostly read in rows of the leading one, including it.

    A sensor that is faster, or has its own times, was mostly read in other rows.
    """
    rows = np.isfinite(base.values[leading]) | (channel(leading).kind != "motion")
    read = {name: np.isfinite(column) for name, column in base.values.items()}
    return [name for name, own in read.items() if name == leading or (own.any() and np.mean(rows[own]) > _BESIDE)]


def _rows_of(base: Stream, beside: Sequence[str]) -> np.ndarray:
    """The rows of the base, (n,), in which these channels were read or nothing was.

    A row without any reading is a missing sample; but if most rows are, they belong to a sensor without a mapping.
    """
    own = _read(base, beside)
    kept = own | ~_read(base, base.values)
    return own if _skips_rows(own[kept]) else kept


def _read(stream: Stream, names: Iterable[str]) -> np.ndarray:
    """The rows, (n,), in which one of these channels has a reading."""
    found = np.zeros(stream.time.size, dtype=bool)
    for name in names:
        found |= np.isfinite(stream.values[name])
    return found


def _skips_rows(read: np.ndarray) -> bool:
    """Whether readings mostly have rows without one in between: the sensor is slower than the rows."""
    found = np.flatnonzero(read)
    return found.size < 2 or np.quantile(np.diff(found), 0.5, method="lower") > 1


def _brought(stream: Stream, names: Iterable[str], base: Stream, spacing: float) -> dict[str, np.ndarray]:
    """These channels of a stream at the times of the base."""
    names = list(names)
    brought: dict[str, np.ndarray] = {}
    if set(QUATERNION) <= set(names):
        table = np.column_stack([stream.values[name] for name in QUATERNION])
        brought |= dict(zip(QUATERNION, _at(stream, table, None, base, spacing).T, strict=True))
    if set(ANGLES) <= set(names):
        table = _quaternions(np.column_stack([stream.values[name] for name in ANGLES]))
        if table is not None:
            brought |= dict(zip(ANGLES, angles(_at(stream, table, None, base, spacing)), strict=True))
    for name in names:
        if name not in brought:
            brought[name] = _at(stream, stream.values[name], channel(name), base, spacing)
    return brought


def _quaternions(table: np.ndarray) -> np.ndarray | None:
    """Roll, pitch and heading, (n, 3), as quaternions if the attitude turns far, otherwise None."""
    known = np.isfinite(table).all(axis=1)
    if not turns_far(*table[known, :2].T):
        return None
    found = np.full((len(table), 4), np.nan)
    found[known] = from_angles(*table[known].T)
    return found


def _rarer(stream: Stream, names: Iterable[str], spacing: float) -> dict[str, float]:
    """Typical time between readings, s, of the measurements with more than 1.5 rows per reading."""
    found = {}
    for name in names:
        known = np.isfinite(stream.values[name])
        own = typical_interval(stream.time[known], stream.part[known])
        if own > RARER * spacing and not channel(name).held:
            found[name] = own
    return found


def _read_at(stream: Stream, name: str, base: Stream, spacing: float) -> np.ndarray | None:
    """The rows of the base at whose times a channel was read, (n,); None unless all its readings are at such times."""
    found = np.zeros(base.time.size, dtype=bool)
    known = np.isfinite(stream.values[name])
    for part in np.unique(base.part):
        rows, times = np.flatnonzero(base.part == part), stream.time[known & (stream.part == part)]
        times = times[(times > base.time[rows[0]] - spacing) & (times < base.time[rows[-1]] + spacing)]
        after = np.searchsorted(base.time[rows], times - SAME * spacing).clip(max=rows.size - 1)
        if (np.abs(base.time[rows[after]] - times) > SAME * spacing).any():
            return None
        found[rows[after]] = True
    return found


def _at(stream: Stream, column: np.ndarray, of: Channel | None, base: Stream, spacing: float) -> np.ndarray:
    """A column, (n,), or the four of a quaternion, (n, 4), at the times of the base, part by part; NaN if unknown."""
    result = np.full((base.time.size, *column.shape[1:]), np.nan)
    known = np.isfinite(column) if column.ndim == 1 else np.isfinite(column).all(axis=1)
    for part in np.unique(base.part):
        rows = np.flatnonzero(known & (stream.part == part))
        if rows.size:
            wanted = base.part == part
            result[wanted] = _in_part(stream, rows, column, of, base.time[wanted], spacing)
    return result


def _in_part(
    stream: Stream, rows: np.ndarray, column: np.ndarray, of: Channel | None, at: np.ndarray, spacing: float
) -> np.ndarray:
    time, values, slack = stream.time[rows], column[rows], SAME * spacing
    before = np.searchsorted(time, at + slack, side="right") - 1
    if of is not None and of.held:
        until = time[-1] + (_lasts(time, values) if of.kind == "input" else np.inf)
        return np.where((before >= 0) & (at <= until), values[np.maximum(before, 0)], np.nan)
    after = np.minimum(np.searchsorted(time, at), time.size - 1)
    if of is None:
        result = interpolated(at, time, values)
    else:
        result = np.interp(at, time, np.unwrap(values) if of.angle else values)
    near = stream.near
    if near is None:
        near = gap_limit(np.diff(time)) if time.size > 1 else 0.0
        if of is None or of.name not in _SLOW:
            near = min(near, near_limit(spacing))
    last, following = time[np.maximum(before, 0)], time[after]
    far = (following - last > near) & (np.minimum(np.abs(at - last), np.abs(following - at)) > 0.5 * spacing)
    result[far | (at < time[0] - slack) | (at > time[-1] + slack)] = np.nan
    return result


def _lasts(time: np.ndarray, values: np.ndarray) -> float:
    """How long the last of some values, (n,), sent at certain times, holds, s: for ever, unless it would be sent again.

    values: of an actuator's command.  If it is mostly sent without a change, it is sent again and again.  When that
    ends, its sender has stopped, and so have most thrusters and servos, which stop without a command.  Twice the
    longest pause is still an ordinary one.
    """
    if time.size < _REPEATED or np.mean(np.diff(values) == 0.0) < 0.5:
        return np.inf
    return 2.0 * float(np.diff(time).max())


def _on_ended(stream: Stream, names: Iterable[str], base: Stream, values: Mapping[str, np.ndarray]) -> list[str]:
    """A line on the actuators' commands that are no longer sent, and so unknown, when the log ends; else none."""
    ended: dict[str, float] = {}
    for name in names if base.time.size else ():
        sent = stream.time[np.isfinite(stream.values[name]) & (stream.part == base.part[-1])]
        unknown = channel(name).kind == "input" and np.isnan(values[name][-1])
        if unknown and sent.size and sent[-1] < base.time[-1]:
            ended[name] = base.time[-1] - sent[-1]
    if not ended:
        return []
    shown = [*ended] if len(ended) < 4 else [*[*ended][:2], f"{len(ended) - 2} others"]
    return [f"{listed(shown)}: last sent {min(ended.values()):.3g} s before the log ends, and unknown after that."]


def _segments(base: Stream) -> np.ndarray | None:
    """A label per row: that of the file, with a number if the clock splits a segment of one label."""
    if base.labels is None:
        return base.part if base.part.size and base.part.max() > 0 else None
    labels = base.labels.copy()
    begins = np.r_[True, base.part[1:] != base.part[:-1]]
    again = begins & np.r_[False, base.labels[1:] == base.labels[:-1]]
    if not again.any():
        return labels
    number = np.zeros(labels.size, dtype=int)
    for row in np.flatnonzero(begins):
        number[row:] = number[row - 1] + 1 if again[row] else 0
    return np.array([f"{label} ({k + 1})" if k else str(label) for label, k in zip(labels, number)])
