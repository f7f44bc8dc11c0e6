"""Logs from ROS bags: `.bag` files of ROS 1, and folders or `.db3` files of ROS 2.

A ROS 1 bag is read chunk by chunk with the index after each, so that a bag that was not closed is read as far as
possible.  Bags of ROS 2 are opened by rosbags (the extra `ros`).  Nothing in a bag is run.
Source: wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import mmap
import re
import struct
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.records.log import Format, Log, Scope, missing_extra
from auv_gym.records.readers.mcap import read_files
from auv_gym.records.readers.opening import Damaged, mapped, unpacked
from auv_gym.records.readers.ros_messages import Samples, Topics
from auv_gym.records.readers.ros_types import Topic

_MAGIC = b"#ROSBAG V2.0\n"
_CHUNK, _INDEX, _CONNECTION, _CHUNK_INFO, _MESSAGE, _BAG = 5, 4, 7, 6, 2, 3
_OPEN = "The bag is cut short, or was not closed by its recorder: it is read as far as it goes."
_U32 = struct.Struct("<I")
_ENTRY = np.dtype([("s", "<u4"), ("ns", "<u4"), ("offset", "<u4")])


def _is_ros1(path: Path, head: bytes) -> bool:
    return head.startswith(b"#ROSBAG V")


def _is_ros2(path: Path, head: bytes) -> bool:
    if path.is_dir():
        metadata = path / "metadata.yaml"
        if not metadata.is_file():
            return False
        with metadata.open("rb") as file:
            return b"rosbag2_bagfile_information" in file.read(4096)
    return head.startswith(b"SQLite format 3\0") and path.suffix.lower() == ".db3"


def _read_ros1(path: Path, scope: Scope) -> Log:
    _needed()
    with closing(mapped(path)) as data:
        if data[: len(_MAGIC)] != _MAGIC:
            version = data[:40].partition(b"\n")[0].decode("ascii", "replace").strip()
            raise ValueError(f"{path} needs version 2.0 of bags, got {version!r}: convert it with `rosbag fix`.")
        bag = _Bag(data)
        topics = Topics(scope)
        sinks = {}
        for connection in sorted(bag.rows):
            topic = bag.topic(connection)
            samples = None if topic is None else topics.samples(topic)
            if samples is not None:
                sinks[connection] = samples
        lost = 0
        for number in range(len(bag.chunks)):
            lost += bag.read(number, sinks)
            topics.progress(number / len(bag.chunks), f"reading {path.name}")
        if lost:
            bag.notes.append(f"{lost} messages are lost, because their chunks are damaged.")
        return topics.log(ROS1.name, path, bag.notes)


@dataclass(frozen=True)
class _Chunk:
    """The position of a chunk, and the index after it: for each connection, the messages in the chunk."""

    compression: bytes
    size: int
    start: int
    end: int
    index: dict[int, np.ndarray] = field(default_factory=dict)


class _Bag:
    """The chunks and connections of a bag, from one pass over its records that skips the messages."""

    def __init__(self, data: mmap.mmap) -> None:
        self._data = data
        self.chunks: list[_Chunk] = []
        self.notes: list[str] = []
        self._connections: dict[int, Topic] = {}
        self._closed = False
        at = len(_MAGIC)
        while at < len(data):
            try:
                at = self._step(at)
            except (Damaged, LookupError, struct.error, ValueError):
                self.notes.append(f"The bag is cut short or damaged at byte {at} of {len(data)}, and read up to there.")
                break
        if not self.notes and not self._closed:
            self.notes.append(_OPEN)
        for number, chunk in enumerate(self.chunks):
            if chunk.index.keys() - self._connections.keys():  # the bag was not closed
                self._scan(number)
        self.rows: dict[int, int] = {}
        for chunk in self.chunks:
            for connection, entries in chunk.index.items():
                self.rows[connection] = self.rows.get(connection, 0) + len(entries)

    def topic(self, connection: int) -> Topic | None:
        """The topic of a connection, with the number and times of its messages."""
        topic = self._connections.get(connection)
        if topic is None:
            return None
        times = [1e-9 * _nanoseconds(chunk.index[connection]) for chunk in self.chunks if connection in chunk.index]
        times = [part for part in times if part.size]
        span = (float(min(part.min() for part in times)), float(max(part.max() for part in times))) if times else None
        return Topic(topic.name, topic.type, "ros1", topic.definition, rows=self.rows[connection], span=span)

    def read(self, number: int, sinks: Mapping[int, Samples]) -> int:
        """Pass the messages of a chunk to their sinks; returns how many of them are damaged."""
        chunk = self.chunks[number]
        wanted = {connection: chunk.index[connection] for connection in chunk.index.keys() & sinks.keys()}
        wanted = {connection: entries[: sinks[connection].room] for connection, entries in wanted.items()}
        total = sum(map(len, wanted.values()))
        if not total:
            return 0
        try:
            body, base, end = self._body(chunk)
        except Damaged:
            return total
        lost = 0
        for connection, entries in wanted.items():
            add = sinks[connection].add
            for moment, offset in zip(_nanoseconds(entries).tolist(), entries["offset"].tolist(), strict=True):
                try:
                    add(moment, _message(body, base + offset, end))
                except (Damaged, LookupError, struct.error):
                    lost += 1
        return lost

    def _step(self, at: int) -> int:
        """Register the record at a byte; returns the start of the next one."""
        data = self._data
        fields, start, end = _record(data, at, len(data))
        kind = fields[b"op"][0]
        if kind == _CHUNK and (end > len(data) or end == start):  # the length is written when the chunk is closed
            self._salvage(fields, start)
            return len(data)
        if end > len(data) or kind not in (_CHUNK, _INDEX, _CONNECTION, _CHUNK_INFO, _BAG):
            raise Damaged
        if kind == _CHUNK:
            self.chunks.append(_Chunk(fields[b"compression"], _U32.unpack(fields[b"size"])[0], start, end))
        elif kind == _INDEX:
            entries = np.frombuffer(data[start : end - (end - start) % _ENTRY.itemsize], dtype=_ENTRY)
            self.chunks[-1].index[_U32.unpack(fields[b"conn"])[0]] = entries
        elif kind == _CONNECTION:
            self._connect(fields, data, start, end)
        elif kind == _BAG:  # gives the position of the connections, or 0
            self._closed = 0 < struct.unpack("<Q", fields[b"index_pos"])[0] < len(data)
        return end

    def _body(self, chunk: _Chunk) -> tuple[bytes | mmap.mmap, int, int]:
        """The bytes that hold the records of a chunk, and where these begin and end."""
        if chunk.compression == b"none":
            return self._data, chunk.start, chunk.end
        body = unpacked(self._data[chunk.start : chunk.end], chunk.compression, chunk.size)
        return body, 0, len(body)

    def _salvage(self, fields: Mapping[bytes, bytes], start: int) -> None:
        """Recover the messages in the last chunk of a bag that was not closed."""
        self.notes.append(_OPEN)
        if fields.get(b"compression") == b"none":
            self.chunks.append(_Chunk(b"none", 0, start, len(self._data)))
            self._scan(len(self.chunks) - 1, index=True)

    def _scan(self, number: int, index: bool = False) -> None:
        """Find the connections in a chunk, and its messages if it has no index."""
        chunk = self.chunks[number]
        found: dict[int, list[tuple[int, int, int]]] = {}
        try:
            body, base, end = self._body(chunk)
            at = base
            while at < end:
                fields, start, stop = _record(body, at, end)
                kind = fields[b"op"][0]
                if stop > end or kind not in (_CONNECTION, _MESSAGE):
                    break
                if kind == _CONNECTION:
                    self._connect(fields, body, start, stop)
                else:
                    s, ns = struct.unpack("<II", fields[b"time"])
                    found.setdefault(_U32.unpack(fields[b"conn"])[0], []).append((s, ns, at - base))
                at = stop
        except (Damaged, LookupError, struct.error, ValueError):
            pass  # keep what was found before
        if index:
            chunk.index.update({connection: np.array(entries, dtype=_ENTRY) for connection, entries in found.items()})

    def _connect(self, fields: Mapping[bytes, bytes], body: bytes | mmap.mmap, start: int, end: int) -> None:
        more = _header_fields(body, start, end)
        name, kind, definition = (
            text.decode("utf-8", "replace")
            for text in (fields[b"topic"], more[b"type"], more.get(b"message_definition", b""))
        )
        self._connections[_U32.unpack(fields[b"conn"])[0]] = Topic(name, kind, "ros1", definition)


def _record(data: bytes | mmap.mmap, at: int, end: int) -> tuple[dict[bytes, bytes], int, int]:
    """The header of a record, and the bounds of its data."""
    if at + 8 > end:
        raise Damaged
    (size,) = _U32.unpack_from(data, at)
    if size > end - at - 8:
        raise Damaged
    start = at + 8 + size
    return _header_fields(data, at + 4, at + 4 + size), start, start + _U32.unpack_from(data, start - 4)[0]


def _header_fields(data: bytes | mmap.mmap, at: int, end: int) -> dict[bytes, bytes]:
    fields = {}
    while at < end:
        (size,) = _U32.unpack_from(data, at)
        name, equals, value = data[at + 4 : min(at + 4 + size, end)].partition(b"=")
        at += 4 + size
        if not equals or at > end:
            raise Damaged
        fields[name] = value
    return fields


def _message(body: bytes | mmap.mmap, at: int, end: int) -> bytes:
    """The bytes of the message at an offset of the index; a connection record may come first."""
    while True:
        fields, start, stop = _record(body, at, end)
        if stop > end:
            raise Damaged
        if fields[b"op"][0] == _MESSAGE:
            return body[start:stop]
        if fields[b"op"][0] != _CONNECTION:
            raise Damaged
        at = stop


def _nanoseconds(entries: np.ndarray) -> np.ndarray:
    return entries["s"].astype(np.int64) * 10**9 + entries["ns"]


def _read_ros2(path: Path, scope: Scope) -> Log:
    rosbag2 = _needed()
    if path.is_dir():
        files = sorted(path.glob("*.mcap"), key=lambda file: (len(file.name), file.name))
        metadata = (path / "metadata.yaml").read_bytes()
        if files and not re.search(rb"compression_mode:\s*[\"']?(file|message)", metadata, re.IGNORECASE):
            return read_files(files, path, scope, ROS2.name)
    topics = Topics(scope)
    notes: list[str] = []
    try:
        with rosbag2.Reader(path) as reader:
            if not reader.connections:
                raise ValueError("it has no topics")
            _collect(reader, topics, scope, path.name, notes)
            return topics.log(ROS2.name, path, notes)
    except ValueError as error:
        raise error if str(path) in str(error) else _refusal(path, error) from error
    except Exception as error:  # errors of the database, the metadata or rosbags
        raise _refusal(path, error) from error


def _collect(reader: Any, topics: Topics, scope: Scope, name: str, notes: list[str]) -> None:
    """Pass the messages of an open bag to its topics; adds a note if it ends early."""
    spans = dict(_spans(reader)) if scope.most is not None else {}
    sinks: dict[tuple[str, str], Samples] = {}
    for connection in reader.connections:
        kind, idl = connection.msgdef.format.name, connection.msgdef.format.name == "IDL"
        definition = "" if kind == "NONE" else connection.msgdef.data
        topic = Topic(
            connection.topic,
            connection.msgtype,
            connection.ext.serialization_format,
            definition,
            idl,
            connection.msgcount,
            spans.get(connection.topic),
        )
        samples = topics.samples(topic)
        if samples is not None:
            sinks[connection.topic, connection.msgtype] = samples
    wanted = [found for found in reader.connections if (found.topic, found.msgtype) in sinks]
    total, done = sum(found.msgcount for found in wanted), 0
    try:
        for connection, moment, raw in reader.messages(wanted) if wanted else ():
            samples = sinks[connection.topic, connection.msgtype]
            if not samples.full:
                samples.add(moment, bytes(raw))
            done += 1
            if done % 256 == 0:
                topics.progress(done / max(total, 1), f"reading {name}")
                if topics.enough:
                    return
    except Exception as error:
        if not done:
            raise
        notes.append(f"The bag is damaged after {done} of {total} messages, and read up to there ({error}).")
    else:
        if done < total:
            notes.append(f"The bag says that it holds {total} messages of these topics, and {done} were found.")


def _spans(reader: Any) -> Iterator[tuple[str, tuple[float, float]]]:
    """First and last time of each topic, s, from the databases of a bag."""
    found: dict[str, list[int]] = {}
    for storage in getattr(reader.storage, "storages", [reader.storage]):
        if getattr(storage, "dbconn", None) is None:
            continue
        query = (
            "SELECT topics.name, MIN(messages.timestamp), MAX(messages.timestamp) FROM messages "
            "JOIN topics ON messages.topic_id = topics.id GROUP BY topics.name"
        )
        for name, first, last in storage.dbconn.cursor().execute(query):
            found.setdefault(name, []).extend((first, last))
    for name, times in found.items():
        yield name, (min(times) * 1e-9, max(times) * 1e-9)


def _refusal(path: Path, error: Exception) -> ValueError:
    words = (str(error).strip().splitlines() or [type(error).__name__])[0].rstrip(".")
    return ValueError(
        f"{path} cannot be read as a ROS 2 bag: {words}. Copy it again, mend it with `ros2 bag reindex`, or give the "
        "path of one .db3 or .mcap file in it."
    )


def _needed() -> Any:
    try:
        from rosbags import rosbag2
    except ImportError as error:
        raise missing_extra("ROS bags", "rosbags", "ros") from error
    return rosbag2


ROS1 = Format("ROS 1 bag", (".bag", ".bag.active"), _is_ros1, _read_ros1, slow=True)
ROS2 = Format("ROS 2 bag", (".db3",), _is_ros2, _read_ros2, slow=True)
