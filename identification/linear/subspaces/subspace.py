"""The shared part of the subspace methods: from states, as combinations of the past, to a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log
from typing import Any, Literal, Protocol

import numpy as np
from scipy import linalg

from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from identification.linear.subspaces.long_predictor import LongPredictor
from identification.linear.subspaces.realisation import Realisation
from identification.linear.subspaces.refinement import Candidate, candidate, covariance_of, descended, refined
from identification.linear.subspaces.state_space_fit import StateSpaceFit, fit_of
from identification.linear.triangles import triangle_tall

_DEPENDENT = 1e-9  # relative singular value of unit-length columns below which a column is redundant
_NOISELESS = 1e-9  # ratio of one-step error to an output's spread below which it is rounding
_INSIDE = 0.999  # largest magnitude of a pole after reflection into the unit circle, if it has to be stable
_LARGEST_ORDER = 20
_UNHELPFUL = 4  # orders beyond the best one that are tried without improvement
ROWS_PER_COLUMN = 2


class Settings(Protocol):
    """Settings that all subspace methods share.

    order: of the model.  integrators: number of poles at exactly 1; if chosen, at most one per output.  offset: True:
    an operating point is estimated; False: inputs and outputs rest at zero; "auto": as True, but integrators rest at
    zero inputs unless the record shows a drift there.  stable: whether unstable poles are reflected into the unit
    circle.  refine: whether the model is refined by minimising prediction errors, which also gives intervals.  "auto":
    whatever has the least BIC.
    """

    @property
    def outputs(self) -> Sequence[str]: ...
    @property
    def order(self) -> int | Literal["auto"]: ...
    @property
    def horizon(self) -> int | None: ...
    @property
    def integrators(self) -> int | Literal["auto"]: ...
    @property
    def offset(self) -> bool | Literal["auto"]: ...
    @property
    def stable(self) -> bool: ...
    @property
    def refine(self) -> bool: ...


@dataclass(frozen=True, eq=False)
class States:
    """Combinations of the last `past` samples that predict the future, in order of relevance.

    weights: (n, past (m + p)), oldest sample first.  singular_values: for choosing the order.
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


def check_settings(asked: Settings) -> None:
    """Raise an error if order, horizon, integrators or offset are invalid."""
    name, order, horizon, integrators = type(asked).__name__, asked.order, asked.horizon, asked.integrators
    if order != "auto" and not _is_whole(order, 1):
        raise ValueError(f"{name} needs order >= 1 as a whole number, or 'auto', got {order!r}.")
    if horizon is not None and not _is_whole(horizon, 2):
        raise ValueError(f"{name} needs horizon >= 2 samples, or none for its own choice, got {horizon!r}.")
    if integrators != "auto" and not _is_whole(integrators, 0):
        raise ValueError(f"{name} needs integrators >= 0 as a whole number, or 'auto', got {integrators!r}.")
    if integrators != "auto" and order != "auto" and integrators > order:
        raise ValueError(f"{name} needs no more integrators than its order {order}, got {integrators}.")
    if integrators != "auto" and integrators > len(asked.outputs):
        raise ValueError(
            f"{name} needs no more integrators than outputs ({', '.join(asked.outputs)}), got {integrators}: "
            "more could not be told apart."
        )
    if asked.stable and integrators not in ("auto", 0):
        raise ValueError(f"{name} cannot have {integrators} integrators and be stable: ask for one of the two.")
    if asked.offset not in (True, False, "auto"):
        raise ValueError(f"{name} needs offset as true, false or 'auto', got {asked.offset!r}.")


def least_horizon(order: int | str, outputs: int) -> int:
    """The shortest horizon, in samples, for finding a model of this order."""
    return 2 if order == "auto" else max(int(order) // outputs + 2, 2)


def check_excitation(name: str, factor: np.ndarray, series: Series, horizon: int) -> None:
    """Raise an error if the inputs do not excite `horizon` lags; factor: R of their lags, with middles subtracted."""
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
    """States now and one sample later, inputs and outputs, compressed to a few rows with the same products.

    one: (rows, 1), or (rows, 0) without an operating point.  samples: the original number of rows.
    """

    one: np.ndarray
    now: np.ndarray
    u: np.ndarray
    y: np.ndarray
    after: np.ndarray
    samples: int

    @classmethod
    def of(cls, states: States, count: int, scaled: Scaled) -> Regressors:
        """The regressors for the first `count` states."""
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


def identified(asked: Settings, states: States, scaled: Scaled, integrators: int) -> Candidate:
    """The model of the requested order, or of the order with the least log determinant of its errors plus BIC penalty.

    Orders increase from 1 until four more bring no improvement; the penalty counts n (m + 2 p) parameters, r^2 fewer if
    r poles are at 1.
    Source: Bauer 2001, Order estimation for subspace methods, Automatica 37; Schwarz 1978, Annals of Statistics 6.
    """
    name, largest = type(asked).__name__, min(len(states.weights), (states.past - 1) * scaled.outputs)
    if asked.order != "auto" and asked.order > largest:
        raise ValueError(
            f"{name} finds orders up to {largest} in this record at this horizon, got {asked.order}: raise horizon, "
            "record longer or lower order."
        )
    most = min(largest, _LARGEST_ORDER) if asked.order == "auto" else asked.order
    regressors = Regressors.of(states, most, scaled)
    if asked.order != "auto":
        return _candidate(asked, states, most, regressors, scaled, integrators)
    charge = log(regressors.samples) / regressors.samples
    best, least, problem = None, np.inf, None
    for count in range(max(integrators, 1), most + 1):
        try:
            found = _candidate(asked, states, count, regressors, scaled, integrators)
        except ValueError as error:
            problem = error
            continue
        size = found.loss + charge * found.found.parameters
        if best is None or size < least:
            best, least = found, size
        elif count > len(best.found.a) + _UNHELPFUL:
            break
    if best is None:
        raise problem or ValueError(f"{name} finds no states in this record: excite the inputs with more frequencies.")
    return best


def _refined(found: Candidate, scaled: Scaled) -> Candidate | None:
    """A model after refinement; None if the record is too short for it."""
    try:
        return descended(scaled, found.found)[0]
    except ValueError:
        return None


def with_fitting_integrators(
    asked: Settings, states: States, scaled: Scaled, most: int
) -> tuple[Candidate, Candidate | None]:
    """The model with `most` poles at 1, or with fewer if refined models need fewer, and that model refined.

    A long predictor has more poles at 1 than the system if the input holds the output's level, as integral feedback
    does: an additional pole and zero at 1 that cancel.  With them, a model is worse or needs more states.  The penalty
    for releasing poles from 1 is the log of the information on them, for other parameters BIC's log N.
    Source: Phillips and Ploberger 1996, An asymptotic theory of Bayesian inference for time series, Econometrica 64.
    """
    found = [identified(asked, states, scaled, count) for count in range(most + 1)]
    finer = [_refined(one, scaled) for one in found]
    rows, sizes = sum(len(y) for y in scaled.y), []
    for one in finer:
        if one is None:  # too short for a decision
            return found[most], None
        let_go = most - one.found.integrators
        known = _information_on_poles(one, scaled)[:let_go] if let_go else np.empty(0)
        sizes.append(rows * one.loss + log(rows) * (one.found.parameters - len(known)) + np.sum(np.log(known)))
    best = int(np.argmin(sizes))
    return found[best], finer[best]


def _information_on_poles(here: Candidate, scaled: Scaled) -> np.ndarray:
    """The inverse variance of each free pole, nearest 1 first."""
    r, a = here.found.integrators, here.found.a
    covariance = covariance_of(here, scaled)[0][: a.size, : a.size]
    solved: Any = linalg.eig(a[r:, r:], left=True, right=True)
    values, left, right = solved
    slopes = np.zeros((len(values), *a.shape), dtype=complex)
    across = np.sum(left.conj() * right, axis=0)
    slopes[:, r:, r:] = np.einsum("ik,jk->kij", left.conj(), right) / across[:, None, None]
    flat = slopes.reshape(len(values), a.size)
    spread = np.real(np.einsum("ki,ij,kj->k", flat, covariance, flat.conj()))
    order = np.argsort(np.abs(values - 1.0))
    return 1.0 / np.maximum(spread[order], np.finfo(float).tiny)


def drifts(here: Candidate, scaled: Scaled) -> bool:
    """Whether a record shows a drift of a refined model's integrators at zero input.

    The drift counts if its square over its variance exceeds the log of the information on it, in spreads of the outputs
    per sample: 3 log N for the slope of a line, and BIC's log N under random walks.
    Source: Phillips and Ploberger 1996, An asymptotic theory of Bayesian inference for time series, Econometrica 64.
    """
    found, (covariance, _) = here.found, covariance_of(here, scaled)
    r, (n, m) = found.integrators, found.b.shape
    zero = -scaled.input_middle / scaled.input_spread
    drift = found.drift[:r] + found.b[:r] @ zero
    slopes = np.zeros((r, found.vector.size))
    for i in range(r):
        slopes[i, n * n + i * m : n * n + (i + 1) * m] = zero
        slopes[i, -scaled.outputs - n + i] = 1.0
    spread = slopes @ covariance @ slopes.T
    seen = found.summed @ spread @ found.summed.T
    charge = -np.sum(np.log(np.linalg.svd(seen, compute_uv=False)[:r]))
    return bool(drift @ np.linalg.solve(spread, drift) > charge)


def _candidate(
    asked: Settings,
    states: States,
    order: int,
    regressors: Regressors,
    scaled: Scaled,
    integrators: int,
    resting: bool = False,
) -> Candidate:
    """The model of an order; resting: whether its integrators have no drift."""
    name, later = type(asked).__name__, scaled.after(states.past)
    starts = np.array([states.over(z[: states.past], order)[0] for z in scaled.joint if len(z) > states.past])
    free = realise(regressors, order, name, asked.stable)
    if not integrators:
        return candidate(free, starts, later)
    turn = slowest_first(free.a)
    model = with_integrators(free, regressors, integrators, turn, resting or not scaled.offset, scaled, name)
    return candidate(model, starts @ turn.T, later)


def realise(regressors: Regressors, order: int, name: str, stable: bool = False) -> Realisation:
    """The model by regression of outputs and next states on the first `order` states and inputs.

    An output does not depend on the input of the same sample.  stable: whether poles outside the unit circle are
    reflected into it.  Source: Verhaegen and Verdult 2007, Filtering and System Identification, sec. 9.6.
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


def slowest_first(a: np.ndarray) -> np.ndarray:
    """Orthonormal rows: combinations of states, the slowest by themselves first (integrators do not move)."""
    return np.linalg.svd(a - np.eye(len(a)))[0].T[::-1]


def with_integrators(
    free: Realisation,
    regressors: Regressors,
    count: int,
    turn: np.ndarray,
    resting: bool,
    scaled: Scaled,
    name: str,
) -> Realisation:
    """The realisation in rotated states, the first of which are refitted as sums of inputs and errors.

    resting: whether these stay constant at zero input; otherwise they have a drift.
    """
    found, (order, m) = free.turned(turn), free.b.shape
    now, after = (part[:, :order] @ turn.T for part in (regressors.now, regressors.after))
    u, one, rest = regressors.u, regressors.one, -scaled.input_middle / scaled.input_spread
    drifting = one.shape[1] == 1 and not resting
    e = _errors(found, regressors, now)
    heard = e if free.k.any() else np.zeros((len(e), 0))
    given = u - one * rest if one.shape[1] and resting else u
    columns = np.concatenate([given, heard, *([one] if drifting else [])], axis=1)
    moved = _solve(columns, (after - now)[:, :count], name).T
    a, b, k, drift = found.a.copy(), found.b.copy(), found.k.copy(), found.drift.copy()
    a[:count], b[:count], k[:count] = np.eye(count, order), moved[:, :m], 0.0
    if heard.shape[1]:
        k[:count] = moved[:, m : m + heard.shape[1]]
    drift[:count] = moved[:, -1] if drifting else -b[:count] @ rest
    result = replace(found, a=a, b=b, k=k, drift=drift, integrators=count, rest=rest if resting else None)
    w = after - now @ a.T - u @ b.T - (one * drift if one.shape[1] else 0.0)
    joint = np.concatenate([w, e], axis=1)
    return with_stable_predictor(result, joint.T @ joint / regressors.samples)


def finished(
    asked: Settings, series: Series, scaled: Scaled, states: States, predictor: LongPredictor
) -> StateSpaceFit:
    """The fit of a model with these states, refined if requested, with notes on the choices."""
    integrators = 0 if asked.stable else asked.integrators
    if integrators == "auto":
        integrators = predictor.integrators if asked.order == "auto" else min(predictor.integrators, asked.order)
    finer = None
    if asked.integrators == "auto" and integrators:
        found, finer = with_fitting_integrators(asked, states, scaled, integrators)
    else:
        found = identified(asked, states, scaled, integrators)
    integrators = found.found.integrators
    if integrators and asked.offset == "auto":
        finer = finer or _refined(found, scaled)
        if finer is None or not drifts(finer, scaled):
            order = len(found.found.a)
            regressors = Regressors.of(states, order, scaled)
            found = _candidate(asked, states, order, regressors, scaled, integrators, resting=True)
    if asked.refine:
        fit = refined(series, scaled, found.found, stable=asked.stable, singular_values=states.singular_values)
    else:
        shape = found.found
        held = integrators * (len(shape.a) + (shape.rest is not None)) if scaled.offset else shape.drift.size
        free = shape.vector.size - held - (0 if scaled.offset else scaled.outputs)
        fit = fit_of(series, scaled, shape, found.errors, free, singular_values=states.singular_values)
    fit = replace(fit, horizon=states.past)
    return replace(fit, notes=_notes(asked, fit))


def reflected(a: np.ndarray) -> np.ndarray:
    """The matrix with eigenvalues outside the unit circle mirrored into it."""
    values, vectors = np.linalg.eig(a)
    size = np.maximum(np.abs(values), np.finfo(float).tiny)
    inside = np.where(size < 1.0, values, values / size * np.minimum(1.0 / size, _INSIDE))
    return np.real(vectors @ np.diag(inside) @ np.linalg.inv(vectors))


def with_stable_predictor(found: Realisation, spread: np.ndarray) -> Realisation:
    """The realisation, with the Kalman gain if its predictor is unstable; spread: mean square of errors of x and y."""
    if np.abs(np.linalg.eigvals(found.predictor)).max() < 1.0:
        return found
    n, p = found.k.shape
    # states without noise can make the equation unsolvable: add noise of the size of rounding, then more
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


def _errors(found: Realisation, regressors: Regressors, now: np.ndarray) -> np.ndarray:
    e = regressors.y - now @ found.c.T
    return e - regressors.one * found.level if regressors.one.shape[1] else e


def _notes(asked: Settings, fit: StateSpaceFit) -> tuple[str, ...]:
    """Choices that depend on the data, in words."""
    found, sums = [], fit.centre.integrators
    if asked.order == "auto":
        found.append(f"order {fit.order}, chosen by BIC")
    if asked.horizon is None:
        found.append(f"horizon of {fit.horizon} samples ({fit.horizon * fit.model.dt:g} s), chosen by AIC")
    if asked.integrators == "auto" and not asked.stable:
        poles = "no pole" if not sums else "one pole" if sums == 1 else f"{sums} poles"
        verb = "integrate" if sums > 1 else "integrates"
        found.append(f"{poles} fixed at 1: {' and '.join(fit.integrating) or 'no output'} {verb}, by a unit-root test")
    if asked.offset == "auto" and sums:
        rests = fit.centre.rest is not None
        found.append(f"{'no' if rests else 'a'} drift at zero input: the record shows {'none' if rests else 'one'}")
    return tuple(found)


def _is_whole(value: object, least: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= least


def _solve(columns: np.ndarray, target: np.ndarray, name: str) -> np.ndarray:
    """Least squares; raises if the columns are dependent."""
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
