"""Nonlinear least squares of prediction errors by the Levenberg-Marquardt method."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from auv_gym.compiled import outlined
from identification.linear.polynomials.filtering import fill_c, fill_errors, half_squares, is_stable, normal_equations
from identification.linear.polynomials.prediction import Prediction

# Relative size below which a direction of the parameters counts as undetermined at the start; its square must be above
# rounding, since normal matrices are formed.
_WHITE = 1e-7
_ROUNDING = 1e-13  # relative reduction of the loss by a step below which it is only rounding
REASONS = ("iterations", "gradient", "step", "error", "rounding")


@dataclass(frozen=True)
class Stopping:
    """Stopping rules of an iteration: largest number of steps, or thresholds for gradient, step or error.

    damping: initial value, relative to the largest diagonal element of the normal matrix.  The gradient is relative to
    the loss, the step to the parameters, and the error (RMS) to the spread of the output, so that no threshold depends
    on units.  Source: Geng and Zhao 2012, sec. V; Madsen, Nielsen and Tingleff 2004, alg. 3.16.
    """

    damping: float = 1e-5
    iterations: int = 100
    gradient: float = 1e-10
    step: float = 1e-10
    error: float = 1e-10


@dataclass(frozen=True, eq=False)
class Minimum:
    """The result of an iteration, and why it ended: see REASONS; rounding: a step would gain only rounding."""

    free: np.ndarray
    starts: np.ndarray
    value: float
    iterations: int
    reason: str


@dataclass(frozen=True, eq=False)
class Linearised:
    """Half the sum of squares about a point, and the normal equations: see `normal_equations`."""

    value: float
    gradient: np.ndarray
    matrix: np.ndarray
    start_gradient: np.ndarray
    across: np.ndarray
    start_matrix: np.ndarray

    @property
    def reduced(self) -> np.ndarray:
        """The normal matrix of the parameters with the starts eliminated."""
        if not self.start_matrix.size:
            return self.matrix
        solved = np.linalg.solve(self.start_matrix, np.swapaxes(self.across, 1, 2))
        return self.matrix - np.einsum("spq,sqr->pr", self.across, solved)


def minimise(
    prediction: Prediction, free: np.ndarray, starts: np.ndarray, weight: np.ndarray, stopping: Stopping
) -> Minimum:
    """The parameters and starts with the least sum of squared errors, starting from the given ones.

    weight: (r, r), applied to the errors of a sample.  Steps are taken in coordinates in which the derivatives of the
    errors at the start are orthonormal, so that neither units nor slow poles affect the damping; C stays stable.
    """
    about = linearised(prediction, free, starts, weight)
    if not np.isfinite(about.value) or not (prediction.structure.tied or is_stable(prediction.c(free))):
        raise ValueError("The iteration starts from a model whose errors are not finite.")
    size = np.sqrt(2.0 * about.value)
    if size * np.abs(np.linalg.inv(weight)).max() <= stopping.error * np.sqrt(prediction.samples):
        return Minimum(free, starts, about.value, 0, "error")
    basis = _orthonormal(about)
    z, begin = np.linalg.solve(basis, free), starts.copy()
    chain = prediction.problem.mix @ basis
    square = 2.0 * about.value  # the scaled loss starts at one half
    here = (
        basis.T @ about.gradient / square,
        basis.T @ about.matrix @ basis / square,
        about.start_gradient / square,
        np.ascontiguousarray(basis.T @ about.across / square),
        about.start_matrix / square,
    )
    loss, count, reason = _descend(
        prediction.problem, z, begin, weight / size, chain, prediction.structure.tied, *here, *astuple(stopping)[:-1]
    )
    return Minimum(basis @ z, begin, 2.0 * about.value * loss, count, REASONS[reason])


def linearised(prediction: Prediction, free: np.ndarray, starts: np.ndarray, weight: np.ndarray) -> Linearised:
    """The normal equations at a point."""
    problem, c = prediction.problem, prediction.c(free)
    e = np.empty((problem.rows, len(weight)))
    fill_errors(problem, prediction.terms(free), c, starts, e)
    p, (s, q) = free.size, starts.shape
    arrays = np.zeros(p), np.zeros((p, p)), np.zeros((s, q)), np.zeros((s, p, q)), np.zeros((s, q, q))
    normal_equations(problem, c, e, weight, problem.mix, *arrays)
    return Linearised(half_squares(e, weight), *arrays)


def _orthonormal(about: Linearised) -> np.ndarray:
    """Directions of the parameters, as columns, in which the reduced normal matrix is the unit matrix."""
    matrix = about.reduced
    size = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    squares, directions = np.linalg.eigh(matrix / np.outer(size, size))
    return (
        directions / np.sqrt(np.maximum(squares, _WHITE**2 * squares.max())) / size[:, None] * np.sqrt(2 * about.value)
    )


@outlined
def _descend(
    problem,
    z,
    starts,
    weight,
    chain,
    tied,
    gradient,
    matrix,
    start_gradient,
    across,
    start_matrix,
    tau,
    most,
    least_gradient,
    least_step,
):
    """Move z and starts to the minimum in place; returns the loss, the number of iterations, and the reason's number.

    Terms are base + chain z.  The normal equations are given for the start, where the loss is one half.
    """
    r, (segments, q), p = problem.numbers.size, starts.shape, z.size
    c, e = np.zeros((q // r + 1, r, r)), np.empty((problem.at[-1], r))
    solved = np.zeros((segments, p, q))
    change, start_change = np.zeros(p), np.zeros((segments, q))
    tried, tried_starts = np.zeros(p), np.zeros((segments, q))
    value, damping = 0.5, 0.0
    for i in range(p):
        damping = max(damping, tau * matrix[i, i])
    for s in range(segments):
        for k in range(q):
            damping = max(damping, tau * start_matrix[s, k, k])
    growth = 2.0
    for count in range(most):
        steepest = 0.0
        for i in range(p):
            steepest = max(steepest, abs(gradient[i]))
        for s in range(segments):
            for k in range(q):
                steepest = max(steepest, abs(start_gradient[s, k]))
        if steepest <= least_gradient:
            return value, count, 1
        if _step(gradient, matrix, start_gradient, across, start_matrix, damping, solved, change, start_change):
            length, whole, slope = 0.0, 0.0, 0.0
            for i in range(p):
                length += change[i] ** 2
                whole += z[i] ** 2
                slope += gradient[i] * change[i]
                tried[i] = z[i] + change[i]
            for s in range(segments):
                for k in range(q):
                    length += start_change[s, k] ** 2
                    whole += starts[s, k] ** 2
                    slope += start_gradient[s, k] * start_change[s, k]
                    tried_starts[s, k] = starts[s, k] + start_change[s, k]
            if np.sqrt(length) <= least_step * (np.sqrt(whole) + least_step):
                return value, count + 1, 2
            expected = 0.5 * (damping * length - slope)
            if expected <= _ROUNDING * value:
                return value, count + 1, 4
            ratio = (value - _value(problem, tried, tried_starts, weight, chain, tied, c, e)) / expected
        else:
            ratio = -1.0
        if ratio > 0.0:
            for i in range(p):
                z[i] = tried[i]
            for s in range(segments):
                for k in range(q):
                    starts[s, k] = tried_starts[s, k]
            value -= ratio * expected
            normal_equations(problem, c, e, weight, chain, gradient, matrix, start_gradient, across, start_matrix)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * ratio - 1.0) ** 3)
            growth = 2.0
        else:
            damping *= growth
            growth *= 2.0
    return value, most, 0


@outlined
def _value(problem, z, starts, weight, chain, tied, c, e):
    """Half the weighted sum of squares of the errors, infinite if C is not stable; fills c and e."""
    values = problem.base.copy()
    for k in range(values.size):
        for i in range(z.size):
            values[k] += chain[k, i] * z[i]
    fill_c(values, problem.late, c)
    if not tied and not is_stable(c):
        return np.inf
    fill_errors(problem, values, c, starts, e)
    return half_squares(e, weight)


@outlined
def _step(gradient, matrix, start_gradient, across, start_matrix, damping, solved, change, start_change):
    """Compute the damped Gauss-Newton step of parameters and starts; False if the matrices are not positive definite.

    Each segment's starts are eliminated; solved, (S, P, q), is workspace for their dependence on the parameters.
    """
    p, (segments, q) = gradient.size, start_gradient.shape
    reduced = matrix.copy()
    for i in range(p):
        reduced[i, i] += damping
        change[i] = -gradient[i]
    for s in range(segments if q else 0):
        own = start_matrix[s].copy()
        for k in range(q):
            own[k, k] += damping
            start_change[s, k] = -start_gradient[s, k]
        if not _factor(own):
            return False
        _substitute(own, start_change[s])
        for i in range(p):
            for k in range(q):
                solved[s, i, k] = across[s, i, k]
            _substitute(own, solved[s, i])
            for k in range(q):
                change[i] -= across[s, i, k] * start_change[s, k]
                for j in range(i + 1):
                    reduced[i, j] -= solved[s, i, k] * across[s, j, k]
    for i in range(p):
        for j in range(i):
            reduced[j, i] = reduced[i, j]
    if not _factor(reduced):
        return False
    _substitute(reduced, change)
    for s in range(segments):
        for i in range(p):
            for k in range(q):
                start_change[s, k] -= solved[s, i, k] * change[i]
    return True


@outlined
def _factor(a):
    """Cholesky factor of a positive definite matrix into its lower triangle; False if it is not positive definite."""
    for j in range(a.shape[0]):
        for i in range(j, a.shape[0]):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                a[j, j] = np.sqrt(total)
            else:
                a[i, j] = total / a[j, j]
    return True


@outlined
def _substitute(factor, b):
    """Solve with a Cholesky factor, in place."""
    for i in range(b.size):
        for k in range(i):
            b[i] -= factor[i, k] * b[k]
        b[i] /= factor[i, i]
    for i in range(b.size - 1, -1, -1):
        for k in range(i + 1, b.size):
            b[i] -= factor[k, i] * b[k]
        b[i] /= factor[i, i]
