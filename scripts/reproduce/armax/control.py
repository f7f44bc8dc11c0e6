"""Predictive control of depth on identified models, on the true vehicle, compared with that on its true linear form.

Two steps of depth by two lengths, planned every 4 s, within 5 degrees of pitch.  Every seed draws sensor noise and a
vertical current, the same for all controllers.  The true motion is judged.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import radians
from typing import Any

import numpy as np

from auv_gym.envs.task_env import TaskEnv
from auv_gym.models.linear import Polynomial, StateSpace
from auv_gym.plant import Plant, load_vehicle
from controllers.autopilots import autopilot
from controllers.composed.scheduled import Scheduled
from controllers.controller import Controller
from identification.experiments.driving import Run, drive
from scripts.reproduce.s_plane import Case, responses, targets

VEHICLE, DT = "npsauv", 4.0  # s
PITCH_LIMIT = radians(5.0)
SHALLOW, DEEP = 20.0, 30.6  # m, two lengths apart
LEGS = ((8.0, DEEP), (208.0, SHALLOW))  # s, m
END = 400.0  # s
CASE = Case("depth", "depth_m", SHALLOW, LEGS, END)
UPDRAUGHT = 0.03  # m/s, largest vertical current drawn
ROUNDED = {"depth": 0.01, "inclinometer": 0.001745}  # m, rad: as in the experiment
NOISE = {"depth": 0.02, "inclinometer": radians(0.1)}  # m, rad: standard deviations
_SLOWEST = 0.97  # zero of C: it decays in thirty samples, the length of plans
PLANES = ("stern_plane_rad", "bow_plane_rad")


@dataclass(frozen=True)
class Controlled:
    """The result of a controller for a seed.

    cost: integral of the squared error of depth, m2 s.  settling, s, for good within 5 % of the step (inf: never), and
    overshoot, m: of each step.  pitch: the largest, rad.  travel: of both planes, rad.  failed: why it ended early.
    """

    controller: str
    seed: int
    cost: float = float("nan")
    settling: tuple[float, ...] = ()
    overshoot: tuple[float, ...] = ()
    pitch: float = float("nan")
    travel: float = float("nan")
    failed: str = ""


def vehicle() -> Plant:
    """The true vehicle."""
    return load_vehicle(VEHICLE, dt=DT)


def pilots(models: Mapping[str, Polynomial]) -> dict[str, Controller]:
    """PID, GPC on the true linear form, and the same GPC on each model, by name.

    The models get the Kalman filter of the true form, and also the filter of their own noise if that forgets within the
    horizon (CARIMA).
    """
    found = {kind: autopilot(vehicle(), kind, ["depth_m"], pitch_limit=PITCH_LIMIT) for kind in ("pid", "gpc")}
    gpc = found["gpc"]
    assert isinstance(gpc, Scheduled)
    result: dict[str, Controller] = {"PID": found["pid"], "GPC, true linear form": gpc}
    for name, model in models.items():
        result[f"GPC, {name}"] = _with_model(gpc, _without_noise(model))
        if _forgets(model):
            result[f"GPC, {name}, own noise"] = _with_model(gpc, model)
    return result


def controlled_run(controller: Controller, seed: int) -> Run:
    """The run of a controller against the true vehicle."""
    rng = np.random.default_rng(seed)
    effects = {f"effects.sampling.{sensor}.quantisation": value for sensor, value in ROUNDED.items()}
    effects |= {f"effects.sampling.{sensor}.noise": value for sensor, value in NOISE.items()}
    effects["effects.current.down"] = float(rng.uniform(-UPDRAUGHT, UPDRAUGHT))
    env = TaskEnv("Depth", vehicle(), effects=effects, duration=END)
    targets = {"depth_m": ((0.0, SHALLOW), *LEGS)}
    return drive(env, controller, seed=seed, targets=targets, start={"depth_m": SHALLOW})


def judged(name: str, seed: int, run: Run) -> Controlled:
    """The results of a run."""
    if run.reason:
        return Controlled(name, seed, failed=run.reason)
    time = run.truth.time
    steps = responses(CASE, run)
    inside = time < END
    return Controlled(
        name,
        seed,
        cost=float(np.sum((run.truth["depth_m"] - targets(CASE, time))[inside] ** 2) * DT),
        settling=tuple(step.settling_time for step in steps),
        overshoot=tuple(step.overshoot for step in steps),
        pitch=float(np.abs(run.truth["pitch_rad"]).max()),
        travel=float(sum(np.abs(np.diff(run.record[plane])).sum() for plane in PLANES)),
    )


def study(
    controllers: Mapping[str, Controller], seeds: Sequence[int], told: Callable[[float], object] = lambda share: None
) -> list[Controlled]:
    """Every controller on every seed."""
    found = []
    for k, seed in enumerate(seeds):
        for name, controller in controllers.items():
            found.append(judged(name, seed, controlled_run(controller, seed)))
        told((k + 1) / len(seeds))
    return found


def _with_model(gpc: Scheduled, model: StateSpace | Polynomial) -> Scheduled:
    inner: Any = gpc.controller
    return replace(gpc, controller=replace(inner, model=model))


def _without_noise(model: Polynomial) -> StateSpace:
    """The response to the inputs, as the true linear form has it: the filter then uses the noise of the settings."""
    space = model.to_state_space()
    return replace(space, k=np.zeros_like(space.k))


def _forgets(model: Polynomial) -> bool:
    """Whether the filter according to C decays within the horizon."""
    zeros = [np.abs(np.roots(model.c[:, i, i])).max(initial=0.0) for i in range(len(model.outputs))]
    return max(zeros) < _SLOWEST
