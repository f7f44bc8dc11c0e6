"""llsi: ARX, and PO-MOESP, whose window follows from the order."""

from __future__ import annotations

from typing import Any

import llsi
import numpy as np

from scripts.benchmarks.peers.runner import Method, main


def _data(u: np.ndarray, y: np.ndarray) -> tuple[Any, list[str], list[str]]:
    outputs, inputs = [f"y{i}" for i in range(y.shape[1])], [f"u{i}" for i in range(u.shape[1])]
    return llsi.SysIdData(Ts=1.0, **dict(zip(outputs, y.T)), **dict(zip(inputs, u.T))), outputs, inputs


def _arx(data: tuple[Any, list[str], list[str]]) -> Any:
    series, outputs, inputs = data
    return llsi.sysid(series, outputs[0], inputs[0], (4, 4, 1), method="arx")


def _coefficients(fitted: Any) -> dict[str, Any]:
    return {"a": np.ravel(fitted.a), "b": np.append(0.0, np.ravel(fitted.b))}


def _po_moesp(data: tuple[Any, list[str], list[str]]) -> Any:
    series, outputs, inputs = data
    return llsi.sysid(series, outputs, inputs, (3,), method="po-moesp")


def _matrices(fitted: Any) -> dict[str, Any]:
    return {"a": fitted.A, "b": fitted.B, "c": fitted.C, "d": fitted.D}


METHODS = (
    Method("ARX", "least squares", "armax", _arx, _coefficients, _data),
    Method("PO-MOESP", "subspace", "state_space", _po_moesp, _matrices, _data),
)

if __name__ == "__main__":
    raise SystemExit(main(METHODS))
