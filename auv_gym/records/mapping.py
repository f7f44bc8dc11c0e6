"""Mappings from columns of a file to channels: the user's own table, or those shipped for common sources.

A mapping renames, changes a sign, scales, shifts, or states a constant.  Nothing in it is evaluated.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from auv_gym.channels import CHANNELS, SEGMENT_COLUMNS, Channel, conversion, in_unit, is_flag, known_suffixes
from auv_gym.param import did_you_mean
from auv_gym.records.log import Group, Log
from auv_gym.records.naming import WORDS, is_commanded, nickname_of

MappingLike = Mapping[str, Any] | str | Path | None
YOURS = "your mapping"
NICKNAME = "a common name of it, and its unit"
OWN = "its name and unit"
FIELD = "its name in the message"
RULES = {YOURS: 1, OWN: 3, NICKNAME: 3, FIELD: 4}  # numbered as in docs/logs.md; 2 is for shipped mappings
TIMES = ("time_s", "time_ms", "time_min", "time_h")
DATED = frozenset({"time", "timestamp", "datetime", "date_time", "time_utc", "time_iso"})  # in lower case
_FEW, _MANY = 4, 25  # fields of a message listed in a note; most topics with a note each
# By the ending of a thruster's command: the values of full astern and full ahead.
FULL = {"us": (1100.0, 1900.0), "share": (-1.0, 1.0), "norm": (-1.0, 1.0), "pct": (-100.0, 100.0)}
_TURNED_FRAMES = ("_ned", "_frd")  # endings of a frame_id whose axes are those of our channels: forward or north first


@dataclass(frozen=True)
class Target:
    """The destination of a column: a channel's name with the unit of the numbers; value = factor * number + offset."""

    name: str
    factor: float = 1.0
    offset: float = 0.0

    def channel_and_values(self, values: np.ndarray, unit: str | None = None) -> tuple[Channel, np.ndarray]:
        """The channel, and the column's values in its unit.  unit: stated by the file; overrides the name's suffix."""
        found = conversion(self.name, unit)
        if self.factor != 1.0 or self.offset != 0.0:
            values = self.factor * values + self.offset
        return found.channel, found.convert(values)


@dataclass(frozen=True)
class Names:
    """A mapping: targets by column, and values of channels that were constant.

    title: the source of a shipped mapping.  needs: it fits if each of these lists has a column in the log.
    types: targets by message type and field.  only: whether columns without a target are left out.
    glides: whether its vehicles glide, so that their speed follows from depth and pitch.  vehicle: the preset of its
    vehicle.  formats: those that it is for, all if empty.
    """

    targets: Mapping[str, Target] = field(default_factory=dict)
    left_out: frozenset[str] = frozenset()
    constants: Mapping[str, float] = field(default_factory=dict)
    only: bool = False
    title: str = ""
    needs: tuple[tuple[str, ...], ...] = ()
    types: Mapping[str, Mapping[str, Target]] = field(default_factory=dict)
    glides: bool = False
    vehicle: str = ""
    formats: tuple[str, ...] = ()


def load_mapping(mapping: MappingLike) -> Names:
    """The user's mapping, from a table or the path of a flat TOML file; raises ValueError for anything unsupported."""
    if isinstance(mapping, (str, Path)):
        mapping = _toml(Path(mapping), f"The mapping {mapping}")
    if mapping is not None and not isinstance(mapping, Mapping):
        raise ValueError(
            "A mapping needs a dict from their columns to our channels, such as {'Hdg': 'heading_deg'}, or the path of "
            f"a TOML file, got {mapping!r}."
        )
    targets, left_out, constants = {}, set(), {}
    for theirs, ours in (mapping or {}).items():
        if isinstance(ours, (int, float)) and not isinstance(ours, bool):
            constants[theirs] = float(ours)
        elif ours == "":
            left_out.add(theirs)
        elif theirs == "*":
            raise ValueError("In a mapping '*' can only be '' (leave out all columns not named).")
        else:
            targets[theirs] = _target(theirs, ours)
    return Names(targets, frozenset(left_out - {"*"}), constants, "*" in left_out)


@cache
def shipped() -> tuple[Names, ...]:
    """The mappings for common sources in this package, in the order of their file names."""
    found = []
    for file in sorted(files("auv_gym.records").joinpath("mappings").iterdir(), key=lambda entry: entry.name):
        if file.name.endswith(".toml"):
            content = tomllib.loads(file.read_text(encoding="utf-8"))
            found.append(
                Names(
                    targets={theirs: _target(theirs, ours) for theirs, ours in content.get("names", {}).items()},
                    constants={name: float(value) for name, value in content.get("constants", {}).items()},
                    title=content["title"],
                    needs=tuple(tuple(names) for names in content["needs"]),
                    types={
                        kind: {name: _target(name, ours) for name, ours in of_kind.items()}
                        for kind, of_kind in content.get("types", {}).items()
                    },
                    glides=bool(content.get("glides", False)),
                    vehicle=content.get("vehicle", ""),
                    formats=tuple(content.get("formats", ())),
                )
            )
    return tuple(found)


@dataclass(frozen=True, eq=False)
class Source:
    """A column that becomes a channel: its place, its target, and the unit that the file states."""

    group: Group
    column: str
    target: Target
    unit: str | None = None
    by: str = OWN  # or YOURS, NICKNAME, FIELD, the title of a shipped mapping

    @property
    def channel(self) -> Channel:
        """The channel that it becomes; raises if the target's unit is unknown."""
        return conversion(self.target.name, self.unit).channel


def sources(log: Log, names: Names) -> tuple[list[Source], list[str]]:
    """The use of a log's columns: sources in order of preference, and a line for each column left out.

    First come the columns that the user's mapping names, then those of the shipped mappings that fit, then those whose
    own name and unit identify a channel, possibly within their topic or message if this is unique.
    Raises if the mapping names a column that does not exist.
    """
    found: list[Source] = []
    given: set[str] = set()
    for theirs, target in names.targets.items():
        if target.name in TIMES and log.column(theirs) is None and any(group.time is not None for group in log.groups):
            continue  # the reader already knows the time
        group, column = _named(log, theirs)
        found.append(Source(group, column, target, by=YOURS))
        given.add(column)
    for theirs in names.left_out:
        given |= {column for _, column, _ in _matches(log, theirs)}
    if names.only:
        return found, []
    for fitting in fitting_mappings(log):
        for source in _shipped_sources(log, fitting):
            if source.column not in given:
                found.append(source)
                given.add(source.column)
    notes, unnamed, nicknamed = [], {}, []
    fields = _fields(log, given)
    given |= {field.column for field in fields}
    for group in log.groups:
        rest = [column for column in group.columns if column not in given and column not in SEGMENT_COLUMNS]
        if _is_message(group, rest):
            unnamed |= {group.name: rest} if rest else {}
            continue
        for column in rest:
            try:
                source = _by_itself(group, column)
            except ValueError:
                notes.append(f"{column}: left out, since {_why(group, column)}.")
            else:
                (nicknamed if source.by == NICKNAME else found).append(source)
    found += [*fields, *nicknamed]  # a column with exactly the channel's name comes first
    return found, [*notes, *_on_unnamed(unnamed)]


def _is_message(group: Group, columns: Iterable[str]) -> bool:
    """Whether columns are fields of a topic, or of a kind of message."""
    return bool(group.name) and all(column.startswith(group.name) for column in columns)


def _fields(log: Log, given: set[str]) -> list[Source]:
    """Fields of topics and messages without a mapping whose own names identify one of our channels.

    None if several fields match one channel; a set point, such as `cmd/depth_m`, never counts as a measurement.
    """
    found: dict[str, list[Source]] = {}
    for group in log.groups:
        rest = [column for column in group.columns if column not in given]
        for column in rest if _is_message(group, rest) else ():
            parts = re.split(r"[./]", column)
            try:
                source = _by_itself(group, column, parts[-1])
            except ValueError:
                continue
            told = source.channel
            if told.name in CHANNELS and (told.kind in ("input", "command") or not is_commanded("/".join(parts[:-1]))):
                found.setdefault(told.name, []).append(replace(source, by=FIELD))
    return [own[0] for own in found.values() if len(own) == 1]


def _on_unnamed(unnamed: Mapping[str, list[str]]) -> list[str]:
    """A line on each topic or message with fields that no mapping names; a single line if there are many."""
    if len(unnamed) > _MANY:
        first = ", ".join(list(unnamed)[:_FEW])
        return [f"{len(unnamed):,} signals left out, since no mapping names them: {first}, ..."]
    lines = []
    for group, columns in unnamed.items():
        if columns == [group]:
            lines.append(f"{group}: left out, since no mapping names it.")
            continue
        few = ", ".join(name.removeprefix(group).lstrip(".") or name for name in columns[:_FEW])
        few += ", ..." if len(columns) > _FEW else ""
        counted = f"{len(columns)} column{'s' * (len(columns) != 1)} ({few})"
        lines.append(f"{group}: {counted} left out, since no mapping names {'it' if len(columns) == 1 else 'them'}.")
    return lines


def fitting_mappings(log: Log) -> list[Names]:
    """The shipped mappings that fit a log; those that name most of its columns come first."""
    if log not in _FITTING:
        fitting = [(len(list(_shipped_sources(log, names))), names) for names in shipped() if _fits(log, names)]
        _FITTING[log] = [names for count, names in sorted(fitting, key=lambda pair: -pair[0]) if count]
    return _FITTING[log]


_FITTING: WeakKeyDictionary[Log, list[Names]] = WeakKeyDictionary()  # cache, since several callers ask


def _fits(log: Log, names: Names) -> bool:
    if names.formats and log.format not in names.formats:
        return False
    if names.types and any(_of_type(log, kind) for kind in names.types):
        return True
    return bool(names.needs) and all(any(_matches(log, name) for name in choice) for choice in names.needs)


def _shipped_sources(log: Log, names: Names) -> Iterator[Source]:
    for theirs, target in names.targets.items():
        matches = _matches(log, theirs)
        if len(matches) == 1:  # below two namespaces, it would be ambiguous
            group, column, unit = matches[0]
            yield _source(group, column, target, unit, names.title)
    for kind, targets in names.types.items():
        groups = _of_type(log, kind)
        if groups:
            group = max(groups, key=lambda one: one.rows)
            for name, target in targets.items():
                column = f"{group.name}.{name}"
                if column in group.columns:
                    yield Source(group, column, target, None, f"{names.title}, {kind}")


def _of_type(log: Log, kind: str) -> list[Group]:
    name, _, turned = kind.partition("@")
    return [g for g in log.groups if g.type == name and g.frame.endswith(_TURNED_FRAMES) == bool(turned)]


def _source(group: Group, column: str, target: Target, unit: str | None, title: str) -> Source:
    """A source by a shipped mapping, in the unit that the file states if it is of the target's quantity."""
    stated = unit or group.units.get(column)
    if stated:
        try:
            if conversion(target.name, stated).channel == conversion(target.name).channel:
                return Source(group, column, target, stated, title)
        except ValueError:  # a unit of that format without a meaning here, such as 'nodim'
            pass
    return Source(group, column, target, None, title)


def _matches(log: Log, theirs: str) -> list[tuple[Group, str, str | None]]:
    """The columns that a name can mean: the exact name, one below a namespace, or one followed by its unit."""
    if theirs in log.by_name:
        return [(log.by_name[theirs], theirs, None)]
    plain = theirs.lstrip("/")
    below, spaced = "/" + plain, plain + " "
    names = [name for name in log.by_name if name == plain or name.endswith(below) or name.startswith(spaced)]
    found: list[tuple[Group, str, str | None]] = [(log.by_name[name], name, None) for name in names]
    for suffix in known_suffixes():
        name = f"{plain}_{suffix}"
        if name in log.by_name and not _is_ours(name):
            found.append((log.by_name[name], name, suffix))
    return found


def _named(log: Log, theirs: str) -> tuple[Group, str]:
    """The column that a user's mapping names; raises if there is none, or more than one."""
    found = [match for match in _matches(log, theirs) if match[2] is None]
    if not found:
        listed = list_of(log.names)
        raise ValueError(
            f"The mapping names the column {theirs!r}, which the file does not have. "
            f"{did_you_mean(theirs, log.names)}It has {listed}."
        )
    if len(found) > 1:
        raise ValueError(
            f"The mapping names {theirs!r}, which may be {list_of(name for _, name, _ in found)}: write one of them."
        )
    group, column, _ = found[0]
    return group, column


def _by_itself(group: Group, column: str, called: str = "") -> Source:
    """The source of a column whose own name, or its alias, identifies a channel; in the file's unit."""
    unit, name = group.units.get(column), called or column
    if unit in ("", "1", "nodim", "-"):
        unit = None
    bare = name.partition("[")[0].partition("(")[0] if name.endswith(("]", ")")) else name.removesuffix("%")
    plain = "_".join(bare.lower().split())
    nickname = _by_nickname(plain)
    known = [one for one in (name, plain, nickname) if one and is_known(one, unit)]
    target = next((one for one in known if conversion(one, unit).channel.name in CHANNELS), None)
    if target is None:  # a channel that we do not list, under its name without the unit in brackets
        target = plain if bare != name and plain in known else (known or [name])[0]
        target = nickname if nickname in known else target
    conversion(target, unit)
    return Source(group, column, Target(target), unit, by=NICKNAME if target == nickname else OWN)


def guessed(group: Group, column: str, channel: str) -> Target | None:
    """The target of a column that looks like a channel, in the unit that the file or its name states.

    None if it cannot be that channel: text, a flag, constant, or in a unit of another quantity.
    """
    values, plain = group.columns[column], "_".join(column.lower().split())
    if isinstance(values, list) or is_flag(plain):
        return None
    known = values[np.isfinite(values)]
    if group.rows <= values.size and not (known.size and np.ptp(known) > 0.0):
        return None
    unit, last = group.units.get(column), re.split(r"[\s_]", column)[-1]
    if not unit and last != column and plain not in WORDS.get(channel, ()):
        unit = last
    if not unit or not is_known("any", unit):
        return Target(channel)
    try:
        return Target(in_unit(channel, unit))
    except ValueError:
        return command_in(channel, "pct" if unit == "%" else unit)


def command_in(channel: str, unit: str) -> Target | None:
    """The target of a thruster's command in another unit; None if either unit is not in `FULL`."""
    wanted, given = FULL.get(channel.rpartition("_")[2]), FULL.get(unit)
    if wanted is None or given is None:
        return None
    factor = (wanted[1] - wanted[0]) / (given[1] - given[0])
    return Target(channel, factor, wanted[0] - factor * given[0])


def _by_nickname(plain: str) -> str:
    """The channel's name for a column with a common alias, keeping its unit suffix; '' if there is none."""
    stem, _, suffix = plain.rpartition("_")
    if own := nickname_of(plain):
        return own
    own = nickname_of(stem)
    return f"{own}_{suffix}" if own and suffix in known_suffixes() else ""


def _why(group: Group, column: str) -> str:
    """The reason why a column does not identify a channel by itself."""
    unit = group.units.get(column)
    if unit and is_known(column, None):
        return f"its unit by the file, {unit!r}, does not fit its name"
    if unit:
        return f"its unit {unit!r} is not known"
    stem, _, suffix = column.rpartition("_")
    if stem and suffix in known_suffixes():
        return f"{stem!r} cannot be in {suffix!r}"
    return "its unit is not known"


def _is_ours(name: str) -> bool:
    """Whether a column has exactly the name of one of our channels."""
    return is_known(name, None) and conversion(name).channel.name in CHANNELS


def is_known(name: str, unit: str | None) -> bool:
    """Whether a column with this name and unit is a signal with a known, suitable unit."""
    try:
        conversion(name, unit)
    except ValueError:
        return False
    return True


def _toml(path: Path, what: str) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(
            f"Cannot read the mapping {path}: {error.strerror}. Give a TOML file; `look --mapping-out` writes one."
        ) from error
    except ValueError as error:
        _check_twice(path, what)
        raise ValueError(f'{what} is not TOML ({error}): write lines such as "Hdg" = "heading_deg".') from error


def _check_twice(path: Path, what: str) -> None:
    """Raise ValueError if two lines of a mapping name the same column."""
    lines: dict[str, int] = {}
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        key = re.match(r"""\s*("(?:[^"\\]|\\.)*"|'[^']*'|[\w-]+)\s*=""", line)
        name = key[1].strip("\"'") if key else ""
        if name and lines.setdefault(name, number) != number:
            raise ValueError(f"{what} names {name!r} twice, in lines {lines[name]} and {number}: keep one of them.")


def _target(theirs: str, ours: Any) -> Target:
    """The target that a mapping gives for a column: a text, or a table with `to`, `factor` and `offset`."""
    if isinstance(ours, str) and ours.strip("-"):
        return Target(ours.removeprefix("-"), -1.0 if ours.startswith("-") else 1.0)
    if isinstance(ours, Mapping) and isinstance(ours.get("to"), str) and set(ours) <= {"to", "factor", "offset"}:
        numbers = {key: value for key, value in ours.items() if key != "to"}
        if all(isinstance(v, (int, float)) and not isinstance(v, bool) and np.isfinite(v) for v in numbers.values()):
            target = _target(theirs, ours["to"])
            factor = float(numbers.get("factor", 1.0))
            return replace(target, factor=target.factor * factor, offset=float(numbers.get("offset", 0.0)))
    raise ValueError(
        f'A mapping has one text per column, got {ours!r} for {theirs!r}: write "{theirs}" = "depth_m", a table '
        'such as { to = "depth_m", factor = 0.1, offset = -10.1 }, or a number for a channel of ours that was constant.'
    )


def list_of(names: Iterable[str], most: int = 40) -> str:
    """Names in quotes, separated by commas; if there are many, the rest as a count."""
    names = list(names)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(map(repr, names[:most])) or "none") + more
