"""Extended least squares: ARMAX models by regression on their own errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from auv_gym.records.record import Record
from identification.linear.polynomials.filtering import is_stable, largest_root
from identification.linear.polynomials.polynomial_fit import PolynomialFit, fit_coupled_outputs
from identification.linear.polynomials.prediction import Prediction
from identification.linear.polynomials.structure import ByOrders, Orders, Row

PASSES = 50
_SETTLED = 1e-9  # relative change of the sum of squares in a pass that ends the iteration
_SHARE = 0.7  # of a full step, taken in each pass after the first
_SEEN = 1e-10  # relative power of the errors that the regression leaves; below this, they do not determine C
_INSIDE = 0.98  # magnitude to which the largest root of an unstable C is reduced


@dataclass(frozen=True)
class Els(ByOrders):
    """ARMAX by extended least squares: A(q) y = B(q) u + C(q) e, regressed on the errors of the last pass.

    Settings as in Arx, and n_c: lags of the errors.  Unbiased if C is near 1 (1/C - 1/2 positive real), less accurate
    than Armax, which starts from it.  Source: Ljung 1999, sec. 10.4 (pseudolinear regression).

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import Els, closed_loop
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0))
        >>> fit = Els(["rudder_rad"], ["heading_rad"]).fit(log)
        >>> fit.model.to_state_space().poles().round(2)
        array([1. , 0.8])
    """

    inputs: Sequence[str]
    outputs: Sequence[str]
    n_a: Orders = 2
    n_b: Orders = 2
    n_c: Orders = 2
    delay: Orders = 1
    offset: bool = True
    structure: str = "diagonal"
    integrating: Sequence[str] = ()
    skip: int = 0

    def fit(self, *records: Record) -> PolynomialFit:
        """Fit over all segments of all records; raises if the data do not determine all coefficients."""
        return fit_coupled_outputs(
            "Els", records, self.orders, self.offset, self.skip, lambda errors, arx: (extended(errors, arx), None, "")
        )


def extended(prediction: Prediction, arx: np.ndarray, passes: int = PASSES) -> np.ndarray:
    """The parameters of the pass with the smallest errors; arx: those of least squares, with zeros for C.

    Each pass uses the errors of the previous one and takes part of the full step, since full steps oscillate; an
    unstable C is made stable.
    """
    lags, rows = prediction.lags, prediction.rows
    parts = [_Part.of(prediction, row) for row in rows] if lags else []
    free, best, least = arx, arx, np.inf
    previous = np.inf
    for count in range(passes if lags else 0):
        errors = [e[lags:] for e in prediction.errors(free, prediction.starts())]
        loss = sum(float(np.vdot(e, e)) for e in errors)
        if loss < least:
            best, least = free, loss
        if abs(loss - previous) <= _SETTLED * loss:
            break
        previous = loss
        passed = _with_stable_c(prediction, np.concatenate([part.solve(errors) for part in parts]))
        mixed = passed if count == 0 else (1.0 - _SHARE) * free + _SHARE * passed
        free = _with_stable_c(prediction, mixed)
    return best


@dataclass(frozen=True, eq=False)
class _Part:
    """The part of an output's regression that consists of measured signals.

    late: which parameters belong to errors.  errors: their lags and numbers.
    """

    joints: list[np.ndarray]
    triangle: np.ndarray
    late: np.ndarray
    errors: list[tuple[int, int]]

    @classmethod
    def of(cls, prediction: Prediction, row: Row) -> _Part:
        problem = prediction.regressions[prediction.rows.index(row)]
        ends = np.cumsum([len(y) - prediction.first for y in prediction.scaled.y])[:-1]
        late = [term.kind == "c" for term in row.free_terms] + [False] * prediction.intercept
        local = {of.number: i for i, of in enumerate(prediction.rows)}
        errors = [(term.lag, local[term.number]) for term in row.free_terms if term.kind == "c"]
        return cls(np.split(problem.joint, ends), problem.triangle, np.array(late), errors)

    @cached_property
    def back(self) -> np.ndarray:
        """The inverse of the regression's own triangle."""
        return np.linalg.inv(self.triangle[:-1, :-1])

    def solve(self, errors: Sequence[np.ndarray]) -> np.ndarray:
        """The parameters of the regression extended by these errors; the measured part is eliminated."""
        count = len(self.errors)
        across, among = np.zeros((self.triangle.shape[1], count)), np.zeros((count, count))
        for joint, e in zip(self.joints, errors):
            columns = [(lag, e[: max(len(e) - lag, 0), i]) for lag, i in self.errors]
            for k, (lag, column) in enumerate(columns):
                across[:, k] += joint[lag:].T @ column
                for other, (late, with_column) in enumerate(columns[: k + 1]):
                    # both from the row at which the later of the two begins
                    size = len(e) - max(lag, late)
                    if size > 0:
                        among[k, other] += column[column.size - size :] @ with_column[with_column.size - size :]
        among = np.tril(among) + np.tril(among, -1).T
        known, onto, along = self.triangle[:-1, -1], self.back.T @ across[:-1], across[-1]
        free = np.empty(self.late.size)
        left = among - onto.T @ onto
        floor = (_SEEN * np.trace(among) + np.finfo(float).tiny) * np.eye(count)
        free[self.late] = np.linalg.solve(left + floor, along - onto.T @ known)
        free[~self.late] = self.back @ (known - onto @ free[self.late])
        return free


def _with_stable_c(prediction: Prediction, free: np.ndarray) -> np.ndarray:
    """The parameters with all roots of C scaled into the unit circle by one factor."""
    c = prediction.c(free)
    if is_stable(c):
        return free
    factor, free, at = _INSIDE / largest_root(c), free.copy(), 0
    for row in prediction.rows:
        for k, term in enumerate(row.free_terms):
            if term.kind == "c":
                free[at + k] *= factor**term.lag
        at += row.free + prediction.intercept
    return free
