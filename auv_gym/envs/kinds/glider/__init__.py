"""Environments for underwater gliders that turn in the horizontal plane."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.envs.kernel.layout import Layout
from auv_gym.envs.kind import EnvKind, View
from auv_gym.envs.kinds.glider.hooks import HOOKS
from auv_gym.envs.kinds.glider.scale import scale


def _view(episodes: Any, row: np.ndarray) -> View:
    from auv_gym.envs.kinds.glider.view import GliderView  # imports matplotlib, so only when a picture is needed

    return GliderView(episodes, row)


KIND = EnvKind(
    title="the heading of an underwater glider",
    layout=Layout(
        geometry=("error_sin", "error_cos", "turn_rate", "speed"),
        sensors={"compass": ("heading_rad",)},
        plan={"rudder_limit": 1, "speed": 2},
        row={"last_heading": 1},
    ),
    hooks=HOOKS,
    scale=scale,
    options=("speed", "compass_noise"),
    view=_view,
    # the compass, and the speed, which is an input; no sensor measures rate of turn and position
    readings={"heading_rad": "heading_rad", "u_mps": "speed"},
)
