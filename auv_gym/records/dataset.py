"""The dataset behind a record: made of arrays or read from a file, checked, and cut to a selection of samples."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym.channels import CHANNELS, channel
from auv_gym.records.mending import bridged, check_runs, missing_samples, on_bridged, on_dropped, repaired
from auv_gym.records.time_axis import check_time, numbered, slices

if TYPE_CHECKING:
    import xarray as xr

LABELS, NOTES, INTERVAL = "segment_labels", "notes", "interval_s"  # attributes
UNREAD = ".unread"  # suffix of a channel's name: a variable that is 1 where a value lies between readings


def is_channel(name: str) -> bool:
    """Whether a variable of a dataset is a signal."""
    return name != "segment" and not name.endswith(UNREAD)


def without_marks(dataset: xr.Dataset, names: Iterable[str]) -> xr.Dataset:
    """The dataset without the markers for filled-in values of these channels."""
    return dataset.drop_vars([name + UNREAD for name in names], errors="ignore")


def dataset_of(variables: Mapping[str, Any], time: Any, attrs: Mapping[str, Any]) -> xr.Dataset:
    import xarray as xr  # not at the top: importing pandas takes as long as all that an environment needs

    return xr.Dataset(variables, {"time_s": time}, attrs)


def vector(name: str, values: Any, size: int | None) -> np.ndarray:
    try:
        column = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"Channel {name!r} needs numbers, got {type(values).__name__}: {error}.") from error
    if column.ndim != 1 or size not in (None, column.size):
        wanted = f"({size},)" if size is not None else "(n,)"
        raise ValueError(f"Channel {name!r} needs one value per sample, shape {wanted}, got shape {column.shape}.")
    return column


def checked_mask(needed: str, mask: Any, size: int, hint: str = "") -> np.ndarray:
    """A mask of samples as an array, (size,); for anything else, ValueError that begins with what is needed."""
    mask = np.asarray(mask)
    if mask.dtype != bool or mask.shape != (size,):
        raise ValueError(f"{needed}, shape ({size},), got {mask.dtype} of shape {mask.shape}{hint}.")
    return mask


def common_attrs(variables: Sequence[xr.DataArray]) -> dict[str, Any]:
    """The attributes of a channel over several datasets: fill counts are summed, and the longest interval is used."""
    found = dict(variables[0].attrs)
    intervals = [float(variable.attrs[INTERVAL]) for variable in variables if INTERVAL in variable.attrs]
    if intervals:
        found[INTERVAL] = max(intervals)
    filled = sum(int(variable.attrs.get("filled", 0)) for variable in variables)
    return {**found, "filled": filled} if filled else found


def dataset_of_arrays(
    time_s: Any,
    values: Mapping[str, Any],
    segment: Any,
    attrs: Mapping[str, Any],
    max_fill: int,
    long_runs: str,
    required: Collection[str] | None,
    notes: Sequence[str],
    unread: Mapping[str, np.ndarray],
    spare: Collection[str],
) -> xr.Dataset:
    """The dataset of equally long arrays, with missing values filled or dropped as `Record.from_arrays` describes."""
    time = vector("time_s", time_s, None)
    columns = {name: vector(name, column, time.size) for name, column in values.items()}
    ids, labels = numbered(segment, time.size)
    check_time(time, ids)
    parts = slices(ids)
    variables: dict[str, Any] = {}
    marks: dict[str, Any] = {}
    bridges: dict[str, np.ndarray] = {}
    for name, column in columns.items():
        known, finite = channel(name), np.isfinite(column)
        if known.needed and time.size and not finite.any() and (required is None or name in required):
            raise ValueError(
                f"Channel {name!r} has no value in any of its {time.size} samples: leave it out, or check the log."
            )
        mended = np.where(finite, column, np.nan)
        for part in parts:
            mended[part] = repaired(time[part], mended[part], known.angle, known.held, max_fill)
        if name in spare:
            missing, mended = ~np.isfinite(mended), bridged(time, mended, parts)
            if missing.any() and np.isfinite(mended).all():
                bridges[name] = missing
        filled = np.isfinite(mended) & ~finite
        variables[name] = ("time_s", mended, {"filled": int(filled.sum())} if filled.any() else {})
        between = filled | unread[name] if name in unread else filled
        if between.any() and not known.held:
            marks[name] = ("time_s", between)
    missing, costly = missing_samples(variables, time.size, required)
    for name in costly:
        del variables[name]
    if long_runs == "raise":
        for name, (_, mended, _) in variables.items():
            if channel(name).needed:
                check_runs(name, time, mended, max_fill)
    if required is not None:
        notes = [*notes, *on_bridged(bridges), *costly.values(), *on_dropped(variables, missing)]
    variables |= {name + UNREAD: mark for name, mark in marks.items() if name in variables}
    variables["segment"] = ("time_s", ids)
    kept = {NOTES: list(notes)} if notes else {}
    dataset = dataset_of(variables, time, {**attrs, **kept, LABELS: labels})
    return selected(dataset, ~missing, None if missing.any() else "")


def selected(dataset: xr.Dataset, mask: np.ndarray, note: str | None, breaks: np.ndarray | None = None) -> xr.Dataset:
    """The dataset of the samples in a mask, cut where it breaks (or at `breaks`), without segments of one sample.

    note: None counts the dropped samples in the attribute `dropped`.
    """
    ids, labels = dataset["segment"].values, dataset.attrs[LABELS]
    begins = np.ones(ids.size, dtype=bool)
    begins[1:] = (np.diff(ids) != 0) | (np.diff(mask.astype(int)) != 0)
    if breaks is not None:
        begins |= breaks
    parts = np.cumsum(begins) - 1
    keep = mask & (np.bincount(parts)[parts] > 1) if ids.size else mask
    if not keep.any():
        raise ValueError(_nothing_left(dataset, mask))
    chosen = dataset.isel(time_s=keep)
    numbers, first = np.unique(parts[keep], return_index=True)
    chosen["segment"] = ("time_s", np.searchsorted(numbers, parts[keep]))
    chosen.attrs = {**dataset.attrs, LABELS: [str(labels[k]) for k in ids[keep][first]]}
    if note is None:
        chosen.attrs["dropped"] = int(keep.size - keep.sum())
    return chosen


def _nothing_left(dataset: xr.Dataset, mask: np.ndarray) -> str:
    size = dataset.sizes["time_s"]
    if size < 2:
        return f"A record needs at least 2 samples, got {size}: check that the file has rows below its header."
    names = [name for name in map(str, dataset.data_vars) if is_channel(name) and channel(name).needed]
    counts = {name: int(np.isfinite(dataset[name].values).sum()) for name in names}
    fewest = min(counts, key=lambda name: counts[name], default="")
    if fewest and counts[fewest] < size and not mask.all():
        return (
            f"Nothing is left of {size} samples once those without a value are dropped; {fewest!r} has "
            f"{counts[fewest]} values. Leave that channel out, or record it at every sample."
        )
    return (
        f"Nothing is left: {int(mask.sum())} of {size} samples are selected, and no two in a row. A log needs at least "
        "2 samples in a row, and many more for a fit or a diagnosis: give a longer log, or select more of it."
    )


def checked(dataset: xr.Dataset) -> xr.Dataset:
    """The dataset in the form that a Record promises, with units and names; raises if that is impossible."""
    if "time_s" not in dataset.coords or dataset["time_s"].dims != ("time_s",):
        raise ValueError(f"A record needs a coordinate time_s along a dimension time_s, got {list(dataset.coords)}.")
    time = vector("time_s", dataset["time_s"].values, None)
    if time.size < 2:
        raise ValueError(f"A record needs at least 2 samples, got {time.size}.")
    segment = dataset["segment"].values if "segment" in dataset.data_vars else None
    ids, labels = numbered(segment, time.size)
    given = dataset.attrs.get(LABELS)
    if given is not None and np.size(given) == len(labels):
        labels = [str(label) for label in np.atleast_1d(given)]
    check_time(time, ids)
    lengths = np.bincount(ids)
    if lengths.min() < 2:
        raise ValueError(f"Segment {int(np.argmin(lengths))} has a single sample: a segment needs at least 2.")
    variables: dict[str, Any] = {}
    for name, variable in dataset.data_vars.items():
        if not is_channel(str(name)):
            continue
        known, values = channel(str(name)), vector(str(name), variable.values, time.size)
        bad = ~np.isfinite(values)
        if known.needed and bad.any():
            row = int(np.argmax(bad))
            raise ValueError(
                f"Channel {name!r} has no finite value at row {row + 1} ({time[row]:.10g} s): build the record with "
                "Record.from_arrays, which fills short runs and cuts at long ones."
            )
        variables[str(name)] = ("time_s", values, {**variable.attrs, "units": known.unit, "long_name": known.label})
        if f"{name}{UNREAD}" in dataset:
            marks = dataset[f"{name}{UNREAD}"].values != 0
            words = {"long_name": f"1 where {known.label} was filled in between readings"}
            variables[f"{name}{UNREAD}"] = ("time_s", marks.astype(np.int8), words)
    variables["segment"] = ("time_s", ids, {"long_name": "segment"})
    coordinate = ("time_s", time, {"units": "s", "long_name": CHANNELS["time_s"].label})
    return dataset_of(variables, coordinate, {**dataset.attrs, LABELS: labels})


def saved_dataset(path: str | Path) -> xr.Dataset:
    """The dataset in a file that `Record.save` wrote; raises ValueError for any other file."""
    if not Path(path).is_file():
        raise ValueError(f"There is no file {path}: give the path of a record that Record.save wrote.")
    try:
        import xarray as xr

        dataset = xr.load_dataset(path, engine="h5netcdf", decode_times=False)
    except Exception as error:  # a damaged file may raise almost anything
        raise ValueError(f"{path} is not a NetCDF record, or is cut short ({error}): save it again.") from error
    if LABELS not in dataset.attrs or "time_s" not in dataset:
        raise ValueError(f"{path} was not written by Record.save: read it with read_record.")
    return dataset
