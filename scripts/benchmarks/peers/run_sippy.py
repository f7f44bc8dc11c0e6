"""sippy_unipi: ARMAX by extended least squares (ILLS) and by optimisation (OPT), and its subspace methods."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from sippy_unipi import system_identification

from scripts.benchmarks.peers.runner import Method, main


def _polynomial(data: tuple[np.ndarray, np.ndarray], **settings: Any) -> Any:
    u, y = data
    return system_identification(y[:, 0], u[:, 0], **settings)


def _coefficients(fitted: Any) -> dict[str, Any]:
    noise = getattr(fitted, "NUMERATOR_H", None)
    model = {"a": fitted.DENOMINATOR[0][0], "b": np.append(0.0, fitted.NUMERATOR[0][0])}
    return model if noise is None else {**model, "c": noise[0][0]}


def _states(data: tuple[np.ndarray, np.ndarray], method: str, rows: int) -> Any:
    u, y = data
    return system_identification(y, u, method, SS_fixed_order=3, SS_f=rows, SS_p=rows)


def _matrices(fitted: Any) -> dict[str, Any]:
    return {"a": fitted.A, "b": fitted.B, "c": fitted.C, "d": fitted.D}


# its delay is counted from the sample after the input
_ARX = partial(_polynomial, id_method="ARX", ARX_orders=[4, 4, 0])
_ARMAX = partial(_polynomial, id_method="ARMAX", ARMAX_orders=[4, 4, 2, 0])
METHODS = (
    Method("ARX", "least squares", "armax", _ARX, _coefficients),
    Method("ILLS", "extended least squares", "armax", partial(_ARMAX, ARMAX_mod="ILLS"), _coefficients),
    Method("OPT", "prediction error", "armax", partial(_ARMAX, ARMAX_mod="OPT"), _coefficients),
    Method("N4SID", "subspace", "state_space", partial(_states, method="N4SID", rows=20), _matrices),
    Method("MOESP", "subspace", "state_space", partial(_states, method="MOESP", rows=20), _matrices),
    Method("PARSIM-K", "subspace", "state_space", partial(_states, method="PARSIM-K", rows=10), _matrices),
)

if __name__ == "__main__":
    raise SystemExit(main(METHODS))
