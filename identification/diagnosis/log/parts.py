"""A record in parts: fits count all of it, what they find must foretell each part, and errors are those of unseen ones.

Parts follow from the record, not from how long free runs are wanted, so that no name depends on that.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.deciding import MOST_PARTS
from identification.fit.shooting import unknown_states
from identification.fit.windows import LEAST_SAMPLES, cut, stretches_of

Part = tuple[slice, ...]


def parts_of(plant: Plant, record: Record, most: int = MOST_PARTS) -> tuple[Part, ...]:
    """The stretches that a filter goes through, in up to `most` parts of equal length, one after the other.

    Of whole segments in turn where each has an unknown of its own (`Family.shared`), which its pieces would tell each
    other, and there are several.
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
    numbers = [block_numbers(record, stretches, most)[s] for s in _own(stretches)]
    found: list[list[slice]] = [[] for _ in range(most)]
    for stretch, own in zip(stretches, numbers, strict=True):
        edges = stretch.start + np.r_[0, np.flatnonzero(np.diff(own)) + 1, own.size]
        for a, b in pairwise(edges.tolist()):
            found[int(own[a - stretch.start])].append(slice(a, b))
    return tuple(tuple(part) for part in found if part)


def excerpts(record: Record, parts: Sequence[Part], inputs: Sequence[str], samples: int) -> tuple[Part, ...]:
    """Of each part, the stretch of at most so many samples in which the inputs move most; of several logs, one of each.

    No reading decides which of them count, only what was commanded.
    """
    return tuple(
        tuple(_liveliest(record, own, inputs, samples // len(logs)) for own in logs)
        for logs in (_by_log(record, part) for part in parts)
    )


def _by_log(record: Record, part: Part) -> list[Part]:
    """The pieces of a part, those of one label together, in the order of the record."""
    starts, labels, found = [segment.start for segment in record.segments], record.labels, dict[str, list[slice]]()
    for piece in part:
        segment = int(np.searchsorted(starts, piece.start, side="right")) - 1
        found.setdefault(labels[segment], []).append(piece)
    return [tuple(own) for own in found.values()]


def _liveliest(record: Record, part: Part, inputs: Sequence[str], samples: int) -> slice:
    pieces = [slice(a, min(a + samples, p.stop)) for p in part for a in range(p.start, p.stop, samples)]
    longest = max(p.stop - p.start for p in pieces)
    pieces = [p for p in pieces if 2 * (p.stop - p.start) >= longest]
    return pieces[int(np.argmax(excitation(record, inputs, pieces)))]


def excitation(record: Record, inputs: Sequence[str], pieces: Sequence[slice]) -> np.ndarray:
    """How much those inputs that a record has move in each of some pieces, each over its most in any, summed; (K,)."""
    signals = [record[name] for name in inputs if record.has(name)]
    moves = np.array([[float(np.std(signal[p])) for signal in signals] for p in pieces])
    return np.sum(moves / np.maximum(moves.max(axis=0), 1e-12), axis=1)


def block_numbers(record: Record, stretches: Sequence[slice], count: int) -> np.ndarray:
    """For each row of the stretches, which of `count` equal times it is in, what lies between stretches left out."""
    lengths = [record.time[s] - record.time[s.start] for s in stretches]
    before = np.cumsum([0.0, *(float(own[-1]) * own.size / max(own.size - 1, 1) for own in lengths)])
    at = np.concatenate([own + b for own, b in zip(lengths, before, strict=False)])
    return np.minimum((at / before[-1] * count).astype(int), count - 1)


def windows_of(record: Record, part: Part, seconds: float) -> Part:
    """A part in equal windows of at most `seconds`; what is shorter than half of that only if there is nothing else."""
    found = [w for piece in part for w in cut(record.time, piece.start, piece.stop, seconds)]
    found = [w for w in found if w.stop - w.start >= LEAST_SAMPLES]
    long = [w for w in found if record.time[w.stop - 1] - record.time[w.start] >= 0.5 * seconds]
    return tuple(long or found)


def _own(stretches: Sequence[slice]) -> list[slice]:
    """Where the rows of each stretch are among those of all."""
    edges = np.cumsum([0, *(s.stop - s.start for s in stretches)])
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]
