"""This project's own kernel machines."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from identification.kernel_machines import fixed_size, regression
from identification.kernel_machines.fixed_size import FixedSize
from identification.kernel_machines.machine import KernelMachine
from identification.kernel_machines.regression import LsSvmRegression
from identification.kernel_machines.tuning.sweep import sweep, sweep_each
from identification.kernel_machines.tuning.tuning import Tuned, anneal, descend, descend_each
from scripts.benchmarks.peers.kernel_runner import Method, main

Learnt = tuple[tuple[KernelMachine, ...], dict[str, Any]]
Jobs = Mapping[str, Any]


def _full(x: np.ndarray, y: np.ndarray, jobs: Jobs) -> Learnt:
    return (LsSvmRegression(jobs["penalty"], jobs["sigma"]).fit(x, y),), {}


def _fixed(x: np.ndarray, y: np.ndarray, jobs: Jobs) -> Learnt:
    return (FixedSize(jobs["penalty"], jobs["sigma"], jobs["size"]).fit(x, y),), {}


def _tuned(search: Callable[..., Tuned[Any]], settings: Any, **options: Any) -> Callable[..., Learnt]:
    def learn(x: np.ndarray, y: np.ndarray, jobs: Jobs) -> Learnt:
        found = search(settings(jobs), x, y, **options)
        return (found.settings.fit(x, y),), {"loss": found.loss, "solved": found.evaluations}

    return learn


def _each(
    search: Callable[..., tuple[Tuned[Any], ...]], fit: Callable[..., Any], settings: Any
) -> Callable[..., Learnt]:
    def learn(x: np.ndarray, y: np.ndarray, jobs: Jobs) -> Learnt:
        found = search(settings(jobs), x, y)
        loss = float(np.mean([one.loss for one in found]))
        return fit([one.settings for one in found], x, y), {
            "loss": loss,
            "solved": sum(one.evaluations for one in found),
        }

    return learn


def _annealed(x: np.ndarray, y: np.ndarray, jobs: Jobs) -> Learnt:
    """Annealing with as many evaluations as fit into the time of a descent."""
    begin = time.perf_counter()
    descend(LsSvmRegression(), x, y)
    allowed = time.perf_counter() - begin
    begin = time.perf_counter()
    LsSvmRegression(jobs["penalty"], jobs["sigma"]).fit(x, y)
    count = max(1, round(allowed / (time.perf_counter() - begin)))
    begin = time.perf_counter()
    learnt, told = _tuned(anneal, _plain, rng=np.random.default_rng(0), evaluations=count)(x, y, jobs)
    return learnt, {**told, "learn_s": time.perf_counter() - begin, "cpu_s": None}


def _plain(jobs: Jobs) -> LsSvmRegression:
    return LsSvmRegression()


def _sized(jobs: Jobs) -> FixedSize:
    return FixedSize(size=jobs["size"])


def _predict(machines: tuple[KernelMachine, ...], x: np.ndarray) -> np.ndarray:
    return machines[0](x) if len(machines) == 1 else np.column_stack([machine(x) for machine in machines])


METHODS = (
    Method("machines", "LsSvmRegression", _full, _predict),
    Method("machines", "FixedSize", _fixed, _predict),
    Method("tuning", "descend, all outputs together", _tuned(descend, _plain), _predict),
    Method("tuning", "descend_each, every output", _each(descend_each, regression.fit_each, _plain), _predict),
    Method("tuning", "anneal, as long as descend", _annealed, _predict),
    Method("long", "FixedSize", _fixed, _predict),
    Method("long", "FixedSize, sweep", _tuned(sweep, _sized), _predict),
    Method("long", "FixedSize, sweep_each", _each(sweep_each, fixed_size.fit_each, _sized), _predict),
)

if __name__ == "__main__":
    raise SystemExit(main(METHODS))
