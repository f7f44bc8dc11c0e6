"""Least squares of prediction errors by Levenberg and Marquardt's method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.linear.prediction import Prediction

# Relative size below which a direction of the parameters is as good as not seen at the start; its square has to be
# above rounding, since normal matrices are formed.
_WHITE = 1e-7


@dataclass(frozen=True)
class Stopping:
    """When an iteration ends: at its largest number, or where gradient, step or error are below a threshold.

    damping: at the start, relative to the largest diagonal element of the normal matrix.  The gradient is relative
    to the loss, the step to the parameters, and the error (root mean square) to the spread of the output, so that none
    depends on units.  Source: Geng and Zhao 2012, sec. V; Madsen, Nielsen and Tingleff 2004, alg. 3.16.
    """

    damping: float = 1e-5
    iterations: int = 100
    gradient: float = 1e-10
    step: float = 1e-10
    error: float = 1e-10


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where an iteration ended, and why: one of gradient, step, error, rounding, iterations."""

    free: np.ndarray
    starts: np.ndarray
    value: float
    iterations: int
    reason: str


def minimise(
    prediction: Prediction, free: np.ndarray, starts: np.ndarray, weight: np.ndarray, stopping: Stopping
) -> Minimum:
    """The parameters and starts with the least sum of squared errors, from where they are.

    weight: (r, r), applied to the errors of a sample.  The steps are taken in coordinates in which the errors' slopes
    at the beginning are orthonormal, so that neither units nor slow poles matter to the damping.
    """
    size = prediction.value(free, starts, weight)
    if not np.isfinite(size):
        raise ValueError("The iteration starts from a model whose errors are not finite.")
    if np.sqrt(2.0 * size) * np.abs(np.linalg.inv(weight)).max() <= stopping.error * np.sqrt(prediction.samples):
        return Minimum(free, starts, size, 0, "error")
    weight = weight / np.sqrt(2.0 * size)  # the loss begins at a half
    basis = _orthonormal(prediction, free, starts, weight)
    there = prediction.linearised(free, starts, weight, basis)
    diagonal = max(np.diag(there.matrix).max(), np.einsum("sii->si", there.start_matrix).max(initial=0.0))
    damping, growth = stopping.damping * diagonal, 2.0
    back = np.linalg.pinv(basis)
    reason, count = "iterations", 0
    while count < stopping.iterations:
        steepest = max(np.abs(there.gradient).max(), np.abs(there.start_gradient).max(initial=0.0))
        if steepest <= stopping.gradient:
            reason = "gradient"
            break
        count += 1
        change, start_change = there.step(damping)
        length = np.sqrt(change @ change + np.sum(start_change**2))
        whole = np.sqrt(np.sum((back @ free) ** 2) + np.sum(starts**2))
        if length <= stopping.step * (whole + stopping.step):
            reason = "step"
            break
        tried, tried_starts = free + basis @ change, starts + start_change
        value = prediction.value(tried, tried_starts, weight)
        slope = there.gradient @ change + np.sum(there.start_gradient * start_change)
        expected = 0.5 * (damping * length**2 - slope)
        if expected <= 4.0 * np.finfo(float).eps * there.value:
            reason = "rounding"
            break
        ratio = (there.value - value) / expected
        if ratio > 0.0:
            free, starts = tried, tried_starts
            there = prediction.linearised(free, starts, weight, basis)
            damping, growth = damping * max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3), 2.0
        else:
            damping, growth = damping * growth, 2.0 * growth
    return Minimum(free, starts, 2.0 * size * there.value, count, reason)


def _orthonormal(prediction: Prediction, free: np.ndarray, starts: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Directions of the parameters, as columns, along which the errors' slopes are orthonormal."""
    matrix = prediction.linearised(free, starts, weight, np.eye(free.size)).reduced()[0]
    size = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    squares, directions = np.linalg.eigh(matrix / np.outer(size, size))
    return directions / np.sqrt(np.maximum(squares, _WHITE**2 * squares.max())) / size[:, None]
