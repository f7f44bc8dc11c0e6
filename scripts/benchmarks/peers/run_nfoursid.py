"""nfoursid: its one method, with blocks of 10 and of 15 rows."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from nfoursid.nfoursid import NFourSID

from scripts.benchmarks.peers.runner import Method, main

_INPUTS, _OUTPUTS = ["u0", "u1"], ["y0", "y1"]


def _frame(u: np.ndarray, y: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame(np.hstack([u, y]), columns=[*_INPUTS, *_OUTPUTS])


def _fit(frame: pd.DataFrame, rows: int) -> Any:
    identified = NFourSID(frame, _OUTPUTS, _INPUTS, num_block_rows=rows)
    identified.subspace_identification()
    return identified.system_identification(rank=3)[0]


def _matrices(fitted: Any) -> dict[str, Any]:
    return {"a": fitted.a, "b": fitted.b, "c": fitted.c, "d": fitted.d}


METHODS = tuple(
    Method(f"{rows} block rows", "subspace", "state_space", partial(_fit, rows=rows), _matrices, _frame)
    for rows in (10, 15)
)

if __name__ == "__main__":
    raise SystemExit(main(METHODS))
