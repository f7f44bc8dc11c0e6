"""Logs of PX4 vehicles (`.ulg`), read by pyulog (the extra `px4`).

A group is a topic of uORB; its second instance is the topic with the suffix _1.  Time is s since the autopilot started.
The format states no units.  Source: docs.px4.io/main/en/dev_log/ulog_file_format.html.
"""

from __future__ import annotations

import io
import mmap
import struct
from collections.abc import Callable
from contextlib import closing, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, NamedTuple

from auv_gym.records.log import MOST_ELEMENTS, Format, Group, Log, Scope, missing_extra
from auv_gym.records.readers.opening import mapped

_MAGIC = b"ULog\x01\x12\x35"
_FILE_HEADER = 16  # bytes
_TIME = "timestamp"  # us, of every message
_SUBSCRIPTION, _DATA = b"AD"
_KINDS = frozenset(b"ADIMPQRSOLCBF")  # of messages
_LONGEST = 10_000  # bytes; pyulog treats a longer message of another kind as damage, and so do we
_SAMPLE = 4_000_000  # bytes of data for a first look; some 20 s of a fast log
_TOLD = 1 << 17  # messages between reports of progress


def _is_ulog(path: Path, head: bytes) -> bool:
    return head.startswith(_MAGIC)


def _read(path: Path, scope: Scope) -> Log:
    try:
        from pyulog import ULog
    except ImportError as error:
        raise missing_extra("PX4 logs", "pyulog", "px4") from error
    with closing(mapped(path)) as data:
        if len(data) < _FILE_HEADER or not data[:_FILE_HEADER].startswith(_MAGIC):
            raise ValueError(f"{path} needs to begin with the header of a PX4 log, and does not: copy it again.")
        survey = _survey(data, lambda share: scope.progress(share / 4, f"looking through {path.name}"))
        end = survey.end if scope.most is None else survey.sample
        part = _Part(data, end, lambda share: scope.progress(0.25 + 0.75 * share, f"reading {path.name}"))
        topics = {name for group in scope.groups or () for name in (group, group.rpartition("_")[0])}
        try:
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                ulog = ULog(part, None if scope.groups is None else sorted(topics))
        except Exception as error:
            words = str(error) or type(error).__name__
            raise ValueError(f"{path} is no PX4 log that can be read: {words}. Copy it again.") from error
        total = len(data)
    notes = []
    if survey.end < total:
        notes.append(f"The log is cut short or damaged at byte {survey.end} of {total}, and read up to there.")
    if ulog.dropouts:
        lost = sum(dropout.duration for dropout in ulog.dropouts) * 1e-3
        notes.append(f"The autopilot could not write for {lost:.3g} s in all, {len(ulog.dropouts)} times.")
    found = {_name(topic): topic for topic in ulog.data_list if _TIME in topic.data}
    groups = [_group(topic, survey, scope) for name, topic in found.items() if scope.wants(name)]
    if not groups and scope.groups is None:
        raise ValueError(f"{path} needs messages of topics, got none in {total} bytes. Copy it from the vehicle again.")
    return Log(FORMAT.name, path.name, tuple(groups), notes=tuple(notes))


class _Survey(NamedTuple):
    """The end of the undamaged part of a log, and of the first _SAMPLE bytes of data; rows and span by topic id."""

    end: int
    sample: int
    rows: dict[int, int]
    spans: dict[int, tuple[float, float]]


def _survey(data: mmap.mmap, progress: Callable[[float], None]) -> _Survey:
    """An overview of a log without its content; the timestamp is the first field of a data message."""
    header, content = struct.Struct("<HB").unpack_from, struct.Struct("<HQ").unpack_from
    rows: dict[int, int] = {}
    spans: dict[int, tuple[float, float]] = {}
    at, size, number = _FILE_HEADER, len(data), 0
    begin, sample = size, _FILE_HEADER  # of the data
    while at + 3 <= size:
        length, kind = header(data, at)
        following = at + 3 + length
        # neither is ever 0; zeros are what an unwritten part of the card holds
        if not length or not kind or following > size or (kind not in _KINDS and length > _LONGEST):
            break
        if kind == _DATA and length >= 10:
            topic, moment = content(data, at + 3)
            rows[topic] = rows.get(topic, 0) + 1
            spans[topic] = (spans[topic][0] if topic in spans else moment * 1e-6, moment * 1e-6)
        elif kind == _SUBSCRIPTION:
            begin = min(begin, at)
        at = following
        if at - begin <= _SAMPLE:
            sample = at
        number += 1
        if number % _TOLD == 0:
            progress(at / size)
    return _Survey(at, sample, rows, spans)


class _Part:
    """The first bytes of a log as a file for pyulog, reporting how far it has been read."""

    def __init__(self, data: mmap.mmap, size: int, progress: Callable[[float], None]) -> None:
        self._data, self._size, self._progress = data, size, progress
        self._at = self._reads = 0

    def read(self, size: int) -> bytes:
        self._reads += 1
        if self._reads % (2 * _TOLD) == 0:
            self._progress(self._at / self._size)
        start, self._at = self._at, max(self._at, min(self._at + size, self._size))
        return self._data[start : self._at]

    def seek(self, offset: int, whence: int = 0) -> int:
        self._at = max((0, self._at, self._size)[whence] + offset, 0)
        return self._at

    def tell(self) -> int:
        return self._at

    def close(self) -> None:
        pass


def _name(topic: Any) -> str:
    return topic.name if topic.multi_id == 0 else f"{topic.name}_{topic.multi_id}"


def _group(topic: Any, survey: _Survey, scope: Scope) -> Group:
    """The numbers of a topic, without texts and long arrays."""
    name = _name(topic)
    long = tuple(f"{field.partition('[')[0]}[" for field in topic.data if field.endswith(f"[{MOST_ELEMENTS}]"))
    fields = [field.field_name for field in topic.field_data if field.type_str != "char"]
    columns = {
        f"{name}.{field}": topic.data[field][: scope.most].astype(float)
        for field in fields
        if field != _TIME and not field.startswith(("_padding", *long))
    }
    time = topic.data[_TIME][: scope.most] * 1e-6
    rows = max(survey.rows.get(topic.msg_id, 0), time.size) if scope.most is not None else time.size
    return Group(
        name, columns, time, {}, topic.name, "", rows, survey.spans.get(topic.msg_id) if rows > time.size else None
    )


FORMAT = Format("PX4 ULog", (".ulg", ".ulog"), _is_ulog, _read, slow=True)
