"""Vehicles against models identified from them, in the environment: the same controller, the same seeds.

    python -m scripts.identified_rollouts --seeds 5 --out rollouts

For each vehicle and seed: an experiment in closed loop with noisy sensors and PRBS at the actuators and the set point;
ARMAX, N4SID with refinement and a grey box fitted to it; then an episode of steps with the vehicle, and with each model
in its place. The grey box begins from coefficients that are 15 % off, which run along as "not identified".
A deviation is the root mean square of the model's reading less the vehicle's, in percent of the step.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import radians
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from rich.console import Console
from rich.table import Table

import auv_gym.envs  # noqa: F401  # registers the environments
from auv_gym.channels import channel
from auv_gym.cli.options.console import table
from auv_gym.model import Diverged, Model
from auv_gym.param import replace_at, value_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from auv_gym.writing import replacing
from controllers.autopilots import autopilot
from controllers.composed.excited import Excited
from identification.compare.comparison import ClosedLoop, compare_closed
from identification.experiments.driving import Steps, drive
from identification.experiments.excitation import make_signal
from identification.experiments.manoeuvres import NOISE
from identification.fit.greybox import GreyBox
from identification.linear.polynomials.armax import Armax
from identification.linear.subspaces.n4sid import N4sid
from scripts.over_seeds import all_of

UNKNOWN = "not identified"
METHODS = ("armax", "n4sid", "grey_box")
SHARES = (0.85, 1.15)  # of the true values, in turn, that the grey box begins from
TEST_SEEDS = 1000  # added to a seed, so that an episode's noise is not that of the experiment


@dataclass(frozen=True)
class Scene:
    """A vehicle, the experiment that its models are fitted to, and the task that they are judged by.

    excitation: (amplitude, s of a bit) of a PRBS by actuator or set point, about `held`.  steps: of the task.
    options: of the environment.  guard: settings of the autopilot in the experiment alone.  armax, order: orders of the
    linear models.  free, window: of the grey box.  shown: channels of the figure, the first of which is judged.
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
    shown: tuple[str, ...]
    guard: Mapping[str, Any] = field(default_factory=dict)
    window: float | None = None


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a seed: deviations, percent and in the channel's unit, by model; why others have none; the runs."""

    percent: dict[str, float]
    rmse: dict[str, float]
    failed: dict[str, str]
    vehicle: Record
    runs: dict[str, Record]


def _sensors(**noise: float) -> dict[str, Any]:
    return {"effects": {f"effects.sampling.{sensor}.noise": value for sensor, value in noise.items()}}


_TORPEDO = {**NOISE, "compass": radians(0.5), "depth": 0.02}
SCENES: Mapping[str, Scene] = {
    "npsauv": Scene(
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
        shown=("depth_m", "pitch_rad"),
        guard={"pitch_limit": 0.028},
    ),
    "remus100": Scene(
        env="Heading",
        dt=0.2,
        lengths=(300.0, 120.0),
        excitation={"rudder_rad": (0.08, 1.0), "heading_rad": (0.2, 10.0)},
        held={"heading_rad": 0.0},
        steps={"heading_rad": [(0.0, 0.0), (10.0, radians(20.0)), (60.0, radians(-10.0))]},
        options=_sensors(**_TORPEDO),
        inputs=("rudder_rad",),
        outputs=("r_radps",),  # which the controller reads beside the heading, so that both have to agree
        armax={"n_a": 2, "n_b": 2, "n_c": 2},
        order=2,
        free=("hull.sway.uv", "hull.yaw.uv", "hull.yaw.ur", "parts.rudder.moment"),
        shown=("heading_rad", "r_radps"),
        window=10.0,  # s: its pitch is unstable, and a free run of minutes says nothing of it
    ),
    "slocum": Scene(
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
        shown=("heading_rad",),
    ),
    "qiandao_float": Scene(
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
        shown=("depth_m",),
    ),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run all seeds of the vehicles, print a table, draw a figure for each; 1 if a model has no run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--vehicle", nargs="+", default=list(SCENES), choices=list(SCENES), help="default: all")
    parser.add_argument("--seeds", type=int, default=5, help="experiments with each (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="the first of them (default %(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default %(default)s)")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    parser.add_argument("--out", type=Path, help="folder for the figures (PNG); default: no figures")
    given = parser.parse_args(argv)
    try:
        found = study(given.vehicle, range(given.seed, given.seed + given.seeds), jobs=given.jobs)
        written = [] if given.out is None else [draw(vehicle, of[0], given.out) for vehicle, of in found.items()]
    except (ValueError, OSError, ImportError) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    if given.json:
        print(json.dumps(as_json(found), indent=1))
    else:
        console = Console(highlight=False, width=max(Console().width, 120))
        console.print(_table(found))
        for vehicle, outcomes in found.items():
            for name, reason in {n: r for outcome in outcomes for n, r in outcome.failed.items()}.items():
                console.print(f"{vehicle}, {name}: {reason}", markup=False)
        for path in written:
            console.print(f"Written to {path}", markup=False, soft_wrap=True)
    return int(any(outcome.failed for of in found.values() for outcome in of))


def study(vehicles: Sequence[str], seeds: Sequence[int], *, jobs: int = 1) -> dict[str, list[Outcome]]:
    """What came of each seed, by vehicle."""
    if not seeds or jobs < 1:
        raise ValueError(f"Needed --seeds and --jobs of at least 1, got {len(seeds)} and {jobs}.")
    tasks = [(vehicle, seed) for vehicle in vehicles for seed in seeds]
    found: dict[str, list[Outcome]] = {vehicle: [] for vehicle in vehicles}
    for (vehicle, _), outcome in zip(tasks, all_of(attempt, tasks, jobs, "identifying", "runs"), strict=True):
        found[vehicle].append(outcome)
    return found


def attempt(vehicle: str, seed: int, methods: Sequence[str] = METHODS) -> Outcome:
    """An experiment, the fits, and the runs of one seed."""
    scene = SCENES[vehicle]
    plant = load_vehicle(vehicle, dt=scene.dt)
    record = experiment(scene, plant, np.random.default_rng(seed))
    wrong = off(plant, scene.free)
    models: dict[str, Model] = {}
    failed = {}
    for name in methods:
        try:
            models[name] = _estimator(name, scene, wrong).fit(record).model
        except (ValueError, Diverged) as error:
            failed[name] = str(error)
    done = _compared(scene, plant, {**models, UNKNOWN: wrong}, TEST_SEEDS + seed)
    judged = {name: of[scene.shown[0]] for name, of in done.deviations.items()}
    return Outcome(
        {name: deviation.percent for name, deviation in judged.items()},
        {name: deviation.rmse for name, deviation in judged.items()},
        {**failed, **done.failed},
        done.vehicle.record,
        {name: run.record for name, run in done.runs.items()},
    )


def experiment(scene: Scene, plant: Plant, rng: np.random.Generator) -> Record:
    """The record of a vehicle under its autopilot with excitation added; raises if the episode is cut short."""
    length = scene.lengths[0]
    signals = {
        name: make_signal("prbs", round(length / scene.dt), scene.dt, rng, amplitude=amplitude, clock_s=clock)
        for name, (amplitude, clock) in scene.excitation.items()
    }
    loop = Excited(autopilot(plant, targets=tuple(scene.held), **scene.guard), signals, scene.dt)
    held: Steps = {name: [(0.0, value)] for name, value in scene.held.items()}
    run = drive(_env(scene, plant, length), loop, seed=int(rng.integers(2**31)), targets=held, start=scene.held)
    if run.reason:
        raise ValueError(f"The experiment with {plant.name} was cut short: {run.reason}. Lower its excitation.")
    return run.record


def off(plant: Plant, free: Sequence[str]) -> Plant:
    """A plant whose coefficients are wrong by SHARES in turn."""
    return replace_at(plant, {path: SHARES[i % 2] * value_at(plant, path) for i, path in enumerate(free)})


def as_json(found: Mapping[str, Sequence[Outcome]]) -> dict[str, Any]:
    """Deviations by vehicle and model, of each seed; null where there is none."""
    return {
        vehicle: {
            "channel": SCENES[vehicle].shown[0],
            "models": {
                name: {
                    "percent": [outcome.percent.get(name) for outcome in outcomes],
                    "rmse": [outcome.rmse.get(name) for outcome in outcomes],
                }
                for name in (*METHODS, UNKNOWN)
            },
        }
        for vehicle, outcomes in found.items()
    }


def draw(vehicle: str, outcome: Outcome, folder: Path) -> Path:
    """The runs of one seed over one another; the file written."""
    from matplotlib import rc_context

    from identification.pages.drawing import STYLE
    from identification.pages.model_figures import rollout_figure

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"identified_{vehicle}.png"
    with rc_context(STYLE), replacing(path) as new:
        figure = rollout_figure(outcome.vehicle, outcome.runs, SCENES[vehicle].shown, vehicle)
        figure.savefig(new, format="png", dpi=130, facecolor="white")
    return path


def _env(scene: Scene, plant: Plant, duration: float, model: Model | None = None) -> gymnasium.Env:
    options: dict[str, Any] = dict(scene.options) if model is None else {**scene.options, "model": model}
    return gymnasium.make(f"auv_gym/{scene.env}-v0", vehicle=plant, duration=duration, **options)


def _compared(scene: Scene, plant: Plant, models: Mapping[str, Model], seed: int) -> ClosedLoop:
    return compare_closed(
        lambda model: _env(scene, plant, scene.lengths[1], model),
        autopilot(plant, targets=tuple(scene.held)),
        models,
        seed=seed,
        targets=scene.steps,
        start=scene.held,
    )


def _estimator(name: str, scene: Scene, wrong: Plant) -> Any:
    if name == "grey_box":
        return GreyBox(wrong, scene.free, window=scene.window)
    if name == "armax":
        return Armax(scene.inputs, scene.outputs, **scene.armax)
    return N4sid(scene.inputs, scene.outputs, order=scene.order, refine=True)


def _table(found: Mapping[str, Sequence[Outcome]]) -> Table:
    shown = table(
        "Deviation of models from the vehicle in the environment, root mean square",
        "vehicle",
        "channel",
        "model",
        "seeds>",
        "median, % of the step>",
        "range, %>",
        "median>",
    )
    for vehicle, outcomes in found.items():
        first = SCENES[vehicle].shown[0]
        for name in (*METHODS, UNKNOWN):
            percent = [outcome.percent[name] for outcome in outcomes if name in outcome.percent]
            rmse = [outcome.rmse[name] for outcome in outcomes if name in outcome.rmse]
            if not percent:
                shown.add_row(vehicle, channel(first).label, name, "0", "", "", "")
                continue
            angle = channel(first).unit == "rad"
            middle = f"{np.degrees(np.median(rmse)):.3f} deg" if angle else f"{np.median(rmse):.3f} m"
            spread = f"{min(percent):.2f} to {max(percent):.2f}"
            row = (vehicle, channel(first).label, name, str(len(percent)), f"{np.median(percent):.2f}", spread, middle)
            shown.add_row(*row)
    return shown


if __name__ == "__main__":
    sys.exit(main())
