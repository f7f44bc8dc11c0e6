"""The standard experiment of each family of vehicles, simulated: what a log of such a vehicle looks like."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.param import did_you_mean, list_paths, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.experiments.kinds import KINDS, Mission


def run_mission(plant: Plant, rng: np.random.Generator, **settings: Any) -> Record:
    """The record of the standard experiment with a vehicle; raises on a setting that it does not have, or Diverged."""
    mission = mission_of(plant)
    for name in settings:
        if name not in mission.settings:
            raise ValueError(
                f"The experiment of {plant.name} ({mission.title}) has no setting {name!r}. "
                f"{did_you_mean(name, mission.settings)}It has {', '.join(mission.settings)}."
            )
    given = [
        path for path in list_paths(plant) if path.startswith("effects.sampling.") and value_at(plant, path) != 0.0
    ]
    if given and not mission.sampled:
        noises = ", ".join(name for name in mission.settings if name.endswith("noise"))
        raise ValueError(
            f"The experiment of {plant.name} ({mission.title}) has no {given[0]}: set {noises}, or drive an "
            "environment, which has it."
        )
    return mission.make(plant, rng, **settings)


def mission_of(plant: Plant) -> Mission:
    """The standard experiment with a vehicle."""
    return KINDS.of(plant.family).mission(plant)
