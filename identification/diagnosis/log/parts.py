"""Division of a record into parts: fits use all of them, findings must predict each one, errors are of unseen parts.

The parts depend on the record, not on the requested length of free runs, so that the effects named do not depend on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.deciding import MOST_PARTS
from identification.fit.shooting import unknown_states
from identification.fit.windows import LEAST_SAMPLES, cut, stretches_of

Part = tuple[slice, ...]


def parts_of(plant: Plant, record: Record, most: int = MOST_PARTS) -> tuple[Part, ...]:
    """The stretches that a filter goes through, in up to `most` consecutive parts of equal duration.

    If each segment has an unknown state (`Family.shared`) and there are several, whole segments are dealt to the parts
    in turn: pieces of one segment would share that state.
    """
    stretches = stretches_of(plant, record)
    if unknown_states(plant):
        starts = [segment.start for segment in record.segments]
        of = [int(np.searchsorted(starts, s.start, side="right")) for s in stretches]
        used = list(dict.fromkeys(of))
        if len(used) > 1:
            count = min(most, len(used))
            return tuple(
                tuple(s for s, k in zip(stretches, of, strict=True) if used.index(k) % count == part)
                for part in range(count)
            )
    return tuple(tuple(part) for part in in_equal_times(record, stretches, most) if part)


def in_equal_times(record: Record, stretches: Sequence[slice], count: int) -> list[list[slice]]:
    """The pieces of stretches in each of `count` equal spans of time; see `block_numbers`.

    No cut leaves fewer than `LEAST_SAMPLES` samples on a side; a piece belongs to the span in which its middle is.
    """
    numbers = block_numbers(record, stretches, count)
    found: list[list[slice]] = [[] for _ in range(count)]
    for stretch, own in zip(stretches, (numbers[s] for s in _own(stretches)), strict=True):
        edges = [0]
        for cut_at in (np.flatnonzero(np.diff(own)) + 1).tolist():
            if min(cut_at - edges[-1], own.size - cut_at) >= LEAST_SAMPLES:
                edges.append(cut_at)
        for a, b in pairwise([*edges, own.size]):
            found[int(own[(a + b) // 2])].append(slice(stretch.start + a, stretch.start + b))
    return found


@dataclass(frozen=True)
class OneLog:
    """One of a record's logs: its label, its number, and its rows."""

    label: str
    number: int
    rows: slice

    @property
    def name(self) -> str:
        """The log's label, or "log" and a label that is a number, or its number."""
        return f"log {self.label or self.number}" if self.label.isdigit() or not self.label else self.label

    def among(self, pieces: Sequence[slice]) -> list[slice]:
        """The pieces of the record that begin in this log."""
        return [p for p in pieces if self.rows.start <= p.start < self.rows.stop]


def logs_in(record: Record) -> list[OneLog]:
    """The logs of a record: consecutive segments with the same label."""
    found: list[OneLog] = []
    for label, segment in zip(record.labels, record.segments, strict=True):
        if found and found[-1].label == label:
            found[-1] = replace(found[-1], rows=slice(found[-1].rows.start, segment.stop))
        else:
            found.append(OneLog(label, len(found) + 1, segment))
    return found


def excerpts(record: Record, parts: Sequence[Part], inputs: Sequence[str], samples: int) -> tuple[Part, ...]:
    """The stretch of each part, at most `samples` long, in which the inputs move most; one from each log if several.

    The choice depends only on the commands, not on any reading.
    """
    logs, found = logs_in(record), list[Part]()
    for part in parts:
        by_log = [own for own in (one.among(part) for one in logs) if own]
        found.append(tuple(_liveliest(record, own, inputs, samples // len(by_log)) for own in by_log))
    return tuple(found)


def _liveliest(record: Record, part: Sequence[slice], inputs: Sequence[str], samples: int) -> slice:
    pieces = [slice(a, min(a + samples, p.stop)) for p in part for a in range(p.start, p.stop, samples)]
    longest = max(p.stop - p.start for p in pieces)
    pieces = [p for p in pieces if 2 * (p.stop - p.start) >= longest]
    return pieces[int(np.argmax(excitation(record, inputs, pieces)))]


def excitation(record: Record, inputs: Sequence[str], pieces: Sequence[slice]) -> np.ndarray:
    """The excitation of each piece, (K,): standard deviation of each input, over its largest in any piece, summed."""
    signals = [record[name] for name in inputs if record.has(name)]
    moves = np.array([[float(np.std(signal[p])) for signal in signals] for p in pieces])
    return np.sum(moves / np.maximum(moves.max(axis=0), 1e-12), axis=1)


def block_numbers(record: Record, stretches: Sequence[slice], count: int) -> np.ndarray:
    """The number of the equal span of time, of `count`, that each row of the stretches is in; gaps do not count."""
    lengths = [record.time[s] - record.time[s.start] for s in stretches]
    before = np.cumsum([0.0, *(float(own[-1]) * own.size / max(own.size - 1, 1) for own in lengths)])
    at = np.concatenate([own + b for own, b in zip(lengths, before, strict=False)])
    return np.minimum((at / before[-1] * count).astype(int), count - 1)


def windows_of(record: Record, part: Part, seconds: float) -> Part:
    """A part in equal windows of at most `seconds`; ones shorter than half of that only if there are no others."""
    found = [w for piece in part for w in cut(record.time, piece.start, piece.stop, seconds)]
    found = [w for w in found if w.stop - w.start >= LEAST_SAMPLES]
    long = [w for w in found if record.time[w.stop - 1] - record.time[w.start] >= 0.5 * seconds]
    return tuple(long or found)


def _own(stretches: Sequence[slice]) -> list[slice]:
    """The position of each stretch's rows among the rows of all stretches."""
    edges = np.cumsum([0, *(s.stop - s.start for s in stretches)])
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]
