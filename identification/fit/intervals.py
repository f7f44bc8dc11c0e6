"""How sure fitted parameters are: covariance by information, robust to a misjudged colour, and likelihood profiles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from auv_gym.param import replace_at
from identification.fit.prediction_errors import STEP, Point, PredictionErrors

_PROFILED = 6  # values at either side at which a profile is sought
_FAR = 8.0  # standard errors, the farthest of them


@dataclass(frozen=True, eq=False)
class Information:
    """What a record tells of the paths, in units of their scales.

    covariance: (P, P), robust.  alone: (P, P), normal matrix of the rows that count, without what was known before.
    """

    covariance: np.ndarray
    alone: np.ndarray


def information_of(problem: PredictionErrors, point: Point, paths: Sequence[str]) -> Information:
    """The information of a fitted point and the covariance that follows.

    Prediction errors of the right model are white, and the covariance is the inverse of the information.  Where the
    noise is not what was taken for it, neighbouring scores correlate: the variance of each parameter is at least that
    of the sandwich form with Bartlett weights (Newey and West 1987; Ljung 1999, sec. 9.3).
    """
    root, basis = np.sqrt(problem.counted)[:, None], problem.start_basis(point)
    columns = problem.columns_of(point, [(p, STEP) for p in paths]) * root
    flat = columns.reshape(len(paths), point.errors.size)
    flat = flat - (flat @ basis) @ basis.T
    alone = flat @ flat.T
    known = np.diag(problem.pulls(point.vector, paths)[1] ** 2)
    inverse = np.linalg.pinv(alone + known, rcond=1e-13, hermitian=True)
    scores = np.einsum("prc,rc->rp", flat.reshape(columns.shape), point.errors * root)
    long_run = scores.T @ scores
    lags = int(np.ceil(4.0 * (max(len(scores), 1) / 100.0) ** (2.0 / 9.0)))  # Newey and West 1994, Bartlett
    same = problem.stretch_of_row
    for lag in range(1, lags + 1):
        near = (same[lag:] == same[:-lag])[:, None]
        cross = (scores[lag:] * near).T @ scores[:-lag]
        long_run += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    robust = inverse @ (long_run + known) @ inverse
    wider = np.sqrt(np.maximum(np.diag(robust) / np.maximum(np.diag(inverse), 1e-300), 1.0))
    return Information(inverse * np.outer(wider, wider), alone)


def profile_interval(
    problem: PredictionErrors, point: Point, paths: Sequence[str], path: str, error: float, level: float = 0.95
) -> tuple[float, float]:
    """Where twice the log-likelihood, all else refitted, falls by the quantile of chi-square; for kinks and bounds.

    error: standard error of the path, in its unit, by which the search begins.  A side on which it never falls so far
    ends at the bound.
    """
    bar = 0.5 * float(stats.chi2.ppf(level, 1))
    others = [p for p in paths if p != path]
    best, value = problem.objective(point, paths), float(point.vector[problem.index[path]])
    limits = problem.bounds(path)
    found = []
    for side, limit in zip((-1.0, 1.0), limits, strict=True):
        inner, drop_inner, step, near = value, 0.0, 1.5 * max(error, 1e-3 * problem.scale(path)), point
        edge = limit
        for _ in range(_PROFILED):
            tried = float(np.clip(inner + side * step, *limits))
            plant = replace_at(problem.plant_at(near, paths), path, tried)
            there = problem.solve(plant, others, near, iterations=4, noise=False)
            drop = best - problem.objective(there, others)
            if drop >= bar:
                share = (np.sqrt(bar) - np.sqrt(max(drop_inner, 0.0))) / max(
                    np.sqrt(drop) - np.sqrt(max(drop_inner, 0.0)), 1e-12
                )
                edge = inner + share * (tried - inner)
                break
            inner, drop_inner, near = tried, drop, there
            if tried == limit:
                break
            reached = abs(inner - value)  # sizes go as the root of the fall
            step = float(
                np.clip(reached * (np.sqrt(bar / max(drop, 0.05 * bar)) * 1.1 - 1.0), 0.3 * reached, 3.0 * reached)
            )
        found.append(float(edge))
    return found[0], found[1]
