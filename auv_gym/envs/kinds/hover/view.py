"""What a picture shows of the task of a vehicle that thrusters move."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.envs.episodes import Episodes
from auv_gym.rendering import Target


def goal(episodes: Episodes, record: Any, waypoints: np.ndarray) -> Target:
    """What the vehicle is asked to do now."""
    if not episodes.task.targets:
        return Target(waypoints=waypoints, active=int(record["reached"]), radius=float(episodes.settings["radius"]))
    target = record["target"]
    return Target(waypoints=target[None, :3].copy(), heading=float(target[3]))
