"""The standard experiment of each family of vehicles, simulated as a typical log of such a vehicle."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from auv_gym.param import did_you_mean, list_paths, value_at
from auv_gym.plant import Plant, check_vehicle
from auv_gym.records.record import Record
from identification.experiments.excitation import check_generator
from identification.experiments.kinds import KINDS, Mission


def run_mission(plant: Plant, rng: np.random.Generator, **settings: Any) -> Record:
    """Simulate the standard experiment of a vehicle; raises as `check_mission` does, or Diverged.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import run_mission
        >>> log = run_mission(load_vehicle("slocum"), np.random.default_rng(0), duration=300)
        >>> len(log), log.names[:3]
        (76, ('heading_rad', 'rudder_rad', 'heading_cmd_rad'))
    """
    check_vehicle("run_mission", plant)
    check_generator("run_mission", rng)
    check_mission(plant, settings)
    return mission_of(plant).make(plant, rng, **settings)


def check_mission(plant: Plant, settings: Iterable[str]) -> None:
    """Raise ValueError for a setting that the experiment does not have, or for sampling noise if it adds its own."""
    mission = mission_of(plant)
    for name in settings:
        if name not in mission.settings:
            raise ValueError(
                f"The experiment of {plant.name} ({mission.title}) has no setting {name!r}. "
                f"{did_you_mean(name, mission.settings)}It has {', '.join(mission.settings)}."
            )
    given = [path for path in sampling_of(plant) if value_at(plant, path) != 0.0]
    if given and not mission.sampled:
        raise ValueError(
            f"The experiment of {plant.name} ({mission.title}) makes the noise of its readings itself and has no "
            f"{given[0]}: leave it out, or drive an environment, which has it."
        )


def sampling_of(plant: Plant) -> list[str]:
    """The paths of sampling effects on readings."""
    return [path for path in list_paths(plant) if path.startswith("effects.sampling.")]


def mission_of(plant: Plant) -> Mission:
    """The standard experiment with a vehicle."""
    return KINDS.of(plant.family).mission(plant)
