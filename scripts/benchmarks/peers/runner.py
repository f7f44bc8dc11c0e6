"""The common part of runners: each method fits each record of a folder; only the fit is timed, and its model returned.

It imports nothing but numpy, so that it runs in every peer's environment.  The folder holds jobs.json (samples, seeds,
budget_s) and SYSTEM_SAMPLES_SEED.npz with u (n, m) and y (n, p).  It prints a line of JSON for each fit.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

LEAST_SEEDS = 3  # for a method that is already over its budget


@dataclass(frozen=True)
class Method:
    """A method of identification: its name, its kind, and its fit.

    prepare: u, y to the input of `fit`, not timed.  fit: timed.  model: the fitted one as JSON, not timed; for "armax"
    coefficients a, b, c from power 0 of the delay on (c absent: not reported), for "state_space" matrices a, b, c, d;
    offset_u, offset_y if signals are relative to these.
    """

    name: str
    kind: str
    system: str
    fit: Callable[[Any], Any]
    model: Callable[[Any], dict[str, Any]]
    prepare: Callable[[np.ndarray, np.ndarray], Any] = lambda u, y: (u, y)


def main(methods: Sequence[Method], argv: Sequence[str] | None = None) -> int:
    """Run all methods over the folder named by the only argument."""
    (folder,) = sys.argv[1:] if argv is None else argv
    jobs = json.loads((Path(folder) / "jobs.json").read_text(encoding="utf-8"))
    with _lines() as say:
        say({"fits": len(methods) * len(jobs["samples"]) * jobs["seeds"]})
        for method in methods:
            for samples in jobs["samples"]:
                for line in _fits(method, Path(folder), samples, jobs["seeds"], jobs["budget_s"]):
                    say({"method": method.name, "kind": method.kind, "system": method.system, **line})
    return 0


def _fits(method: Method, folder: Path, samples: int, seeds: int, budget_s: float) -> Iterator[dict[str, Any]]:
    """One line for each seed, and one about the rest once the budget is spent or a fit has failed."""
    started = time.perf_counter()
    for seed in range(seeds):
        line: dict[str, Any] = {"samples": samples, "seed": seed}
        try:
            with np.load(folder / f"{method.system}_{samples}_{seed}.npz") as arrays, _at_most(3.0 * budget_s):
                u, y = arrays["u"], arrays["y"]
                if seed == 0:  # compiles, and completes imports
                    few = min(samples, 1000)
                    method.fit(method.prepare(u[:few], y[:few]))
                data = method.prepare(u, y)
                begin, cpu = time.perf_counter(), time.process_time()
                fitted = method.fit(data)
                line |= {"seconds": time.perf_counter() - begin, "cpu_s": time.process_time() - cpu}
                line["model"] = {key: np.asarray(value).tolist() for key, value in method.model(fitted).items()}
        except (Exception, SystemExit) as error:  # a failing method must not stop the others
            yield {**line, "error": f"{type(error).__name__}: {error}", "left": seeds - seed - 1}
            return
        yield line
        spent = time.perf_counter() - started
        if seed + 1 < seeds and spent > budget_s and seed + 1 >= min(LEAST_SEEDS, seeds):
            yield {"samples": samples, "left": seeds - seed - 1}
            return


@contextmanager
def _at_most(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in the block after so many seconds, on systems with the needed signal."""
    if not hasattr(signal, "SIGALRM"):
        yield
        return

    def late(number: int, frame: object) -> None:
        raise TimeoutError(f"a fit took longer than {seconds:g} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def _lines() -> Iterator[Callable[[dict[str, Any]], None]]:
    """A function that prints JSON lines; anything else printed in the block goes to standard error."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        with os.fdopen(os.dup(kept), "w", encoding="utf-8") as out, redirect_stdout(sys.stderr):

            def say(line: dict[str, Any]) -> None:
                out.write(json.dumps(line) + "\n")
                out.flush()

            yield say
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
