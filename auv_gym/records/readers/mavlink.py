"""Telemetry logs of ground stations (`.tlog`): MAVLink frames, each preceded by its time.

The package pymavlink (the extra `ardupilot`) has the definitions of messages.  Times are those of the log, s since
1970, in the order of the rows.  Source: mavlink.io, "Packet Serialization" and "File Formats".
"""

from __future__ import annotations

import mmap
import struct
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from auv_gym.records.log import MOST_ELEMENTS, Format, Group, Log, Scope, missing_extra
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

_MOST_SUMS = 50_000  # checksums computed to tell lone frames from damage before the rest is given up: about a second
_FRAME = struct.Struct("<BBBxxBBHB")  # marker, payload length, flags, system, component, message (version 2)
_V1, _V2 = 0xFE, 0xFD
_HEADS = {_V1: 6, _V2: 10}
_LATEST = 4.1e15  # microseconds since 1970: the year 2099; a larger number is not a time stamp
_TYPES: Final = {"b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8",
                 "f": "<f4", "d": "<f8"}  # fmt: skip
_TEXTS: Final = ("STATUSTEXT", "PARAM_VALUE")
_GROUND_STATION, _NO_AUTOPILOT = 6, 8  # MAV_TYPE_GCS, MAV_AUTOPILOT_INVALID


class _Sender(NamedTuple):
    """The common properties of a kind of frames: version, message, and sender."""

    marker: int
    message: int
    system: int
    component: int


def _recognises(path: Path, head: bytes) -> bool:
    """Whether the file begins with a time and a frame, followed by another pair if there is more."""
    end = _end(head, 0)
    if end == 0 or int.from_bytes(head[:8], "big") > _LATEST:
        return False
    return end + 8 >= len(head) or (head[end + 8] in _HEADS and int.from_bytes(head[end : end + 8], "big") <= _LATEST)


def _end(content: bytes | mmap.mmap, at: int) -> int:
    """The end of a time and its frame; 0 if none starts here."""
    if at + 8 + _FRAME.size > len(content):
        return 0
    marker, length, flags, *_ = _FRAME.unpack_from(content, at + 8)
    if marker == _V2:
        return at + 20 + length + (13 if flags & 1 else 0)  # signed or not
    return at + 16 + length if marker == _V1 else 0


def _read(path: Path, scope: Scope) -> Log:
    """Groups `ATTITUDE`, ... with columns `ATTITUDE.roll`; time since 1970, by the clock of the ground station.

    If several senders use one message, senders other than the autopilot have theirs in `HEARTBEAT(1.100)`, by system
    and component; heartbeats of ground stations are left out.  If a message has instances, those other than 0 are
    `BATTERY_STATUS[1]` or `NAMED_VALUE_FLOAT[PilotGain]`.
    """
    try:
        ardupilotmega = import_module("pymavlink.dialects.v20.ardupilotmega")  # 20,000 lines without types
    except ImportError as error:
        raise missing_extra("Telemetry logs (.tlog)", "pymavlink", "ardupilot") from error
    messages = {number: _Message.of(message) for number, message in ardupilotmega.mavlink_map.items()}
    content = mapped(path)
    data = np.frombuffer(content, np.uint8)
    frames, notes = _frames(content, messages, scope.progress)
    if not frames:
        raise ValueError(
            f"{path} has no MAVLink frames with a time before each, as a telemetry log (.tlog) has: give one of "
            "QGroundControl, Mission Planner or MAVProxy, or copy it again."
        )
    unknown = {sender.message for sender in frames} - set(messages)
    if unknown:
        notes.append(f"Left out {len(unknown)} kinds of messages that ArduPilot's MAVLink dialect does not have.")
    parts = _parts({key: at for key, at in frames.items() if key.message in messages}, messages, data)
    wrong, groups, parameters = 0, [], []
    for done, (name, (message, pieces)) in enumerate(parts.items()):
        scope.progress(0.5 + 0.5 * done / len(parts), f"decoding {name}")
        if message.name == "PARAM_VALUE":
            rows, _ = message.rows(data, pieces, None)
            parameters += [(text_of(row["param_id"]), float(row["param_value"])) for row in rows]
        columns = message.columns(name)
        if message.name in _TEXTS or not columns or not scope.wants(name):
            continue
        group, bad = _group(name, message, pieces, columns, data, scope.most)
        wrong += bad
        if group is not None:
            groups.append(group)
    if not groups and scope.groups is None:
        raise ValueError(f"{path} has no message with numbers whose checksum is right: copy it again.")
    if wrong:
        notes.append(f"Left out {wrong} messages whose checksum is wrong.")
    return Log("MAVLink telemetry log", path.name, tuple(groups), servo_functions(parameters), tuple(notes))


@dataclass(frozen=True)
class _Message:
    """A message as MAVLink defines it: the structure of its payload, and the conversion of its numbers to columns."""

    name: str
    dtype: np.dtype
    seed: int  # of the checksum, which also covers the definition
    units: dict[str, str]
    instance: str

    @staticmethod
    def of(definition: Any) -> _Message:
        """The message for a class of the library."""
        fields = []
        codes = definition.native_format.decode().lstrip("<>=")
        for name, code, elements in zip(definition.ordered_fieldnames, codes, definition.array_lengths, strict=True):
            if code == "c":
                fields.append((name, f"S{max(elements, 1)}"))
            else:
                fields.append((name, _TYPES[code], (elements,)) if elements else (name, _TYPES[code]))
        units = dict(definition.fieldunits_by_name)
        return _Message(
            definition.msgname, np.dtype(fields), definition.crc_extra, units, definition.instance_field or ""
        )

    def columns(self, prefix: str) -> dict[str, Number]:
        """Its numeric fields, by the name of the column."""
        columns: dict[str, Number] = {}
        for name in self.dtype.names or ():
            kind = self.dtype[name]
            elements = kind.shape[0] if kind.shape else 0
            if kind.base.kind == "S" or elements > MOST_ELEMENTS or name == self.instance:
                continue
            unit, factor = UNITS.get(self.units.get(name, ""), (self.units.get(name, ""), 1.0))
            output = self.name == "SERVO_OUTPUT_RAW" and name.startswith("servo")
            for element in range(elements) if elements else (None,):
                label = f"{prefix}.{name}" if element is None else f"{prefix}.{name}[{element}]"
                columns[label] = Number(name, element, unit, 1.0, factor, output)
        return columns

    def rows(
        self, data: np.ndarray, pieces: list[tuple[_Sender, np.ndarray]], most: int | None
    ) -> tuple[np.ndarray, np.ndarray]:
        """The payloads, in the order of the file, and their times in microseconds; wrong checksums are left out.

        Fields that an older version or a shortened frame does not have are 0, as MAVLink defines.
        """
        all_rows, starts = [], []
        for sender, at in pieces:
            at = at[:most]
            head = _HEADS[sender.marker]
            lengths = data[at + 9].astype(np.int64)
            frames = structures(data, at + 8, np.dtype((np.void, head + int(lengths.max()) + 2)))
            raw = frames.view(np.uint8).reshape(at.size, -1)
            good = _checksums(raw, head + lengths, self.seed)
            payload = np.zeros((at.size, self.dtype.itemsize), np.uint8)
            width = min(raw.shape[1] - head, self.dtype.itemsize)
            payload[:, :width] = raw[:, head : head + width]
            payload[np.arange(self.dtype.itemsize) >= lengths[:, None]] = 0
            all_rows.append(payload[good].view(self.dtype)[:, 0])
            starts.append(at[good])
        start = np.concatenate(starts)
        order = np.argsort(start)[:most]
        stamps = structures(data, start[order], np.dtype(">u8"))
        return np.concatenate(all_rows)[order], stamps


def _frames(
    content: mmap.mmap, messages: dict[int, _Message], progress: Callable[[float, str], None]
) -> tuple[dict[_Sender, np.ndarray], list[str]]:
    """The starts of frames, with the time before them, by kind and sender."""
    found: dict[int, array] = {}
    size, sums = len(content), 0
    search = Search(size, progress)
    at, due, last, ahead = 0, 0, size - 8 - _FRAME.size, dict.fromkeys(_HEADS, 0)
    unpack = _FRAME.unpack_from
    while at <= last:
        marker, length, flags, system, component, low, high = unpack(content, at + 8)
        if marker == _V2:
            end = at + 20 + length + (13 if flags & 1 else 0)
            key = ((low | high << 16) << 17) | system << 9 | component << 1 | 1
        elif marker == _V1:  # shorter header: sequence, system, component, message
            end = at + 16 + length
            key = content[at + 13] << 17 | content[at + 11] << 9 | content[at + 12] << 1
        else:
            end = 0
        if end and end <= size:
            chained = end + 9 > size or (content[end + 8] in _HEADS and content[end] == 0)
            if not chained and sums < _MOST_SUMS and key >> 17 in messages:
                sums += 1
                chained = _sum_is_right(content[at + 8 : end], messages[key >> 17].seed)
            if chained and content[at] == 0:
                starts = found.get(key)
                if starts is None:
                    starts = found[key] = array("q")
                starts.append(at)
                at = end
                if at >= due:
                    due = search.reached(at)
                continue
        if end > size:
            break
        enough = search.misses() or sums >= _MOST_SUMS
        for marker, place in ahead.items():
            if place < at + 9:  # one `find` over the whole rest if there is none, instead of one per attempt
                place = content.find(bytes((marker,)), at + 9)
                ahead[marker] = place if place >= 0 else size + 8
        following = size if enough else min(ahead.values()) - 8
        search.passes(at, following)
        at = following
    senders = {
        _Sender(_V2 if key & 1 else _V1, key >> 17, key >> 9 & 0xFF, key >> 1 & 0xFF): np.frombuffer(starts, np.int64)
        for key, starts in found.items()
    }
    return senders, search.notes(at)


def _parts(
    frames: dict[_Sender, np.ndarray], messages: dict[int, _Message], data: np.ndarray
) -> dict[str, tuple[_Message, list[tuple[_Sender, np.ndarray]]]]:
    """The frames of each group, by its name."""
    counts: dict[tuple[int, int], int] = {}
    stations, autopilots = set(), set()
    for sender, at in frames.items():
        who = sender.system, sender.component
        counts[who] = counts.get(who, 0) + at.size
        if messages[sender.message].name == "HEARTBEAT":
            rows, _ = messages[sender.message].rows(data, [(sender, at)], 100)
            if (rows["type"] == _GROUND_STATION).any():
                stations.add(who)
            elif (rows["autopilot"] != _NO_AUTOPILOT).any():
                autopilots.add(who)
    main = max(autopilots or counts, key=lambda who: counts[who], default=None)
    senders_of: dict[int, set[tuple[int, int]]] = {}
    for sender in frames:
        senders_of.setdefault(sender.message, set()).add((sender.system, sender.component))
    parts: dict[str, tuple[_Message, list[tuple[_Sender, np.ndarray]]]] = {}
    for sender, at in frames.items():
        message, who = messages[sender.message], (sender.system, sender.component)
        if message.name == "HEARTBEAT":
            if who in stations:
                continue
            others = senders_of[sender.message] - stations
        else:
            others = senders_of[sender.message]
        mark = "" if len(others) == 1 or who == main else f"({who[0]}.{who[1]})"
        for instance, some in _instances(message, sender, at, data):
            parts.setdefault(f"{message.name}{mark}{instance}", (message, []))[1].append((sender, some))
    return dict(sorted(parts.items()))


def _instances(
    message: _Message, sender: _Sender, at: np.ndarray, data: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    """The frames of each instance, by the suffix of its name: none for instance 0."""
    if not message.instance:
        yield "", at
        return
    kind, offset = {**(message.dtype.fields or {})}[message.instance][:2]
    values = np.concatenate(
        [structures(data, some + 8 + _HEADS[sender.marker] + offset, kind).copy() for some in pieces_of(at)]
    )
    lengths = data[at + 9].astype(np.int64) - offset
    raw = values.view(np.uint8).reshape(at.size, -1)
    raw[np.arange(raw.shape[1]) >= lengths[:, None]] = 0  # a shortened frame omits trailing zeros
    for value in np.unique(values):
        label = text_of(value.item()) if isinstance(value.item(), bytes) else str(value) if value else ""
        yield f"[{label}]" if label else "", at[values == value]


def _group(
    name: str,
    message: _Message,
    pieces: list[tuple[_Sender, np.ndarray]],
    columns: dict[str, Number],
    data: np.ndarray,
    most: int | None,
) -> tuple[Group | None, int]:
    """A group, and the number of its messages that were left out; None if none remains."""
    rows, stamps = message.rows(data, pieces, most)
    count = sum(at.size for _, at in pieces)
    wanted = count if most is None else min(most, count)
    wrong = wanted - rows.size
    if not rows.size:
        return None, wrong
    ends = np.array([min(at[0] for _, at in pieces), max(at[-1] for _, at in pieces)])
    span = structures(data, ends, np.dtype(">u8")) * 1e-6
    group = Group(
        name,
        {label: column.of(rows) for label, column in columns.items()},
        stamps * 1e-6,
        {label: column.unit for label, column in columns.items() if column.unit},
        message.name,
        rows=count if wanted < count else rows.size,
        span=(float(span[0]), float(span[1])) if wanted < count else None,
    )
    return group, wrong


def _crc_table() -> np.ndarray:
    """The effect of a byte on the checksum CRC-16/MCRF4XX: polynomial 0x1021, reflected."""
    table = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        table = np.where(table & 1, table >> 1 ^ 0x8408, table >> 1).astype(np.uint16)
    return table


_CRC = _crc_table()
_CRC_LIST = _CRC.tolist()


def _checksums(raw: np.ndarray, lengths: np.ndarray, seed: int) -> np.ndarray:
    """Whether each frame's checksum is right; it covers all bytes after the marker, up to the frame's length."""
    crc = np.full(raw.shape[0], 0xFFFF, np.uint16)
    for k in range(1, int(lengths.max(initial=0))):
        crc = np.where(k < lengths, crc >> 8 ^ _CRC[(crc ^ raw[:, k]) & 0xFF], crc)
    crc = crc >> 8 ^ _CRC[(crc ^ seed) & 0xFF]
    row = np.arange(raw.shape[0])
    return crc == raw[row, lengths].astype(np.uint16) | raw[row, lengths + 1].astype(np.uint16) << 8


def _sum_is_right(frame: bytes, seed: int) -> bool:
    """Whether the checksum of a single frame, which may be signed, is right."""
    end = _HEADS[frame[0]] + frame[1]
    crc = 0xFFFF
    for byte in frame[1:end]:
        crc = crc >> 8 ^ _CRC_LIST[(crc ^ byte) & 0xFF]
    crc = crc >> 8 ^ _CRC_LIST[(crc ^ seed) & 0xFF]
    return crc == int.from_bytes(frame[end : end + 2], "little")


FORMAT = Format("MAVLink telemetry log", (".tlog",), _recognises, refusing(_read), slow=True)
