"""A glider straight ahead."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auv_gym.models.linear.kinds import SMALL, SteadyKind
from auv_gym.plant import Plant


def _moves(plant: Plant) -> dict[str, tuple[str, ...]]:
    return dict.fromkeys(plant.family.inputs[:3], ("heading_rad", "r_radps"))


def _usual(plant: Plant) -> Sequence[str]:
    return plant.family.required


def _steady(plant: Plant) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(len(plant.family.states)), np.array([plant.constants.get(name, 0.0) for name in plant.inputs])


def _steps(plant: Plant, names: Sequence[str]) -> np.ndarray:
    return np.full(len(names), SMALL)


KIND = SteadyKind(_moves, _usual, _steady, _steps)
