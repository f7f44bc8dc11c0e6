"""Profiling floats in environments."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.envs.kernel.layout import Layout
from auv_gym.envs.kind import EnvKind, View
from auv_gym.envs.kinds.float import hooks
from auv_gym.envs.kinds.float.scale import scale


def _view(episodes: Any, row: np.ndarray) -> View:
    from auv_gym.envs.kinds.float.view import FloatView  # imports matplotlib, so only when a picture is needed

    return FloatView(episodes, row)


KIND = EnvKind(
    title="a profiling float",
    layout=Layout(
        geometry=("error", "position"),
        # a float measures its rate only through its depth sensor
        sensors={"depth": ("depth_m", "depth_rate_mps")},
        plan={
            "start_depth": 2, "duration": 1, "near": 1, "near_dt": 1,
            "engine": 1, "engine_middle": 1, "engine_half": 1, "engine_rate": 1, "holds_back": 1,
            "depth_limit": 1, "speed_limit": 1,
        },
        row={"position": 1, "last_depth": 1},
        shown={"coming_dt": 1},
    ),
    hooks=hooks.HOOKS,
    scale=scale,
    options=("near", "depths"),
    view=_view,
    reasons={
        hooks.FLEW: ("out of the water: depth_m is {value:.3g}", ""),
        hooks.TOO_DEEP: ("too deep: depth_m is {value:.4g}, the limit {limit:.4g}", "depth_limit"),
        hooks.TOO_FAST: ("out of its envelope: the speed is {value:.3g} m/s, the limit {limit:.3g}", "speed_limit"),
    },
    infos={"dt_s": "coming_dt"},
)  # fmt: skip
