"""Several files as one record: side by side if they cover the same time, otherwise one after another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from auv_gym.records.log import Log
from auv_gym.records.record import Record, concat

_VEHICLE = "platform_id"  # attribute of a log with the name of its vehicle
_SHARED = 0.5  # of the shorter log's samples: two logs that share more have the same content
_OVERLAP = 0.1  # of the shorter log's duration; a log that continues another may begin a little earlier


def side_by_side(found: Sequence[tuple[Path, Log | Record]]) -> list[tuple[Path, Log | Record]]:
    """The logs, with two of one format and label merged if they hold different signals of the same time.

    This applies to a glider's flight and science computers, which log the same segment.
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
    if 2 * len(shared) > min(len(one.names), len(other.names)):  # another dive with the same number
        return False
    (start, stop), (first, last) = (_span_of(log) for log in (one, other))
    return first < stop and start < last


def _span_of(log: Log) -> tuple[float, float]:
    times = [group.time for group in log.groups if group.time is not None and np.isfinite(group.time).any()]
    return min((float(np.nanmin(t)) for t in times), default=0.0), max(
        (float(np.nanmax(t)) for t in times), default=0.0
    )


def check_apart(records: Sequence[tuple[str, Record]]) -> None:
    """Raise ValueError if two named logs hold the same evidence, or belong to different vehicles.

    The evidence is the same if segments agree in all values of the channels that all logs have, or if dated logs
    overlap in time.
    """
    if len(records) < 2:
        return
    common = sorted(set.intersection(*(set(record.names) for _, record in records)))
    known = [(name, record, _lengths_by_content(record, common)) for name, record in records]
    for (name, one, held), (name_2, two, held_2) in combinations(known, 2):
        vehicle, vehicle_2 = one.attrs.get(_VEHICLE), two.attrs.get(_VEHICLE)
        if vehicle and vehicle_2 and vehicle != vehicle_2:
            raise ValueError(
                f"Logs of one vehicle are needed, but {name} is of {vehicle} and {name_2} is of {vehicle_2}: give the "
                "logs of one of them."
            )
        if sum(held[key] for key in held.keys() & held_2.keys()) > _SHARED * min(len(one), len(two)):
            twice = f"{name} was given twice" if name == name_2 else f"{name} and {name_2} hold the same samples"
            raise ValueError(f"{twice}, which would count as twice the evidence: give each log once.")
        overlap = _overlap(one, two)
        if overlap > _OVERLAP * min(one.duration_s, two.duration_s):
            raise ValueError(
                f"{name} and {name_2} overlap in time by {overlap:.0f} s, and what happened then would count twice: "
                "leave one of them out, or correct their clocks."
            )


def _lengths_by_content(record: Record, names: Sequence[str]) -> dict[bytes, int]:
    """The number of samples of each segment, by its values of these channels; empty without channels."""
    values = record.matrix(names)
    return {values[s].tobytes(): s.stop - s.start for s in record.segments} if names else {}


def _overlap(one: Record, other: Record) -> float:
    """The time that segments of two logs overlap, s; 0 if not both have a date."""
    spans = []
    for record in (one, other):
        begin, time = float(record.attrs.get("start_epoch_s", np.nan)), record.time
        spans.append(begin + np.array([(time[s.start], time[s.stop - 1]) for s in record.segments]))
    own, others = spans[0][:, None], spans[1][None]
    shared = np.minimum(own[..., 1], others[..., 1]) - np.maximum(own[..., 0], others[..., 0])
    return float(np.nansum(np.maximum(shared, 0.0)))


def one_after_the_other(records: list[Record]) -> Record:
    """One record of several files on the clock of the first, with the channels common to all of them."""
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


def labels_of(logs: Sequence[tuple[Path, str]]) -> list[str]:
    """The names of logs: the label or the file's name, with the folder if two are the same."""
    names = [label or file.name for file, label in logs]
    return [
        f"{file.parent.name}/{name}" if names.count(name) > 1 else name
        for (file, _), name in zip(logs, names, strict=True)
    ]


def labelled(record: Record, label: str) -> Record:
    """The record with a file's name as the label of its segments."""
    own = record.labels
    labels = [f"{label}, {text}" if text else label for text in own]
    return record.with_labels(labels)
