"""Interquartile means of few runs with stratified bootstrap intervals, and the closed share of a gap.

Source: Agarwal, Schwarzer, Castro, Courville and Bellemare 2021, Deep reinforcement learning at the edge of the
statistical precipice, Advances in Neural Information Processing Systems 34, sections 4.1 and 4.3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

RESAMPLES = 10_000
LEVEL = 0.95
Strata = Sequence[np.ndarray]


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval; the interval is the value twice if nothing was resampled."""

    value: float
    low: float
    high: float


def interquartile_mean(values: np.ndarray) -> np.ndarray:
    """Mean of the middle half along the last axis; values at its edges count in part."""
    x = np.sort(np.asarray(values, dtype=float), axis=-1)
    n = x.shape[-1]
    at = np.arange(n)
    weight = np.clip(np.minimum(at + 1.0, 0.75 * n) - np.maximum(at, 0.25 * n), 0.0, None)
    return x @ weight / weight.sum()


def iqm(strata: Strata, rng: np.random.Generator) -> Estimate:
    """The interquartile mean of the scores of all runs; strata: scores by task, whose runs are resampled separately.

    A run is one training; its score is its mean return over the episodes, which are the same for all runs.
    """
    scores = _checked(strata)
    drawn = np.concatenate([_drawn(one, rng) for one in scores], axis=1)
    return _estimate(float(interquartile_mean(np.concatenate(scores))), interquartile_mean(drawn))


def compared(rows: Sequence[np.ndarray], value: Callable[..., np.ndarray], rng: np.random.Generator) -> Estimate:
    """A function of the interquartile means of several rows of one task, with each row's runs resampled separately."""
    scores = _checked(rows)
    means = [interquartile_mean(_drawn(one, rng)) for one in scores]
    return _estimate(float(value(*(interquartile_mean(one) for one in scores))), value(*means))


def share_closed(true: np.ndarray, believed: np.ndarray, found: np.ndarray) -> np.ndarray:
    """The share of the loss from the true to the believed model that a third one recovers."""
    return (found - believed) / (true - believed)


def _drawn(scores: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return scores[rng.integers(scores.size, size=(RESAMPLES, scores.size))]


def _estimate(value: float, drawn: np.ndarray) -> Estimate:
    low, high = np.quantile(drawn, [0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)])
    return Estimate(value, float(low), float(high))


def _checked(strata: Strata) -> list[np.ndarray]:
    scores = [np.atleast_1d(np.asarray(one, dtype=float)) for one in strata]
    if not scores or any(one.ndim != 1 or one.size < 1 or not np.isfinite(one).all() for one in scores):
        raise ValueError(f"Statistics need one finite score or more in each stratum, got {list(strata)!r}.")
    return scores
