"""The columns of a log as channels: which column each channel is taken from, in which unit, and on whose times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from auv_gym.channels import SEGMENT_COLUMNS, conversion, is_flag
from auv_gym.records.clocks import Clock, clocks_of
from auv_gym.records.completing import completed
from auv_gym.records.log import Column, Group, Log
from auv_gym.records.mapping import YOURS, Names, Source, fitting_mappings, sources
from auv_gym.records.readers.text import numbers_or_text
from auv_gym.records.streams import Stream

NO_VALUE = "samples has a value."  # the end of a note on an empty column
_EPOCH_FROM = 1e8  # s; larger times count from 1970 and are shifted to start at zero


@dataclass(frozen=True)
class Needs:
    """The channels that a vehicle takes from a log.

    required: the channels that it needs, the leading one first.  wanted: others that it can use.  spare: measurements
    that may be missing for any time; angles are not, since they might turn unseen.
    attack: function from pitch to the angle of attack of its steady glide, both rad, if it has a lift model.
    """

    required: tuple[str, ...] = ()
    wanted: tuple[str, ...] = ()
    spare: frozenset[str] = frozenset()
    attack: Callable[[np.ndarray], np.ndarray] | None = None


@dataclass(frozen=True, eq=False)
class Understood:
    """A log with its columns as channels, each group on its own times.

    by_channel: the sources of each channel, those in use first.  notes: what was left out or mended, a line each.
    constants: channels that did not change and were not logged.  clocks: of groups without times of their own.
    derived: how each derived channel was computed.  glides: see `Names`.  epoch: the time of zero, s since 1970, if
    known.
    """

    log: Log
    streams: list[Stream]
    by_channel: dict[str, list[Source]]
    constants: dict[str, float]
    clocks: dict[str, Clock]
    derived: dict[str, str]
    notes: list[str] = field(default_factory=list)
    glides: bool = False
    epoch: float | None = None


def understood(log: Log, names: Names, needs: Needs) -> Understood:
    """The columns of a log as channels; raises if the mapping does not fit the log, or if no column holds time."""
    notes = list(log.notes)
    clocks = clocks_of(log, names, notes)
    held = {column for clock in clocks.values() for column in clock.columns}
    taken = replace(names, left_out=names.left_out | held)
    found, left_out = sources(log, taken)
    notes += left_out
    constants = _constants(log, names, found)
    values, by_channel = _chosen(found, needs, held, notes)
    streams, epoch = [], None
    for group in log.groups:
        own = values.get(id(group), {})
        if not own or (group.time is None and group.name not in clocks):
            continue
        time = np.asarray(clocks[group.name].times if group.time is None else group.time, dtype=float)
        dated = group.time is None and bool(np.nanmin(time, initial=np.inf) > _EPOCH_FROM)
        streams.append(Stream(time, own, group.name, _labels(group, found), group.near, dated))
    finite = [float(np.nanmin(s.time)) for s in streams if np.isfinite(s.time).any()]
    if finite and max(finite) > _EPOCH_FROM:
        epoch = min(value for value in finite if value > _EPOCH_FROM)
        streams = [replace(stream, time=stream.time - epoch) for stream in streams]
    streams, derived = completed(streams, constants, notes)
    glides = any(fitting.glides for fitting in fitting_mappings(log))
    return Understood(log, streams, by_channel, constants, clocks, derived, notes, glides, epoch)


def _chosen(
    found: Sequence[Source], needs: Needs, clocks: set[str], notes: list[str]
) -> tuple[dict[int, dict[str, np.ndarray]], dict[str, list[Source]]]:
    """Values by group and channel, from the first source of each channel that has any; the others are noted."""
    values: dict[int, dict[str, np.ndarray]] = {}
    by_channel: dict[str, list[Source]] = {}
    empty: dict[str, str] = {}
    for source in found:
        name, column = source.channel.name, source.group.columns[source.column]
        no_signal = source.column in clocks or source.channel.kind == "time" or name in SEGMENT_COLUMNS
        if no_signal or (is_flag(name) and isinstance(column, list)):
            continue
        first = by_channel.setdefault(name, [])
        if first:
            if source.by == YOURS == first[0].by:
                raise ValueError(
                    f"Two columns come in as {source.target.name!r}: map one of them to another channel, or to ''."
                )
            notes.append(f"{source.column}: left out, since {name} is taken from {first[0].column}.")
            first.append(source)
            continue
        if isinstance(column, list):
            cell, row = _first_text(column)
            if source.by == YOURS or name in needs.required:
                raise ValueError(
                    f"Column {source.column!r} needs numbers, got {cell!r} at row {row} below the header: correct the "
                    "cells, or map the column to '' to leave it out."
                )
            notes.append(f"{source.column}: left out, since it holds text ({cell!r} at row {row}).")
            continue
        _, converted = source.target.channel_and_values(column.astype(np.float64), source.unit)
        if not np.isfinite(converted).any():
            empty[name] = f"any of its {converted.size} samples (column {source.column!r})"
            notes.append(f"{source.column}: left out, since none of its {converted.size:,} {NO_VALUE}")
            continue
        first.append(source)
        values.setdefault(id(source.group), {})[name] = converted
    for name in needs.required:
        if name in empty and not by_channel[name]:
            raise ValueError(f"Channel {name!r} has no value in {empty[name]}: check the log, or map another column.")
    return values, {name: of for name, of in by_channel.items() if of}


def _first_text(column: list[str]) -> tuple[str, int]:
    """The first cell that is not a number, and its row, counted from 1."""
    row = next(row for row, cell in enumerate(column) if isinstance(numbers_or_text([cell]), list))
    return column[row], row + 1


def _constants(log: Log, names: Names, found: Sequence[Source]) -> dict[str, float]:
    """Constant channels that were not logged, in SI: from the user's mapping, the shipped ones, or the file."""
    logged = {source.channel.name for source in found}
    constants: dict[str, float] = {}
    stated = {key: value for key, value in log.attrs.items() if key in ("latitude_deg", "magnetic_variation_deg")}
    shipped = {key: value for fitting in fitting_mappings(log) for key, value in fitting.constants.items()}
    for given, strict in ((stated, False), (shipped, False), (names.constants, True)):
        for name, value in given.items():
            target, convert = conversion(name)
            if target.name in logged:
                if strict:
                    raise ValueError(
                        f"The mapping makes {name!r} constant, but the file has it: leave it out of the mapping."
                    )
                continue
            constants[target.name] = float(convert(np.array([float(value)]))[0])
    return constants


def _labels(group: Group, found: Sequence[Source]) -> np.ndarray | None:
    """A label per row, from the columns that divide a table."""
    by_target = {s.target.name: s.column for s in found if s.group is group and s.target.name in SEGMENT_COLUMNS}
    columns = [by_target.get(name, name) for name in SEGMENT_COLUMNS]
    return joined_labels([group.columns[name] for name in columns if name in group.columns])


def joined_labels(columns: list[Column]) -> np.ndarray | None:
    """One label per sample from the columns that divide a file; a change in any of them begins a segment."""
    if not columns:
        return None
    if len(columns) == 1 and not isinstance(columns[0][0], str) and not np.isfinite(columns[0]).all():
        return np.asarray(columns[0])  # refused by row where it divides a record
    text = [[_as_label(cell) for cell in column] for column in columns]
    return np.array(["/".join(labels) for labels in zip(*text, strict=True)])


def _as_label(cell: Any) -> str:
    """The text of a cell; the dives 1 and 1.0 of two files are the same one."""
    if isinstance(cell, str):
        return cell
    return f"{int(cell)}" if float(cell).is_integer() else f"{cell:g}"
