"""sysidentpy: least squares, plain and extended, with the eight regressors of the true structure; it reports no C."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from sysidentpy.basis_function import Polynomial
from sysidentpy.model_structure_selection import FROLS
from sysidentpy.parameter_estimation import LeastSquares

from scripts.benchmarks.peers.runner import Method, main

_LAGS = 4


def _fit(data: tuple[np.ndarray, np.ndarray], extended: bool) -> Any:
    u, y = data
    estimator = FROLS(
        order_selection=False,
        n_terms=2 * _LAGS,
        ylag=_LAGS,
        xlag=_LAGS,
        elag=2,
        basis_function=Polynomial(degree=1),
        estimator=LeastSquares(unbiased=extended),
    )
    return estimator.fit(X=u, y=y)


def _coefficients(fitted: Any) -> dict[str, Any]:
    """Coefficients by their codes: 1003 is the output three samples before, 2001 the input one sample before."""
    found = {int(code[0]): value for code, value in zip(fitted.final_model, np.ravel(fitted.theta))}
    lags = range(1, _LAGS + 1)
    a, b = [-found.get(1000 + lag, 0.0) for lag in lags], [found.get(2000 + lag, 0.0) for lag in lags]
    return {"a": [1.0, *a], "b": [0.0, *b]}


METHODS = (
    Method("LS", "least squares", "armax", partial(_fit, extended=False), _coefficients),
    Method("ELS", "extended least squares", "armax", partial(_fit, extended=True), _coefficients),
)

if __name__ == "__main__":
    raise SystemExit(main(METHODS))
