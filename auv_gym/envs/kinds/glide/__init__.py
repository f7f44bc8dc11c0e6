"""Gliders that fly by their polar, steered by their masses, in environments."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.envs.kernel import path, pump
from auv_gym.envs.kernel.layout import Layout
from auv_gym.envs.kind import EnvKind, View
from auv_gym.envs.kinds.glide import hooks
from auv_gym.envs.kinds.glide.scale import prepare, scale


def _view(episodes: Any, row: np.ndarray) -> View:
    from auv_gym.envs.yos import YoView  # imports matplotlib, so only when a picture is needed

    return YoView(episodes, row)


KIND = EnvKind(
    title="a glider that flies",
    layout=Layout(
        geometry=(
            *path.GEOMETRY, "sinking", "reckoned_north", "reckoned_east", "current_north", "current_east",
            "current_along", "current_across",
        ),
        sensors={
            "depth": ("depth_m",),
            "compass": ("heading_rad",),
            "inclinometer": ("roll_rad", "pitch_rad"),
            "position": ("north_m", "east_m"),
        },
        plan={
            **path.PLAN, **pump.PLAN, "limit": "actuators", "middle": "actuators", "action_of": "actuators",
            "bottom": 1, "usual_attack": 1,
        },
        # flown: through the water since the last fix, m.  drift: the water's velocity estimated over the last dive, m/s
        row={**path.ROW, **pump.ROW, "last_depth": 1, "fix": 2, "fix_time": 1, "flown": 2, "drift": 2},
        shown={"reached": 1, **pump.SHOWN},
    ),
    hooks=hooks.HOOKS,
    scale=scale,
    options=("bottom", "waypoints"),
    view=_view,
    prepare=prepare,
    reasons={
        hooks.GROUNDED: ("touched the bottom: depth_m is {value:.4g}, the bottom at {limit:.4g}", "bottom"),
        hooks.ARRIVED: ("arrived at the last waypoint", ""),
    },
    readings={
        "depth_m": "depth_m", "roll_rad": "roll_rad", "pitch_rad": "pitch_rad", "heading_rad": "heading_rad",
        "depth_rate_mps": "sinking", "north_m": "reckoned_north", "east_m": "reckoned_east",
        "current_north_mps": "current_north", "current_east_mps": "current_east",
    },
    infos={"energy_J": "energy"},
)  # fmt: skip
