"""From states as combinations of the past to a model: what the subspace methods share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log

import numpy as np
from scipy import linalg

from identification.linear.realisation import Realisation
from identification.linear.refinement import Candidate, candidate, refined
from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from identification.linear.state_space_fit import StateSpaceFit, fit_of
from identification.linear.triangles import triangle_tall

_DEPENDENT = 1e-9  # singular value over the largest, of columns of unit size, below which they are one too many
_NOISELESS = 1e-9  # one-step error over the spread of an output below which it is rounding
_INSIDE = 0.999  # size to which a pole outside the unit circle is moved at least, where it has to be stable
_LARGEST_ORDER = 20
_UNHELPFUL = 4  # orders beyond the best, after which no more are tried
ROWS_PER_COLUMN = 2


@dataclass(frozen=True, eq=False)
class States:
    """Combinations of the last `past` samples that hold what they tell of the future, most telling first.

    weights: (n, past (m + p)), oldest sample first.  singular_values: what the order is chosen from.
    """

    weights: np.ndarray
    singular_values: np.ndarray
    past: int

    def over(self, z: np.ndarray, count: int) -> np.ndarray:
        """The first `count` states of a segment, from row `past` to the row after the last, (n + 1 - past, count)."""
        q, rows = z.shape[1], len(z) + 1 - self.past
        states = np.zeros((rows, count))
        for j in range(self.past):
            states += z[j : j + rows] @ self.weights[:count, j * q : (j + 1) * q].T
        return states


def check_settings(name: str, order: int | str, horizon: int | None) -> None:
    """Raises, on behalf of the estimator `name`, if order or horizon cannot be."""
    if order != "auto" and (isinstance(order, bool) or not isinstance(order, int) or order < 1):
        raise ValueError(f"{name} needs order >= 1 as a whole number, or 'auto', got {order!r}.")
    if horizon is None:
        return
    if isinstance(horizon, bool) or not isinstance(horizon, int) or horizon < 2:
        raise ValueError(f"{name} needs horizon >= 2 samples, or none for its own choice, got {horizon!r}.")


def check_excitation(name: str, factor: np.ndarray, series: Series, horizon: int) -> None:
    """Raises if the inputs do not excite `horizon` lags; factor: R of their lags, middles taken off."""
    size = np.linalg.norm(factor, axis=0)
    values = np.linalg.svd(factor / np.where(size > 0.0, size, 1.0), compute_uv=False)
    excited = int(np.count_nonzero(values > _DEPENDENT * values[0]))
    if excited < values.size:
        m = len(series.inputs)
        raise ValueError(
            f"{name} needs inputs that excite {horizon} lags, got {', '.join(series.inputs)} exciting {excited} of "
            f"{m} x {horizon}: use a record with more frequencies or steps, inputs moving apart from one another, or a "
            "smaller horizon."
        )


@dataclass(frozen=True, eq=False)
class Regressors:
    """States now and a sample after, inputs and outputs, as the few rows that have the same products as all of them.

    one: (rows, 1), or (rows, 0) without an operating point.  samples: how many rows there were.
    """

    one: np.ndarray
    now: np.ndarray
    u: np.ndarray
    y: np.ndarray
    after: np.ndarray
    samples: int

    @classmethod
    def of(cls, states: States, count: int, scaled: Scaled) -> Regressors:
        """Those of the first `count` states."""
        kept = [(u, y, z) for u, y, z in zip(scaled.u, scaled.y, scaled.joint) if len(z) > states.past]
        x = [states.over(z, count) for _, _, z in kept]
        parts = (
            np.ones((sum(len(part) - 1 for part in x), 1 if scaled.offset else 0)),
            np.concatenate([part[:-1] for part in x]),
            np.concatenate([u[states.past :] for u, _, _ in kept]),
            np.concatenate([y[states.past :] for _, y, _ in kept]),
            np.concatenate([part[1:] for part in x]),
        )
        few = triangle_tall(np.concatenate(parts, axis=1))
        one, now, u, y, after = np.split(few, np.cumsum([part.shape[1] for part in parts])[:-1], axis=1)
        return cls(one, now, u, y, after, len(parts[0]))


def identified(states: States, order: int | str, largest: int, scaled: Scaled, name: str, stable: bool) -> Candidate:
    """The model of this order; where that is "auto", of the order of least log det of its errors plus BIC's charge.

    Orders go up from 1 until four more do not help; the charge counts n (m + 2 p) parameters.
    Source: Bauer 2001, Order estimation for subspace methods, Automatica 37; Schwarz 1978, Annals of Statistics 6.
    """
    if order != "auto" and int(order) > largest:
        raise ValueError(
            f"{name} finds orders up to {largest} in this record at this horizon, got {order}: raise horizon, record "
            "longer or lower order."
        )
    most = min(largest, _LARGEST_ORDER) if order == "auto" else int(order)
    regressors = Regressors.of(states, most, scaled)
    if order != "auto":
        return _candidate(states, most, regressors, scaled, name, stable)
    charge = (scaled.inputs + 2 * scaled.outputs) * log(regressors.samples) / regressors.samples
    best, least, problem = None, np.inf, None
    for count in range(1, most + 1):
        try:
            found = _candidate(states, count, regressors, scaled, name, stable)
        except ValueError as error:
            problem = error
            continue
        if best is None or found.loss + count * charge < least:
            best, least = found, found.loss + count * charge
        elif count > len(best.found.a) + _UNHELPFUL:
            break
    if best is None:
        raise problem or ValueError(f"{name} finds no states in this record: excite the inputs with more frequencies.")
    return best


def _candidate(
    states: States, order: int, regressors: Regressors, scaled: Scaled, name: str, stable: bool
) -> Candidate:
    later = scaled.after(states.past)
    starts = np.array([states.over(z[: states.past], order)[0] for z in scaled.joint if len(z) > states.past])
    return candidate(realise(regressors, order, name, stable), starts, later)


def realise(regressors: Regressors, order: int, name: str, stable: bool = False) -> Realisation:
    """The model by regression of outputs and next states on the first `order` states and inputs.

    An output does not see the input of its own sample.  stable: whether poles outside the unit circle are reflected
    into it.  Source: Verhaegen and Verdult 2007, Filtering and System Identification, sec. 9.6.
    """
    one, u, y = regressors.one, regressors.u, regressors.y
    now, after = regressors.now[:, :order], regressors.after[:, :order]
    m, p = u.shape[1], y.shape[1]
    found = _solve(np.concatenate([now, one], axis=1), y, name)
    c, level = found[:order].T, found[order:].sum(axis=0)
    e = y - now @ c.T - one * level if one.shape[1] else y - now @ c.T
    quiet = bool((np.linalg.norm(e, axis=0) < _NOISELESS * np.sqrt(regressors.samples)).any())
    heard = np.zeros((len(e), 0)) if quiet else e
    found = _solve(np.concatenate([now, u, heard, one], axis=1), after, name)
    a = found[:order].T
    if stable and np.abs(np.linalg.eigvals(a)).max() >= 1.0:
        a = reflected(a)
        moved = _solve(np.concatenate([u, heard, one], axis=1), after - now @ a.T, name)
        found = np.concatenate([a.T, moved])
    w = after - np.concatenate([now, u, one], axis=1) @ np.delete(
        found, np.s_[order + m : order + m + heard.shape[1]], 0
    )
    b, k = found[order : order + m].T, found[order + m : order + m + heard.shape[1]].T
    drift = found[order + m + heard.shape[1] :].sum(axis=0)
    result = Realisation(a, b, c, np.zeros((order, p)) if quiet else k, drift, level)
    joint = np.concatenate([w, e], axis=1)
    return with_stable_predictor(result, joint.T @ joint / regressors.samples)


def finished(
    series: Series, scaled: Scaled, found: Candidate, states: States, stable: bool, refine: bool
) -> StateSpaceFit:
    """The fit of a model, refined if asked for."""
    if refine:
        return refined(series, scaled, found.found, stable=stable, singular_values=states.singular_values)
    free = found.found.vector.size - (0 if scaled.offset else len(found.found.drift) + scaled.outputs)
    return fit_of(series, scaled, found.found, found.errors, free, singular_values=states.singular_values)


def reflected(a: np.ndarray) -> np.ndarray:
    """The matrix with eigenvalues outside the unit circle moved to their mirror images inside it."""
    values, vectors = np.linalg.eig(a)
    size = np.maximum(np.abs(values), np.finfo(float).tiny)
    inside = np.where(size < 1.0, values, values / size * np.minimum(1.0 / size, _INSIDE))
    return np.real(vectors @ np.diag(inside) @ np.linalg.inv(vectors))


def with_stable_predictor(found: Realisation, spread: np.ndarray) -> Realisation:
    """The realisation, where its predictor is unstable with Kalman's gain; spread: mean square of errors of x and y."""
    if np.abs(np.linalg.eigvals(found.predictor)).max() < 1.0:
        return found
    n, p = found.k.shape
    # noise of the size of rounding, and then more, where states without noise leave the equation unsolvable
    for share in (1e-10, 1e-6, 1e-3):
        q = spread[:n, :n] + share * np.eye(n)
        r = spread[n:, n:] + share * np.eye(p)
        s = spread[:n, n:] if share < 1e-3 else np.zeros((n, p))
        try:
            x = linalg.solve_discrete_are(found.a.T, found.c.T, q, r, s=s)
        except np.linalg.LinAlgError:
            continue
        k = np.linalg.solve(found.c @ x @ found.c.T + r, found.c @ x @ found.a.T + s.T).T
        better = replace(found, k=k)
        if np.abs(np.linalg.eigvals(better.predictor)).max() < 1.0:
            return better
    return replace(found, k=np.zeros_like(found.k))


def _solve(columns: np.ndarray, target: np.ndarray, name: str) -> np.ndarray:
    """Least squares; raises where the columns are dependent."""
    count = columns.shape[1]
    r = triangle_tall(np.concatenate([columns, target], axis=1))
    size = np.linalg.norm(r[:, :count], axis=0)
    size[size == 0.0] = 1.0
    values = np.linalg.svd(r[:count, :count] / size, compute_uv=False)
    if values[-1] <= _DEPENDENT * values[0]:
        raise ValueError(
            f"{name} cannot tell states and inputs apart in this record: lower order, or excite the inputs with more "
            "frequencies, independent of the feedback."
        )
    return np.linalg.solve(r[:count, :count], r[:count, count:])
