"""Experiments with a glider in six degrees of freedom: yos on a heading that changes in steps."""

from __future__ import annotations

from math import pi, radians
from typing import Any

import numpy as np

from auv_gym.envs.task_env import TaskEnv
from auv_gym.param import replace_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from controllers.autopilots import autopilot
from identification.experiments.designs import COMPASS, DEPTH_NOISE, Design, mission
from identification.experiments.driving import drive
from identification.experiments.excitation import set_point_steps
from identification.experiments.kinds import ExperimentKind, Mission
from identification.experiments.manoeuvres import NOISE

_TURN, _HOLD = (radians(20.0), radians(70.0)), (200.0, 500.0)  # rad and s: a Seawing turns by 30 deg a minute at most
_NOT_MEASURED = ("depth_rate_mps", "north_cmd_m", "east_cmd_m", "depth_cmd_m")  # but computed, or the environment's
_SENSORS = ("inclinometer", "gyros", "position")


def _yos(
    plant: Plant,
    rng: np.random.Generator,
    *,
    duration: float = 3600.0,
    compass_noise: float = COMPASS,
    depth_noise: float = DEPTH_NOISE,
    **flown: Any,
) -> Record:
    """Yos with heading steps; flown: settings of the autopilot.

    If the plant's own `effects.sampling` has noise, that noise is used.
    """
    noise = {**{name: NOISE[name] for name in _SENSORS}, "compass": compass_noise, "depth": depth_noise}
    own = plant.effects.sampling
    noisy = {f"effects.sampling.{s}.noise": v for s, v in noise.items() if getattr(own, s).noise == 0.0}
    time = plant.dt * np.arange(round(duration / plant.dt) + 1)
    heading = float(rng.uniform(-pi, pi))
    wanted = set_point_steps(time, rng, start=heading, hold=_HOLD, step=_TURN)
    at = np.r_[0, np.flatnonzero(np.diff(wanted)) + 1]
    run = drive(
        TaskEnv("Glide", replace_at(plant, noisy), duration=duration, randomise={}),
        autopilot(plant, targets=["heading_rad"], **flown),
        seed=int(rng.integers(2**31)),
        targets={"heading_rad": list(zip(time[at].tolist(), wanted[at].tolist(), strict=True))},
        start={"heading_rad": heading},
    )
    if run.reason:
        raise ValueError(f"The run of {plant.name} was cut short: {run.reason}. Check its effects, or choose apogee.")
    return run.record.without([name for name in _NOT_MEASURED if run.record.has(name)])


def _mission(plant: Plant) -> Mission:
    settings = ("duration", "compass_noise", "depth_noise", "top", "apogee", "lift", "pitch")
    return Mission("yos on a heading that changes in steps", settings, _yos, sampled=True)


def _designs(plant: Plant) -> tuple[Design, ...]:
    def of(**settings: Any):
        return lambda plant, duration: mission(duration=duration, **settings)

    return (
        Design("mission", "yos with heading steps", of()),
        Design("slow", "yos with heading steps, with half of the engine", of(lift=0.5)),
        Design("steep", "steep yos with heading steps", of(pitch=0.7)),
        Design("short", "short yos with heading steps", of(top=20.0, apogee=35.0)),
    )


KIND = ExperimentKind(
    mission=_mission, designs=_designs, minutes=lambda plant: (10.0, 240.0), environment="auv_gym/Glide-v0"
)
