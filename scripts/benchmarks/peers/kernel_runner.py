"""The common part of runners of kernel machines: each method learns the arrays of a folder and prints lines of JSON.

It imports nothing but numpy, so that it runs in every peer's environment.  The folder holds jobs.json (section,
penalty, sigma, ...) and data.npz: x (n, d) and y (n, m) to learn from, noise-free fresh_x and fresh_y to judge by.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROWS = 10_000
ONE_ROW_S = 0.3  # time for repeated predictions of one row


@dataclass(frozen=True)
class Method:
    """A way to train a machine: the section in which it is measured, and its name there.

    learn: x, y and the jobs to the machine and its reported numbers; timed.  predict: a machine and rows to (n, m).
    """

    section: str
    name: str
    learn: Callable[[np.ndarray, np.ndarray, Mapping[str, Any]], tuple[Any, dict[str, Any]]]
    predict: Callable[[Any, np.ndarray], np.ndarray]


def main(methods: Sequence[Method], argv: Sequence[str] | None = None) -> int:
    """Run the methods of the section of the folder named by the only argument."""
    (folder,) = sys.argv[1:] if argv is None else argv
    jobs = json.loads((Path(folder) / "jobs.json").read_text(encoding="utf-8"))
    with np.load(Path(folder) / "data.npz") as arrays:
        data = dict(arrays)
    for method in methods:
        if method.section == jobs["section"]:
            print(json.dumps({"method": method.name, **measured(method, data, jobs)}), flush=True)
    return 0


def measured(method: Method, data: Mapping[str, np.ndarray], jobs: Mapping[str, Any]) -> dict[str, Any]:
    """Seconds to learn and to predict, error on fresh data over its spread, and the peak of memory so far."""
    few = slice(min(len(data["x"]), 100))
    method.predict(method.learn(data["x"][few], data["y"][few], jobs)[0], data["fresh_x"])  # compiles
    begin, cpu = time.perf_counter(), time.process_time()
    machine, told = method.learn(data["x"], data["y"], jobs)
    learn_s, cpu_s = time.perf_counter() - begin, time.process_time() - cpu
    away = method.predict(machine, data["fresh_x"]) - data["fresh_y"]
    error = np.sqrt(np.mean((away / data["fresh_y"].std(axis=0)) ** 2))
    rows = np.resize(data["fresh_x"], (ROWS, data["fresh_x"].shape[1]))
    return {
        "learn_s": learn_s,
        "cpu_s": cpu_s,
        "row_us": 1e6 * _least(lambda: method.predict(machine, rows[:1]), ONE_ROW_S),
        "rows_ms": 1e3 * _least(lambda: method.predict(machine, rows), 0.0),
        "error_percent": 100.0 * float(error),
        "peak_mb": _peak_mb(),
        **told,
    }


def _least(run: Callable[[], object], seconds: float) -> float:
    """The shortest of the calls that fit into so many seconds, at least two."""
    begin, least = time.perf_counter(), np.inf
    count = 0
    while count < 2 or time.perf_counter() - begin < seconds:
        start = time.perf_counter()
        run()
        least = min(least, time.perf_counter() - start)
        count += 1
    return least


def _peak_mb() -> float | None:
    """The largest memory of this process so far, MB; None if the system does not report it.

    getrusage is no alternative: it includes the memory of the process that started this one.
    """
    status = Path("/proc/self/status")
    lines = status.read_text(encoding="ascii", errors="replace").splitlines() if status.exists() else []
    return next((int(line.split()[1]) / 1e3 for line in lines if line.startswith("VmHWM")), None)
