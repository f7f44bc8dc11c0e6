"""Record: named signals with units over time, cut into segments; the common data type of all packages."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, final

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import check_number, did_you_mean
from auv_gym.records.attitude import ANGLES, QUATERNION, interpolated, interpolated_angles, turns_far
from auv_gym.records.dataset import (
    INTERVAL,
    LABELS,
    NOTES,
    UNREAD,
    checked,
    checked_mask,
    common_attrs,
    dataset_of,
    dataset_of_arrays,
    is_channel,
    saved_dataset,
    selected,
    vector,
    without_marks,
)
from auv_gym.records.log import FIXES
from auv_gym.records.mending import MAX_FILL
from auv_gym.records.time_axis import at_times, even_grids, even_windows, gap_limit, nearest, slices
from auv_gym.writing import check_ending, replacing

if TYPE_CHECKING:
    import xarray as xr

RARER = 1.5  # sample intervals between readings; from this ratio on, some samples have no reading


@final
@dataclass(frozen=True, eq=False)
class Record:
    """Named signals in SI over time, in one or more segments, on an xarray Dataset.

    dataset: dimension and coordinate time_s; float64 variables named as channels; an integer variable `segment`, one
    value per sample, that changes where a segment begins (if missing: one segment).  Time may be uneven and may restart
    with a segment.  A variable `depth_m.unread` is 1 where the value of depth_m was filled in.  Raises if time does not
    rise within a segment, if a segment has fewer than 2 samples, or if a motion or input channel is not finite; other
    channels may hold NaN.  `from_arrays` repairs what can be repaired.

    Example:

        >>> from auv_gym import Record
        >>> log = Record.from_arrays([0, 1, 2, 3], {"depth_m": [0.0, 0.4, 1.1, 1.9]})
        >>> log
        Record(4 samples, 1 segment, 3 s: depth_m)
        >>> log["depth_m"]
        array([0. , 0.4, 1.1, 1.9])
    """

    dataset: xr.Dataset

    def __post_init__(self) -> None:
        object.__setattr__(self, "dataset", checked(self.dataset))

    @classmethod
    def from_arrays(
        cls,
        time_s: Any,
        values: Mapping[str, Any],
        segment: Any = None,
        attrs: Mapping[str, Any] | None = None,
        *,
        max_fill: int = MAX_FILL,
        long_runs: Literal["cut", "raise"] = "cut",
        required: Collection[str] | None = None,
        notes: Sequence[str] = (),
        unread: Mapping[str, np.ndarray] | None = None,
        spare: Collection[str] = (),
    ) -> Record:
        """A record of equally long arrays, with angles unwrapped and missing values (NaN, infinities) handled.

        Up to `max_fill` consecutive missing samples are filled: linearly, or for inputs, commands and flags with the
        last value; the variable's attribute `filled` counts them, and linearly filled values are not `readings`.
        Longer runs in a motion or input channel, and missing values at the ends of a segment, are dropped and the
        record is cut; its attribute `dropped` counts them (long_runs "raise": a run longer than `max_fill` is an
        error).  Longer runs in other channels stay NaN.  Segments of a single sample are dropped.
        segment: one label per sample, of any type.  unread: by channel, where values lie between readings, (n,).
        required: if given, a motion or input channel that is not listed is left out if it would cost more than a tenth
        of the samples.  notes: lines to keep; lines on what was dropped are added.
        spare: measurements that may be missing for any time: they go on along straight lines, which are no `readings`.
        Raises if nothing is left.
        """
        return cls(
            dataset_of_arrays(
                time_s, values, segment, attrs or {}, max_fill, long_runs, required, notes, unread or {}, spare
            )
        )

    @property
    def time(self) -> np.ndarray:
        """Time of each sample, s, shape (n,)."""
        return self.dataset["time_s"].values.copy()

    @property
    def elapsed(self) -> np.ndarray:
        """Time since the start of each sample's segment, s, shape (n,)."""
        time = self.time
        return np.concatenate([time[s] - time[s.start] for s in self.segments])

    @property
    def names(self) -> tuple[str, ...]:
        """The channels of the record."""
        return tuple(name for name in map(str, self.dataset.data_vars) if is_channel(name))

    @property
    def attrs(self) -> dict[str, Any]:
        """Attributes of the whole record: source, start_epoch_s, dropped, ..."""
        return {str(k): v for k, v in self.dataset.attrs.items() if k not in (LABELS, NOTES)}

    @property
    def notes(self) -> list[str]:
        """What was left out of its file, mended, or cut, and why; a line each."""
        return [str(line) for line in np.atleast_1d(self.dataset.attrs.get(NOTES, []))]

    @property
    def segments(self) -> list[slice]:
        """The segments, in order, as slices of the samples."""
        return slices(self.dataset["segment"].values)

    @property
    def labels(self) -> list[str]:
        """One label per segment: the name in the file, or '' if it had none."""
        return [str(label) for label in self.dataset.attrs[LABELS]]

    @property
    def duration_s(self) -> float:
        """Sum over the segments of last minus first time, s."""
        return float(sum(self.time[s.stop - 1] - self.time[s.start] for s in self.segments))

    @property
    def sample_interval(self) -> float:
        """Median time between samples of a segment, s."""
        return self._typical[0]

    def interval_of(self, name: str) -> float:
        """Time between the readings of a channel, s: the sample interval, or longer if the channel is interpolated."""
        self[name]
        told = float(self.dataset[name].attrs.get(INTERVAL, 0.0))
        if name + UNREAD in self.dataset:
            time, read = self.time, self.readings(name)
            apart = np.concatenate([np.diff(time[s][read[s]]) for s in self.segments])
            told = float(np.median(apart)) if apart.size else self.duration_s
        return max(self.sample_interval, told)

    def readings(self, name: str) -> np.ndarray:
        """A mask, (n,), of the samples that hold a reading of a channel rather than a filled-in value.

        If only the interval between readings is known, one of the samples in each interval; otherwise all samples.
        """
        if name + UNREAD in self.dataset:
            return (self.dataset[name + UNREAD].values == 0) & np.isfinite(self.dataset[name].values)
        held, interval = np.ones(len(self), dtype=bool), self.interval_of(name)
        if interval < RARER * self.sample_interval:
            return held
        time = self.time
        for s in self.segments:
            number = np.floor((time[s] - time[s.start]) / interval + 1e-6)
            held[s] = np.diff(number, prepend=-1.0) > 0.0
        return held

    def longest_unread(self, name: str) -> float:
        """The longest time within a segment in which a channel has no reading, s."""
        time, read = self.time, self.readings(name)
        own = [np.diff(time[s][read[s]], prepend=time[s.start], append=time[s.stop - 1]) for s in self.segments]
        return max(float(apart.max()) for apart in own)

    def is_uniform(self, tol: float = 1e-3) -> bool:
        """Whether all intervals within segments equal the median, to `tol` times the median."""
        median, farthest = self._typical
        return farthest <= tol * median

    def has(self, name: str) -> bool:
        """Whether the record has a channel."""
        return isinstance(name, str) and is_channel(name) and name in self.dataset.data_vars

    def __contains__(self, name: str) -> bool:
        return self.has(name)

    def __iter__(self) -> Iterator[str]:
        """The channels, as in a mapping; `len` is the number of samples."""
        return iter(self.names)

    def __getitem__(self, name: str) -> np.ndarray:
        """A copy of a channel's values, shape (n,), float64; raises if the channel is missing."""
        if not isinstance(name, str):
            raise ValueError(
                f"A record is read by channel, such as record['depth_m'], got record[{name!r}]: choose samples with "
                "record.select or record.between."
            )
        if name == "time_s":
            return self.time
        if not self.has(name):
            raise ValueError(
                f"The record has no channel {name!r}; it has {', '.join(self.names) or 'none'}. "
                f"{did_you_mean(name, self.names)}If it goes by another name in the file, name it in a mapping."
            )
        return self.dataset[name].values.copy()

    def __len__(self) -> int:
        return self.dataset.sizes["time_s"]

    def __repr__(self) -> str:
        parts = len(self.segments)
        size = f"{len(self)} samples, {parts} segment{'s' * (parts != 1)}, {self.duration_s:g} s"
        return f"Record({size}: {', '.join(self.names)})"

    def matrix(self, names: Sequence[str]) -> np.ndarray:
        """The values of several channels, shape (n, len(names)), float64, C-contiguous."""
        matrix = np.empty((len(self), len(names)))
        for column, name in enumerate(names):
            matrix[:, column] = self[name]
        return matrix

    def with_channels(self, values: Mapping[str, Any]) -> Record:
        """The record with these channels added or replaced; angles are not unwrapped, all values are readings."""
        new = {name: ("time_s", vector(name, column, len(self))) for name, column in values.items()}
        return Record(without_marks(self.dataset, values).assign(new))

    def with_intervals(self, seconds: Mapping[str, float]) -> Record:
        """The record with these channels marked as interpolated between readings that are this far apart, s."""
        for name, interval in seconds.items():
            self[name]
            if not (interval > 0.0 and np.isfinite(interval)):
                raise ValueError(f"with_intervals needs a positive interval of {name!r} in s, got {interval}.")
        dataset = self.dataset.copy(deep=False)
        for name, interval in seconds.items():
            dataset.variables[name].attrs = {**dataset.variables[name].attrs, INTERVAL: float(interval)}
        return Record(dataset)

    def with_readings(self, held: Mapping[str, Any]) -> Record:
        """The record with these channels' readings marked, (n,); all other values count as filled in."""
        marks = {}
        for name, given in held.items():
            self[name]
            mask = checked_mask(f"with_readings needs one boolean per sample of {name!r}", given, len(self))
            marks[name + UNREAD] = ("time_s", ~mask)
        return Record(self.dataset.assign(marks))

    def without(self, names: Iterable[str]) -> Record:
        """The record without these channels; raises if one is missing."""
        names = [names] if isinstance(names, str) else list(names)
        for name in names:
            self[name]
        return Record(without_marks(self.dataset, names).drop_vars(names))

    def with_notes(self, notes: Sequence[str], **attrs: Any) -> Record:
        """The record with these notes instead of its own, and with these attributes."""
        others = {name: value for name, value in self.dataset.attrs.items() if name != NOTES}
        dataset = self.dataset.copy(deep=False)
        dataset.attrs = {**others, **attrs, **({NOTES: list(notes)} if notes else {})}
        return Record(dataset)

    def with_labels(self, labels: Sequence[str]) -> Record:
        """The record with these labels for its segments, one each."""
        if len(labels) != len(self.segments):
            raise ValueError(f"with_labels needs a label for each of {len(self.segments)} segments, got {len(labels)}.")
        return Record(self.dataset.assign_attrs({LABELS: [str(label) for label in labels]}))

    def later(self, seconds: float) -> Record:
        """The record with all times shifted later by this many seconds."""
        return Record(self.dataset.assign_coords(time_s=("time_s", self.time + seconds)))

    def select(self, mask: Any) -> Record:
        """The samples in the mask, shape (n,); segments are cut where it breaks, and single samples dropped."""
        hint = ": write record.select(record['depth_m'] > 10)"
        mask = checked_mask("select needs one boolean per sample", mask, len(self), hint)
        return Record(selected(self.dataset, mask, ""))

    def between(self, start: float, stop: float) -> Record:
        """The samples with start <= time < stop, s."""
        return self.select((self.time >= start) & (self.time < stop))

    def split_gaps(self, max_gap_s: float | None = None) -> Record:
        """The record cut wherever two samples are more than `max_gap_s` apart, without segments of a single sample.

        Default: 5 times the median interval, or 3 times the longest of the shorter 90 % if sampling is uneven.
        """
        check_gap(max_gap_s)
        if max_gap_s is None:
            max_gap_s = gap_limit(self._intervals())
        time = self.time
        breaks = np.zeros(len(self), dtype=bool)
        for part in self.segments:
            breaks[part.start + 1 : part.stop] = np.diff(time[part]) > max_gap_s
        if not breaks.any():
            return self
        return Record(selected(self.dataset, np.ones(len(self), dtype=bool), "", breaks))

    def resample(self, dt: float) -> Record:
        """The record at even steps of dt, s, from the start of each segment; never across a gap between segments.

        Inputs, commands and flags hold their last value; everything else is interpolated linearly (angles are already
        continuous), and attitudes that turn far along the shortest rotation.  Nothing is filtered: smooth first if dt
        is much longer than the interval.  Values between readings add no information, so a channel keeps its
        `interval_of` if dt is shorter.
        """
        if not (dt > 0.0 and np.isfinite(dt)):
            raise ValueError(f"resample needs a positive step in s, got {dt}.")
        time, segments = self.time, self.segments
        by_segment = even_grids(time, segments, dt)
        grids, origins = list(by_segment.values()), [segments[k] for k in by_segment]

        def turned(between: Callable[..., np.ndarray], names: Sequence[str]) -> dict[str, np.ndarray]:
            attitude = self.matrix(names)
            rows = np.concatenate([between(grid, time[o], attitude[o]) for grid, o in zip(grids, origins)])
            return dict(zip(names, rows.T, strict=True))

        variables: dict[str, Any] = {}
        for name in self.names:
            held = channel(name).held
            parts = [at_times(grid, time[o], self.dataset[name].values[o], held, dt) for grid, o in zip(grids, origins)]
            own = self.interval_of(name)
            apart = {INTERVAL: own} if dt < own and not held else {}
            variables[name] = ("time_s", np.concatenate(parts), {**self.dataset[name].attrs, **apart})
            if name + UNREAD in self.dataset:
                read = self.readings(name)
                unread = [~nearest(grid, time[o][read[o]]) for grid, o in zip(grids, origins)]
                variables[name + UNREAD] = ("time_s", np.concatenate(unread))
        attitudes: dict[str, np.ndarray] = {}
        if set(QUATERNION) <= set(variables):
            attitudes |= turned(interpolated, QUATERNION)
        if set(ANGLES) <= set(variables) and any(turns_far(*self.matrix(ANGLES)[o, :2].T) for o in origins):
            attitudes |= turned(interpolated_angles, ANGLES)
        for name, values in attitudes.items():
            variables[name] = ("time_s", values, variables[name][2])
        variables["segment"] = ("time_s", np.repeat(np.arange(len(grids)), [grid.size for grid in grids]))
        attrs = {**self.dataset.attrs, LABELS: [self.labels[k] for k in by_segment]}
        return Record(dataset_of(variables, np.concatenate(grids), attrs))

    def windows(self, seconds: float) -> list[slice]:
        """Consecutive windows of this length within each segment, as slices; a shorter rest is dropped.

        A window ends before the next begins: at 4 s per sample, 120 s are 30 samples.  Windows of a single sample are
        dropped.
        """
        if not seconds > 0.0:
            raise ValueError(f"windows needs a positive length in s, got {seconds}.")
        return even_windows(self.time, self.segments, seconds)

    def save(self, path: str | Path) -> None:
        """Write NetCDF to a file that ends in .nc, aside and then renamed; raises if the folder cannot be written."""
        check_ending(path, ".nc", "The file of a record")
        with replacing(path) as new:
            self.dataset.to_netcdf(new, engine="h5netcdf")

    @classmethod
    def load(cls, path: str | Path) -> Record:
        """The record that `save` wrote; for other files, use `auv_gym.records.reading.read_record`."""
        return cls(saved_dataset(path))

    @cached_property
    def _typical(self) -> tuple[float, float]:
        """The median of the intervals, and the largest deviation from it, s."""
        intervals = self._intervals()
        median = np.median(intervals)
        return float(median), float(np.max(np.abs(intervals - median)))

    def _intervals(self) -> np.ndarray:
        time = self.time
        return np.concatenate([np.diff(time[part]) for part in self.segments])


def check_record(name: str, given: Any) -> None:
    """Raise an error that names the caller, `name`, if this is not a record."""
    if isinstance(given, Record):
        return
    if isinstance(given, str | Path):
        raise ValueError(f"{name} needs a record, got {str(given)!r}: read_record({str(given)!r}) reads it.")
    hint = "join several with concat" if isinstance(given, list | tuple) else "Record.from_arrays makes one of arrays"
    raise ValueError(f"{name} needs a record, got a {type(given).__name__}: {hint}.")


def check_gap(max_gap_s: float | None) -> None:
    """Raise unless this is a time, s, infinity (no gap is too long) or None."""
    if max_gap_s is not None and max_gap_s != np.inf:
        check_number("max_gap_s", max_gap_s, "s", above=0.0)


def records_of(name: str, given: Any) -> tuple[Record, ...]:
    """One record or several, as a tuple; raises an error that names the caller, `name`, for none or for other data."""
    alone = isinstance(given, Record | str) or not isinstance(given, Iterable)
    records = (given,) if alone else tuple(given)
    if not records:
        raise ValueError(f"{name} needs at least one record, got none.")
    for one in records:
        if not isinstance(one, Record):
            listed = isinstance(one, list | tuple)
            hint = "give its items one by one, as in fit(*records)" if listed else "read_record reads a log"
            raise ValueError(f"{name} needs records, got a {type(one).__name__}: {hint}.")
    return records


def concat(records: Sequence[Record]) -> Record:
    """Concatenate records with the same channels into one record; each segment keeps its own time.

    Example:

        >>> from auv_gym import Record, concat
        >>> dive = Record.from_arrays([0, 1, 2], {"depth_m": [0.0, 0.5, 1.0]})
        >>> concat([dive, dive])
        Record(6 samples, 2 segments, 4 s: depth_m)
    """
    records = records_of("concat", records)
    names = set(records[0].names)
    for number, record in enumerate(records):
        if set(record.names) != names:
            odd = ", ".join(sorted(names ^ set(record.names)))
            raise ValueError(
                f"concat needs the same channels in all records; record {number} and record 0 differ in {odd}: "
                "leave those out with record.without."
            )
    starts = np.cumsum([0] + [len(record.segments) for record in records])
    ids = np.concatenate([record.dataset["segment"].values + start for record, start in zip(records, starts)])
    variables: dict[str, Any] = {}
    for name in records[0].names:
        together = np.concatenate([record[name] for record in records])
        variables[name] = ("time_s", together, common_attrs([record.dataset[name] for record in records]))
        if any(name + UNREAD in record.dataset for record in records):
            variables[name + UNREAD] = ("time_s", np.concatenate([~record.readings(name) for record in records]))
    variables["segment"] = ("time_s", ids)
    first = records[0].attrs
    attrs: dict[str, Any] = {
        key: v for key, v in first.items() if all(str(r.attrs.get(key)) == str(v) for r in records)
    }
    notes = list(dict.fromkeys(line for record in records for line in record.notes))
    attrs |= {NOTES: notes} if notes else {}
    fixes = [float(number) for record in records for number in np.ravel(record.attrs.get(FIXES, ()))]
    attrs |= {FIXES: fixes} if fixes else {}
    attrs[LABELS] = [label for record in records for label in record.labels]
    return Record(dataset_of(variables, np.concatenate([record.time for record in records]), attrs))
