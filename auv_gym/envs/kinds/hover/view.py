"""The target of a task for a vehicle moved by thrusters, for pictures."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.envs.episodes import Episodes
from auv_gym.rendering import Target


def goal(episodes: Episodes, record: Any, waypoints: np.ndarray) -> Target:
    """The vehicle's present target."""
    if not episodes.task.targets:
        return Target(waypoints=waypoints, active=int(record["reached"]), radius=float(episodes.settings["radius"]))
    target = record["target"]
    return Target(waypoints=target[None, :3].copy(), heading=float(target[3]))
