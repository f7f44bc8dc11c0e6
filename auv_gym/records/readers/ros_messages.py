"""Topics of ROS logs as groups of columns, for the readers of ROS bags and MCAP files."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from auv_gym.records.log import MOST_ELEMENTS, Group, Log, Scope
from auv_gym.records.readers.ros_bytes import from_bytes
from auv_gym.records.readers.ros_json import from_json
from auv_gym.records.readers.ros_types import NO_SIGNALS, Block, Topic, Unreadable, full_type, parsed, shipped

ENCODINGS = ("ros1", "cdr", "json")
_BLOCK = 4096  # messages that are decoded at once
_BLOCK_BYTES = 16_000_000
_UNSTEADY = 0.5  # s; stamps that deviate more from the recorder's clock do not run with it
_SAME_CLOCK = 1.0  # s; a smaller offset is transmission time, not another clock
_FIRST_LOOK = 3.0  # s
_SHOWN = 6  # names in a note


class Topics:
    """The topics of a log being read: takes raw messages, and makes groups and notes of them."""

    def __init__(self, scope: Scope) -> None:
        self._scope = scope
        self._samples: dict[str, Samples] = {}
        self._left_out: dict[str, str] = {}
        self._began = self._last = time.monotonic()

    def samples(self, topic: Topic) -> Samples | None:
        """The destination of a topic's messages; None if they are not needed, or left out."""
        name = "/".join(part for part in topic.name.split("/") if part)
        known = self._samples.get(name)
        if known is not None:  # from another publisher, or in the next file of a bag
            if (known.topic.type, known.topic.encoding) != (full_type(topic.type), topic.encoding):
                self._left_out[f"{name} as {topic.type}"] = f"it is also a topic of {known.topic.type}"
                return None
            known.extend(topic)
            return known
        if not self._scope.wants(name) or name in self._left_out:
            return None
        try:
            self._samples[name] = Samples(replace(topic, name=name, type=full_type(topic.type)), self._scope.most)
        except Unreadable as reason:
            self._left_out[name] = str(reason)
            return None
        return self._samples[name]

    @property
    def enough(self) -> bool:
        """Whether a first look at a file without an index may end: all topics so far are full, or it took too long."""
        if self._scope.most is None:
            return False
        full = all(samples.full for samples in self._samples.values())
        return (full and bool(self._samples)) or time.monotonic() > self._began + _FIRST_LOOK

    def progress(self, fraction: float, words: str) -> None:
        """Report the progress of reading to the scope, at most twice a second."""
        now = time.monotonic()
        if now - self._last > 0.5:
            self._last = now
            self._scope.progress(min(max(fraction, 0.0), 1.0), words)

    def log(self, form: str, path: Path, notes: Iterable[str] = ()) -> Log:
        """The log; raises ValueError if a file holds nothing readable."""
        groups: list[Group] = []
        clocks: dict[str, list[str]] = {}
        more: list[str] = []
        covariances: list[str] = []
        empty: list[str] = []
        for name, samples in self._samples.items():
            try:
                group, clock = samples.group()
            except Unreadable as reason:
                self._left_out[name] = str(reason)
                continue
            if not group.rows:
                empty.append(name)
                continue
            groups.append(group)
            if len(group.columns) and group.time is not None and group.time.size:
                clocks.setdefault(clock, []).append(name)
            more += samples.notes()
            covariances += [name] * samples.covariances
        if not groups and self._scope.groups is None:
            reasons = "; ".join(f"{name}: {reason}" for name, reason in list(self._left_out.items())[:_SHOWN])
            got = f"none that can be read ({reasons})" if reasons else "no messages"
            raise ValueError(
                f"{path} needs at least one topic with numbers, got {got}. {''.join(f'{note} ' for note in notes)}"
                "Copy it again, or record the topics of sensors and actuators."
            )
        lines = [*notes]
        lines += [f"{name} is left out: {reason}." for name, reason in self._left_out.items()]
        lines += [clock.format(_listed(names)) for clock, names in clocks.items()]
        lines += more
        if empty:
            lines.append(f"There are no messages in {_listed(empty)}.")
        if covariances:
            lines.append(f"Covariances are left out in {_listed(covariances)}.")
        return Log(form, path.name, tuple(groups), notes=tuple(lines))


class Samples:
    """The messages of a topic, decoded block by block; raises Unreadable if they cannot be decoded."""

    def __init__(self, topic: Topic, most: int | None) -> None:
        self.topic = topic
        self.covariances = False
        self._most = most
        self._decoders = _decoders(topic)
        self._decode = next(self._decoders)
        self._ns: list[int] = []
        self._raw: list[bytes] = []
        self._bytes = 0
        self._added = 0
        self._bad = 0
        self._blocks: list[Block] = []
        self._unreadable: Unreadable | None = None

    @property
    def full(self) -> bool:
        """Whether a first look has enough messages."""
        return self._unreadable is not None or (self._most is not None and self._added >= self._most)

    @property
    def room(self) -> int | None:
        """The number of messages still needed; None: all."""
        if self._unreadable is not None:
            return 0
        return None if self._most is None else max(self._most - self._added, 0)

    def extend(self, topic: Topic) -> None:
        """Count the messages of the same topic from another publisher or file."""
        spans = [span for span in (self.topic.span, topic.span) if span is not None]
        span = (min(first for first, _ in spans), max(last for _, last in spans)) if spans else None
        self.topic = replace(self.topic, rows=self.topic.rows + topic.rows, span=span)

    def add(self, ns: int, raw: bytes) -> None:
        """Take a message that was received ns nanoseconds after 1970."""
        self._ns.append(ns)
        self._raw.append(raw)
        self._bytes += len(raw)
        self._added += 1
        if len(self._raw) >= _BLOCK or self._bytes >= _BLOCK_BYTES:
            self._flush()

    def group(self) -> tuple[Group, str]:
        """The group, and words for a note on the origin of its times, with {} for the topic."""
        self._flush()
        if self._unreadable is not None:
            raise self._unreadable
        kept = sum(block.received.size for block in self._blocks)
        if self._bad and not kept:
            raise Unreadable(f"none of its {self._bad} messages is what its definition says")
        names = dict.fromkeys(name for block in self._blocks for name in block.columns)
        long = {name for block in self._blocks for name in block.long}
        columns = {
            name: np.concatenate(
                [block.columns.get(name, np.full(block.received.size, np.nan)) for block in self._blocks]
            )
            for name in names
            if not any(name.startswith(f"{array}[") for array in long)
        }
        for field in self._unknown():
            mine = [name for name in columns if name.startswith(f"{field}.")]
            if all(np.isnan(columns[name]).all() for name in mine):
                columns = {name: column for name, column in columns.items() if name not in mine}
        if kept and not columns:
            raise Unreadable(f"it holds no numbers ({self.topic.type})" if not long else _long_words(long))
        received = _joined([block.received for block in self._blocks])
        seconds, clock = _clock(received, _joined([block.stamps for block in self._blocks]))
        units = {name: unit for block in self._blocks for name, unit in block.units.items() if name in columns}
        frame = next((block.frame for block in self._blocks if block.frame), "")
        rows = self.topic.rows if self._most is not None and self._added < self.topic.rows else kept
        span = self.topic.span if kept < rows else None
        self.covariances = any(block.covariances for block in self._blocks)
        return Group(self.topic.name, columns, seconds, units, self.topic.type, frame, rows, span), clock

    def notes(self) -> list[str]:
        """A line for each thing that is missing in the group."""
        long = {name for block in self._blocks for name in block.long}
        lines = [f"{self.topic.name}: {_long_words(long)}."] if long else []
        lines += [f"{field} is left out where its covariance says that it is not known." for field in self._unknown()]
        if self._bad:
            lines.append(f"{self.topic.name}: {self._bad} messages are not what its definition says, and are left out.")
        return lines

    def _unknown(self) -> list[str]:
        return sorted({field for block in self._blocks for field in block.unknown})

    def _flush(self) -> None:
        raws, received = self._raw, np.array(self._ns, dtype=np.int64) * 1e-9
        self._raw, self._ns, self._bytes = [], [], 0
        if not raws or self._unreadable is not None:
            return
        try:
            block = self._decoded(raws, received)
        except Unreadable as reason:
            self._unreadable = reason
            return
        self._bad += len(raws) - block.received.size
        self._blocks.append(block)

    def _decoded(self, raws: Sequence[bytes], received: np.ndarray) -> Block:
        """Decode the messages by the definition that fits the first of them."""
        block, why = None, Unreadable("")
        for decode in chain([self._decode], self._decoders):
            try:
                block = decode(raws, received)
            except Unreadable as reason:
                why = reason
                continue
            self._decode = decode
            if block.received.size or self._blocks:
                break
        if block is None:
            raise why
        return block


def _decoders(topic: Topic) -> Iterator[Callable[[Sequence[bytes], np.ndarray], Block]]:
    """Ways to decode the messages of a topic, the likeliest first."""
    if topic.encoding not in ENCODINGS:
        raise Unreadable(f"its messages are in {topic.encoding!r}, and only {', '.join(ENCODINGS)} are read")
    if topic.type in NO_SIGNALS:
        raise Unreadable(f"it holds {NO_SIGNALS[topic.type]} ({topic.type})")
    if topic.encoding == "json":
        return iter([partial(from_json, topic)])
    if topic.definition:
        return iter([partial(from_bytes, topic, parsed(topic.definition, topic.type, topic.idl))])
    found = (partial(from_bytes, topic, types) for types in shipped(topic.encoding == "ros1") if topic.type in types)
    first = next(found, None)
    if first is None:
        raise Unreadable(f"its type {topic.type or '(without a name)'} is defined neither in the file nor by ROS")
    return chain([first], found)


def _clock(received: np.ndarray, stamps: np.ndarray) -> tuple[np.ndarray, str]:
    """The time of each message, s, and its origin: the stamp, unless stamps are unusable.

    Stamps are usable if all are set and run with the recorder's clock.  If they count from another start, they are
    shifted by their median offset, so that all topics share one clock.
    """
    if not stamps.size or np.isnan(stamps).all():
        return received, "Time is the time of reception in {}, whose messages have no stamp."
    if not (np.isfinite(stamps) & (stamps != 0.0)).all():
        return received, "Time is the time of reception in {}, because not all stamps are set."
    late = received - stamps
    low, offset, high = np.percentile(late, [1.0, 50.0, 99.0])
    if high - low > _UNSTEADY:
        return received, (
            f"Time is the time of reception in {{}}, because the stamps wander by {high - low:.3g} s against the "
            "recorder's clock."
        )
    if abs(offset) <= _SAME_CLOCK:
        return stamps, "Time is the stamp of each message in {}."
    return stamps + offset, (
        f"Time is the stamp of each message plus {offset:.6g} s, which sets it to the recorder's clock, in {{}}."
    )


def _joined(parts: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate(parts) if parts else np.zeros(0)


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more


def _long_words(long: Collection[str]) -> str:
    return f"arrays of more than {MOST_ELEMENTS} numbers are left out ({_listed(sorted(long))})"
