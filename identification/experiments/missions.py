"""The standard experiment of each family of vehicles, simulated: what a log of such a vehicle looks like."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_gym.param import did_you_mean
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.experiments.float_dives import depth_control, oil_mission, summer_lake
from identification.experiments.heading_control import closed_loop
from identification.experiments.manoeuvres import steer

_LAKE_TARGETS, _LAKE_HOLD = (40.0, 0.0), 600.0  # m, s


@dataclass(frozen=True)
class Mission:
    """An experiment; settings: the names that it takes, in SI, beside the plant and the generator."""

    title: str
    settings: tuple[str, ...]
    make: Callable[..., Record]


def run_mission(plant: Plant, rng: np.random.Generator, **settings: Any) -> Record:
    """The record of the standard experiment with a vehicle; raises on a setting that it does not have, or Diverged."""
    mission = mission_of(plant)
    for name in settings:
        if name not in mission.settings:
            raise ValueError(
                f"The experiment of {plant.name} ({mission.title}) has no setting {name!r}. "
                f"{did_you_mean(name, mission.settings)}It has {', '.join(mission.settings)}."
            )
    return mission.make(plant, rng, **settings)


def mission_of(plant: Plant) -> Mission:
    """The standard experiment with a vehicle."""
    return MISSIONS[plant.family.name]


def _heading(plant: Plant, rng: np.random.Generator, **settings: Any) -> Record:
    return closed_loop(plant, rng=rng, **settings)


def _lake(
    plant: Plant,
    rng: np.random.Generator,
    *,
    target_depths: Sequence[float] = _LAKE_TARGETS,
    duration: float | None = None,
    depth_noise: float = 0.02,
) -> Record:
    """duration: s, shared evenly by the targets."""
    hold = _LAKE_HOLD if duration is None else duration / len(target_depths)
    return depth_control(plant, target_depths, rng=rng, hold=hold, noise=depth_noise, temperature_profile=summer_lake)


def _dives(plant: Plant, rng: np.random.Generator, *, depth_noise: float = 0.1, **settings: Any) -> Record:
    named = {"depths": settings["target_depths"]} if "target_depths" in settings else {}
    return oil_mission(plant, rng=rng, noise=depth_noise, **named)


def _manoeuvres(plant: Plant, rng: np.random.Generator, **settings: Any) -> Record:
    return steer(plant, rng=rng, **settings)


_STEER = Mission(
    "heading, depth and speed in steps, with excitation at rudder and stern plane",
    ("duration", "compass_noise", "depth_noise"),
    _manoeuvres,
)
MISSIONS: Mapping[str, Mission] = {
    "glider": Mission(
        "a changing heading, with excitation at the rudder", ("duration", "compass_noise", "track_noise"), _heading
    ),
    "float_piston": Mission(
        "from depth to depth in a stratified lake", ("duration", "target_depths", "depth_noise"), _lake
    ),
    "float_oil": Mission("dives with pump and valve", ("target_depths", "depth_noise"), _dives),
    "body": _STEER,
}
