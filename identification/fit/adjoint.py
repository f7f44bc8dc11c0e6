"""The gradient of a Kalman filter's likelihood with respect to the noises and to the initial states of its stretches.

Source: adjoint of a filter, Koopman and Shephard 1992, Biometrika 79, extended here from all rows to any weights of the
rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auv_gym.compiled import outlined
from identification.fit.kalman import Pass, System, among, latest, own_states


@dataclass(frozen=True, eq=False)
class Slopes:
    """The gradient of a weighted sum of scores.

    noises: (C + 2 D,), by the logarithms of the standard deviations of the channels and of the accelerations, and of
    their correlation times.  means: (W, N), and covariances: (W, N, N), by the initial means and covariances of the
    stretches.
    """

    noises: np.ndarray
    means: np.ndarray
    covariances: np.ndarray


def slopes_of(
    system: System, found: Pass, weights: np.ndarray, variances: np.ndarray, deviations: np.ndarray, times: np.ndarray
) -> Slopes:
    """The gradient of the weighted sum of the scores of a pass, by its adjoint; zero for the accelerations left out."""
    kept = deviations > 0.0
    s, own, count, size = latest(system, kept), own_states(system, kept), variances.size, found.means.shape[1]
    slopes = np.zeros(count + 2 * int(kept.sum()))
    means, covariances = np.zeros((len(s.origin), size)), np.zeros((len(s.origin), size, size))
    numbers = (s.a, s.c, s.finite, s.counts, s.begin, s.constant, s.durations)
    _backward(
        *numbers, weights, variances, deviations[kept], times[kept], s.turning,
        np.compress(own, found.gains, axis=1), found.whiten, found.innovations, found.roots, found.means,
        slopes, means, covariances,
    )  # fmt: skip
    noises = among(slopes, np.r_[np.ones(count, dtype=bool), kept, kept], 0)
    return Slopes(noises, among(means, own, 1), among(covariances, own, 1, 2))


@outlined
def _backward(
    a, c, finite, counts, begin, constant, durations, weights, variances, deviations, times, turns,
    gains, whiten, innovations, roots, means, slopes, mean_slopes, covariance_slopes,
):  # fmt: skip
    """The adjoint of `_forward`; see `slopes_of`."""
    rows, count, size = c.shape
    pushed = deviations.shape[0]
    solid = size - pushed
    mean, covariance = np.zeros(size), np.zeros((size, size))  # slopes by the mean and covariance before the next row
    before, product, known = np.zeros(size), np.zeros((size, size)), np.zeros((size, size))
    inverse, inner, across = np.zeros((count, count)), np.zeros((count, count)), np.zeros((count, size))
    weighted, reach = np.zeros((size, count)), np.zeros((count, size))
    scaled, onto, told = np.zeros(count), np.zeros(count), np.zeros(size)
    keeps, gives, partner = np.zeros(pushed), np.zeros(pushed), np.arange(pushed) + solid
    stretch = mean_slopes.shape[0]
    for k in range(rows - 1, -1, -1):
        # backwards over the time update, from before the next row's readings to after this row's
        ends = k + 1 == rows or begin[k + 1] == 1
        if k + 1 < rows and begin[k + 1] > 0:
            for d in range(pushed):
                slopes[count + d] += covariance[solid + d, solid + d] * 2.0 * deviations[d] ** 2
            for i in range(size):  # constant states carry over, without their cross-covariances
                goes_on = constant[i] and not ends
                mean[i] = mean[i] if goes_on else 0.0
                for j in range(size):
                    covariance[i, j] = covariance[i, j] if goes_on and i == j else 0.0
        if not ends:
            _known(roots[k], known)
            _updated(known, gains[k], c[k], reach)
            _of_turns(durations[k], times, turns, keeps, gives, partner, solid)
            for i in range(size):  # P A^T P_next A, by rows
                for j in range(size):
                    product[i, j] = 0.0
                for n in range(solid):
                    factor = covariance[i, n]
                    if factor != 0.0:
                        for j in range(size):
                            product[i, j] += factor * a[k, n, j]
                before[i] = 0.0
            for d in range(pushed):
                j = solid + d
                for i in range(size):
                    product[i, j] += covariance[i, j] * keeps[d]
                if gives[d] != 0.0:
                    for i in range(size):
                        product[i, j] += covariance[i, partner[d]] * gives[d]
            for d in range(pushed):
                i = solid + d
                decay = np.exp(-durations[k] / times[d])
                ratio = decay * durations[k] / times[d]  # slope of the decay by the logarithm of the time
                if begin[k + 1] == 0:
                    slopes[count + d] += covariance[i, i] * 2.0 * deviations[d] ** 2 * (1.0 - decay * decay)
                    total = mean[i] * means[k, i]
                    for n in range(size):
                        total += 2.0 * product[i, n] * known[n, i]
                    if gives[d] != 0.0:
                        turned = mean[i] * means[k, partner[d]]
                        for n in range(size):
                            turned += 2.0 * product[i, n] * known[n, partner[d]]
                        total = (keeps[d] * total - gives[d] * turned) / decay
                    total -= 2.0 * deviations[d] ** 2 * decay * covariance[i, i]
                    slopes[count + pushed + d] += total * ratio
                before[i] = keeps[d] * mean[i] + gives[d] * mean[partner[d]]
            for n in range(solid):
                factor = mean[n]
                for j in range(size):
                    before[j] += factor * a[k, n, j]
            for i in range(size):
                mean[i] = before[i]
                for j in range(size):
                    covariance[i, j] = 0.0
            for n in range(solid):
                for i in range(size):
                    factor = a[k, n, i]
                    if factor != 0.0:
                        for j in range(size):
                            covariance[i, j] += factor * product[n, j]
            for d in range(pushed):
                i = solid + d
                for j in range(size):
                    covariance[i, j] += keeps[d] * product[i, j]
                if gives[d] != 0.0:
                    for j in range(size):
                        covariance[i, j] += gives[d] * product[partner[d], j]
        # backwards over the measurement update
        for m in range(count):
            scaled[m] = 0.0
            onto[m] = 0.0
            for n in range(count):
                inverse[m, n] = 0.0
                inner[m, n] = 0.0
        for j in range(count):
            for m in range(j + 1):
                factor = whiten[k, j, m]
                scaled[m] += factor * innovations[k, j]
                if factor != 0.0:
                    for n in range(j + 1):
                        inverse[m, n] += factor * whiten[k, j, n]
        for i in range(size):
            factor = mean[i]
            for m in range(count):
                onto[m] += factor * gains[k, i, m]
                weighted[i, m] = 0.0
            for j in range(size):
                factor = covariance[i, j]
                for m in range(count):
                    weighted[i, m] += factor * gains[k, j, m]
        for i in range(size):
            for m in range(count):
                factor = gains[k, i, m]
                for n in range(count):
                    inner[m, n] += factor * weighted[i, n]
        for m in range(count):
            for n in range(count):
                inner[m, n] -= 0.5 * (onto[m] * scaled[n] + scaled[m] * onto[n])
                inner[m, n] += 0.5 * weights[k] * (scaled[m] * scaled[n] - inverse[m, n])
            if finite[k, m]:
                slopes[m] += inner[m, m] * 2.0 * (variances[m] / counts[k, m])
        # G becomes L^T G L with L = I - K C, one side after the other: for an unstable vehicle, the terms of both at
        # once would be so large that only rounding error would be left
        for i in range(size):
            before[i], told[i] = mean[i], 0.0
            for j in range(size):
                product[i, j] = covariance[i, j]
            for m in range(count):
                factor = weighted[i, m]
                for j in range(size):
                    product[i, j] -= factor * c[k, m, j]
        for m in range(count):
            for j in range(size):
                reach[m, j] = 0.0
        for i in range(size):
            for m in range(count):
                factor = gains[k, i, m]
                for j in range(size):
                    reach[m, j] += factor * product[i, j]
        for m in range(count):
            factor = onto[m]
            for j in range(size):
                before[j] -= factor * c[k, m, j]
        for m in range(count):
            for j in range(size):
                told[j] += scaled[m] * c[k, m, j]
                across[m, j] = 0.0
            for n in range(count):
                factor = inverse[m, n]
                for j in range(size):
                    across[m, j] += factor * c[k, n, j]
        for i in range(size):
            mean[i] = before[i] + weights[k] * told[i]
            for j in range(size):
                covariance[i, j] = 0.5 * (before[i] * told[j] + told[i] * (before[j] + weights[k] * told[j]))
                covariance[i, j] += product[i, j]
        for m in range(count):
            for j in range(size):
                reach[m, j] += 0.5 * weights[k] * across[m, j]
            for i in range(size):
                factor = c[k, m, i]
                if factor != 0.0:
                    for j in range(size):
                        covariance[i, j] -= factor * reach[m, j]
        if begin[k] > 0:
            stretch -= 1
            for i in range(size):
                mean_slopes[stretch, i] = mean[i]
                for j in range(size):
                    covariance_slopes[stretch, i, j] = covariance[i, j]
    for d in range(pushed):
        slopes[count + d] += covariance[solid + d, solid + d] * 2.0 * deviations[d] ** 2


@outlined
def _of_turns(duration, times, turns, keeps, gives, partner, solid):
    """Write the share of each acceleration, (D,), kept after a duration, s, and the share passed to its partner."""
    for d in range(times.shape[0]):
        decay = np.exp(-duration / times[d])
        if turns[d] == 0.0:
            if d == 0 or turns[d - 1] == 0.0:
                keeps[d], gives[d] = decay, 0.0
            continue
        keeps[d], gives[d] = decay * np.cos(turns[d] * duration), decay * np.sin(turns[d] * duration)
        partner[d], partner[d + 1] = solid + d + 1, solid + d
        keeps[d + 1], gives[d + 1] = keeps[d], -gives[d]


@outlined
def _known(root, covariance):
    """Write root^T root into covariance."""
    size = root.shape[0]
    for i in range(size):
        for j in range(size):
            covariance[i, j] = 0.0
    for n in range(size):
        for i in range(size):
            factor = root[n, i]
            if factor != 0.0:
                for j in range(size):
                    covariance[i, j] += factor * root[n, j]


@outlined
def _updated(covariance, gain, c, reach):
    """Update a covariance by a row's readings to P - K C P, in place; reach: work, (C, N)."""
    count, size = c.shape
    for m in range(count):
        for j in range(size):
            reach[m, j] = 0.0
        for n in range(size):
            factor = c[m, n]
            if factor != 0.0:
                for j in range(size):
                    reach[m, j] += factor * covariance[n, j]
    for i in range(size):
        for m in range(count):
            factor = gain[i, m]
            for j in range(size):
                covariance[i, j] -= factor * reach[m, j]
