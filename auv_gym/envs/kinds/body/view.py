"""The target of a body's task, for pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.envs.episodes import Episodes
from auv_gym.rendering import Target


def goal(episodes: Episodes, record: Any, waypoints: np.ndarray) -> Target:
    """The vehicle's present target."""
    channel = episodes.task.channel
    if not channel:
        return Target(waypoints=waypoints, active=int(record["reached"]), radius=float(episodes.settings["radius"]))
    target = float(record["target"][0])
    return Target(
        depth=target if channel == "depth_m" else None,
        heading=target if channel == "heading_rad" else None,
        speed=target if channel == "u_mps" else None,
    )
