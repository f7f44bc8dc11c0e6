"""Vehicles in six degrees of freedom, in environments."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.envs.kernel.layout import Layout
from auv_gym.envs.kind import EnvKind, View
from auv_gym.envs.kinds.body import hooks
from auv_gym.envs.kinds.body.scale import scale
from auv_gym.vehicles.family import Family


def _view(episodes: Any, row: np.ndarray) -> View:
    from auv_gym.envs.kinds.body.view import BodyView  # with matplotlib, so not before a picture is wanted

    return BodyView(episodes, row)


def _first_of_roles(family: Family) -> dict[str, int]:
    """YAW_INPUT and others: the first input of each role, -1 where there is none."""
    roles = family.body.by_role()
    return {
        f"{role.upper()}_INPUT": family.inputs.index(roles[role][0]) if role in roles else -1
        for role in ("yaw", "pitch", "surge")
    }


KIND = EnvKind(
    title="a vehicle in six degrees of freedom",
    layout=Layout(
        geometry=(
            "error", "error_sin", "error_cos", "target",
            "across", "below", "remaining", "course_sin", "course_cos", "sink", "next_course_sin", "next_course_cos",
            "next_sink",
        ),
        sensors={
            "depth": ("depth_m",),
            "compass": ("heading_rad",),
            "inclinometer": ("roll_rad", "pitch_rad"),
            "gyros": ("p_radps", "q_radps", "r_radps"),
            "dvl_ground": ("u_dvl_mps", "v_dvl_mps", "w_dvl_mps"),
            "dvl_water": ("u_mps", "v_mps", "w_mps"),
            "position": ("north_m", "east_m"),
        },
        plan={
            "start_depth": 2, "cruise_state": "states", "cruise_command": "inputs",
            "limit": "actuators", "middle": "actuators", "action_of": "actuators",
            "rudder_gains": 3, "plane_gains": 4, "held_depth_error": 1,
            "follows_path": 1, "leg": 2, "turn": 1, "slope": 1, "path_speed": 1, "radius": 1,
            "waypoints_at": 1, "waypoints": 1,
            "depth_limit": 1, "speed_limit": 1, "pitch_limit": 1, "roll_limit": 1, "rate_limit": 1,
        },
        row={
            "held": 2,
            # the leg of a path: where it starts, the waypoint after its end, and directions
            "origin": 3, "next": 3, "course": 1, "sink": 1, "length": 1, "next_course": 1, "next_sink": 1,
        },
        shown={"reached": 1, "support_distance": 1},
    ),
    hooks=hooks.HOOKS,
    scale=scale,
    options=("actions", "waypoints"),
    view=_view,
    reasons={
        hooks.BROACHED: ("broached: depth_m is {value:.3g}", ""),
        hooks.TOO_DEEP: ("too deep: depth_m is {value:.4g}, the limit {limit:.4g}", "depth_limit"),
        hooks.PITCHED: ("out of its envelope: pitch_rad is {value:.3g}, the limit {limit:.3g}", "pitch_limit"),
        hooks.ROLLED: ("out of its envelope: roll_rad is {value:.3g}, the limit {limit:.3g}", "roll_limit"),
        hooks.TOO_FAST: ("out of its envelope: the speed is {value:.3g} m/s, the limit {limit:.3g}", "speed_limit"),
        hooks.SPINNING: (
            "out of its envelope: the rate of turn is {value:.3g} rad/s, the limit {limit:.3g}", "rate_limit",
        ),
        hooks.ARRIVED: ("arrived at the last waypoint", ""),
    },
    numbers=_first_of_roles,
)  # fmt: skip
