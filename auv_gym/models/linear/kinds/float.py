"""A float at rest in deep water, with its drag linearised at a tenth of its top speed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auv_gym.models.linear.kinds import SMALL, SteadyKind
from auv_gym.plant import Plant
from auv_gym.plant.float_engine import find_engine

_DEEP = 100.0  # m, far from the surface
_NEAR_REST = 0.1  # of the top speed: quadratic drag has no slope at rest


def _moves(plant: Plant) -> dict[str, tuple[str, ...]]:
    return {plant.family.required[0]: ("depth_m", "depth_rate_mps")}


def _usual(plant: Plant) -> Sequence[str]:
    return plant.family.required


def _steady(plant: Plant) -> tuple[np.ndarray, np.ndarray]:
    state = np.zeros(len(plant.family.states))
    state[plant.family.states.index("depth_m")] = _DEEP
    named = {"piston_m": plant.hull.piston_neutral} if plant.family.required == ("piston_m",) else {}
    return state, np.array([plant.constants.get(name, named.get(name, 0.0)) for name in plant.inputs])


def _steps(plant: Plant, names: Sequence[str]) -> np.ndarray:
    hull, engine = plant.hull, find_engine(plant)
    slow = _NEAR_REST * engine.speed
    force = slow * (hull.drag_linear + slow * hull.drag_quadratic)
    share = force / (engine.speed * (hull.drag_linear + engine.speed * hull.drag_quadratic))
    # without inertia, the engine's step alone makes the speed
    moved = share * engine.half if hull.quasi_steady else SMALL * engine.half
    sizes = {"depth_m": SMALL, "depth_rate_mps": slow}
    return np.array([sizes.get(name, moved) for name in names])


KIND = SteadyKind(_moves, _usual, _steady, _steps)
