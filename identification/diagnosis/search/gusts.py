"""Tests of whether random accelerations are stronger at some times than at others, or last too long for noise."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from identification.deciding import GUST_PARTS, LEFT
from identification.fit.followed import Point
from identification.fit.prediction_errors import PredictionErrors

_SMALL_STEP = 0.05  # change of the logarithm of a strength, for its information
_LONGER = np.exp([0.5, 1.0, 2.0, 3.0])  # factors of the longest correlation time that are tried


def gusts(problem: PredictionErrors, point: Point) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The velocities whose random accelerations are surely stronger in some part of the record, and such channels.

    The channels are those with lasting errors.  The test uses the slopes of the log-likelihood of equal parts by an
    acceleration's strength (a score test; Rao 1948, Proceedings of the Cambridge Philosophical Society 44).  With an
    information of n/2 in a part, twice the slope plus n is distributed nearly as chi-square with n degrees of freedom,
    and exactly if the acceleration is measured directly.
    `LEFT` is the probability of a false alarm, shared among all accelerations and parts.
    """
    if point.system is None or not problem.pushes(point).any():
        return (), ()
    strengths = [len(problem.channels) + int(d) for d in np.flatnonzero(problem.pushes(point))]
    slopes = problem.slopes_in_parts(point, GUST_PARTS)[:, strengths]
    informations = np.diag(problem.noise_information(point, strengths, _SMALL_STEP))
    found: tuple[list[str], list[str]] = ([], [])
    tried = [slopes.reshape(-1, together, len(strengths)).sum(axis=1) for together in (1, 2, 4)]
    count = len(strengths) * sum(len(one) for one in tried)
    for k, (i, information) in enumerate(zip(strengths, informations, strict=True)):
        freedoms = [2.0 * information / len(one) for one in tried]
        chances = [chi2.sf(2.0 * s[:, k].max() + n, n) for s, n in zip(tried, freedoms, strict=True) if n > 0.0]
        if count * min(chances, default=1.0) < LEFT:
            d = i - len(problem.channels)
            found[int(problem.misread[d])].append(problem.pushed[d])
    return tuple(found[0]), tuple(found[1])


def slow(problem: PredictionErrors, point: Point) -> tuple[str, ...]:
    """The states pushed by noise that surely lasts longer than any noise may, like an effect that acts slowly.

    The test compares the likelihoods of longer correlation times, with the strength at high frequencies held, at the
    level `LEFT`.
    """
    system = point.system
    if system is None:
        return ()
    channels, pushed = len(problem.channels), len(problem.pushed)
    there = np.flatnonzero(problem.pushes(point) & (point.logs[channels + pushed :] >= problem.slowest - 1e-9))
    found, usual = [], problem.likelihood_of_noises(system, point.logs)
    for d in there:
        longer = np.tile(point.logs, (len(_LONGER), 1))
        longer[:, channels + d] += 0.5 * np.log(_LONGER)
        longer[:, channels + pushed + d] += np.log(_LONGER)
        gain = 2.0 * (max(problem.likelihood_of_noises(system, logs) for logs in longer) - usual)
        if 0.5 * chi2.sf(gain, 1) < LEFT / len(there):
            found.append(problem.pushed[d])
    return tuple(found)
