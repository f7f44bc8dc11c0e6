"""Experiments with a vehicle that hovers by thrusters: telegraph signals along its axes, or at single thrusters."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.experiments.designs import Design, mission
from identification.experiments.hovering import hover
from identification.experiments.kinds import ExperimentKind, Mission

_SETTINGS = ("duration", "compass_noise", "depth_noise", "loop", "amplitude", "dwell", "axes", "measured")
_SLOW = 4.0  # s, a dwell long enough for a vehicle to approach a steady speed


def _telegraph(plant: Plant, rng: np.random.Generator, **settings: Any) -> Record:
    return hover(plant, rng=rng, **settings)


def _mission(plant: Plant) -> Mission:
    return Mission(
        "position, depth and heading in steps, with telegraph signals along each axis", _SETTINGS, _telegraph
    )


def _designs(plant: Plant) -> tuple[Design, ...]:
    def of(**settings: Any):
        return lambda plant, duration: mission(duration=duration, **settings)

    return (
        Design("mission", "steps, with telegraph signals along each axis", of()),
        Design("slow", "steps, with slow telegraph signals along each axis", of(dwell=_SLOW)),
        Design("strong", "steps, with strong telegraph signals along each axis", of(amplitude=0.4)),
        Design("steps", "steps without excitation", of(amplitude=0.0)),
        Design("yaw", "steps, with a telegraph signal in yaw", of(axes=["yaw_Nm"])),
        Design("heave", "steps, with a telegraph signal up and down", of(axes=["heave_N"])),
        Design("level", "steps, with telegraph signals ahead and to the side", of(axes=["surge_N", "sway_N"])),
        Design("thrusters", "no control, with a telegraph signal at each thruster", of(loop="open")),
    )


KIND = ExperimentKind(mission=_mission, designs=_designs, minutes=lambda plant: (0.5, 20.0))
