"""Prediction-error refinement of a state-space model in innovations form, all its matrices free."""

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
_FLAT = 1e-9  # expected fall of the loss per sample at which a descent ends
_DAMPING = 1e-3  # at the start, over the diagonal of the normal matrix
_LARGEST_DAMPING = 1e10
_ROUNDING = 1e-10  # error over the spread of an output below which errors are rounding
_FADED = 1e-60  # slope of the state by its start, below which it is none
_STABLE = 1.0 - 1e-6  # largest size of a predictor's pole


@dataclass(frozen=True, eq=False)
class Candidate:
    """A realisation with the states that its segments start in, (segments, n), and its one-step errors, (rows, p)."""

    found: Realisation
    starts: np.ndarray
    states: np.ndarray
    errors: np.ndarray

    @cached_property
    def spread(self) -> np.ndarray:
        """Mean square of the errors, (p, p), kept away from zero where they are rounding."""
        p = self.errors.shape[1]
        return self.errors.T @ self.errors / len(self.errors) + _ROUNDING**2 * np.eye(p)

    @cached_property
    def loss(self) -> float:
        """log det of the errors' mean square; least where the likelihood of normal errors is largest."""
        sign, value = np.linalg.slogdet(self.spread)
        return float(value) if sign > 0.0 and np.isfinite(value) else np.inf


@dataclass(frozen=True, eq=False)
class Slopes:
    """Normal equations of the errors, weighted with the inverse of their mean square.

    matrix, gradient: by the local coordinates, the starts solved for.  start_matrices, mixed, start_gradients: of each
    segment, from which its start follows.
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
    """The model of least one-step errors, log det of their mean square, that a descent from another reaches.

    found: between scaled signals, with a stable predictor.  stable: whether no pole may leave the unit circle.  Each
    segment has a start of its own.
    Gauss-Newton steps with Levenberg's damping in the directions that change more than the choice of states; the
    predictor stays stable, the model need not be.  Intervals follow from the normal matrix at the end.
    Source: McKelvey, Helmersson and Ribarits 2004, Data driven local coordinates for multivariable linear systems and
    their application to system identification, Automatica 40; Ljung 1999, sec. 7.2, 9.4.
    """
    here, count = descended(scaled, found, stable, iterations)
    covariance, free = covariance_of(here, scaled)
    return fit_of(series, scaled, here.found, here.errors, free, covariance, singular_values, count)


def covariance_of(here: Candidate, scaled: Scaled) -> tuple[np.ndarray, int]:
    """The covariance of the entries at the end of a descent, (P, P), and how many numbers were fitted, starts too."""
    samples, directions = here.errors.size, local_directions(here.found, scaled.offset)
    free = directions.shape[1] + here.starts.size
    covariance = (
        directions
        @ np.linalg.pinv(realisation_normal_equations(here, scaled, directions).matrix, hermitian=True)
        @ directions.T
    )
    # the spread was divided by rows, an unbiased one is divided by what the fitted numbers leave
    return covariance * samples / (samples - free), free


def descended(
    scaled: Scaled, found: Realisation, stable: bool = False, iterations: int = _ITERATIONS
) -> tuple[Candidate, int]:
    """The model of least errors that a descent from another reaches, and after how many iterations."""
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
    """Changes of a realisation's entries across those that a change of the states makes, orthonormal, (P, free).

    offset: whether drift and level are free, and the states' origin with them.  Integrators stay what they are, and
    stay at rest at their input.
    """
    a, b, c, k, drift, level = found.parts
    n, r = len(a), found.integrators
    one, ends = np.eye(n), drift.size + level.size
    # of the states by 1 + turn: turn a - a turn, turn b, -c turn, turn k, turn drift
    turned = [np.kron(one, a.T) - np.kron(a, one), np.kron(one, b.T), -np.kron(c, one), np.kron(one, k.T)]
    turned += [np.kron(one, drift), np.zeros((level.size, n * n))]
    sums_only = np.ones((n, n), dtype=bool)
    sums_only[:r, r:] = False  # a sum plus another state is none
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
    directions[: r * n] = 0.0  # rounding
    return directions


def started(found: Realisation, scaled: Scaled) -> Candidate:
    """The realisation with the starts of least errors."""
    at_rest = candidate(found, np.zeros((len(scaled.y), len(found.a))), scaled)
    none = np.zeros((found.vector.size, 0))
    slopes = realisation_normal_equations(at_rest, scaled, none, np.eye(scaled.outputs))
    return candidate(found, slopes.step(0.0)[1], scaled)


def moved(
    here: Candidate, scaled: Scaled, change: np.ndarray, start_change: np.ndarray, stable: bool
) -> Candidate | None:
    """The candidate with these changes; none where its predictor is unstable, or the model and it must not be."""
    found = here.found.at(here.found.vector + change)
    if not np.abs(np.linalg.eigvals(found.predictor)).max() < _STABLE:
        return None
    if stable and not np.abs(np.linalg.eigvals(found.a)).max() < _STABLE:
        return None
    return candidate(found, here.starts + start_change, scaled)


def realisation_normal_equations(
    here: Candidate, scaled: Scaled, directions: np.ndarray, weight: np.ndarray | None = None
) -> Slopes:
    """The normal equations about a candidate; weight: of the errors, default the inverse of their mean square."""
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
    """What state, input, error and one add to the slopes of states, (signals, n J), and `root` errors, (signals, p J).

    J: the local coordinates, then the start, which moves the states at once and then nothing more.
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
    """A realisation with starts, run over all segments."""
    driven = [u @ found.b.T + (y - found.level) @ found.k.T + found.drift for u, y in zip(scaled.u, scaled.y)]
    ends = np.cumsum([0, *(len(y) for y in scaled.y)])
    states = np.concatenate(driven)
    with np.errstate(over="ignore", invalid="ignore"):
        _states(found.predictor, ends, np.ascontiguousarray(starts), states)
        errors = np.concatenate(scaled.y) - states @ found.c.T - found.level
    return Candidate(found, starts, states, errors)


@compiled
def _states(a, ends, starts, x):
    """States of segments, in place of what drives them, x, (rows, n)."""
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
    """Slopes of errors, (rows, p, J), added to what enters them; slope: of the state, (n, J), at the first row.

    states: what drives its slopes, (rows, n, J), the last n not at all.  slope leaves as that past the last row.
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
            if largest < _FADED:  # numbers too small for their exponent take a hundred times longer
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
