"""What the study of the torpedo AUV finds: tuned machines, circles and dives, control, and noisy records."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from auv_gym.model import simulate
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.experiments.driving import Run
from identification.kernel_machines.hull.hull import HullFit, HullLsSvm
from scripts.ls_svm.control import CASES, Controlled, compared, steered
from scripts.ls_svm.experiments import MANOEUVRES, Judgement, bang_bang_runs, circled, judged, vehicle
from scripts.ls_svm.surrogates import DATA, STEP
from scripts.over_seeds import all_of

RUNS = 40  # of a minute, without noise
TUNED, TREND = "LS-SVM", "LS-SVM with a trend"
WAYS: dict[str, dict[str, Any]] = {  # C and sigma beside the trend: chosen by the manoeuvres themselves, seeds 0 to 3
    TUNED: {},
    TREND: {"trend": True, "size": 256, "penalty": 1e4, "sigma": 12.0},
}
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")


@dataclass(frozen=True, eq=False)
class Learned:
    """A fit, and how its model does: judgements by manoeuvre, differences under control by case."""

    fit: HullFit
    circles: tuple[Judgement, ...]
    control: tuple[Controlled, ...]

    @property
    def model(self) -> Plant:
        return self.fit.model


def learned(data: str, seed: int, **options: Any) -> Learned:
    """The vehicle learned from noise-free runs, and judged; options: of `HullLsSvm`."""
    plant = replace(vehicle(), longest_step=STEP)
    fit = HullLsSvm(plant, **options).fit(*bang_bang_runs(DATA[data], seed, runs=RUNS))
    circles = tuple(judged(circled(one), simulate(fit.model, circled(one)), fit.model) for one in MANOEUVRES)
    control = tuple(compared(case, steered(case), steered(case, fit.model)) for case in CASES)
    return Learned(fit, circles, control)


def figures_of(data: str, way: str, seed: int) -> dict:
    """The numbers of one seed, for a table over many."""
    found = learned(data, seed, **WAYS[way])
    settings = found.fit.settings[0]
    return {
        "data": data,
        "method": way,
        "seed": seed,
        "penalty": settings.penalty,
        "sigma": settings.sigma,
        "circles": [{key: float(value) for key, value in asdict(one).items()} for one in found.circles],
        "control": [asdict(one) for one in found.control],
    }


def over_seeds(data: Iterable[str], seeds: Sequence[int], jobs: int) -> list[dict]:
    """The numbers of many seeds."""
    return all_of(
        figures_of, [(name, way, seed) for name in data for way in WAYS for seed in seeds], jobs, "learning", "fits"
    )


def noisy(work: Callable[[str, int], list[dict]], seeds: Sequence[int], jobs: int) -> list[dict]:
    """The rows of all methods over noisy records of many seeds."""
    tasks = [(name, seed) for name in DATA for seed in seeds]
    return [row for rows in all_of(work, tasks, jobs, "identifying", "experiments") for row in rows]


def flights(model: Plant) -> tuple[list[tuple[Record, Record]], list[tuple[Run, Run]]]:
    """Runs of the vehicle and of a model, of each manoeuvre and each case of control."""
    circles = [(circled(one), simulate(model, circled(one))) for one in MANOEUVRES]
    return circles, [(steered(case), steered(case, model)) for case in CASES]


def share_within(values: Sequence[float], limit: float) -> str:
    """How many are within a limit, in words."""
    return f"{int(np.sum(np.asarray(values) <= limit))} of {len(values)}"
