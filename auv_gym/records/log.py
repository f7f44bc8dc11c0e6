"""The content of a log file as read: named columns in groups that were sampled together."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.extra import how_to_install

Column = np.ndarray | list[str]
FIXES = "gps_fixes"  # attribute of a log: s since 1970, latitude and longitude, deg, of each fix, concatenated
MOST_ELEMENTS = 64  # of an array in a message; longer ones are images, scans or plots, not signals


def _silent(fraction: float, text: str) -> None:
    pass


@dataclass(frozen=True)
class Scope:
    """The part of a file that is needed.

    groups: the names of the groups whose samples are needed; None for all.  most: the number of samples per group that
    suffices for a first look at a large file; None for all.  beside: a folder with files that the log needs, if they
    are not in its own folder.  progress: called with a fraction from 0 to 1 and words.
    """

    groups: Collection[str] | None = None
    most: int | None = None
    beside: Path | None = None
    progress: Callable[[float, str], None] = _silent

    def wants(self, group: str) -> bool:
        """Whether the samples of this group are needed."""
        return self.groups is None or group in self.groups


@dataclass(frozen=True, eq=False)
class Group:
    """Columns that were sampled together: a table, a topic, a kind of message, a dimension of a NetCDF file.

    name: of the topic or the kind of message, '' for a table.
    columns: (n,) each, in the file's own units and frames, as numbers, or as text for labels and dates; by the complete
    name that a mapping uses: `rovio/thrusters[5]`, `ATT.Roll`, `eng_head`.
    time: s, (n,), in the order of the file, since 1970 or since the clock's start; None if a column of a table holds
    it.
    units: of the columns whose unit the file or its format states.
    type, frame: type and frame_id of a message, if it has them.
    rows: number of rows in the file, more than n if a `Scope` asked for fewer.  span: first and last time of all rows,
    s, if n is smaller.
    near: the longest time between samples, s, over which a measurement may be interpolated; None: the general rule.
    """

    name: str
    columns: Mapping[str, Column]
    time: np.ndarray | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    type: str = ""
    frame: str = ""
    rows: int = 0
    span: tuple[float, float] | None = None
    near: float | None = None

    def __post_init__(self) -> None:
        n = len(next(iter(self.columns.values()), ()))
        if any(len(column) != n for column in self.columns.values()) or (self.time is not None and len(self.time) != n):
            lengths = {name: len(column) for name, column in self.columns.items()}
            raise ValueError(f"The columns of the group {self.name!r} need one length, got {lengths}.")
        if not self.rows:
            object.__setattr__(self, "rows", n)


@dataclass(frozen=True, eq=False)
class Log:
    """The groups of a file, and its general attributes.

    format: in words, "ROS 1 bag".  attrs: kept in the record; numbers, text, or lists of these.
    notes: a line each on what the reader left out or mended, and why.
    label: of a file that is one segment of several, such as a dive.
    """

    format: str
    source: str
    groups: tuple[Group, ...]
    attrs: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    label: str = ""

    def column(self, name: str) -> tuple[Group, Column] | None:
        """A column and its group, or None if no group has a column of this name."""
        group = self.by_name.get(name)
        return None if group is None else (group, group.columns[name])

    @cached_property
    def by_name(self) -> dict[str, Group]:
        """The group of each column; the first one if several have the name."""
        found: dict[str, Group] = {}
        for group in self.groups:
            for name in group.columns:
                found.setdefault(name, group)
        return found

    @property
    def names(self) -> list[str]:
        """The names of all columns."""
        return [name for group in self.groups for name in group.columns]


@dataclass(frozen=True)
class Format:
    """A format of logs.

    name: in words, "ROS 1 bag".  endings: of its files, in lower case, with the dot; none for folders.
    recognises: quick check of whether a file has this format, by its path and first 4096 bytes (b"" for a folder).
    read: returns the log in a file, as far as the scope asks; raises ValueError with a sentence; imports what it needs.
    slow: whether a first look at a large file should ask for a sample instead of the whole file.
    general: whether it may recognise files of any kind, such as tables in text; it is tried last, and never for a file
    with the ending of another format.
    """

    name: str
    endings: tuple[str, ...]
    recognises: Callable[[Path, bytes], bool]
    read: Callable[[Path, Scope], Log]
    slow: bool = False
    general: bool = False


def array_columns(name: str, rows: Sequence[Any]) -> dict[str, np.ndarray]:
    """The elements of an array in each message, as columns `name[0]`, `name[1]`, ...; NaN where an array is shorter.

    Empty if the arrays have more than `MOST_ELEMENTS`.
    """
    longest = max((len(row) for row in rows), default=0)
    if longest > MOST_ELEMENTS:
        return {}
    table = np.full((len(rows), longest), np.nan)
    for k, row in enumerate(rows):
        table[k, : len(row)] = row
    return {f"{name}[{k}]": table[:, k].copy() for k in range(longest)}


class Untimed(ValueError):
    """Error: a log has no time, or the same one in all rows."""


class Empty(ValueError):
    """Error: none of a log's columns has a value."""


def missing_extra(what: str, package: str, extra: str) -> ValueError:
    """The error for a format whose package is not installed."""
    return ValueError(f"{what} are read by the package {package}, which is not installed; {how_to_install(extra)}.")
