"""The period of a swell, from a peak in the spectrum of prediction errors, which gusts do not cause.

Decaying accelerations have most power at low frequencies, whatever their correlation time, so a filter with them alone
is wrong in waves: its errors stay periodic, and coefficients that imitate a resonance are biased.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import f as fisher

from identification.deciding import FALSE_ALARM, LONGEST_SWELL
from identification.fit.followed import Point
from identification.fit.prediction_errors import PredictionErrors

_ROWS = 4  # shortest period of the search, in rows
_WIDTH = 1.15  # ratio of neighbouring frequencies; a band extends from the one below to the one above
_BELOW, _ABOVE = (0.5, 0.35, 0.25), (2.0, 2.8)  # over a peak's frequency: the bands that it is compared with
_LEAST = 4  # least number of frequencies in a band


def period_of_swell(problem: PredictionErrors, point: Point) -> float | None:
    """The period, s, of a significant spectral peak in the errors of a point, None without one.

    The power in a narrow band is compared with that of bands beside it, on either side the weakest, since a sea may
    have more than one peak; white errors make all equal (Fisher's F).  The most significant of all bands counts, its
    probability multiplied by the number of comparisons.
    """
    if point.system is None or not np.isfinite(point.scores).all():
        return None
    step = float(np.median(problem.durations))
    shortest = _ROWS * step
    if shortest * _WIDTH >= LONGEST_SWELL:
        return None
    frequencies, powers = _spectrum(problem, point, step)
    count = int(np.log(LONGEST_SWELL / shortest) / np.log(_WIDTH))
    middles = _WIDTH ** np.arange(1, count) / LONGEST_SWELL

    def band(middle: float) -> np.ndarray:
        return (frequencies > middle / _WIDTH) & (frequencies < middle * _WIDTH)

    read = float(problem.finite.mean(axis=0).sum())  # number of channels, with rarely read ones in part
    best, least = None, FALSE_ALARM / max(len(middles) * len(_BELOW + _ABOVE), 1)
    for middle in middles:
        own = band(middle)
        if own.sum() < _LEAST:
            continue
        sides = [[s for away in ways if (s := band(middle * away)).any()] for ways in (_BELOW, _ABOVE)]
        if not all(sides):
            continue
        chance = max(min(_chance(powers[own], powers[s], read) for s in side) for side in sides)
        if chance < least:
            best, least = own, chance
    if best is None:
        return None
    weights = powers[best] / powers[best].sum()
    return float(1.0 / (weights @ frequencies[best]))


def _spectrum(problem: PredictionErrors, point: Point, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, Hz, and powers of the errors, summed over the channels, of all stretches, (n,) both."""
    errors, found = point.errors, []
    for w in range(len(problem.stretches)):
        own = errors[problem.stretch_of_row == w]
        frequencies = np.fft.rfftfreq(len(own), step)
        powers = np.abs(np.fft.rfft(own, axis=0)) ** 2 / max(len(own), 1)
        found.append(np.stack([frequencies, powers.sum(axis=1)])[:, 1:])
    frequencies, powers = np.concatenate(found, axis=1)
    return frequencies, powers


def _chance(powers: np.ndarray, others: np.ndarray, channels: float) -> float:
    """The probability that white errors show powers so much larger than others.

    Each power has two degrees of freedom for each of the channels in its sum.
    """
    return float(fisher.sf(powers.mean() / others.mean(), 2 * channels * powers.size, 2 * channels * others.size))
