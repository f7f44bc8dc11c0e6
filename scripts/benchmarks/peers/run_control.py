"""python-control: Markov parameters by least squares, and the eigensystem realisation of them.

31 parameters serve short records best, 41 long ones.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import control
import numpy as np

from scripts.benchmarks.peers.runner import Method, main


def _fit(data: tuple[np.ndarray, np.ndarray], count: int) -> Any:
    u, y = data
    responses = control.markov(y.T, u.T, count, truncate=True)
    rows = (count - 1) // 2
    return control.eigensys_realization(responses, 3, m=rows, n=rows)[0]


def _matrices(fitted: Any) -> dict[str, Any]:
    return {"a": fitted.A, "b": fitted.B, "c": fitted.C, "d": fitted.D}


METHODS = tuple(
    Method(f"markov {count} + ERA", "impulse response", "state_space", partial(_fit, count=count), _matrices)
    for count in (31, 41)
)

if __name__ == "__main__":
    raise SystemExit(main(METHODS))
