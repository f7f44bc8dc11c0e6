"""The control case of Xu et al. 2013 on `heu_torpedo`: surge, heading and depth under S-plane, PID and GPC.

    python -m scripts.reproduce.s_plane --seeds 20 --jobs 2 --out s_plane

Surge goes from rest to 1.5 m/s; heading to 50 deg for 40 s, then back to 0; depth from 5 m to 10 m for 40 s, then back
to 5 m. The last two are at the speed of 3.5 V. In each run the same autopilot holds the other two channels. Every seed
draws a current, and noise for all sensors, the same for the three controllers. Errors are those of the true motion.

Source: Xu, Zou, Yin and Cao 2013, Ocean Engineering 67, section 5.3, table 4, figures 11 to 16.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from math import isfinite, pi, radians
from typing import Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.envs.task_env import TaskEnv
from auv_gym.model import Model
from auv_gym.param import replace_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.cruise import find_cruise
from controllers.autopilots import autopilot
from controllers.trials.settling import Step, step_response
from identification.experiments.driving import Run, drive
from scripts.studies.harness import Found, Sheet, Study

VEHICLE = "heu_torpedo"
VOLTAGE = 3.5  # V, of the runs in heading and depth
CONTROLLERS = {"S-plane": "s_plane", "PID": "pid", "GPC": "gpc"}
CURRENT, UPDRAUGHT = 0.2, 0.03  # m/s, largest current drawn, horizontal and vertical
NOISE = {  # standard deviations of the sensors
    "depth": 0.02,  # m
    "compass": radians(0.5),
    "inclinometer": radians(0.2),
    "gyros": radians(0.2),  # rad/s
    "dvl_water": 0.02,  # m/s
}
BAND = 0.05  # of a step, on either side of the target
BEND = 1e-9


@dataclass(frozen=True)
class Case:
    """A run: the channel of the step, the steps (time s, value) from a first value, and its length, s."""

    title: str
    channel: str
    first: float
    steps: tuple[tuple[float, float], ...]
    duration: float

    @property
    def legs(self) -> list[tuple[float, float, float]]:
        """Beginning and end, s, and target of each step."""
        ends = [time for time, _ in self.steps[1:]] + [self.duration]
        return [(time, end, value) for (time, value), end in zip(self.steps, ends, strict=True)]


CASES = (
    Case("surge", "u_mps", 0.0, ((0.0, 1.5),), 40.0),
    Case("heading", "heading_rad", 0.0, ((0.0, radians(50.0)), (40.0, 0.0)), 80.0),
    Case("depth", "depth_m", 5.0, ((0.0, 10.0), (40.0, 5.0)), 80.0),
)


def speed_at(voltage: float, plant: Plant) -> float:
    """The steady forward speed at a voltage, m/s."""
    return find_cruise(replace_at(plant, "parts.propeller.design", voltage)).speed


def controlled_run(case: Case, kind: str, seed: int | None, model: Model | None = None) -> Run:
    """The run of a case under a controller; seed None: without current and noise; model: replaces the vehicle."""
    plant = load_vehicle(VEHICLE)
    cruise = speed_at(VOLTAGE, plant)
    effects = {}
    if seed is not None:
        rng = np.random.default_rng(seed)
        speed, course = CURRENT * np.sqrt(rng.random()), rng.uniform(-pi, pi)
        effects = {"effects.current.north": speed * np.cos(course), "effects.current.east": speed * np.sin(course)}
        effects["effects.current.down"] = rng.uniform(-UPDRAUGHT, UPDRAUGHT)
        effects |= {f"effects.sampling.{sensor}.noise": value for sensor, value in NOISE.items()}
    env = TaskEnv(
        "Depth",
        plant,
        effects={name: float(value) for name, value in effects.items()},
        actions=("rudder_rad", "stern_plane_rad", "propeller_V"),
        duration=case.duration,
        model=model,
    )
    steady = {"depth_m": 5.0, "heading_rad": 0.0, "u_mps": cruise}
    targets = {name: ((0.0, value),) for name, value in steady.items()} | {case.channel: case.steps}
    start = {**steady, case.channel: case.first}
    return drive(env, autopilot(plant, kind), seed=0 if seed is None else seed, targets=targets, start=start)


def responses(case: Case, run: Run) -> list[Step]:
    """The step responses of the true motion."""
    time, values = run.truth.time, run.truth[case.channel]
    found, before = [], case.first
    for begin, end, target in case.legs:
        leg = (time >= begin - BEND) & (time < end - BEND)
        # the step is counted from the target before it, which the vehicle need not have reached exactly
        shown = values[leg].copy()
        shown[0] = before
        found.append(step_response(time[leg], shown, target, BAND * abs(target - before)))
        before = target
    return found


def targets(case: Case, time: np.ndarray) -> np.ndarray:
    """The target of a case's channel at each time."""
    begun = [time >= begin - BEND for begin, _, _ in reversed(case.legs)]
    return np.select(begun, [value for _, _, value in reversed(case.legs)], case.first)


def tracking(case: Case, run: Run) -> float:
    """RMS difference of the true motion from its target, in the channel's unit."""
    error = run.truth[case.channel] - targets(case, run.truth.time)
    return float(np.sqrt(np.mean(error**2)))


def attempt(name: str, seed: int) -> dict[str, Any]:
    """The response to each step of a run, or why the run ended early."""
    case, controller = RUNS[name]
    run = controlled_run(case, CONTROLLERS[controller], seed)
    if run.reason:
        return {"cut": run.reason, "steps": []}
    rms, steps, before = tracking(case, run), [], case.first
    for (_, _, target), step in zip(case.legs, responses(case, run), strict=True):
        steps.append({"from": before, "to": target, "rms": rms, **step._asdict()})
        before = target
    return {"cut": "", "steps": steps}


def sheets(found: Found) -> list[Sheet]:
    """Settling, overshoot and tracking by step and controller: median over the seeds, and the worst."""
    rows: list[list[str]] = []
    for case in CASES:
        known = channel(case.channel)
        unit, factor = ("deg", 180.0 / pi) if known.unit == "rad" else (known.unit, 1.0)
        before = case.first
        for number, (_, _, target) in enumerate(case.legs):
            for controller in CONTROLLERS:
                runs = found.of(_named(case, controller))
                mine = [run["steps"][number] for run in runs if not run["cut"]]
                cut = len(runs) - len(mine)
                row = [f"{case.title} {factor * before:g} to {factor * target:g} {unit}", controller]
                if mine:
                    settling, rms = np.array([s["settling_time"] for s in mine]), np.array([s["rms"] for s in mine])
                    over = np.array([100.0 * s["overshoot"] / abs(target - before) for s in mine])
                    row += [
                        f"{_middle(settling)} ({_number(settling.max())})",
                        f"{np.median(over):.1f} ({over.max():.1f})",
                        f"{factor * np.median(rms):.3g} ({factor * rms.max():.3g}) {unit}",
                        f"{int(np.sum(~np.isfinite(settling))) + cut} of {len(runs)}",
                    ]
                elif runs:
                    row += ["-", "-", "-", f"{cut} runs cut short"]
                rows += [row] if runs else []
            before = target
        rows.append([])
    heads = ("step!", "controller!", "settling, s>", "overshoot, %>", "rms error of the run>", "not settled>")
    return [Sheet("control_case", f"Settling within {BAND:.0%} of the step; median (worst) over seeds", heads, rows)]


def _middle(values: np.ndarray) -> str:
    return _number(float(np.sort(values)[values.size // 2]))


def _number(value: float) -> str:
    return f"{value:.1f}" if isfinite(value) else "never"


def _named(case: Case, controller: str) -> str:
    return f"{case.title}, {controller}"


RUNS = {_named(case, controller): (case, controller) for case in CASES for controller in CONTROLLERS}


STUDY = Study(__doc__ or "", attempt, tuple(RUNS), sheets, seeds=20)

if __name__ == "__main__":
    sys.exit(STUDY.main())
