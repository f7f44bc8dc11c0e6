"""Decoding of ROS messages into columns of numbers, thousands of messages at a time.

Source: OMG DDS-XTypes 1.3, sec. 7.4.1 (CDR, which ROS 2 writes); wiki.ros.org/msg (ROS 1, the same without padding).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from auv_gym.records.log import MOST_ELEMENTS
from auv_gym.records.readers.ros_types import (
    HEADER,
    LAYOUT,
    MAY_BE_UNKNOWN,
    TIMES,
    UNITS,
    Block,
    Topic,
    Types,
    Unreadable,
)

_MOST_STEPS = 20_000  # through the fields of one message; a message with more is not a signal
_NUMBERS = {
    "bool": "u1", "byte": "u1", "char": "u1", "octet": "u1", "int8": "i1", "uint8": "u1", "int16": "i2",
    "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip


def from_bytes(topic: Topic, types: Types, raws: Sequence[bytes], received: np.ndarray) -> Block:
    """The columns of messages; messages with the same layout are decoded together."""
    n = len(raws)
    good = np.zeros(n, dtype=bool)
    stamps = np.full(n, np.nan)
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    long: set[str] = set()
    unknown: set[str] = set()
    frame, covariances = "", False
    sizes = np.fromiter(map(len, raws), dtype=np.int64, count=n)
    for size in np.unique(sizes):
        rows = np.flatnonzero(sizes == size)
        table = np.frombuffer(b"".join([raws[row] for row in rows.tolist()]), dtype=np.uint8).reshape(rows.size, size)
        while rows.size:
            try:
                walk = _Walk(raws[int(rows[0])], topic, types)
            except (ValueError, RecursionError):
                rows, table = rows[1:], table[1:]
                continue
            starts = [0] * (topic.encoding == "cdr") + walk.lengths
            fixed = np.array([at + k for at in starts for k in range(4)], dtype=np.int64)
            alike = (table[:, fixed] == table[0, fixed]).all(axis=1)
            mine, part = rows[alike], table[alike]
            good[mine] = True
            for numbers in walk.numbers:
                values = numbers.values(part)
                for k, name in enumerate(numbers.names):
                    columns.setdefault(name, np.full(n, np.nan))[mine] = values[:, k]
                    if numbers.unit:
                        units[name] = numbers.unit
            for first in walk.known:
                not_known = mine[first.values(part)[:, 0] == -1.0]
                for name in columns:
                    if name.startswith(f"{first.name}."):
                        columns[name][not_known] = np.nan
                        unknown |= {first.name} if not_known.size else set()
            if walk.stamp is not None:
                stamps[mine] = walk.stamp.values(part)[:, 0]
            long |= walk.long
            frame = frame or walk.frame
            covariances |= walk.covariances
            rows, table = rows[~alike], table[~alike]
    columns = {name: column[good] for name, column in columns.items()}
    return Block(received[good], stamps[good], columns, units, frame, long, unknown, covariances)


class _Numbers(NamedTuple):
    """The position of a number, or of the elements of an array (count is not None), in a message."""

    name: str
    offset: int
    dtype: str
    count: int | None
    unit: str

    @property
    def names(self) -> list[str]:
        return [self.name] if self.count is None else [f"{self.name}[{k}]" for k in range(self.count)]

    def values(self, table: np.ndarray) -> np.ndarray:
        """Its values, (messages, count), in messages given as rows of bytes."""
        if self.dtype.endswith("time"):
            parts = [
                np.ascontiguousarray(table[:, at : at + 4]).view(f"{self.dtype[0]}{kind}").astype(float)
                for at, kind in ((self.offset, "i4"), (self.offset + 4, "u4"))
            ]
            return parts[0] + 1e-9 * parts[1]
        size = np.dtype(self.dtype).itemsize * (1 if self.count is None else self.count)
        part = np.ascontiguousarray(table[:, self.offset : self.offset + size])
        return part.view(self.dtype).astype(float)


class _Walk:
    """A walk through the bytes of one message that finds the positions of its numbers.

    lengths: positions of the lengths of its strings and arrays; messages with the same lengths have the same layout.
    Raises ValueError if the bytes do not match the definition.
    """

    def __init__(self, raw: bytes, topic: Topic, types: Types) -> None:
        self._raw = raw
        self._types = types
        self._cdr = topic.encoding == "cdr"
        self._start = self._pos = 4 if self._cdr else 0
        self._steps = 0
        self._order = "<"
        self.lengths: list[int] = []
        self.numbers: list[_Numbers] = []
        self.known: list[_Numbers] = []  # by the name of a field, the number that is -1 if the field is unknown
        self.long: set[str] = set()
        self.stamp: _Numbers | None = None
        self.frame = ""
        self.covariances = False
        if self._cdr:
            if len(raw) < 4 or raw[0] != 0:
                raise ValueError("no encapsulation")
            if raw[1] > 1:
                raise Unreadable("its messages are in a CDR encoding other than that of ROS 2")
            self._order = "<" if raw[1] else ">"
        self._may_be_unknown = topic.type in MAY_BE_UNKNOWN
        fields = self._fields(topic.type)
        alone = [name for name, what in fields if what[1] not in (HEADER, LAYOUT)] == ["data"]
        for name, what in fields:
            path = topic.name if alone and name == "data" else f"{topic.name}.{name}"
            header = name == "header" and what[1] == HEADER
            self._field(path, what, UNITS.get(topic.type, {}).get(name, ""), name.endswith("covariance"), header)
        if not 0 <= len(raw) - self._pos < (4 if self._cdr else 1):
            raise ValueError("longer or shorter")

    def _fields(self, kind: str) -> Sequence[tuple[str, Any]]:
        if kind not in self._types:
            raise Unreadable(f"its type {kind} is defined neither in the file nor by ROS")
        return self._types[kind]

    def _field(self, path: str, what: Any, unit: str, quiet: bool, header: bool = False) -> None:
        """Step over a field; quiet: without recording its numbers; header: whether it is the message's header."""
        self._steps += 1
        if self._steps > _MOST_STEPS:
            raise Unreadable(f"a message of it has more than {_MOST_STEPS} fields")
        node, detail = int(what[0]), what[1]
        if quiet and path.endswith("covariance"):
            self.covariances = True
        if node == 1:
            self._base(path, detail[0], unit, quiet)
        elif node == 2:
            self._message(path, detail, unit, quiet, header)
        else:
            item, count = detail
            if node == 4:
                count = self._length()
            if int(item[0]) == 1 and item[1][0] in _NUMBERS:
                self._array(path, _NUMBERS[item[1][0]], count, unit, quiet)
                return
            if int(item[0]) == 2 and count > MOST_ELEMENTS:
                raise Unreadable(f"a message of it holds {count} of {item[1]}, and {MOST_ELEMENTS} at most are read")
            for k in range(count):
                self._field(f"{path}[{k}]", item, unit, quiet)

    def _message(self, path: str, kind: str, unit: str, quiet: bool, header: bool) -> None:
        if kind in TIMES:
            self._align(4)
            self._need(8)
            if not quiet:
                self.numbers.append(_Numbers(path, self._pos, f"{self._order}time", None, "s"))
            self._pos += 8
            return
        fields = self._fields(kind)
        if kind == HEADER:
            for name, what in fields:
                if header and what == (2, TIMES[0]):
                    self._align(4)
                    self.stamp = _Numbers(name, self._pos, f"{self._order}time", None, "s")
                text = self._field_text(what) if header and name == "frame_id" else None
                if text is None:
                    self._field(f"{path}.{name}", what, "", True)
                else:
                    self.frame = text
            return
        units = UNITS.get(kind, {})
        for name, what in fields:
            hushed = quiet or name.endswith("covariance") or kind == LAYOUT
            self._field(f"{path}.{name}", what, unit or units.get(name, ""), hushed)

    def _base(self, path: str, kind: str, unit: str, quiet: bool) -> None:
        if kind == "string":
            self._field_text((1, (kind, 0)))
            return
        if kind not in _NUMBERS:
            raise Unreadable(f"its field {path} is a {kind}")
        dtype = self._order + _NUMBERS[kind]
        size = np.dtype(dtype).itemsize
        self._align(size)
        self._need(size)
        if not quiet and not path.endswith("structure_needs_at_least_one_member"):
            self.numbers.append(_Numbers(path, self._pos, dtype, None, unit))
        self._pos += size

    def _array(self, path: str, kind: str, count: int, unit: str, quiet: bool) -> None:
        size = int(kind[1])
        if count:
            self._align(size)
        self._need(size * count)
        if count > MOST_ELEMENTS and not quiet:
            self.long.add(path)
        elif count and not quiet:
            self.numbers.append(_Numbers(path, self._pos, self._order + kind, count, unit))
        elif count and self._may_be_unknown and path.endswith("_covariance"):
            field = path.removesuffix("_covariance")
            self.known.append(_Numbers(field, self._pos, self._order + kind, None, ""))
        self._pos += size * count

    def _field_text(self, what: Any) -> str | None:
        if what[0] != 1 or what[1][0] != "string":
            return None
        count = self._length()
        self._need(count)
        text = self._raw[self._pos : self._pos + count].rstrip(b"\0").decode("utf-8", "replace")
        self._pos += count
        return text

    def _length(self) -> int:
        self._align(4)
        self._need(4)
        self.lengths.append(self._pos)
        self._pos += 4
        return int.from_bytes(self._raw[self._pos - 4 : self._pos], "little" if self._order == "<" else "big")

    def _align(self, size: int) -> None:
        if self._cdr:
            self._pos += -(self._pos - self._start) % size

    def _need(self, size: int) -> None:
        if size > len(self._raw) - self._pos:
            raise ValueError("shorter")
