"""A vehicle in six degrees of freedom in cruise; each plane, rudder and drive moves the states in its plane."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auv_gym.models.linear.kinds import SMALL, SteadyKind
from auv_gym.plant import Plant
from auv_gym.plant.cruise import command_limits, find_cruise, find_helm

_VERTICAL = ("w_mps", "q_radps", "pitch_rad", "depth_m")
_HORIZONTAL = ("v_mps", "r_radps", "heading_rad")
_PLANES = {"yaw": _HORIZONTAL, "pitch": _VERTICAL, "surge": ("u_mps",)}


def _moves(plant: Plant) -> dict[str, tuple[str, ...]]:
    roles = plant.family.body.by_role()
    return {name: _PLANES[role] for role, names in roles.items() for name in names}


def _usual(plant: Plant) -> Sequence[str]:
    roles = plant.family.body.by_role()
    if not roles:
        find_helm(plant)  # raises with the requirements of a cruise
    return roles.get("pitch", plant.family.required)


def _steady(plant: Plant) -> tuple[np.ndarray, np.ndarray]:
    cruise = find_cruise(plant)
    return cruise.state, cruise.commands


def _steps(plant: Plant, names: Sequence[str]) -> np.ndarray:
    helm = find_helm(plant)
    drive = plant.inputs[helm.drive]  # in volts or turns, while the others are in rad and m/s
    scale = max(float(command_limits(plant)[helm.drive]), 1.0)
    return np.array([SMALL * (scale if name.startswith(drive) else 1.0) for name in names])


KIND = SteadyKind(_moves, _usual, _steady, _steps)
