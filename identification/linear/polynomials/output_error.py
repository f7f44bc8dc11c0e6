"""Output-error models: noise on the measurement only, fitted by free runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from scipy.signal import lfilter

from auv_gym.records.record import Record
from identification.linear.polynomials.armax import least_errors
from identification.linear.polynomials.els import extended
from identification.linear.polynomials.filtering import half_squares, largest_root
from identification.linear.polynomials.levenberg_marquardt import Stopping
from identification.linear.polynomials.polynomial_fit import PolynomialFit, fit_coupled_outputs
from identification.linear.polynomials.prediction import Prediction
from identification.linear.polynomials.structure import ByOrders, Orders

_PASSES = 10
_NEAR = 1e-3  # gradient at which a model is good enough as a start
_INSIDE = 0.999  # largest magnitude of a root of A that is used to filter signals


@dataclass(frozen=True)
class OutputError(ByOrders):
    """An output-error model, y = (B(q) / A(q)) u + e, fitted by minimising the errors of free runs.

    Settings as in Arx.  Each segment's initial state is estimated.  Correct if the noise is on the measurement only;
    under feedback, only if e is white.  An integrating plant can be fitted, an unstable one cannot: use Armax.
    Levenberg-Marquardt starts from filtered least squares (Steiglitz and McBride 1965) and from ARMAX; the better
    result is kept.
    Source: Ljung 1999, secs. 4.2 and 7.2.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import OutputError, closed_loop
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0))
        >>> fit = OutputError(["rudder_rad"], ["heading_rad"]).fit(log)
        >>> fit.model.to_state_space().poles().round(2)
        array([1.  , 0.82])
    """

    tied: ClassVar[bool] = True
    inputs: Sequence[str]
    outputs: Sequence[str]
    n_a: Orders = 2
    n_b: Orders = 2
    delay: Orders = 1
    offset: bool = True
    structure: str = "diagonal"
    integrating: Sequence[str] = ()
    skip: int = 0
    stopping: Stopping = field(default_factory=Stopping)

    def fit(self, *records: Record) -> PolynomialFit:
        """Fit over all segments of all records; raises if the data do not determine all coefficients."""
        return fit_coupled_outputs("OutputError", records, self.orders, self.offset, self.skip, self._minimised)

    def _minimised(self, prediction: Prediction, arx: np.ndarray) -> tuple[np.ndarray, np.ndarray, str]:
        begun = [filtered(prediction, arx) if len(prediction.rows) == 1 else arx, loosened(prediction, arx)]
        return min(
            (least_errors(prediction, start, self.stopping) for start in begun), key=lambda f: _loss(prediction, *f)
        )


def _loss(prediction: Prediction, free: np.ndarray, starts: np.ndarray, _: str) -> float:
    """Log determinant of the errors' covariance."""
    errors = np.concatenate(prediction.errors(free, starts))
    return float(np.linalg.slogdet(errors.T @ errors)[1])


def loosened(prediction: Prediction, arx: np.ndarray) -> np.ndarray:
    """The parameters of A and B from an ARMAX model with its own C of the order of A."""
    loose = replace(prediction, structure=replace(prediction.structure, tied=False))
    loose = replace(loose, rows=tuple(loose.structure.rows[row.number] for row in prediction.rows))
    ours = [
        known
        for row in loose.rows
        for known in [*(term.kind != "c" for term in row.free_terms), *[True] * loose.intercept]
    ]
    start = np.zeros(loose.free)
    start[ours] = arx
    return least_errors(loose, extended(loose, start, _PASSES), Stopping(gradient=_NEAR))[0][ours]


def filtered(prediction: Prediction, arx: np.ndarray) -> np.ndarray:
    """The parameters with the smallest errors among least-squares passes on signals filtered with 1/A."""
    best, least = arx, np.inf
    free, one = arx, np.eye(1)
    for _ in range(_PASSES):
        value = half_squares(np.concatenate(prediction.errors(free, prediction.starts())), one)
        if value < least:
            best, least = free, value
        a = prediction.c(free)[:, 0, 0]
        a = a * min(1.0, _INSIDE / max(largest_root(a[:, None, None]), 1e-12)) ** np.arange(a.size)
        problem = prediction.regressions[0]
        ends = np.cumsum([len(y) - prediction.first for y in prediction.scaled.y])[:-1]
        columns = np.concatenate([lfilter([1.0], a, part, axis=0) for part in np.split(problem.joint, ends)])
        free = np.linalg.lstsq(columns[:, :-1], columns[:, -1], rcond=1e-14)[0]
    return best
