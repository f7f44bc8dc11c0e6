"""Prediction-error refinement of a state-space model in innovations form with all matrices free."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from auv_gym.compiled import compiled
from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from identification.linear.subspaces.realisation import Realisation
from identification.linear.subspaces.state_space_fit import StateSpaceFit, fit_of
from identification.linear.triangles import spans

_ITERATIONS = 60
_FLAT = 1e-9  # expected reduction of the loss per sample that ends a descent
_DAMPING = 1e-3  # initial value, relative to the diagonal of the normal matrix
_LARGEST_DAMPING = 1e10
_ROUNDING = 1e-10  # ratio of the error to an output's spread below which it is rounding
_FADED = 1e-60  # derivative of the state by its start that counts as zero
_STABLE = 1.0 - 1e-6  # largest magnitude of a predictor's pole


@dataclass(frozen=True, eq=False)
class Candidate:
    """A realisation with the initial states of its segments, (segments, n), and its one-step errors, (rows, p)."""

    found: Realisation
    starts: np.ndarray
    states: np.ndarray
    errors: np.ndarray

    @cached_property
    def spread(self) -> np.ndarray:
        """Mean square of the errors, (p, p), kept away from zero for noise-free data."""
        p = self.errors.shape[1]
        return self.errors.T @ self.errors / len(self.errors) + _ROUNDING**2 * np.eye(p)

    @cached_property
    def loss(self) -> float:
        """The log determinant of the errors' mean square; its minimum maximises the likelihood of normal errors."""
        sign, value = np.linalg.slogdet(self.spread)
        return float(value) if sign > 0.0 and np.isfinite(value) else np.inf


@dataclass(frozen=True, eq=False)
class Slopes:
    """Normal equations of the errors, weighted with the inverse of their mean square.

    matrix, gradient: for the local coordinates, with the starts eliminated.  start_matrices, mixed, start_gradients:
    for each segment, to recover its start.
    """

    matrix: np.ndarray
    gradient: np.ndarray
    start_matrices: np.ndarray
    mixed: np.ndarray
    start_gradients: np.ndarray

    def step(self, damping: float) -> tuple[np.ndarray, np.ndarray]:
        """The change of the local coordinates, and of the starts."""
        damped = self.matrix + damping * np.diag(np.diag(self.matrix) + 1e-12 * np.trace(self.matrix))
        change = -np.linalg.lstsq(damped, self.gradient, rcond=1e-15)[0]
        right = self.start_gradients + np.einsum("sij,j->si", self.mixed, change)
        return change, -np.einsum("sij,sj->si", self.start_matrices, right)


def refined(
    series: Series,
    scaled: Scaled,
    found: Realisation,
    *,
    stable: bool = False,
    iterations: int = _ITERATIONS,
    singular_values: np.ndarray | None = None,
) -> StateSpaceFit:
    """Refine a model by minimising the log determinant of its one-step errors' mean square.

    found: between scaled signals, with a stable predictor.  stable: whether all poles must stay inside the unit circle.
    Each segment has a start of its own.
    Damped Gauss-Newton steps are taken in the directions that change more than the choice of states; the predictor
    stays stable, the model need not be.  Intervals follow from the normal matrix at the end.
    Source: McKelvey, Helmersson and Ribarits 2004, Data driven local coordinates for multivariable linear systems and
    their application to system identification, Automatica 40; Ljung 1999, sec. 7.2, 9.4.
    """
    here, count = descended(scaled, found, stable, iterations)
    covariance, free = covariance_of(here, scaled)
    return fit_of(series, scaled, here.found, here.errors, free, covariance, singular_values, count)


def covariance_of(here: Candidate, scaled: Scaled) -> tuple[np.ndarray, int]:
    """The covariance of the entries after a descent, (P, P), and how many numbers were fitted, including starts."""
    samples, directions = here.errors.size, local_directions(here.found, scaled.offset)
    free = directions.shape[1] + here.starts.size
    covariance = (
        directions
        @ np.linalg.pinv(realisation_normal_equations(here, scaled, directions).matrix, hermitian=True)
        @ directions.T
    )
    # the spread was divided by the rows; divide by the remaining degrees of freedom instead
    return covariance * samples / (samples - free), free


def descended(
    scaled: Scaled, found: Realisation, stable: bool = False, iterations: int = _ITERATIONS
) -> tuple[Candidate, int]:
    """The model with the least errors that a descent reaches, and the number of iterations."""
    rows = sum(len(y) for y in scaled.y)
    free = local_directions(found, scaled.offset).shape[1] + len(scaled.y) * len(found.a)
    if rows * scaled.outputs <= 2 * free:
        raise ValueError(
            f"A refinement of {free} numbers needs more than {2 * free} samples of outputs, got "
            f"{rows * scaled.outputs}: record longer, or lower order."
        )
    here = started(found, scaled)
    damping, count, directions = _DAMPING, 0, local_directions(here.found, scaled.offset)
    slopes = realisation_normal_equations(here, scaled, directions)
    noiseless = 2.0 * scaled.outputs * np.log(2.0 * _ROUNDING)
    while count < iterations and here.loss > noiseless:
        change, start_change = slopes.step(damping)
        expected = -(change @ slopes.gradient + np.sum(start_change * slopes.start_gradients)) / rows
        if not expected > _FLAT or damping > _LARGEST_DAMPING:
            break
        count += 1
        tried = moved(here, scaled, directions @ change, start_change, stable)
        if tried is None or not tried.loss < here.loss:
            damping *= 8.0
            continue
        here, damping = tried, damping / 10.0
        directions = local_directions(here.found, scaled.offset)
        slopes = realisation_normal_equations(here, scaled, directions)
    return here, count


def local_directions(found: Realisation, offset: bool) -> np.ndarray:
    """Changes of a realisation's entries orthogonal to those by a change of states, orthonormal, (P, free).

    offset: whether drift and level are free, and with them the origin of the states.  Integrators stay integrators, and
    stay at rest at their input.
    """
    a, b, c, k, drift, level = found.parts
    n, r = len(a), found.integrators
    one, ends = np.eye(n), drift.size + level.size
    # for states changed by 1 + turn: turn a - a turn, turn b, -c turn, turn k, turn drift
    turned = [np.kron(one, a.T) - np.kron(a, one), np.kron(one, b.T), -np.kron(c, one), np.kron(one, k.T)]
    turned += [np.kron(one, drift), np.zeros((level.size, n * n))]
    sums_only = np.ones((n, n), dtype=bool)
    sums_only[:r, r:] = False  # a sum plus another state is no longer a sum
    along = np.concatenate(turned)[:, sums_only.ravel()]
    every = np.eye(len(along))
    held = [every[:, : r * n]]
    if offset:
        beyond = np.concatenate([np.zeros((len(along) - ends, n)), one - a, -c])
        if found.rest is not None:
            resting = every[:, len(along) - ends :][:, :r].copy()  # drift + b rest
            for i in range(r):
                resting[a.size + i * b.shape[1] : a.size + (i + 1) * b.shape[1], i] = found.rest
            held.append(resting)
    else:
        beyond = every[:, len(along) - ends :]
    barred = np.concatenate([along, beyond, *held], axis=1)
    across, _ = np.linalg.qr(barred, mode="complete")
    directions = across[:, barred.shape[1] :]
    directions[: r * n] = 0.0  # remove rounding
    return directions


def started(found: Realisation, scaled: Scaled) -> Candidate:
    """The realisation with the starts that minimise its errors."""
    at_rest = candidate(found, np.zeros((len(scaled.y), len(found.a))), scaled)
    none = np.zeros((found.vector.size, 0))
    slopes = realisation_normal_equations(at_rest, scaled, none, np.eye(scaled.outputs))
    return candidate(found, slopes.step(0.0)[1], scaled)


def moved(
    here: Candidate, scaled: Scaled, change: np.ndarray, start_change: np.ndarray, stable: bool
) -> Candidate | None:
    """The candidate after these changes; None if its predictor is unstable, or if the model is and must not be."""
    found = here.found.at(here.found.vector + change)
    if not np.abs(np.linalg.eigvals(found.predictor)).max() < _STABLE:
        return None
    if stable and not np.abs(np.linalg.eigvals(found.a)).max() < _STABLE:
        return None
    return candidate(found, here.starts + start_change, scaled)


def realisation_normal_equations(
    here: Candidate, scaled: Scaled, directions: np.ndarray, weight: np.ndarray | None = None
) -> Slopes:
    """The normal equations at a candidate; weight: of the errors, default the inverse of their mean square."""
    found, count = here.found, directions.shape[1]
    n, p = len(found.a), len(found.c)
    root = np.linalg.cholesky(np.linalg.inv(here.spread) if weight is None else weight).T
    total, gradient = np.zeros((count, count)), np.zeros(count)
    starts, mixed, pulls = [], [], []
    driving, entering = _forces(found, directions, root)
    row = 0
    for u in scaled.u:
        part = slice(row, row + len(u))
        row += len(u)
        signals = np.concatenate([here.states[part], u, here.errors[part], np.ones((len(u), 1))], axis=1)
        normal, pull = np.zeros((count + n, count + n)), np.zeros(count + n)
        slope = np.concatenate([np.zeros((n, count)), np.eye(n)], axis=1)
        for span in spans(len(u)):
            states = (signals[span] @ driving).reshape(-1, n, count + n)
            errors = (signals[span] @ entering).reshape(-1, p, count + n)
            _slopes(found.predictor, root @ found.c, slope, states, errors)
            errors = errors.reshape(-1, count + n)
            normal += errors.T @ errors
            pull += errors.T @ (here.errors[part][span] @ root.T).ravel()
        own, across = normal[count:, count:], normal[count:, :count]
        inverse = np.linalg.pinv(own, rcond=1e-13, hermitian=True)
        total += normal[:count, :count] - across.T @ inverse @ across
        gradient += pull[:count] - across.T @ inverse @ pull[count:]
        starts.append(inverse)
        mixed.append(across)
        pulls.append(pull[count:])
    return Slopes(total, gradient, np.array(starts), np.array(mixed), np.array(pulls))


def _forces(found: Realisation, directions: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inputs to the derivatives of states, (signals, n J), and of `root` errors, (signals, p J).

    The signals are state, input, error and one.  J: the local coordinates, then the start, which only sets the initial
    derivative of the states.
    """
    n, m = found.b.shape
    p, count = len(found.c), directions.shape[1]
    driving, entering = np.zeros((n + m + p + 1, n, count + n)), np.zeros((n + m + p + 1, p, count + n))
    ends = np.cumsum([part.size for part in found.parts])[:-1]
    a, b, c, k, drift, level = (
        moves.T.reshape(count, *part.shape) for moves, part in zip(np.split(directions, ends), found.parts)
    )
    kept = drift - level @ found.k.T
    driving[:, :, :count] = np.concatenate([a - found.k @ c, b, k, kept[:, :, None]], axis=2).transpose(2, 1, 0)
    entering[:n, :, :count] = -(root @ c).transpose(2, 1, 0)
    entering[-1, :, :count] = -(level @ root.T).T
    return driving.reshape(len(driving), -1), entering.reshape(len(entering), -1)


def candidate(found: Realisation, starts: np.ndarray, scaled: Scaled) -> Candidate:
    """A realisation with given starts, run over all segments."""
    driven = [u @ found.b.T + (y - found.level) @ found.k.T + found.drift for u, y in zip(scaled.u, scaled.y)]
    ends = np.cumsum([0, *(len(y) for y in scaled.y)])
    states = np.concatenate(driven)
    with np.errstate(over="ignore", invalid="ignore"):
        _states(found.predictor, ends, np.ascontiguousarray(starts), states)
        errors = np.concatenate(scaled.y) - states @ found.c.T - found.level
    return Candidate(found, starts, states, errors)


@compiled
def _states(a, ends, starts, x):
    """Replace the inputs of the state equation, x, (rows, n), by the states of the segments."""
    n = a.shape[0]
    held = np.empty(n)
    for segment in range(ends.size - 1):
        for i in range(n):
            held[i] = starts[segment, i]
        for t in range(ends[segment], ends[segment + 1]):
            for i in range(n):
                total = x[t, i]
                x[t, i] = held[i]
                held[i] = total
            for i in range(n):
                for j in range(n):
                    held[i] += a[i, j] * x[t, j]


@compiled
def _slopes(a, c, slope, states, errors):
    """Derivatives of errors, (rows, p, J), added to the direct ones; slope: of the state, (n, J), at the first row.

    states: inputs to the state derivatives, (rows, n, J); the last n have none.  On return, slope is that after the
    last row.
    """
    n, p, count = a.shape[0], c.shape[0], slope.shape[1]
    after = np.empty((n, count))
    fading = True
    for t in range(states.shape[0]):
        if fading:
            largest = 0.0
            for i in range(n):
                for j in range(count - n, count):
                    largest = max(largest, abs(slope[i, j]))
            if largest < _FADED:  # denormal numbers would be a hundred times slower
                slope[:, count - n :] = 0.0
                fading = False
        for i in range(n):
            for j in range(count):
                after[i, j] = states[t, i, j]
        for h in range(n):
            for o in range(p):
                weight = c[o, h]
                for j in range(count):
                    errors[t, o, j] -= weight * slope[h, j]
            for i in range(n):
                weight = a[i, h]
                for j in range(count):
                    after[i, j] += weight * slope[h, j]
        for i in range(n):
            for j in range(count):
                slope[i, j] = after[i, j]
