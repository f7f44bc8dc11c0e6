"""ARX: discrete-time linear models by least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from auv_gym.records.record import Record
from identification.linear.polynomials.polynomial_fit import PolynomialFit, fit_coupled_outputs
from identification.linear.polynomials.structure import ByOrders, Orders


@dataclass(frozen=True)
class Arx(ByOrders):
    """Least-squares ARX, A(q) y = B(q) u + intercept + e.

    n_a: lags of an output.  n_b: lags of an input, from `delay` on; 0 if it does not act.  delay: samples, at least 1,
    as an output does not depend on the input of its own row.  A number applies to all outputs, a list has one for each
    output, a list of lists one for each output and channel.  structure: diagonal (each output by itself) or full (each
    equation has lags of all outputs).  integrating: outputs with a pole at exactly 1, which is counted in n_a.  offset:
    whether an operating point is estimated.  skip: minimum number of samples of each segment used only as lags.
    If e is not white, for example with noise on a measured output, the coefficients are biased for any length of
    record, and the intervals do not include this bias: see Armax.  Source: Ljung 1999, sec. 4.2, 7.3.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import Arx, closed_loop
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0))
        >>> fit = Arx(["rudder_rad"], ["heading_rad"]).fit(log)
        >>> fit.model.to_state_space().poles().round(2)
        array([1.01, 0.64])
    """

    inputs: Sequence[str]
    outputs: Sequence[str]
    n_a: Orders = 2
    n_b: Orders = 2
    delay: Orders = 1
    offset: bool = True
    structure: str = "diagonal"
    integrating: Sequence[str] = ()
    skip: int = 0

    def fit(self, *records: Record) -> PolynomialFit:
        """Fit over all segments of all records, each with its own lags; raises if the data do not determine the fit."""
        return fit_coupled_outputs(
            "Arx", records, self.orders, self.offset, self.skip, lambda errors, arx: (arx, None, "")
        )
