"""LS-SVM models of the torpedo AUV's hull: learned from bang-bang runs, flown beside the vehicle.

    python -m scripts.reproduce.ls_svm --seeds 5 --out ls_svm                      some 3 min
    python -m scripts.reproduce.ls_svm --seeds 20 --case '*' --jobs 2 --out all    some 60 min

Models are learned from bang-bang fins of 8 deg from rest, at 4 V and at 3 to 5 V. They are tested in circles with dives
at 3.5 and 4.5 V with fins of 5 and 10 deg, and under S-plane control of speed, heading and depth. The cases called
noisy compare them with models of other kinds, from the same noisy records.

Source: Xu, Zou, Yin and Cao 2013, Ocean Engineering 67, pages 68-76: table 3 and figures 9 to 16.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from auv_gym.model import Model, simulate
from auv_gym.plant import Plant
from identification.experiments.driving import Run
from identification.kernel_machines.hull.hull import HullFit, HullLsSvm
from scripts.reproduce.ls_svm.experiments import MANOEUVRES, Judgement, bang_bang_runs, circled, judged, vehicle
from scripts.reproduce.ls_svm.pictures import circles_figure
from scripts.reproduce.ls_svm.surrogates import DATA, STEP, judged_methods
from scripts.reproduce.ls_svm.tables import circles, control, noisy, tuned
from scripts.reproduce.s_plane import CASES, Case, controlled_run
from scripts.studies.harness import Found, Sheet, Study

RUNS = 40  # of a minute, without noise
TUNED, TREND, EACH, NOISY = "LS-SVM", "LS-SVM with a trend", "LS-SVM, each axis", "noisy"
WAYS: Mapping[str, Mapping[str, Any]] = {  # C and sigma beside the trend: chosen by the manoeuvres, seeds 0 to 3
    TUNED: {},
    TREND: {"trend": True, "size": 256, "penalty": 1e4, "sigma": 12.0},
    EACH: {"separate": True},
}


@dataclass(frozen=True)
class Controlled:
    """RMS difference of a model's run under control from the vehicle's.

    percent: of the largest step of the target.  value: in the channel's unit.
    """

    percent: float
    value: float


@dataclass(frozen=True, eq=False)
class Learned:
    """A fit, and the quality of its model: judgements by manoeuvre, differences under control by case."""

    fit: HullFit
    circles: tuple[Judgement, ...]
    control: tuple[Controlled, ...]


@cache
def learned(data: str, way: str, seed: int) -> Learned:
    """The vehicle learned from noise-free runs, and judged."""
    plant = replace(vehicle(), longest_step=STEP)
    fit = HullLsSvm(plant, **WAYS[way]).fit(*bang_bang_runs(DATA[data], seed, runs=RUNS))
    circles = tuple(judged(circled(one), simulate(fit.model, circled(one)), fit.model) for one in MANOEUVRES)
    control = tuple(compared(case, steered(case), steered(case, fit.model)) for case in CASES)
    return Learned(fit, circles, control)


def steered(case: Case, model: Model | None = None) -> Run:
    """The run of a case by S-plane, without current and noise; raises if it ended early."""
    run = controlled_run(case, "s_plane", None, model)
    if run.reason:
        raise ValueError(f"The run of {case.title} was cut short: {run.reason}.")
    return run


def compared(case: Case, own: Run, model: Run) -> Controlled:
    """The difference of two runs of a case, in the true motion."""
    values = [case.first, *(value for _, value in case.steps)]
    step = float(np.abs(np.diff(values)).max())
    rms = float(np.sqrt(np.mean((model.truth[case.channel] - own.truth[case.channel]) ** 2)))
    return Controlled(100.0 * rms / step, rms)


def attempt(case: str, seed: int) -> Any:
    """The model learned by a method from the data of a seed; for noisy records, a row for each method and manoeuvre."""
    data, way = RUNS_BY_NAME[case]
    if way == NOISY:
        return judged_methods(data, seed)
    found = learned(data, way, seed)
    settings = [{"penalty": one.penalty, "sigma": one.sigma} for one in found.fit.settings]
    return {
        "settings": settings,
        "shares": found.fit.shares,
        "circles": [asdict(one) for one in found.circles],
        "control": [asdict(one) for one in found.control],
    }


RUNS_BY_NAME = {f"{data}, {way}": (data, way) for way in (*WAYS, NOISY) for data in DATA}
USUAL = [*(f"{data}, {way}" for data in DATA for way in (TUNED, TREND)), f"{next(iter(DATA))}, {EACH}"]


def _by_data(found: Found, *ways: str) -> dict[tuple[str, str], list[Any]]:
    by_data = {RUNS_BY_NAME[case]: found.of(case) for case in found.runs}
    return {(data, way): by_data[data, way] for data in DATA for way in ways if (data, way) in by_data}


def sheets(found: Found) -> list[Sheet]:
    """Table 3 of the paper beside ours, circles, control, and models from noisy records."""
    clean, rows = _by_data(found, TUNED, TREND), _by_data(found, NOISY)
    first = next(iter(DATA))
    both = [_by_data(found, way).get((first, way)) for way in (TUNED, EACH)]
    shown = [tuned(both[0][0], both[1][0])] if both[0] and both[1] else []
    shown += [circles(clean), control(clean)] if clean else []
    return shown + (
        [noisy({data: [row for run in runs for row in run] for (data, _), runs in rows.items()})] if rows else []
    )


def failures(found: Found) -> list[str]:
    """Methods that failed on noisy records, with the number of failures."""
    rows = [row for case in found.runs if RUNS_BY_NAME[case][1] == NOISY for run in found.of(case) for row in run]
    failed = Counter(f"{r['data']}, {r['method']}: {r['failed']}" for r in rows if "failed" in r)
    return [f"{reason}: {count} times" for reason, count in failed.items()]


def pictures(found: Found) -> dict[str, Any]:
    """The circles with the model of the first seed."""
    seed = min(min(runs) for runs in found.runs.values())
    what = f"from bang-bang fins at 4 V, seed {seed}"

    def model() -> Plant:
        return learned("4 V", TUNED, seed).fit.model

    return {
        "ls_svm_circles.png": lambda: circles_figure(
            model(), [(circled(one), simulate(model(), circled(one))) for one in MANOEUVRES], what
        ),
    }


STUDY = Study(
    __doc__ or "",
    attempt,
    tuple(RUNS_BY_NAME),
    sheets,
    seeds=5,
    usual=USUAL,
    remarks=failures,
    pictures=pictures,
    doing="fits",
)
