"""A vehicle with thrusters, hovering at rest and level; each thruster moves the states that its thrust accelerates.

At rest, neither a thruster in its dead zone nor quadratic drag has a slope. The linear form uses secants: between a
quarter of the command in both directions, and up to a tenth of the attainable speed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auv_gym.models.linear.kinds import SMALL, SteadyKind
from auv_gym.plant import Plant
from auv_gym.plant.cruise import command_limits
from auv_gym.plant.hover import find_hover
from auv_gym.plant.thrusters import AXES, find_thrusters

_COMMAND = 0.25  # of the range in both directions
_NEAR_REST = 0.1  # of the attainable speed
_MOVED = 1e-6  # of the largest acceleration: less is rounding
_AXES = {
    "surge": ("u_mps", "north_m"),
    "sway": ("v_mps", "east_m"),
    "heave": ("w_mps", "depth_m"),
    "roll": ("p_radps", "roll_rad"),
    "pitch": ("q_radps", "pitch_rad"),
    "yaw": ("r_radps", "heading_rad"),
}


def _moves(plant: Plant) -> dict[str, tuple[str, ...]]:
    thrusters = find_thrusters(plant)
    gained = np.abs(plant.family.view(plant.derived).computed.inverse_mass @ thrusters.wrench)
    moved = gained > _MOVED * gained.max()
    return {
        name: tuple(state for axis, does in zip(AXES, column, strict=True) if does for state in _AXES[axis])
        for name, column in zip(thrusters.channels, moved.T, strict=True)
    }


def _usual(plant: Plant) -> Sequence[str]:
    return find_thrusters(plant).channels


def _steady(plant: Plant) -> tuple[np.ndarray, np.ndarray]:
    hover = find_hover(plant)
    return hover.state, hover.commands


def _steps(plant: Plant, names: Sequence[str]) -> np.ndarray:
    hover, limits = find_hover(plant), dict(zip(plant.inputs, command_limits(plant).tolist(), strict=False))
    sizes = {_AXES[axis][0]: _NEAR_REST * speed for axis, speed in hover.speeds.items()}
    sizes |= {name: _COMMAND * limits[name] for name in hover.thrusters.channels}
    return np.array([sizes.get(name, SMALL) for name in names])


KIND = SteadyKind(_moves, _usual, _steady, _steps)
