"""Vehicles in six degrees of freedom, in environments."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.envs.kernel import body, path
from auv_gym.envs.kernel.layout import Layout
from auv_gym.envs.kind import EnvKind, View
from auv_gym.envs.kinds.body import hooks
from auv_gym.envs.kinds.body.scale import scale
from auv_gym.vehicles.family import Family


def _view(episodes: Any, row: np.ndarray) -> View:
    from auv_gym.envs.kinds.body.view import goal  # imports matplotlib, so only when a picture is needed
    from auv_gym.envs.track import BodyView

    return BodyView(episodes, row, goal)


def _first_of_roles(family: Family) -> dict[str, int]:
    """YAW_INPUT and others: the first input of each role, -1 if there is none."""
    roles = family.body.by_role()
    return {
        f"{role.upper()}_INPUT": family.inputs.index(roles[role][0]) if role in roles else -1
        for role in ("yaw", "pitch", "surge")
    }


KIND = EnvKind(
    title="a vehicle in six degrees of freedom with fins and a drive",
    layout=Layout(
        geometry=("error", "error_sin", "error_cos", "target", *path.GEOMETRY),
        sensors=body.SENSORS,
        plan={
            "rudder_gains": 3, "plane_gains": 4, "held_depth_error": 1,
            **body.BEGINNING, **path.PLAN, **body.LIMITS,
        },
        row={"held": 2, **path.ROW},
        shown=body.SHOWN,
    ),
    hooks=hooks.HOOKS,
    scale=scale,
    options=("actions", "waypoints"),
    view=_view,
    reasons=body.REASONS,
    numbers=_first_of_roles,
)  # fmt: skip
