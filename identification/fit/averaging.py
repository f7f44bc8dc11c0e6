"""Readings of a densely sampled record, averaged over rows of a few samples each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.records.record import Record


@dataclass(frozen=True, eq=False)
class Averages:
    """Rows of `stride` samples in stretches of a record, and the means of the readings in each.

    A model's outputs are averaged over the same samples, so that a mean has no bias, even if the signal curves within a
    row or some of its readings are missing.  A rarely read channel keeps each reading, at its own time.

    stretches: cut to whole rows.  rows: (R,), the first sample of each.  samples: all of them.  values: (R, C) means,
    NaN without a reading; counts: (R, C), readings in each, 1 without one.  shares: (n, C), weight of each sample in
    its row.
    away: (R,), s, from the first sample of a row to the mean of its times.
    """

    stride: int
    stretches: tuple[slice, ...]
    rows: np.ndarray
    samples: np.ndarray
    values: np.ndarray
    counts: np.ndarray
    shares: np.ndarray
    away: np.ndarray

    @classmethod
    def of(
        cls, record: Record, names: Sequence[str], values: np.ndarray, stretches: Sequence[slice], stride: int
    ) -> Averages:
        """The means of channels, whose values are (n, C), over readings alone: values in between are no information."""
        whole = tuple(slice(w.start, w.start + (w.stop - w.start) // stride * stride) for w in stretches)
        samples = np.concatenate([np.arange(w.start, w.stop) for w in whole])
        held = np.isfinite(values)
        for c, name in enumerate(names):
            if record.has(name):
                held[:, c] &= record.readings(name)
        grouped = samples.reshape(-1, stride)
        counts = np.maximum(held[grouped].sum(axis=1), 1).astype(float)
        told = np.where(held, values, 0.0)[grouped].sum(axis=1) / counts
        told[~held[grouped].any(axis=1)] = np.nan
        shares = np.zeros(values.shape if stride > 1 else (0, values.shape[1]))
        if stride > 1:
            shares[samples] = (held[grouped] / counts[:, None]).reshape(len(samples), values.shape[1])
        time = record.time[grouped]
        away = time.mean(axis=1) - time[:, 0] if stride > 1 else np.zeros(len(grouped))
        rows = np.ascontiguousarray(grouped[:, 0])  # another memory layout would trigger another compilation
        return cls(stride, whole, rows, samples, told, counts, shares, away)
