"""Logs from MCAP files, as recorded by ROS 2 and others: messages of ROS 1, of ROS 2 (CDR) and in JSON.

Records are parsed by mcap and definitions of messages by rosbags (the extra `ros`); nothing in a file is run.  An
unfinished file has no summary, and is read from its start as far as possible.
Source: mcap.dev/spec.
"""

from __future__ import annotations

import io
import mmap
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.records.log import Format, Log, Scope, missing_extra
from auv_gym.records.readers.opening import Damaged, mapped, unpacked
from auv_gym.records.readers.ros_messages import Samples, Topics
from auv_gym.records.readers.ros_types import Topic

_MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX, _STATISTICS = 2, 3, 4, 5, 6, 8, 11
_FOOTER_SIZE = 9 + 20 + len(_MAGIC)
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_RECORD_HEAD = struct.Struct("<BQ")
_LANGUAGES = ("ros1msg", "ros2msg", "ros2idl", "omgidl")  # of message definitions

Data = bytes | mmap.mmap


def _is_mcap(path: Path, head: bytes) -> bool:
    return head.startswith(_MAGIC)


def _read(path: Path, scope: Scope) -> Log:
    return read_files([path], path, scope, FORMAT.name)


def read_files(paths: Sequence[Path], source: Path, scope: Scope, form: str) -> Log:
    """The log in one MCAP file, or in consecutive ones; source, form: of the log."""
    try:
        import mcap.records
        import rosbags.typesys  # noqa: F401
    except ImportError as error:
        raise missing_extra("MCAP files", "mcap", "ros") from error
    topics = Topics(scope)
    notes: list[str] = []
    for number, path in enumerate(paths):

        def progress(fraction: float, number: int = number, path: Path = path) -> None:
            topics.progress((number + fraction) / len(paths), f"reading {path.name}")

        with closing(mapped(path)) as data:
            if data[: len(_MAGIC)] != _MAGIC:
                raise ValueError(f"{path} needs to begin as an MCAP file, and does not: copy it again.")
            name = path.name if len(paths) > 1 else "The file"
            notes += _File(data, mcap.records, topics, name).read(progress)
    return topics.log(form, source, notes)


class _File:
    """A file being read: its schemas and channels, and the destination of each channel's messages."""

    def __init__(self, data: mmap.mmap, records: Any, topics: Topics, name: str) -> None:
        self._data = data
        self._records = records
        self._topics = topics
        self._name = name
        self._schemas: dict[int, Any] = {}
        self._sinks: dict[int, Samples | None] = {}
        self._notes: list[str] = []

    def read(self, progress: Callable[[float], None]) -> list[str]:
        """Hand the messages to their topics; returns lines for notes."""
        try:
            chunks = self._summary()
        except (Damaged, LookupError, struct.error, ValueError):
            self._schemas.clear()
            self._notes.append(
                f"{self._name} is cut short, or was not finished by its recorder: it is read as far as it goes."
            )
            chunks = None
        if chunks is None:
            self._read_on(progress)
        else:
            self._read_chunks(chunks, progress)
        return self._notes

    def _summary(self) -> list[Any] | None:
        """The index of chunks at the file's end, None if a finished file has none; registers the channels."""
        data = self._data
        at = len(data) - _FOOTER_SIZE
        if at < len(_MAGIC) or data[-len(_MAGIC) :] != _MAGIC or data[at] != _FOOTER:
            raise Damaged
        (start,) = struct.unpack_from("<Q", data, at + 9)
        if start == 0:
            return None
        if start > at:
            raise Damaged
        chunks: list[Any] = []
        channels: list[Any] = []
        counts: Mapping[int, int] = {}
        for kind, begin, end in _records(data, start, at):
            if kind == _SCHEMA:
                self._schema(data[begin:end])
            elif kind == _CHANNEL:
                channels.append(self._parsed("Channel", data[begin:end]))
            elif kind == _CHUNK_INDEX:
                chunks.append(self._parsed("ChunkIndex", data[begin:end]))
            elif kind == _STATISTICS:
                counts = self._parsed("Statistics", data[begin:end]).channel_message_counts
        chunks.sort(key=lambda chunk: chunk.message_start_time)
        for channel in channels:
            self._connect(channel, counts.get(channel.id, 0), self._span(channel.id, chunks))
        return chunks if channels and chunks and all(chunk.message_index_offsets for chunk in chunks) else None

    def _span(self, channel: int, chunks: Sequence[Any]) -> tuple[float, float] | None:
        """First and last time of a channel, from the indices of the first and last chunks that contain it."""
        mine = [chunk.message_index_offsets[channel] for chunk in chunks if channel in chunk.message_index_offsets]
        times: list[int] = []
        for at in {mine[0], mine[-1]} if mine else ():
            _, begin, end = next(_records(self._data, at, len(self._data)))
            entries = np.frombuffer(self._data[begin + 6 : end], dtype="<u8")[::2]
            times += [int(entries.min()), int(entries.max())] if entries.size else []
        return (min(times) * 1e-9, max(times) * 1e-9) if times else None

    def _read_chunks(self, chunks: Sequence[Any], progress: Callable[[float], None]) -> None:
        damaged = 0
        for done, chunk in enumerate(chunks):
            wanted = [self._sinks.get(channel) for channel in chunk.message_index_offsets]
            if any(sink is not None and not sink.full for sink in wanted):
                begin = chunk.chunk_start_offset + 9
                try:
                    self._take(self._body(begin, chunk.chunk_start_offset + chunk.chunk_length))
                except (Damaged, LookupError, struct.error, ValueError):
                    damaged += 1
            progress(done / len(chunks))
        if damaged:
            self._notes.append(f"{damaged} of {len(chunks)} chunks are damaged, and messages in them are lost.")

    def _read_on(self, progress: Callable[[float], None]) -> None:
        """Read record by record, without an index."""
        at = len(_MAGIC)
        try:
            for kind, begin, end in _records(self._data, at, len(self._data)):
                if kind == _FOOTER:
                    return
                if kind == _CHUNK:
                    self._take(self._body(begin, end))
                elif kind in (_SCHEMA, _CHANNEL, _MESSAGE):
                    self._record(kind, self._data, begin, end)
                at = end
                progress(at / len(self._data))
                if self._topics.enough:
                    return
        except (Damaged, LookupError, struct.error, ValueError):
            self._notes.append(f"Bytes {at} to {len(self._data)} are cut short or damaged, and left out.")

    def _body(self, begin: int, end: int) -> bytes:
        """The records in a chunk."""
        _, _, size, _, letters = struct.unpack_from("<QQQII", self._data, begin)
        at = begin + 32 + letters
        compression = self._data[begin + 32 : at]
        (length,) = struct.unpack_from("<Q", self._data, at)
        if at + 8 + length > end:
            raise Damaged
        raw = self._data[at + 8 : at + 8 + length]
        return unpacked(raw, compression, size) if compression else raw

    def _take(self, body: bytes) -> None:
        for kind, begin, end in _records(body, 0, len(body)):
            self._record(kind, body, begin, end)

    def _record(self, kind: int, data: Data, begin: int, end: int) -> None:
        if kind == _MESSAGE:
            channel, _, moment, _ = _MESSAGE_HEAD.unpack_from(data, begin)
            sink = self._sinks[channel]
            if sink is not None and not sink.full:
                sink.add(moment, data[begin + _MESSAGE_HEAD.size : end])
        elif kind == _SCHEMA:
            self._schema(data[begin:end])
        elif kind == _CHANNEL:
            channel = self._parsed("Channel", data[begin:end])
            if channel.id not in self._sinks:
                self._connect(channel, 0, None)

    def _parsed(self, kind: str, raw: bytes) -> Any:
        from mcap.data_stream import ReadDataStream

        try:
            return getattr(self._records, kind).read(ReadDataStream(io.BytesIO(raw)))
        except Exception as error:
            raise Damaged from error

    def _schema(self, raw: bytes) -> None:
        schema = self._parsed("Schema", raw)
        self._schemas[schema.id] = schema

    def _connect(self, channel: Any, rows: int, span: tuple[float, float] | None) -> None:
        topic = Topic(channel.topic, "", channel.message_encoding, rows=rows, span=span)
        schema = self._schemas.get(channel.schema_id)
        if schema is not None:
            text = schema.data.decode("utf-8", "replace") if schema.encoding in _LANGUAGES else ""
            topic = replace(topic, type=schema.name, definition=text, idl=schema.encoding.endswith("idl"))
        self._sinks[channel.id] = self._topics.samples(topic)


def _records(data: Data, at: int, end: int) -> Iterator[tuple[int, int, int]]:
    """The kind of each record, and the bounds of its content; raises Damaged if there is no record."""
    while at < end:
        if at + 9 > end:
            raise Damaged
        kind, size = _RECORD_HEAD.unpack_from(data, at)
        at += 9
        if kind == 0 or size > end - at:  # zero is not a kind of record
            raise Damaged
        yield kind, at, at + size
        at += size
        if kind == _FOOTER:
            return


FORMAT = Format("MCAP", (".mcap",), _is_mcap, _read, slow=True)
