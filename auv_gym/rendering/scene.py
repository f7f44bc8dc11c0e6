"""The content of a picture of a run, in SI and radians: the track so far, present attitude, commands and targets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from auv_gym.channels import channel

Limit = float | tuple[float, float]


@dataclass(frozen=True, eq=False)
class Target:
    """The target of the vehicle; each part may be missing.

    heading: rad.  depth: m.  speed: m/s.  waypoints: north, east, depth, m, shape (k, 3).
    active: index of the next waypoint, k when all are reached.  radius: m, at which one counts as reached.
    start: north, east, depth, m, where a route begins.  level: waypoints are positions without a depth.
    """

    heading: float | None = None
    depth: float | None = None
    speed: float | None = None
    waypoints: np.ndarray | None = None
    active: int = 0
    radius: float | None = None
    start: np.ndarray | None = None
    level: bool = False

    def __post_init__(self):
        for name in ("heading", "depth", "speed", "radius"):
            value = getattr(self, name)
            if value is not None and not np.isfinite(value):
                raise ValueError(f"A target's {name} needs a finite number or None, got {value!r}.")
        if self.start is not None:
            _check_finite("start", self.start, 3)
        if self.waypoints is None:
            return
        waypoints = _points("A target's waypoints need", self.waypoints)
        object.__setattr__(self, "waypoints", waypoints)
        if not 0 <= self.active <= len(waypoints):
            raise ValueError(
                f"The active waypoint needs an index from 0 to {len(waypoints)} (all reached), got {self.active!r}."
            )

    @property
    def next_waypoint(self) -> np.ndarray | None:
        """North, east, depth of the active waypoint, m, or None."""
        if self.waypoints is None or self.active >= len(self.waypoints):
            return None
        return self.waypoints[self.active]

    @property
    def next_depth(self) -> float | None:
        """The target depth, m: that of the target, or else of the active waypoint."""
        if self.depth is not None or self.next_waypoint is None or self.level:
            return self.depth
        return float(self.next_waypoint[2])


@dataclass(frozen=True, eq=False)
class Scene:
    """One moment of a run and its history; raises ValueError if it cannot be drawn.

    trail: north, east, depth, m, oldest first, shape (n, 3); n may be 0.  time: s, shape (n,).
    attitude: roll, pitch, heading now, rad.  speed: m/s through the water.
    commands: by channel name (`rudder_rad`), the value and its limit, or both its ends, in the channel's unit.
    current: velocity of the water, north and east, m/s.  title, caption: left and right of the head line.
    model_trail: a second run at the same times, shape (m, 3) with m <= n.  labels: names of the two runs.
    level: the depth is not known, and the plan view takes the place of the depth strip.
    """

    trail: np.ndarray
    time: np.ndarray
    attitude: tuple[float, float, float]
    speed: float
    commands: Mapping[str, tuple[float, Limit]] = field(default_factory=dict)
    target: Target = field(default_factory=Target)
    current: tuple[float, float] | None = None
    title: str = ""
    caption: str = ""
    model_trail: np.ndarray | None = None
    labels: tuple[str, str] = ("vehicle", "model")
    level: bool = False

    def __post_init__(self):
        trail = _points("A scene's trail needs", self.trail)
        time = np.asarray(self.time, dtype=float)
        if time.shape != (len(trail),) or not np.isfinite(time).all() or (np.diff(time) < 0.0).any():
            raise ValueError(
                f"A scene's time needs {len(trail)} finite numbers that do not fall, one for each point of the trail, "
                f"got shape {time.shape}."
            )
        object.__setattr__(self, "trail", trail)
        object.__setattr__(self, "time", time)
        if self.model_trail is not None:
            model_trail = _points("A scene's model_trail needs", self.model_trail)
            object.__setattr__(self, "model_trail", model_trail)
            if len(model_trail) > len(trail):
                raise ValueError(
                    f"A scene's model_trail needs at most the {len(trail)} points of the trail, got {len(model_trail)}."
                )
        _check_finite("attitude", self.attitude, 3)
        _check_finite("speed", self.speed, 1)
        if self.current is not None:
            _check_finite("current", self.current, 2)
        for name, (value, limit) in self.commands.items():
            channel(name)
            low, high = ends(limit)
            if not (np.isfinite([value, low, high]).all() and low < high):
                raise ValueError(f"Command {name!r} needs a finite value and limits that differ, got {value}, {limit}.")


def ends(limit: Limit) -> tuple[float, float]:
    """The smallest and largest value of a command; a single limit applies to both sides."""
    return limit if isinstance(limit, tuple) else (-abs(limit), abs(limit))


def _points(needs: str, values: np.ndarray) -> np.ndarray:
    points = np.asarray(values, dtype=float)
    if points.size == 0:
        return points.reshape(0, 3)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ValueError(f"{needs} finite north, east and depth in shape (n, 3), got shape {points.shape}.")
    return points


def _check_finite(name: str, values: object, count: int) -> None:
    array = np.asarray(values, dtype=float)
    if array.size != count or not np.isfinite(array).all():
        raise ValueError(f"A scene's {name} needs {count} finite number{'s' * (count > 1)}, got {values!r}.")
