"""Missing values in the channels of a record: filled in, dropped, or refused."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import listed

MAX_FILL = 3  # samples; longer runs of missing values are gaps
_FEWEST = 8  # readings that make a channel worth having
_COSTS = 0.1  # share of the samples; an optional channel is left out if it would cost more


def repaired(time: np.ndarray, values: np.ndarray, angle: bool, held: bool, max_fill: int) -> np.ndarray:
    """Values of one segment with angles unwrapped and short inner runs of NaN filled."""
    finite = np.isfinite(values)
    if finite.all() and not angle:
        return values
    known = np.flatnonzero(finite)
    if known.size == 0:
        return values
    result = values.copy()
    if angle:
        result[known] = np.unwrap(values[known])
    gaps = np.flatnonzero(np.diff(known) > 1)
    for gap in gaps[np.diff(known)[gaps] - 1 <= max_fill]:
        inner = slice(known[gap] + 1, known[gap + 1])
        ends = [known[gap], known[gap + 1]]
        result[inner] = result[ends[0]] if held else np.interp(time[inner], time[ends], result[ends])
    return result


def bridged(time: np.ndarray, values: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
    """A measurement, (n,), on straight lines across all missing values, and constant before and after its readings.

    A segment without any reading gets their median.  With fewer than `_FEWEST` readings, values stay missing.
    """
    known = np.isfinite(values)
    if known.sum() < _FEWEST:
        return values
    result = np.where(known, values, np.median(values[known]))
    for part in parts:
        own = known[part]
        if own.any():
            result[part] = np.interp(time[part], time[part][own], values[part][own])
    return result


def missing_samples(
    variables: Mapping[str, Any], size: int, required: Collection[str] | None
) -> tuple[np.ndarray, dict[str, str]]:
    """The samples to drop, since a required value is missing, and the channels that cost too much, with a line each.

    Channels that are not required are ordered by how much each has lost.
    """
    lost = {name: ~np.isfinite(values) for name, (_, values, _) in variables.items() if channel(name).needed}
    missing, costly = np.zeros(size, dtype=bool), {}
    for name, here in lost.items():
        if required is None or name in required:
            missing |= here
    if required is not None:
        for name in sorted(set(lost) - set(required), key=lambda one: (int(lost[one].sum()), list(lost).index(one))):
            cost, left = int((lost[name] & ~missing).sum()), int((~missing).sum())
            if cost > _COSTS * left:
                there = int((~lost[name] & ~missing).sum())
                costly[name] = (
                    f"{name}: left out, since it has values at {there:,} of {left:,} samples only; nothing requires it."
                )
            else:
                missing |= lost[name]
    return missing, costly


def on_dropped(variables: Mapping[str, Any], missing: np.ndarray) -> list[str]:
    """A line on the dropped samples and the channels without a value there; none if all samples are kept."""
    if not missing.any() or missing.all():
        return []
    lost = [n for n, (_, values, _) in variables.items() if channel(n).needed and not np.isfinite(values).all()]
    share = 100.0 * missing.mean()
    names = " or ".join(lost) if len(lost) < 3 else f"{', '.join(lost[:2])} or others"
    were = "was" if missing.sum() == 1 else "were"
    kept = np.flatnonzero(~missing)
    inside = missing[kept[0] : kept[-1]].any()
    what_then = "value; the record is cut there." if inside else "value, at the beginning or end of the record."
    dropped = f"{int(missing.sum()):,} of {missing.size:,} samples ({share:.2g} %) {were} dropped"
    return [f"{dropped}, where {names} had no {what_then}"]


def on_bridged(bridges: Mapping[str, np.ndarray]) -> list[str]:
    """A line on the channels, by name, that have no values in the samples of a mask, (n,), which are kept."""
    groups: dict[bytes, list[str]] = {}
    for name, mask in bridges.items():
        groups.setdefault(mask.tobytes(), []).append(name)
    lines = []
    for names in groups.values():
        mask = bridges[names[0]]
        share, has = 100.0 * mask.mean(), "has" if len(names) == 1 else "have"
        lines.append(
            f"{listed(names)} {has} no value in {int(mask.sum()):,} of {mask.size:,} samples ({share:.2g} %), which "
            "are used without it."
        )
    return lines


def check_runs(name: str, time: np.ndarray, values: np.ndarray, max_fill: int) -> None:
    """Raise ValueError if more than `max_fill` consecutive values are missing."""
    missing = np.flatnonzero(~np.isfinite(values))
    for run in np.split(missing, np.flatnonzero(np.diff(missing) > 1) + 1):
        if run.size > max_fill:
            raise ValueError(
                f"Channel {name!r} has no value in {run.size} rows, {run[0] + 1} to {run[-1] + 1} "
                f"({time[run[0]]:.10g} to {time[run[-1]]:.10g} s); up to {max_fill} in a row are filled in. "
                "Remove these rows, or cut the record there (long_runs='cut', or no --refuse-gaps)."
            )
