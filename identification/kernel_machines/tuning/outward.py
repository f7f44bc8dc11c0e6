"""Penalty and width of an LS-SVM regression by its extrapolation.

The leave-one-out error judges a machine between its samples, where a narrow kernel with a large C is best.  A simulated
model leaves the samples, and such a machine fails there.  So the machine of the inner samples is judged by the outer
ones.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.kernel_machines.regression import Distances, LsSvmRegression, Training
from identification.kernel_machines.tuning.tuning import LEAST_PENALTY, Progress, Tuned, largest_penalty, silent

INNER = 0.7  # share of the samples
FEW_SAMPLES = 800
WIDTHS = 0.5, 30.0  # sigmas searched, in median distances between samples
MOST_PENALTY = 1e8  # beyond, coefficients of 1e8 times the misfit cancel to outputs of 1, which harms long runs
SCAN_WIDTHS, SCAN_PENALTIES = 15, 21
TIED = 0.05  # of the error: smaller differences are chance


def tune_outward(
    settings: LsSvmRegression,
    x: np.ndarray,
    y: np.ndarray,
    *,
    weights: np.ndarray | None = None,
    tolerance: float = 0.0,
    progress: Progress = silent,
) -> Tuned[LsSvmRegression]:
    """Settings with the C and sigma whose machine of the inner samples has the least error at the outer ones.

    The inner samples are 70 % of at most 800, by their Mahalanobis distance from the mean.  The loss is the mean over
    the outputs of log(mean square error / variance), on a grid over C and sigma.  Among the pairs whose error exceeds
    the least by at most 5 % plus `tolerance` of the outputs' spread, the one with the fewest effective parameters is
    chosen: many are equally good here, and the stiffest of them extrapolate better.  errors: those mean squares.
    """
    return _tuned(settings, Training.of(x, y, weights, settings), tolerance, progress)


def tune_outward_each(
    settings: LsSvmRegression,
    x: np.ndarray,
    y: np.ndarray,
    *,
    weights: np.ndarray | None = None,
    tolerance: float = 0.0,
    progress: Progress = silent,
) -> tuple[Tuned[LsSvmRegression], ...]:
    """Like `tune_outward`, for each output of y (n, m) by itself: m settings, for `fit_each`."""
    columns = Training.of(x, y, weights, settings).columns()
    return tuple(
        _tuned(settings, column, tolerance, lambda done, text, o=o: progress((o + done) / len(columns), text))
        for o, column in enumerate(columns)
    )


def _tuned(
    settings: LsSvmRegression, training: Training, tolerance: float, progress: Progress
) -> Tuned[LsSvmRegression]:
    part = training.part(FEW_SAMPLES)
    samples, square = part.samples, part.distances.square
    if not samples.varies.any():  # nothing to tune
        return Tuned(settings, (0.0,) * samples.y.shape[1], 0.0, 0)
    inner, outer = _split(samples.x)
    inside = replace(
        part, samples=samples.rows(inner), distances=Distances(square[np.ix_(inner, inner)], part.distances.radial)
    )
    crossed, shares = square[np.ix_(outer, inner)], samples.weights[outer] / samples.weights[outer].sum()
    most = min(MOST_PENALTY, largest_penalty(training.samples))
    penalties = np.geomspace(LEAST_PENALTY, most, SCAN_PENALTIES)
    sigmas = _widths(inside, training) if part.distances.radial else np.array([settings.sigma])
    if not part.distances.radial:  # unlike radial kernels, its values may exceed 1
        penalties *= len(samples.x) / np.trace(square)
    tried: list[tuple[float, float, float, float, np.ndarray]] = []  # loss, effective parameters, sigma, C, errors
    for count, sigma in enumerate(sigmas):
        spectrum = inside.spectrum(float(sigma))
        kernel = np.exp(crossed / -(sigma * sigma)) if part.distances.radial else crossed
        for penalty in penalties:
            solution = spectrum.solution(float(penalty), samples.standard[inner])
            errors = kernel @ solution.coefficients + solution.bias - samples.standard[outer]
            found = np.maximum(shares @ errors**2, np.finfo(float).tiny)
            effective = float(np.sum(spectrum.values / (spectrum.values + 1.0 / penalty)))
            tried.append((float(np.mean(np.log(found))), effective, float(sigma), float(penalty), found))
        progress((count + 1.0) / len(sigmas), f"sigma {sigma:.3g}")
    least = np.exp(0.5 * min(tried, key=lambda one: one[0])[0])
    tied = 2.0 * np.log((1.0 + TIED) * least + tolerance)
    loss, _, sigma, penalty, found = min((one for one in tried if one[0] <= tied), key=lambda one: one[1])
    errors = np.zeros(samples.y.shape[1])
    errors[samples.varies] = found * samples.variance
    return Tuned(replace(settings, penalty=penalty, sigma=sigma), tuple(errors.tolist()), loss, len(tried))


def _split(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the inner samples, and of the outer ones."""
    centred = x - x.mean(axis=0)
    directions = np.linalg.svd(centred / centred.std(axis=0), full_matrices=False)[0]  # each of unit spread
    order = np.argsort(np.sum(directions**2, axis=1), kind="stable")
    inner = max(round(INNER * len(x)), 2)
    return np.sort(order[:inner]), np.sort(order[inner:])


def _widths(inside: Training, training: Training) -> np.ndarray:
    """Sigmas to try, within the reach of all samples and of the inner ones."""
    least = max(WIDTHS[0] * training.distances.median, 1.001 * training.distances.reach[0])
    most = min(WIDTHS[1] * training.distances.median, 0.999 * training.distances.reach[1])
    own = inside.distances.reach
    return np.geomspace(max(least, 1.001 * own[0]), min(most, 0.999 * own[1]), SCAN_WIDTHS)
