"""ARMAX by the prediction-error method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from auv_gym.records.record import Record
from identification.linear.polynomials.els import extended
from identification.linear.polynomials.levenberg_marquardt import Stopping, minimise
from identification.linear.polynomials.polynomial_fit import PolynomialFit, fit_coupled_outputs
from identification.linear.polynomials.prediction import Prediction
from identification.linear.polynomials.structure import ByOrders, Orders

_ROUNDS = 4  # iterations of the weights for coupled outputs
_SAME = 1e-6  # relative change of the errors' covariance that ends the iterations
_START_PASSES = 3


@dataclass(frozen=True)
class Armax(ByOrders):
    """ARMAX by the prediction-error method: A(q) y = B(q) u + intercept + C(q) e.

    Settings as in Arx, and n_c: lags of the errors.  Unbiased in closed loop and under coloured noise, if the orders
    include the true system's.  Starts from extended least squares and uses Levenberg-Marquardt with exact gradients;
    the errors before the first prediction of each segment are estimated, too.  structure full: A and C have all outputs
    in each equation, and errors are weighted by their inverse covariance.  A may be unstable, C is kept stable.
    Source: Geng and Zhao 2012, eqs (16) to (24); Ljung 1999, secs. 7.2 and 10.2.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import Armax, closed_loop
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0))
        >>> fit = Armax(["rudder_rad"], ["heading_rad"]).fit(log)
        >>> fit.model.to_state_space().poles().round(2)
        array([1.  , 0.81])
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
    stopping: Stopping = field(default_factory=Stopping)

    def fit(self, *records: Record) -> PolynomialFit:
        """Fit over all segments of all records; raises if the data do not determine all coefficients."""
        return fit_coupled_outputs("Armax", records, self.orders, self.offset, self.skip, self._minimised)

    def _minimised(self, prediction: Prediction, arx: np.ndarray) -> tuple[np.ndarray, np.ndarray, str]:
        return least_errors(prediction, extended(prediction, arx, _START_PASSES), self.stopping)


def least_errors(prediction: Prediction, free: np.ndarray, stopping: Stopping) -> tuple[np.ndarray, np.ndarray, str]:
    """The parameters and starts with the least errors, and a description of any problem ("" if converged).

    For several outputs, the determinant of the errors' covariance is minimised.
    """
    starts, r = prediction.starts(), len(prediction.rows)
    weight, reason = np.eye(r), ""
    for _ in range(_ROUNDS if r > 1 else 1):
        if r > 1:
            errors = np.concatenate(prediction.errors(free, starts))
            noise = errors.T @ errors / len(errors)
            before, weight = weight, np.linalg.cholesky(np.linalg.inv(noise + 1e-15 * np.trace(noise) * np.eye(r)))
            if np.abs(weight - before).max() <= _SAME * np.abs(weight).max():
                break
        found = minimise(prediction, free, starts, weight, stopping)
        free, starts, reason = found.free, found.starts, found.reason
    if reason != "iterations":
        return free, starts, ""
    return free, starts, f"not at rest after {stopping.iterations} iterations: lower the orders, or record longer"
