"""Performance of autopilots on vehicles with thrusters: steps, currents, and lost thrusters.

    python -m scripts.studies.hovering --out hovering
    python -m scripts.studies.hovering --vehicle bluerov2_heavy

A step has settled within 5 % of its size.  Errors are those of the true position.  Sensors have no noise.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from auv_gym.param import replace_at
from auv_gym.plant import Plant, load_vehicle
from controllers.autopilots import autopilot
from controllers.composed.allocated import Allocated
from controllers.controller import Controller
from controllers.hovering.dynamics import POSE
from controllers.trials.settling import step_response
from controllers.trials.trial import at_rest, run_trial
from scripts.studies.harness import Found, Sheet, Study

VEHICLES = ("bluerov", "bluerov2", "bluerov2_heavy")
LAWS = ("pid", "gpc")
DEPTH = 5.0  # m
HOLD = {"north_m": 0.0, "east_m": 0.0, "depth_m": DEPTH, "heading_rad": 0.0}
STEPS = {"north_m": 2.0, "east_m": 2.0, "depth_m": 2.0, "heading_rad": 1.57}
CURRENT = 0.3  # m/s
SETTLED = 60.0  # s


def attempt(vehicle: str, seed: int) -> dict[str, Any]:
    """Steps by channel and law; and for each case of a current or a loss, the errors with each law."""
    plant = load_vehicle(vehicle)
    pilots = {law: autopilot(plant, law) for law in LAWS}
    steps = {f"{law} {name}": list(_step(plant, pilot, name)) for law, pilot in pilots.items() for name in STEPS}
    pid = pilots["pid"]
    assert isinstance(pid, Allocated)
    held = {
        f"current, {law}": _held(replace_at(plant, {"effects.current.north": CURRENT}), pilot)
        for law, pilot in pilots.items()
    }
    for part in plant.family.body.thrusters:
        broken = replace_at(plant, {"effects.current.north": CURRENT, f"effects.{part.name}.lost": 1.0})
        held[f"{part.name} lost, unknown"] = _held(broken, pid)
        try:
            known = autopilot(plant, lost={part.name: 1.0})
        except ValueError:  # the remaining thrusters cannot control all axes
            continue
        held[f"{part.name} lost, known"] = _held(broken, known)
    return {"steps": steps, "held": held}


def _step(plant: Plant, pilot: Controller, name: str) -> tuple[float, float, float]:
    """Settling time, s, overshoot in percent of the step, and final error of a step."""
    size, begin = STEPS[name], HOLD[name]
    targets = {n: [(0.0, value), *([(2.0, value + size)] if n == name else [])] for n, value in HOLD.items()}
    run = run_trial(plant, pilot, targets, 30.0, start=at_rest(plant, {"depth_m": DEPTH}))
    after = run["time_s"] >= 2.0
    found = step_response(run["time_s"][after], run[name][after], begin + size, 0.05 * size)
    return found.settling_time, 100.0 * found.overshoot / size, abs(found.steady_error)


def _held(plant: Plant, pilot: Controller) -> dict[str, float]:
    """The largest and the final distance from the position, m, heading error and tilt, rad."""
    targets = {name: [(0.0, value)] for name, value in HOLD.items()}
    run = run_trial(plant, pilot, targets, SETTLED, start=at_rest(plant, {"depth_m": DEPTH}))
    away = np.sqrt(run["north_m"] ** 2 + run["east_m"] ** 2 + (run["depth_m"] - DEPTH) ** 2)
    tilt = np.maximum(np.abs(run[POSE[3]]), np.abs(run[POSE[4]]))
    return {
        "largest": float(away.max()),
        "last": float(away[-1]),
        "turned": float(np.abs(run["heading_rad"]).max()),
        "tilted": float(tilt.max()),
        "tilt": float(tilt[-1]),
    }


def sheets(found: Found) -> list[Sheet]:
    steps, held = [], []
    for vehicle, runs in found.runs.items():
        for of in runs.values():
            steps += [[vehicle, *_step_row(of["steps"], name)] for name in STEPS]
            held += [[vehicle, case, *_held_row(errors)] for case, errors in of["held"].items()]
    step_heads = ("vehicle", "step", "size>", *(f"{law}, {what}>" for law in LAWS for what in ("s", "overshoot, %")))
    held_heads = (
        "vehicle",
        "case",
        "largest, m>",
        "after 60 s, m>",
        "turned, deg>",
        "tilted, deg>",
        "after 60 s, deg>",
    )
    return [
        Sheet("steps", "Steps: settled for good within 5 %", step_heads, steps),
        Sheet("held", f"Holding a place in a current of {CURRENT:g} m/s from rest in the water", held_heads, held),
    ]


def _step_row(steps: Mapping[str, Any], name: str) -> list[str]:
    numbers = [steps[f"{law} {name}"] for law in LAWS]
    return [name, f"{STEPS[name]:g}", *(f"{value:.1f}" for settled, over, _ in numbers for value in (settled, over))]


def _held_row(errors: Mapping[str, float]) -> list[str]:
    degrees = [np.degrees(errors[name]) for name in ("turned", "tilted", "tilt")]
    return [f"{errors['largest']:.3f}", f"{errors['last']:.1g}", *(f"{value:.1f}" for value in degrees)]


STUDY = Study(__doc__ or "", attempt, VEHICLES, sheets, seeds=None, one_of="vehicle")

if __name__ == "__main__":
    sys.exit(STUDY.main())
