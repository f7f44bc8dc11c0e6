"""From states as combinations of the past to a model: what the subspace methods share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np
from scipy import linalg

from auv_gym.channels import channel
from identification.linear.hankel import triangle_tall
from identification.linear.realisation import Realisation
from identification.linear.refinement import refined
from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from identification.linear.state_space_fit import StateSpaceFit, fit_of

_DEPENDENT = 1e-9  # singular value over the largest, of columns of unit size, below which they are one too many
_NOISELESS = 1e-9  # one-step error over the spread of an output below which it is rounding
_INSIDE = 0.999  # size to which a pole outside the unit circle is moved at least, where it has to be stable
_LARGEST_ORDER = 20
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


def check_channels(name: str, inputs: Sequence[str], outputs: Sequence[str]) -> None:
    """Raises, on behalf of the estimator `name`, if the channels cannot be those of a model."""
    for what, names in (("inputs", inputs), ("outputs", outputs)):
        if isinstance(names, str) or not names or len(set(names)) != len(names):
            raise ValueError(f"{name} needs {what} as a list of different channel names, got {names!r}.")
        for one in names:
            channel(one)
    both = set(inputs) & set(outputs)
    if both:
        raise ValueError(f"{name} got {', '.join(sorted(both))} as input and as output: choose one.")


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
    values = np.linalg.svd(factor / np.linalg.norm(factor, axis=0), compute_uv=False)
    excited = int(np.count_nonzero(values > _DEPENDENT * values[0]))
    if excited < values.size:
        m = len(series.inputs)
        raise ValueError(
            f"{name} needs inputs that excite {horizon} lags, got {', '.join(series.inputs)} exciting {excited} of "
            f"{m} x {horizon}: use a record with more frequencies or steps, inputs moving apart from one another, or a "
            "smaller horizon."
        )


def choose_order(order: int | str, largest: int, states: States, scaled: Scaled, name: str) -> int:
    """The order asked for, or where that is "auto", the one of least log det of one-step errors plus BIC's charge.

    The charge counts n (m + 2 p) parameters.  Source: Bauer 2001, Order estimation for subspace methods, Automatica 37.
    """
    if order != "auto":
        if int(order) > largest:
            raise ValueError(
                f"{name} finds orders up to {largest} at this horizon, got {order}: raise horizon, record longer or "
                "lower order."
            )
        return int(order)
    most = min(largest, _LARGEST_ORDER, int(np.count_nonzero(states.singular_values > 1e-10)))
    seen = [states.over(z, most)[:-1] for z in scaled.joint if len(z) > states.past]
    x = np.concatenate(seen)
    y = np.concatenate([part[states.past :] for part in scaled.y if len(part) > states.past])
    rows, p = y.shape
    columns = np.concatenate([np.ones((rows, 1)), x], axis=1)[:, 0 if scaled.offset else 1 :]
    _, r = np.linalg.qr(
        np.concatenate([columns, y], axis=1)
    )  # nested: the first columns' part of y is in its first rows
    best, least = 1, np.inf
    for count in range(1, most + 1):
        left = r[columns.shape[1] - most + count :, columns.shape[1] :]
        errors = left.T @ left / rows + _NOISELESS**2 * np.eye(p)
        size = np.linalg.slogdet(errors)[1] + count * (scaled.inputs + 2 * p) * log(rows) / rows
        if size < least:
            best, least = count, float(size)
    return best


def realise(
    states: States, order: int, scaled: Scaled, name: str, stable: bool = False
) -> tuple[Realisation, np.ndarray]:
    """The model by regression of outputs and next states on states and inputs, and its one-step errors, (rows, p).

    An output does not see the input of its own sample.  stable: whether poles outside the unit circle are reflected
    into it.  Source: Verhaegen and Verdult 2007, Filtering and System Identification, sec. 9.6.
    """
    kept = [(u, y, states.over(z, order)) for u, y, z in zip(scaled.u, scaled.y, scaled.joint) if len(z) > states.past]
    now = np.concatenate([x[:-1] for _, _, x in kept])
    after = np.concatenate([x[1:] for _, _, x in kept])
    u = np.concatenate([u[states.past :] for u, _, _ in kept])
    y = np.concatenate([y[states.past :] for _, y, _ in kept])
    one = np.ones((len(y), 1 if scaled.offset else 0))
    m, p = u.shape[1], y.shape[1]
    found = _solve(np.concatenate([now, one], axis=1), y, name)
    c, level = found[:order].T, found[order:].T @ np.ones(one.shape[1])
    e = y - now @ c.T - level
    quiet = bool((np.sqrt(np.mean(e**2, axis=0)) < _NOISELESS).any())
    heard = np.zeros((len(e), 0)) if quiet else e
    found = _solve(np.concatenate([now, u, heard, one], axis=1), after, name)
    a = found[:order].T
    if stable and np.abs(np.linalg.eigvals(a)).max() >= 1.0:
        a = reflected(a)
        moved = _solve(np.concatenate([u, heard, one], axis=1), after - now @ a.T, name)
        found = np.concatenate([a.T, moved])
    b, k = found[order : order + m].T, found[order + m : order + m + heard.shape[1]].T
    drift = found[order + m + heard.shape[1] :].T @ np.ones(one.shape[1])
    result = Realisation(a, b, c, np.zeros((order, p)) if quiet else k, drift, level)
    w = after - now @ a.T - u @ b.T - drift
    return with_stable_predictor(result, w, e), e


def finished(
    series: Series,
    scaled: Scaled,
    found: Realisation,
    errors: np.ndarray,
    states: States,
    stable: bool,
    refine: bool,
) -> StateSpaceFit:
    """The fit of a realisation with these one-step errors, refined if asked for."""
    if refine:
        return refined(series, scaled, found, stable=stable, singular_values=states.singular_values)
    fitted = found.vector.size - (0 if scaled.offset else found.drift.size + found.level.size)
    return fit_of(series, scaled, found, errors, fitted, singular_values=states.singular_values)


def reflected(a: np.ndarray) -> np.ndarray:
    """The matrix with eigenvalues outside the unit circle moved to their mirror images inside it."""
    values, vectors = np.linalg.eig(a)
    size = np.maximum(np.abs(values), np.finfo(float).tiny)
    inside = np.where(size < 1.0, values, values / size * np.minimum(1.0 / size, _INSIDE))
    return np.real(vectors @ np.diag(inside) @ np.linalg.inv(vectors))


def with_stable_predictor(found: Realisation, w: np.ndarray, e: np.ndarray) -> Realisation:
    """The realisation, with Kalman's gain for the errors w of states and e of outputs where its own is unstable."""
    if np.abs(np.linalg.eigvals(found.predictor)).max() < 1.0:
        return found
    n, rows = len(found.a), len(w)
    joint = np.concatenate([w, e], axis=1)
    spread = joint.T @ joint / rows
    # noise of the size of rounding, and then more, where states without noise leave the equation unsolvable
    for share in (1e-10, 1e-6, 1e-3):
        q = spread[:n, :n] + share * np.eye(n)
        r = spread[n:, n:] + share * np.eye(e.shape[1])
        s = spread[:n, n:] if share < 1e-3 else np.zeros((n, e.shape[1]))
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
