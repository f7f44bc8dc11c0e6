"""What a picture shows of a body's task."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.envs.episodes import Episodes
from auv_gym.rendering import Target


def goal(episodes: Episodes, record: Any, waypoints: np.ndarray) -> Target:
    """What the vehicle is asked to do now."""
    channel = episodes.task.channel
    if not channel:
        return Target(waypoints=waypoints, active=int(record["reached"]), radius=float(episodes.settings["radius"]))
    target = float(record["target"][0])
    return Target(
        depth=target if channel == "depth_m" else None,
        heading=target if channel == "heading_rad" else None,
        speed=target if channel == "u_mps" else None,
    )
