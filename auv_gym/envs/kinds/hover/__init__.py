"""Environments for vehicles moved by thrusters."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.envs.kernel import body, path
from auv_gym.envs.kernel.layout import Layout
from auv_gym.envs.kind import EnvKind, View
from auv_gym.envs.kinds.hover import hooks
from auv_gym.envs.kinds.hover.scale import scale


def _view(episodes: Any, row: np.ndarray) -> View:
    from auv_gym.envs.kinds.hover.view import goal  # imports matplotlib, so only when a picture is needed
    from auv_gym.envs.track import BodyView

    return BodyView(episodes, row, goal)


KIND = EnvKind(
    title="a vehicle that thrusters move",
    layout=Layout(
        geometry=(
            "error_ahead", "error_starboard", "error_below", "heading_error_sin", "heading_error_cos", "roll_error",
            "pitch_error", "sum_ahead", "sum_starboard", "sum_below", "sum_heading", *path.GEOMETRY, *hooks.LAST,
        ),
        sensors=body.SENSORS,
        plan={
            # wrench actions: for each thruster its input, holding thrust, and thrusts per action; its curve
            "by_wrench": 1, "thrusters_at": 1, "thrusters": 1, "curves_at": 1, "curves": 1,
            "redrawn": 1, "fixed": 6, "size": 1, "attitude_scale": 1, "sum_rate": 1, "sum_limit": 1,
            **body.BEGINNING, **path.PLAN, **body.LIMITS,
        },
        row={"sums": 4, "push": "actuators", **path.ROW},
        shown=body.SHOWN,
        targets=6,
        first_targets=6,
    ),
    hooks=hooks.HOOKS,
    scale=scale,
    options=("actions", "waypoints"),
    view=_view,
    reasons=body.REASONS,
)  # fmt: skip
