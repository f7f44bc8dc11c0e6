"""Speed of the recursions for a float's diving model, over a record and sample by sample."""

from __future__ import annotations

import argparse
import time

import numpy as np

from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.recursive.corrected_ivls import CorrectedIvls
from identification.recursive.ivls import Ivls
from identification.recursive.rwls import Rwls
from scripts.benchmarks.rollout import in_plain_python
from scripts.reproduce.float.consistency import diving_form, long_dive

METHODS = {"rwls": Rwls(), "ivls": Ivls(), "corrected_ivls": CorrectedIvls()}
# number of passes of `fit` over the record; the corrected one starts with a pass of least squares
PASSES = {"rwls": 1, "ivls": 1, "corrected_ivls": 1 + METHODS["corrected_ivls"].passes}
RATED = "rwls_updates_per_s"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this benchmark."""
    parser.add_argument("--samples", type=int, default=100_000, help="samples of the record (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=5, help="runs of which the fastest counts (default: 5)")
    parser.add_argument("--alone", action="store_true", help="time this process only, without a ratio")


def measure(arguments: argparse.Namespace) -> dict[str, float]:
    """Updates per second by `fit`, with all that it does, and by `update`, and the ratio to plain Python."""
    if arguments.samples < 100 or arguments.repeats < 1:
        raise ValueError(
            f"--samples needs 100 or more and --repeats 1 or more, got {arguments.samples} and {arguments.repeats}."
        )
    compiled = _rates(arguments.samples, arguments.repeats)
    if arguments.alone:
        return compiled
    plain = in_plain_python("recursion", "--samples", "400", "--repeats", str(min(arguments.repeats, 3)))
    return {"plain_over_compiled": compiled[RATED] / plain[RATED], **compiled}


def _rates(samples: int, repeats: int) -> dict[str, float]:
    """Rates of each method; every round runs each method once."""
    plant, rng = load_vehicle("qiandao_float"), np.random.default_rng(0)
    # without noise, since the printed IVLS might end early with it
    record = long_dive(plant, diving_form(plant), samples, 0.0, rng, feedback=False)
    short = record.select(np.arange(len(record)) < 5000)
    over, single = dict.fromkeys(METHODS, 0.0), dict.fromkeys(METHODS, 0.0)
    for estimator in METHODS.values():  # compiles
        estimator.fit(short)
        _update_all(estimator, short.select(np.arange(len(short)) < 3))
    for _ in range(repeats):
        for name, estimator in METHODS.items():
            start = time.perf_counter()
            estimator.fit(record)
            over[name] = max(over[name], PASSES[name] * len(record) / (time.perf_counter() - start))
            start = time.perf_counter()
            _update_all(estimator, short)
            single[name] = max(single[name], len(short) / (time.perf_counter() - start))
    rates = {f"{name}_updates_per_s": rate for name, rate in over.items()}
    return rates | {f"{name}_sample_by_sample_updates_per_s": rate for name, rate in single.items()}


def _update_all(estimator: Rwls | Ivls | CorrectedIvls, record: Record) -> None:
    depth, piston, interval = record["depth_m"], record["piston_m"], np.diff(record.time, prepend=record.time[0])
    memory = estimator.start()
    for k in range(len(record)):
        memory = estimator.update(memory, depth[k], piston[max(k - 1, 0)], interval[k])
