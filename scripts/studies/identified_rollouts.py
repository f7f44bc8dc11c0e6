"""Vehicles compared with models identified from them, in the environment, with the same controller and seeds.

    python -m scripts.studies.identified_rollouts --seeds 5 --jobs 2 --out rollouts

For each vehicle and seed there is an experiment in closed loop, with noisy sensors and PRBS at the actuators and the
set point. ARMAX, refined N4SID and a grey box are fitted to it. Then the vehicle, and each model in its place, runs
through an episode of steps. The grey box begins from coefficients that are 15 % off; these also run, as "not
identified". A deviation is the RMS of the model's reading minus the vehicle's, in percent of the step.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import radians
from typing import Any

import gymnasium
import numpy as np

import auv_gym.envs  # noqa: F401  # registers the environments
from auv_gym.channels import channel
from auv_gym.model import Diverged, Model
from auv_gym.param import replace_at, value_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from controllers.autopilots import autopilot
from controllers.composed.excited import Excited
from identification.compare.closed_loop import ClosedLoop, compare_closed
from identification.experiments.driving import Steps, drive
from identification.experiments.excitation import make_signal
from identification.experiments.manoeuvres import NOISE
from identification.fit.greybox import GreyBox
from identification.linear.polynomials.armax import Armax
from identification.linear.subspaces.n4sid import N4sid
from scripts.studies.harness import Found, Sheet, Study

UNKNOWN = "not identified"
METHODS = ("armax", "n4sid", "grey_box")
SHARES = (0.85, 1.15)  # initial values of the grey box over the true ones, alternating
TEST_SEEDS = 1000  # added to a seed, so that an episode's noise differs from the experiment's


@dataclass(frozen=True)
class Task:
    """A vehicle, the experiment that its models are fitted to, and the task that they are judged by.

    excitation: (amplitude, s of a bit) of a PRBS by actuator or set point, about `held`.  steps: of the task.
    options: of the environment.  guard: settings of the autopilot in the experiment alone.  armax, order: orders of the
    linear models.  free, window: of the grey box.  judged: the judged channel.
    """

    env: str
    dt: float
    lengths: tuple[float, float]
    excitation: Mapping[str, tuple[float, float]]
    held: Mapping[str, float]
    steps: Steps
    options: Mapping[str, Any]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    armax: Mapping[str, Any]
    order: int
    free: tuple[str, ...]
    judged: str
    guard: Mapping[str, Any] = field(default_factory=dict)
    window: float | None = None


def _sensors(**noise: float) -> dict[str, Any]:
    return {"effects": {f"effects.sampling.{sensor}.noise": value for sensor, value in noise.items()}}


_TORPEDO = {**NOISE, "compass": radians(0.5), "depth": 0.02}
TASKS: Mapping[str, Task] = {
    "npsauv": Task(
        env="Depth",
        dt=4.0,
        lengths=(800.0, 400.0),
        excitation={"stern_plane_rad": (0.032, 20.0), "bow_plane_rad": (0.032, 12.0), "depth_m": (6.0, 100.0)},
        held={"depth_m": 50.0},
        steps={"depth_m": [(0.0, 50.0), (40.0, 55.0), (220.0, 45.0)]},
        options=_sensors(**_TORPEDO),
        inputs=("bow_plane_rad", "stern_plane_rad"),
        outputs=("depth_m", "pitch_rad"),
        armax={"n_a": [3, 4], "n_b": 2, "n_c": 2, "integrating": ("depth_m",)},
        order=5,
        free=(
            "hull.heave.uw",
            "hull.heave.uq",
            "hull.pitch.uw",
            "hull.pitch.uq",
            "parts.stern_plane.moment",
            "parts.bow_plane.moment",
        ),
        judged="depth_m",
        guard={"pitch_limit": 0.028},
    ),
    "remus100": Task(
        env="Heading",
        dt=0.2,
        lengths=(300.0, 120.0),
        excitation={"rudder_rad": (0.08, 1.0), "heading_rad": (0.2, 10.0)},
        held={"heading_rad": 0.0},
        steps={"heading_rad": [(0.0, 0.0), (10.0, radians(20.0)), (60.0, radians(-10.0))]},
        options=_sensors(**_TORPEDO),
        inputs=("rudder_rad",),
        outputs=("r_radps",),  # the controller reads it beside the heading, so both have to agree
        armax={"n_a": 2, "n_b": 2, "n_c": 2},
        order=2,
        free=("hull.sway.uv", "hull.yaw.uv", "hull.yaw.ur", "parts.rudder.moment"),
        judged="heading_rad",
        window=10.0,  # s: its pitch is unstable, so a free run of minutes is useless
    ),
    "slocum": Task(
        env="GliderHeading",
        dt=4.0,
        lengths=(2400.0, 800.0),
        excitation={"rudder_rad": (0.15, 16.0), "heading_rad": (0.3, 120.0)},
        held={"heading_rad": 0.0},
        steps={"heading_rad": [(0.0, 0.0), (40.0, radians(30.0)), (400.0, radians(-10.0))]},
        options={"compass_noise": radians(0.5)},
        inputs=("rudder_rad",),
        outputs=("heading_rad",),
        armax={"n_a": 2, "n_b": 2, "n_c": 2, "integrating": ("heading_rad",)},
        order=2,
        free=("hull.n_r", "hull.n_delta"),
        judged="heading_rad",
    ),
    "qiandao_float": Task(
        env="FloatDepth",
        dt=0.7,
        lengths=(2100.0, 700.0),
        excitation={"piston_m": (0.03, 14.0), "depth_m": (4.0, 140.0)},
        held={"depth_m": 20.0},
        steps={"depth_m": [(0.0, 20.0), (40.0, 25.0), (350.0, 20.0)]},
        options={**_sensors(depth=0.02), "randomise": {}},
        inputs=("piston_m",),
        outputs=("depth_m",),
        armax={"n_a": 3, "n_b": 3, "n_c": 3, "integrating": ("depth_m",)},
        order=3,
        free=("hull.drag_quadratic", "hull.drag_linear"),
        judged="depth_m",
    ),
}


def attempt(vehicle: str, seed: int, methods: Sequence[str] = METHODS) -> dict[str, Any]:
    """Deviations of one seed by model, in percent of the step and in the channel's unit, and reasons of failures."""
    done, failed = compared(vehicle, seed, methods)
    judged = {name: of[TASKS[vehicle].judged] for name, of in done.deviations.items()}
    return {
        "percent": {name: deviation.percent for name, deviation in judged.items()},
        "rmse": {name: deviation.rmse for name, deviation in judged.items()},
        "failed": {**failed, **done.failed},
    }


def compared(vehicle: str, seed: int, methods: Sequence[str] = METHODS) -> tuple[ClosedLoop, dict[str, str]]:
    """An experiment, the fits, and the episodes of one seed; reasons of failed fits, by method."""
    task = TASKS[vehicle]
    plant = load_vehicle(vehicle, dt=task.dt)
    record = experiment(task, plant, np.random.default_rng(seed))
    wrong = off(plant, task.free, SHARES)
    models: dict[str, Model] = {}
    failed = {}
    for name in methods:
        try:
            models[name] = _estimator(name, task, wrong).fit(record).model
        except (ValueError, Diverged) as error:
            failed[name] = str(error)
    done = compare_closed(
        lambda model: _env(task, plant, task.lengths[1], model),
        autopilot(plant, targets=tuple(task.held)),
        {**models, UNKNOWN: wrong},
        seed=TEST_SEEDS + seed,
        targets=task.steps,
        start=task.held,
    )
    return done, failed


def experiment(task: Task, plant: Plant, rng: np.random.Generator) -> Record:
    """The record of a vehicle under its autopilot with excitation added; raises if the episode ends early."""
    length = task.lengths[0]
    signals = {
        name: make_signal("prbs", round(length / task.dt), task.dt, rng, amplitude=amplitude, clock_s=clock)
        for name, (amplitude, clock) in task.excitation.items()
    }
    loop = Excited(autopilot(plant, targets=tuple(task.held), **task.guard), signals, task.dt)
    held: Steps = {name: [(0.0, value)] for name, value in task.held.items()}
    run = drive(_env(task, plant, length), loop, seed=int(rng.integers(2**31)), targets=held, start=task.held)
    if run.reason:
        raise ValueError(f"The experiment with {plant.name} was cut short: {run.reason}. Lower its excitation.")
    return run.record


def off(plant: Plant, paths: Sequence[str], shares: tuple[float, float]) -> Plant:
    """A plant whose coefficients are wrong by these shares, alternating."""
    return replace_at(plant, {path: shares[i % 2] * value_at(plant, path) for i, path in enumerate(paths)})


def _env(task: Task, plant: Plant, duration: float, model: Model | None = None) -> gymnasium.Env:
    options: dict[str, Any] = dict(task.options) if model is None else {**task.options, "model": model}
    return gymnasium.make(f"auv_gym/{task.env}-v0", vehicle=plant, duration=duration, **options)


def _estimator(name: str, task: Task, wrong: Plant) -> Any:
    if name == "grey_box":
        return GreyBox(wrong, task.free, window=task.window)
    if name == "armax":
        return Armax(task.inputs, task.outputs, **task.armax)
    return N4sid(task.inputs, task.outputs, order=task.order, refine=True)


def sheets(found: Found) -> list[Sheet]:
    """A row for each vehicle and model; in a file, every seed."""
    rows, every = [], []
    for vehicle, runs in found.runs.items():
        judged = channel(TASKS[vehicle].judged)
        for name in (*METHODS, UNKNOWN):
            done = {seed: run for seed, run in runs.items() if name in run["percent"]}
            percent, rmse = ([run[what][name] for run in done.values()] for what in ("percent", "rmse"))
            row = [vehicle, judged.label, name, str(len(done)), "", "", ""]
            if done:
                middle = np.degrees(np.median(rmse)) if judged.angle else np.median(rmse)
                row[4:6] = f"{np.median(percent):.2f}", f"{min(percent):.2f} to {max(percent):.2f}"
                row[6] = f"{middle:.3f} {'deg' if judged.angle else 'm'}"
            rows.append(row)
            every += [[*row[:3], str(seed), f"{p:.6g}", f"{r:.6g}"] for seed, p, r in zip(done, percent, rmse)]
    heads = ("vehicle", "channel", "model", "seeds>", "median, % of the step>", "range, %>", "median>")
    title = "Deviation of models from the vehicle in the environment, RMS"
    own = ("vehicle", "channel", "model", "seed", "percent", "rmse")
    return [Sheet("deviations", title, heads, rows), Sheet("seeds", "Every seed", own, every, printed=False)]


def failures(found: Found) -> list[str]:
    """Why models have no run, each reason once."""
    reasons = [
        f"{vehicle}, {name}: {reason}"
        for vehicle, runs in found.runs.items()
        for run in runs.values()
        for name, reason in run["failed"].items()
    ]
    return list(dict.fromkeys(reasons))


STUDY = Study(
    __doc__ or "",
    attempt,
    tuple(TASKS),
    sheets,
    seeds=5,
    one_of="vehicle",
    remarks=failures,
    good=lambda found: not failures(found),
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
