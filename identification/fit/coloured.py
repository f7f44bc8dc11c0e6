"""The channels whose prediction errors are clearly not white."""

from __future__ import annotations

import numpy as np

from identification.deciding import EXCESS, LEFT
from identification.fit.followed import Point
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.validation import whiteness

_ROUNDED = 1.3  # ratio of a channel's noise to that of rounding to its steps, up to which its errors count as rounding


def coloured_channels(problem: PredictionErrors, point: Point) -> tuple[str, ...]:
    """The channels whose errors are clearly not white, see `is_coloured`; those `of_rounding` are not tested."""
    rounding = of_rounding(problem, point)
    basis, level = problem.start_basis(point), LEFT / len(problem.channels)
    fitted = basis.reshape(*point.errors.shape, basis.shape[1])
    found = []
    for c, (name, seen) in enumerate(zip(problem.channels, problem.finite.T, strict=True)):
        if not rounding[c] and is_coloured(point.errors[seen, c], problem.stretch_of_row[seen], fitted[seen, c], level):
            found.append(name)
    return tuple(found)


def of_rounding(problem: PredictionErrors, point: Point) -> np.ndarray:
    """Which channels have hardly more noise than rounding to the steps of their readings makes, (C,).

    Such errors depend on where a slow signal is between two steps.  They are neither white nor of steady size, even if
    the model is exact.
    """
    return np.exp(point.logs[: len(problem.channels)]) <= _ROUNDED * problem.steps_of_readings


def is_coloured(error: np.ndarray, stretch: np.ndarray, fitted: np.ndarray, level: float) -> bool:
    """Whether errors are clearly not white, and their correlation would predict more than `EXCESS` of their variance.

    fitted: (n, q), orthonormal columns of what was fitted.  level: probability of a false alarm on white errors.
    """
    white = whiteness(error, stretch, fitted=fitted)
    return white.p_value < level and float((white.correlation**2).sum()) > EXCESS
