"""Errors of a glider in dives that no fit has seen: depth in free runs over half-dives, and intervals by resampling."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid

from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.fit.validation import free_runs, head_windows
from identification.fit.windows import cut

_SHORTEST = 300.0  # s; a shorter stretch is a remainder of a half-dive beside a gap
_PIECE = 600.0  # s; errors of a glider correlate over minutes
_RESAMPLES = 10_000
_ENDS = (0.025, 0.975)


def half_dives(record: Record) -> list[slice]:
    """The stretches without a gap in which a glider dives or climbs, of at least five minutes.

    record: samples in steady flight, which leave a gap at the turn between dive and climb.
    """
    return [s for s in record.segments if record.time[s.stop - 1] - record.time[s.start] >= _SHORTEST]


def depth_error(plant: Plant, record: Record) -> float:
    """RMS error of the depth, m, in free runs over half-dives, each from a start fitted to its first minute."""
    runs = free_runs(plant, record, half_dives(record), plant.settle)
    return rms(runs.errors(runs.channels.index("depth_m")))


def depth_error_of(velocity: np.ndarray, record: Record, settle: float) -> float:
    """RMS error of the depth, m, that a vertical velocity, m/s down, gives in half-dives.

    It is integrated by trapezoids, from the start that fits the first `settle` s best.
    """
    stretches, missed = half_dives(record), []
    for stretch, head in zip(stretches, head_windows(record, stretches, settle), strict=True):
        way = cumulative_trapezoid(velocity[stretch], record.time[stretch], initial=0.0)
        apart, first = way - record["depth_m"][stretch], head.stop - head.start
        missed.append(apart[first:] - apart[:first].mean())
    return rms(np.concatenate(missed))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def rms_draws(missed: Sequence[np.ndarray], record: Record) -> np.ndarray:
    """RMS of each error signal in resampled records, (errors, draws).

    missed: error of each sample; NaN is left out.  Block bootstrap: every stretch without a gap is cut into equal
    pieces of at most ten minutes, and pieces are drawn with replacement, the same ones for all errors.
    """
    pieces = [p for s in record.segments for p in cut(record.time, s.start, s.stop, _PIECE)]
    drawn = np.random.default_rng(0).integers(len(pieces), size=(_RESAMPLES, len(pieces)))
    found = []
    for errors in missed:
        squares = np.array([np.nansum(errors[p] ** 2) for p in pieces])
        counts = np.array([np.isfinite(errors[p]).sum() for p in pieces])
        found.append(np.sqrt(squares[drawn].sum(axis=1) / counts[drawn].sum(axis=1)))
    return np.array(found)


def interval_of(draws: np.ndarray) -> tuple[float, float]:
    """The 95 % interval of a quantity from its values in resampled records."""
    low, high = np.quantile(draws, _ENDS)
    return float(low), float(high)
