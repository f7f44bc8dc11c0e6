"""A glider in six degrees of freedom in a steady dive: volume and slide act in its vertical plane only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auv_gym.models.linear.kinds import SMALL, SteadyKind
from auv_gym.plant import Plant
from auv_gym.plant.cruise import command_limits
from auv_gym.plant.gliding import find_masses, usual_glide

_VERTICAL = ("u_mps", "w_mps", "q_radps", "pitch_rad")  # its depth is not constant in a dive
_LATERAL = ("v_mps", "p_radps", "r_radps", "roll_rad", "heading_rad")
_MOVED = {"volume": _VERTICAL, "slide": _VERTICAL, "turn": _LATERAL}


def _moves(plant: Plant) -> dict[str, tuple[str, ...]]:
    return {name: _MOVED[inside] for inside, names in plant.family.body.by_inside().items() for name in names}


def _usual(plant: Plant) -> Sequence[str]:
    return (plant.inputs[find_masses(plant).slide],)


def _steady(plant: Plant) -> tuple[np.ndarray, np.ndarray]:
    glide = usual_glide(plant, -1.0)
    return glide.state, glide.commands


def _steps(plant: Plant, names: Sequence[str]) -> np.ndarray:
    limits = dict(zip(plant.inputs, command_limits(plant).tolist(), strict=False))
    return np.array([SMALL * limits.get(name.removesuffix(" position"), 1.0) for name in names])


KIND = SteadyKind(_moves, _usual, _steady, _steps)
