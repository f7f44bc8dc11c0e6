"""Several files as one record: side by side where they are of one stretch of time, else one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from auv_gym.records.log import Log
from auv_gym.records.record import Record, concat


def side_by_side(found: Sequence[tuple[Path, Log | Record]]) -> list[tuple[Path, Log | Record]]:
    """The logs, two of one format and label as one where they hold different signals of the same time.

    So a glider's flight and science computers log the same segment.
    """
    result: list[tuple[Path, Log | Record]] = []
    for file, one in found:
        for at, (first, before) in enumerate(result):
            if isinstance(before, Log) and isinstance(one, Log) and _belong_together(before, one):
                taken = set(before.names)
                groups = [group for group in one.groups if not taken & set(group.columns)]
                notes = tuple(dict.fromkeys([*before.notes, *one.notes]))
                attrs = {**one.attrs, **before.attrs}
                both = replace(before, groups=(*before.groups, *groups), attrs=attrs, notes=notes)
                result[at] = (first, both)
                break
        else:
            result.append((file, one))
    return result


def _belong_together(one: Log, other: Log) -> bool:
    if not one.label or (one.format, one.label) != (other.format, other.label):
        return False
    shared = set(one.names) & set(other.names)
    if 2 * len(shared) > min(len(one.names), len(other.names)):  # another dive of the same number
        return False
    (start, stop), (first, last) = (_span_of(log) for log in (one, other))
    return first < stop and start < last


def _span_of(log: Log) -> tuple[float, float]:
    times = [group.time for group in log.groups if group.time is not None and np.isfinite(group.time).any()]
    return min((float(np.nanmin(t)) for t in times), default=0.0), max(
        (float(np.nanmax(t)) for t in times), default=0.0
    )


def one_after_the_other(records: list[Record]) -> Record:
    """One record of several files, on the clock of the first, with the channels that all of them have."""
    if len(records) == 1:
        return records[0]
    common = set.intersection(*(set(record.names) for record in records))
    others = sorted({name for record in records for name in record.names} - common)
    start = [float(record.attrs["start_epoch_s"]) for record in records if "start_epoch_s" in record.attrs]
    if len(start) == len(records):
        order = sorted(range(len(records)), key=start.__getitem__)
        records = [records[k].later(start[k] - start[order[0]]) for k in order]
    joined = concat([record.without([n for n in record.names if n not in common]) for record in records])
    everywhere = [line for line in records[0].notes if all(line in record.notes for record in records)]
    own = [f"{record.labels[0]}: {line}" for record in records for line in record.notes if line not in everywhere]
    left = [f"{name}: left out, since not all of the files have it." for name in others]
    dated = {key: value for key, value in records[0].attrs.items() if key == "start_epoch_s"}
    return joined.with_notes([*everywhere, *left, *own], **dated)


def labelled(record: Record, label: str) -> Record:
    """The record with a file's name as the label of its segments."""
    own = record.labels
    labels = [f"{label}, {text}" if text else label for text in own]
    return record.with_labels(labels)
