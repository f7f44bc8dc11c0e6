"""This project's own estimators, whole fits: from a record to a fit with its uncertainty."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.models.linear import Polynomial
from auv_gym.records.record import Record
from identification.linear.polynomials.armax import Armax
from identification.linear.polynomials.arx import Arx
from identification.linear.polynomials.els import Els
from identification.linear.subspaces.n4sid import N4sid
from identification.linear.subspaces.pbsid import Pbsid
from scripts.benchmarks.peers.runner import Method, main
from scripts.benchmarks.systems import Signals, truth


def _record(system: str, u: np.ndarray, y: np.ndarray) -> Record:
    model = truth(system)
    return Signals(u, y, model.inputs, model.outputs).record


def _model(fit: Any) -> dict[str, Any]:
    model = fit.model
    offsets = {"offset_u": model.input_offset, "offset_y": model.output_offset}
    if isinstance(model, Polynomial) and len(model.outputs) == 1:
        return {"a": model.a[:, 0, 0], "b": model.b[:, 0, 0], "c": model.c[:, 0, 0], **offsets}
    states = model.state_space if isinstance(model, Polynomial) else model
    return {"a": states.a, "b": states.b, "c": states.c, **offsets}


def _method(name: str, kind: str, system: str, estimator: type, **settings: Any) -> Method:
    model = truth(system)
    made = estimator(inputs=model.inputs, outputs=model.outputs, **settings)
    return Method(name, kind, system, made.fit, _model, lambda u, y: _record(system, u, y))


_ARX = {"n_a": 4, "n_b": 4}
_ARMAX = {**_ARX, "n_c": 2}
METHODS = (
    _method("Arx", "least squares", "armax", Arx, **_ARX, offset=False),
    _method("Els", "extended least squares", "armax", Els, **_ARMAX, offset=False),
    _method("Armax", "prediction error", "armax", Armax, **_ARMAX, offset=False),
    _method("Armax, offset too", "prediction error", "armax", Armax, **_ARMAX),
    _method("N4sid", "subspace", "state_space", N4sid, order=3, offset=False),
    _method("Pbsid", "subspace", "state_space", Pbsid, order=3, offset=False),
    _method("N4sid, refined", "prediction error", "state_space", N4sid, order=3, offset=False, refine=True),
    _method("N4sid, refined, offset too", "prediction error", "state_space", N4sid, order=3, refine=True),
    _method(
        "Armax, full", "prediction error", "state_space", Armax, n_a=2, n_b=2, n_c=2, structure="full", offset=False
    ),
)

if __name__ == "__main__":
    raise SystemExit(main(METHODS))
