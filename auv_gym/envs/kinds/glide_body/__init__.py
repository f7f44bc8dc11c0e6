"""Environments for gliders in six degrees of freedom that are moved by their volume and masses."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.envs.kernel import body, path, pump
from auv_gym.envs.kernel.layout import Layout
from auv_gym.envs.kind import EnvKind, View
from auv_gym.envs.kinds.glide_body import hooks
from auv_gym.envs.kinds.glide_body.scale import scale
from auv_gym.vehicles.family import Family

_MEASURED = (
    "depth_m", "roll_rad", "pitch_rad", "heading_rad", "p_radps", "q_radps", "r_radps", "north_m", "east_m",
)  # fmt: skip


def _view(episodes: Any, row: np.ndarray) -> View:
    from auv_gym.envs.yos import YoView  # imports matplotlib, so only when a picture is needed

    return YoView(episodes, row)


def _engine(family: Family) -> dict[str, int]:
    """ENGINE: the input that changes the volume."""
    return {"ENGINE": family.inputs.index(family.body.by_inside()["volume"][0])}


KIND = EnvKind(
    title="a glider in six degrees of freedom that its volume and masses move",
    layout=Layout(
        geometry=(*path.GEOMETRY, "sinking"),
        sensors=body.SENSORS,
        plan={**body.BEGINNING, **path.PLAN, **body.LIMITS, **pump.PLAN},
        row={**path.ROW, **pump.ROW, "last_depth": 1},
        shown={**body.SHOWN, **pump.SHOWN},
    ),
    hooks=hooks.HOOKS,
    scale=scale,
    options=("bottom", "waypoints", "hotel", "pump_efficiency"),
    view=_view,
    reasons={
        **body.REASONS,
        body.BROACHED: ("surfaced: depth_m is {value:.3g}", ""),
        body.TOO_DEEP: ("touched the bottom: depth_m is {value:.4g}, the bottom at {limit:.4g}", "depth_limit"),
    },
    readings={**{name: name for name in _MEASURED}, "depth_rate_mps": "sinking"},
    infos={"energy_J": "energy"},
    numbers=_engine,
)
