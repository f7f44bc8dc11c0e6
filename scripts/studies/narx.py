"""Where a nonlinear black box pays: free runs of NARX LS-SVM, ARX and ARMAX over records of five systems.

    python -m scripts.studies.narx --seeds 3 --jobs 2 --out narx

Each seed gives one record to fit and another without noise for the free runs. All models have the same inputs and
outputs. The number in a method's name is n_a. "One step" means tuned by leave-one-out errors instead of free runs.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import radians
from typing import Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.model import Diverged
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.compare.comparison import compare_open
from identification.estimator import make_estimator
from identification.experiments.float_dives import depth_control
from identification.experiments.heading_control import closed_loop
from identification.experiments.manoeuvres import steer
from scripts.studies.harness import Found, Sheet, Study

METHODS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "ARX 2": ("arx", {"n_a": 2, "n_b": 2}),
    "ARX 4": ("arx", {"n_a": 4, "n_b": 3}),
    "ARMAX 3": ("armax", {"n_a": 3, "n_b": 2, "n_c": 2}),
    "NARX 2": ("narx_ls_svm", {"n_a": 2, "n_b": 2}),
    "NARX 4": ("narx_ls_svm", {"n_a": 4, "n_b": 3}),
    "NARX 4, one step": ("narx_ls_svm", {"n_a": 4, "n_b": 3, "tuning": "leave_one_out"}),
}
TOY_NOISE = 0.05  # rad/s; the outputs span 2 rad/s


@dataclass(frozen=True)
class Case:
    """A system: record(seed, noisy), and the fitted channels.  window: s, of free runs; None: whole records."""

    name: str
    record: Callable[[int, bool], Record]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    integrating: tuple[str, ...] = ()
    window: float | None = None


def glider(seed: int, noisy: bool, damping: float) -> Record:
    """Half an hour of a Slocum under heading control, with quadratic yaw damping, N m s^2."""
    plant = replace_at(load_vehicle("slocum"), "effects.yaw.quadratic_damping", damping)
    noise = radians(0.5) if noisy else 0.0
    return closed_loop(plant, rng=np.random.default_rng(seed), duration=1800.0, compass_noise=noise, track_noise=None)


def torpedo(seed: int, noisy: bool) -> Record:
    """Ten minutes of NPS AUV II under steps of heading, depth and speed, at 1 s; pitch always has its noise."""
    heading, depth = (radians(0.5), 0.02) if noisy else (0.0, 0.0)
    rng = np.random.default_rng(seed)
    record = steer(load_vehicle("npsauv"), rng=rng, duration=600.0, compass_noise=heading, depth_noise=depth)
    return record.resample(1.0)


def piston_float(seed: int, noisy: bool) -> Record:
    """An hour of a profiling float that holds six depths, evenly sampled."""
    plant = load_vehicle("qiandao_float")
    rng, targets = np.random.default_rng(seed), [30.0, 10.0, 40.0, 20.0, 35.0, 15.0]
    return depth_control(plant, targets, rng=rng, noise=0.02 if noisy else 0.0, near=(0.0, plant.dt))


def toy(seed: int, noisy: bool, samples: int = 1500) -> Record:
    """A second-order lag with a saturating input, a product of input and output, and a square."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, samples // 5 + 1), 5)[:samples]
    y = np.zeros(samples)
    for k in range(2, samples):
        driven = 0.1 * np.tanh(2.0 * u[k - 1]) + 0.05 * y[k - 1] * u[k - 1] + 0.03 * u[k - 2] ** 2
        y[k] = 1.4 * y[k - 1] - 0.5 * y[k - 2] + driven
    measured = y + (TOY_NOISE * rng.standard_normal(samples) if noisy else 0.0)
    return Record.from_arrays(0.5 * np.arange(samples), {"rudder_rad": u, "r_radps": measured})


_HEADING = ("rudder_rad", "u_mps"), ("heading_rad",), ("heading_rad",)
_PLANES = ("stern_plane_rad", "rudder_rad", "propeller_rpm"), ("depth_m", "pitch_rad"), ("depth_m",)
SYSTEMS = (
    Case("linear glider", lambda seed, noisy: glider(seed, noisy, 0.0), *_HEADING),
    Case("glider", lambda seed, noisy: glider(seed, noisy, 400.0), *_HEADING),
    Case("torpedo", torpedo, *_PLANES, window=100.0),
    Case("float", piston_float, ("piston_m",), ("depth_m",), ("depth_m",)),
    Case("toy", toy, ("rudder_rad",), ("r_radps",)),
)
NOISY = ", noisy"  # at the end of a case's name
CASES = {f"{case.name}{noise}": case for case in SYSTEMS for noise in ("", NOISY)}


def attempt(case: str, seed: int) -> dict[str, dict[str, float]]:
    """Fit of free runs in percent by method and output; minus infinity for a failed method."""
    of = CASES[case]
    train, held = of.record(seed, case.endswith(NOISY)), of.record(1000 + seed, False)
    found = {}
    for name, (method, settings) in METHODS.items():
        given = {**settings, "integrating": of.integrating}
        try:
            fit = make_estimator(method, given, inputs=of.inputs, outputs=of.outputs).fit(train)
            scores = compare_open({"model": fit.model}, held, window=of.window).scores.get("model")
        except (ValueError, Diverged):
            scores = None
        found[name] = {c: scores[c].fit_percent if scores else -np.inf for c in of.outputs}
    return found


def sheets(found: Found) -> list[Sheet]:
    """A row for each case and output."""
    rows, every = [], []
    for case, runs in found.runs.items():
        of = CASES[case]
        for output in of.outputs:
            row = [of.name, channel(output).label, "yes" if case.endswith(NOISY) else "no"]
            for method in next(iter(runs.values())):
                fits = [run[method][output] for run in runs.values()]
                every += [[*row, method, str(seed), f"{fit:.3f}"] for seed, fit in zip(runs, fits, strict=True)]
                row.append(f"{np.median(fits):.1f} ({min(fits):.0f})" if np.isfinite(fits).any() else "none")
            rows.append(row)
    title = "Free runs over data without noise, fit in %: median, and least"
    heads = ("system", "output", "noise")
    return [
        Sheet("fits", title, (*(f"{head}!" for head in heads), *(f"{method}>" for method in METHODS)), rows),
        Sheet("seeds", "Every fit, %", (*heads, "method", "seed", "fit"), every, printed=False),
    ]


STUDY = Study(__doc__ or "", attempt, tuple(CASES), sheets, seeds=3, doing="records")

if __name__ == "__main__":
    sys.exit(STUDY.main())
