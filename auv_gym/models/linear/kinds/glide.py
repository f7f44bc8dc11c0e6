"""A glider at neutral trim, level and deep: effect of its engine on depth, with the drag at a tenth of its lift."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auv_gym.models.linear.kinds import SMALL, SteadyKind
from auv_gym.plant import Plant
from auv_gym.plant.flying import neutral_engine

_DEEP = 100.0  # m, far from the surface
_FAR = 10.0  # m, distance over which the change of trim with depth is computed
_NEAR_REST = 0.1  # of the engine's range: quadratic drag has no slope at rest


def _moves(plant: Plant) -> dict[str, tuple[str, ...]]:
    return {"buoyancy_volume_m3": ("depth_m", "depth_rate_mps")}


def _usual(plant: Plant) -> Sequence[str]:
    return ("buoyancy_volume_m3",)


def _steady(plant: Plant) -> tuple[np.ndarray, np.ndarray]:
    state = np.zeros(len(plant.family.states))
    state[plant.family.states.index("depth_m")] = _DEEP
    named = {"buoyancy_volume_m3": neutral_engine(plant, _DEEP), "pitch_rad": 0.0}
    return state, np.array([named.get(name, plant.constants.get(name, 0.0)) for name in plant.inputs])


def _steps(plant: Plant, names: Sequence[str]) -> np.ndarray:
    moved = _NEAR_REST * 0.5 * (plant.hull.engine_high - plant.hull.engine_low)
    sizes = {"depth_m": _FAR, "depth_rate_mps": SMALL}
    return np.array([sizes.get(name, moved) for name in names])


KIND = SteadyKind(_moves, _usual, _steady, _steps)
