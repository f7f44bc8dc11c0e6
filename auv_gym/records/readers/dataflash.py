"""Dataflash logs, as written by the autopilots of ArduPilot vehicles (ArduSub); each log defines its messages.

Times are s since boot, in the order of the rows.  Source: ArduPilot, libraries/AP_Logger (LogStructure.h, README.md).
"""

from __future__ import annotations

import mmap
import re
import struct
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from auv_gym.records.log import Format, Group, Log, Scope
from auv_gym.records.readers.ardupilot import (
    UNITS,
    Number,
    Search,
    pieces_of,
    refusing,
    servo_functions,
    structures,
    text_of,
)
from auv_gym.records.readers.opening import mapped

_MARK = b"\xa3\x95"
_FMT = 0x80
_FMT_BODY = struct.Struct("<BB4s16s64s")
# format character -> type, and divisor of the number
_CODES: Final[dict[str, tuple[str, float]]] = {
    "b": ("i1", 1.0), "B": ("u1", 1.0), "M": ("i1", 1.0), "h": ("<i2", 1.0), "H": ("<u2", 1.0), "i": ("<i4", 1.0),
    "I": ("<u4", 1.0), "q": ("<i8", 1.0), "Q": ("<u8", 1.0), "g": ("<f2", 1.0), "f": ("<f4", 1.0), "d": ("<f8", 1.0),
    "c": ("<i2", 100.0), "C": ("<u2", 100.0), "e": ("<i4", 100.0), "E": ("<u4", 100.0), "L": ("<i4", 1e7),
    "n": ("S4", 1.0), "N": ("S16", 1.0), "Z": ("S64", 1.0), "a": ("S64", 1.0),
}  # fmt: skip
_PREFIXES: Final = {1e-1: "d", 1e-2: "c", 1e-3: "m", 1e-6: "u", 1e-9: "n"}
_MOST_DEFINITIONS = 1 << 14  # most messages of these types that are read; there are 256 units, some 1500 parameters
_DEFINING: Final = ("FMT", "FMTU", "UNIT", "MULT", "PARM", "MSG", "FILE")  # definitions, parameters and text
_GPS_EPOCH = 315_964_800.0  # s since 1970, of 6 January 1980
_LEAP_SECONDS, _LEAP_WEEK = 18, 1930  # since the week of 1 January 2017; a receiver with an earlier week is wrong


@dataclass(frozen=True)
class _Kind:
    """A type of messages, as the log defines it."""

    name: str
    codes: str
    fields: tuple[str, ...]
    length: int
    units: dict[str, tuple[str, float]] = field(default_factory=dict)  # unit, and the factor to it
    instance: str = ""

    @property
    def dtype(self) -> np.dtype:
        """The structure, after a header of three bytes, with the log's field names."""
        return np.dtype([(" head", "V3"), *((name, _CODES[code][0]) for name, code in zip(self.fields, self.codes))])

    @property
    def usable(self) -> bool:
        """Whether the definition can be read: a known format, one name per field, and a matching length."""
        known = all(code in _CODES for code in self.codes) and len(self.fields) == len(self.codes)
        named = all(map(str.isidentifier, self.fields)) and len(set(self.fields)) == len(self.fields)
        return known and named and self.dtype.itemsize == self.length

    @property
    def clock(self) -> tuple[str, float]:
        """The field with the time since boot, and its unit in s; ('', 0) if there is none."""
        for name, unit in (("TimeUS", 1e-6), ("TimeMS", 1e-3)):
            if name in self.fields and _CODES[self.codes[self.fields.index(name)]][0][0] != "S":
                return name, unit
        return "", 0.0

    def columns(self, prefix: str) -> dict[str, Number]:
        """Its numeric fields, by the name of the column."""
        columns: dict[str, Number] = {}
        for name, code in zip(self.fields, self.codes):
            if _CODES[code][0].startswith("S") or name in (self.instance, self.clock[0]):
                continue
            unit, factor = self.units.get(name, ("", 1.0))
            output = bool(self.name.startswith("RCO") and re.fullmatch(r"C\d+", name))
            columns[f"{prefix}.{name}"] = Number(name, None, unit, _CODES[code][1], factor, output)
        return columns


@dataclass
class _Contents:
    """The messages of a dataflash log: definitions, and starts of messages, by the type byte."""

    kinds: dict[int, _Kind]
    starts: list[array]
    notes: list[str]

    def named(self, name: str) -> tuple[_Kind, np.ndarray] | None:
        """A type that is defined and occurs in the log."""
        for byte, kind in self.kinds.items():
            if kind.name == name and kind.usable and self.starts[byte]:
                return kind, np.frombuffer(self.starts[byte], np.int64)
        return None

    def table(self, data: np.ndarray, name: str, *fields: str) -> np.ndarray | None:
        """The first messages of a type, raw; None if there are none with all of these fields."""
        found = self.named(name)
        if found is None or not set(fields) <= set(found[0].fields):
            return None
        return structures(data, found[1][:_MOST_DEFINITIONS], found[0].dtype)


def _recognises(path: Path, head: bytes) -> bool:
    return head.startswith(_MARK) and len(head) >= 5 and head[2] == _FMT and head[89:91] in (_MARK, b"", _MARK[:1])


def _read(path: Path, scope: Scope) -> Log:
    """Groups `ATT`, `IMU[0]`, ... with columns `ATT.Roll`; time since boot.

    The attribute start_epoch_s is the time since 1970 at which that clock was 0, from the first fix of the GPS;
    servo_functions has the parameter SERVOn_FUNCTION of each output.
    """
    content = mapped(path)
    data = np.frombuffer(content, np.uint8)
    contents = _indexed(content, scope.progress)
    if not any(contents.starts):
        raise ValueError(
            f"{path} is no dataflash log of ArduPilot, which begins with the bytes a3 95 80: give a .bin from the "
            "autopilot, or check what this file is."
        )
    _add_units(contents, data)
    groups: list[Group] = []
    names: set[str] = set()
    timeless: list[str] = []
    kinds = [(byte, kind) for byte, kind in contents.kinds.items() if contents.starts[byte]]
    for done, (byte, kind) in enumerate(kinds):
        scope.progress(0.5 + 0.5 * done / len(kinds), f"decoding {kind.name}")
        if kind.name in _DEFINING:
            continue
        if not kind.usable or not kind.clock[0] or kind.name in names:
            timeless.append(kind.name)
            continue
        names.add(kind.name)
        groups += _groups(kind, np.frombuffer(contents.starts[byte], np.int64), data, scope)
    if timeless:
        contents.notes.append(
            f"Left out {', '.join(timeless)}: no time, a second definition, or a format that is not known."
        )
    if not names:
        raise ValueError(
            f"{path} has the head of a dataflash log but no messages with a time after it ({data.size} bytes): copy "
            "it from the autopilot again."
        )
    return Log("ArduPilot dataflash log", path.name, tuple(groups), _attrs(contents, data), tuple(contents.notes))


def _indexed(content: mmap.mmap, progress: Callable[[float, str], None]) -> _Contents:
    """The starts of messages; a message counts if another one, or the end of the file, follows it."""
    kinds = {_FMT: _Kind("FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"), 89)}
    lengths = [0] * 256
    lengths[_FMT] = 89
    starts = [array("q") for _ in range(256)]
    size, notes = len(content), []
    search = Search(size, progress)
    at, due = content.find(_MARK), 0
    while 0 <= at <= size - 3:
        byte = content[at + 2]
        end = at + lengths[byte]
        if end > at and end <= size and content[end : end + 2] == _MARK[: size - end]:
            if byte == _FMT:
                new, kind = _definition(content[at + 3 : end])
                if kind.length < 3 or kinds.get(new, kind) != kind:
                    notes.append(f"From byte {at} on, types of messages change their meaning: left out from there.")
                    at = size
                    break
                kinds[new], lengths[new] = kind, kind.length
            starts[byte].append(at)
            at = end
            if at >= due:
                due = search.reached(at)
            continue
        if end > size:
            break
        following = -1 if search.misses() else content.find(_MARK, at + 1)
        following = size if following < 0 else following
        search.passes(at, following)
        at = following
    return _Contents(kinds, starts, notes + search.notes(size if at < 0 else at))


def _definition(body: bytes) -> tuple[int, _Kind]:
    byte, length, name, codes, fields = _FMT_BODY.unpack(body)
    names = tuple(text_of(fields).split(",")) if text_of(fields) else ()
    return byte, _Kind(text_of(name), text_of(codes), names, length)


def _add_units(contents: _Contents, data: np.ndarray) -> None:
    """Add units and instances from the log's own UNIT, MULT and FMTU messages."""
    units = contents.table(data, "UNIT", "Id", "Label")
    factors = contents.table(data, "MULT", "Id", "Mult")
    of_kinds = contents.table(data, "FMTU", "FmtType", "UnitIds", "MultIds")
    if units is None or of_kinds is None:
        return
    labels = {chr(int(row["Id"]) & 0xFF): text_of(row["Label"]) for row in units}
    # some versions log 0.01 as a single-precision number, 0.0099999998
    mults = {} if factors is None else {chr(int(row["Id"]) & 0xFF): float(f"{row['Mult']:.7g}") for row in factors}
    for row in of_kinds:
        kind = contents.kinds.get(int(row["FmtType"]))
        if kind is None or not kind.usable:
            continue
        found: dict[str, tuple[str, float]] = {}
        unit_ids = text_of(row["UnitIds"])
        for name, code, unit, mult in zip(kind.fields, kind.codes, unit_ids, text_of(row["MultIds"]).ljust(16)):
            label = labels.get(unit, "")
            if unit not in "-?#" and label:
                found[name] = _unit_of(label, 1.0 if _CODES[code][1] != 1.0 else mults.get(mult, 1.0))
        marked = unit_ids.find("#")
        instance = kind.fields[marked] if 0 <= marked < len(kind.fields) else ""
        contents.kinds[int(row["FmtType"])] = replace(kind, units=found, instance=instance)


def _unit_of(label: str, mult: float) -> tuple[str, float]:
    """The unit and factor for a label and the multiplier that FMTU states."""
    ours = UNITS.get(label, (label, 1.0))[0]
    if mult in _PREFIXES:
        prefix = _PREFIXES[mult]
        return UNITS.get(prefix + label, UNITS.get(prefix + ours, (prefix + ours, 1.0)))
    return ours, mult if mult > 0.0 else 1.0


def _groups(kind: _Kind, starts: np.ndarray, data: np.ndarray, scope: Scope) -> Iterator[Group]:
    """The group of a type of messages, or one for each of its instances."""
    parts = [(kind.name, starts)]
    code = _CODES[kind.codes[kind.fields.index(kind.instance)]][0] if kind.instance else ""
    if kind.instance and code[-2] in "iu":
        instance = _decoded(data, starts, kind.dtype, {"": Number(kind.instance)})[""]
        parts = [(f"{kind.name}[{value}]", starts[instance == value]) for value in np.unique(instance)]
    name, unit = kind.clock
    for group, at in parts:
        columns = kind.columns(group)
        if not columns or not scope.wants(group):
            continue
        ends = structures(data, at[[0, -1]], kind.dtype)[name] * unit
        few = at[: scope.most]
        values = _decoded(data, few, kind.dtype, {"": Number(name), **columns})
        yield Group(
            group,
            {name: column for name, column in values.items() if name},
            values[""] * unit,
            {name: column.unit for name, column in columns.items() if column.unit},
            kind.name,
            rows=at.size,
            span=(float(ends[0]), float(ends[1])) if few.size < at.size else None,
        )


def _decoded(
    data: np.ndarray, starts: np.ndarray, dtype: np.dtype, columns: dict[str, Number]
) -> dict[str, np.ndarray]:
    parts: dict[str, list[np.ndarray]] = {name: [] for name in columns}
    for piece in pieces_of(starts):
        rows = structures(data, piece, dtype)
        for name, column in columns.items():
            parts[name].append(column.of(rows))
    return {name: np.concatenate(part) for name, part in parts.items()}


def _attrs(contents: _Contents, data: np.ndarray) -> dict[str, Any]:
    attrs: dict[str, Any] = {}
    parameters = contents.table(data, "PARM", "Name", "Value")
    if parameters is not None:
        attrs |= servo_functions((text_of(row["Name"]), float(row["Value"])) for row in parameters)
    fixes = contents.table(data, "GPS", "TimeUS", "Status", "GMS", "GWk")
    if fixes is not None:
        fixes = fixes[(fixes["Status"] >= 3) & (fixes["GWk"] >= _LEAP_WEEK)]
        if fixes.size:
            since = 604_800.0 * fixes["GWk"][0] + 1e-3 * fixes["GMS"][0] - _LEAP_SECONDS
            attrs["start_epoch_s"] = float(_GPS_EPOCH + since - 1e-6 * fixes["TimeUS"][0])
    return attrs


FORMAT = Format("ArduPilot dataflash log", (".bin",), _recognises, refusing(_read), slow=True)
