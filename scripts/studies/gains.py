"""Gains tuned by `auv-gym tune` compared with gains set by hand, on vehicles and noise unseen in tuning.

    python -m scripts.studies.gains --out gains

"By hand" are the gains with which a search begins: linear-quadratic regulators for a torpedo, placed poles for a
vehicle that hovers. "Least cost" are the gains of the presets, tuned without requirements. "Tuned" are gains tuned with
sensitivity_peak<=2. Each seed draws new vehicles and noise.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from auv_gym.plant import load_vehicle
from controllers.gains import Gains, gains_for
from controllers.tuning.bench import bench_of
from controllers.tuning.requirements import USUAL, parse_requirements
from controllers.tuning.spread import known_intervals
from controllers.tuning.tuning import first_gains, judged, tuned
from scripts.studies.harness import Found, Option, Sheet, Study

SHOWN = ("sensitivity_peak", "overshoot_percent", "rms_error_percent")
CASES = (
    *(f"{vehicle}, {how}" for vehicle in ("npsauv", "remus100") for how in ("by hand", "least cost", "tuned")),
    *(f"bluerov2_heavy, {how}" for how in ("by hand", "tuned")),
)


def attempt(case: str, seed: int, evaluations: int, draws: int) -> dict[str, Any]:
    """Quantities of each loop on all vehicles of a seed, by channel."""
    vehicle, how = case.split(", ")
    plant = load_vehicle(vehicle)
    gains = _gains(vehicle, how, evaluations)
    found = judged(plant, gains, "pid", (), known_intervals(plant), seed, draws=draws)
    return {
        "refused": len(found.refused),
        "loops": {name: {q: found.values(name, q) for q in SHOWN} for name in found.loops},
    }


@lru_cache(maxsize=4)
def _gains(vehicle: str, how: str, evaluations: int) -> Gains:
    plant = load_vehicle(vehicle)
    if how == "least cost":
        return gains_for(vehicle, plant.dt)
    if how == "by hand":
        return first_gains(plant)
    bench = bench_of(plant, 0)
    asked = parse_requirements(USUAL, tuple(bench.trial.steps))
    return tuned(bench, evaluations, lambda share, text: None, requirements=asked)


def sheets(found: Found) -> list[Sheet]:
    rows = []
    for case in found.runs:
        vehicle, how = case.split(", ")
        for name in found.of(case)[0]["loops"]:
            rows.append([vehicle, name, how, *_row([run["loops"][name] for run in found.of(case)])])
    rows.sort(key=lambda row: row[:2])
    heads = ("vehicle", "loop", "gains", "vehicles>", "peak <= 2>", "peak>", "overshoot, %>", "RMS error, %>")
    return [Sheet("gains", "Loops on unseen vehicles: median, and in brackets the worst", heads, rows)]


def _row(runs: list[Mapping[str, Any]]) -> list[str]:
    """The number of vehicles, of those with a peak of 2 or less, and median and worst of each quantity."""
    values = {q: np.array([value for run in runs for value in run[q]], dtype=float) for q in SHOWN}
    peaks = values["sensitivity_peak"]
    cells = [f"{np.median(of):.3g} ({of.max():.3g})" for of in values.values()]
    return [f"{peaks.size}", f"{np.count_nonzero(peaks <= 2.0)}", *cells]


STUDY = Study(
    __doc__ or "",
    attempt,
    CASES,
    sheets,
    seeds=3,
    first_seed=100,
    options={
        "evaluations": Option(25, "trials of each loop in the search", least=1),
        "draws": Option(6, "vehicles drawn for each seed", least=1),
    },
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
