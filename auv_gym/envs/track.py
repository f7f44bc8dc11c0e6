"""The track of a vehicle in six degrees of freedom, as a scene to draw."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from auv_gym.envs.episodes import Episodes
from auv_gym.param import value_at
from auv_gym.plant import Plant
from auv_gym.rendering import Scene, Target


class BodyView:
    """The view of one environment, whose row it reads; goal: function of episodes, row record and waypoints."""

    def __init__(self, episodes: Episodes, row: np.ndarray, goal: Callable[[Episodes, Any, np.ndarray], Target]):
        self._goal = goal
        family, state_at = episodes.plant.family, int(episodes.settings["state_at"])
        self._episodes, self._row, self._record = episodes, row, episodes.record(row)
        self._at = {name: state_at + i for i, name in enumerate(family.states)}
        settings = episodes.settings
        self._limits = dict(
            zip(family.actuators, zip(settings["middle"].tolist(), settings["limit"].tolist()), strict=True)
        )
        self._track: list[tuple[float, float, float, float]] = []
        self._waypoints: list[tuple[float, float, float]] = []

    def follow(self, begin: bool = False) -> None:
        """Add the present position to the track; begin: whether an episode begins."""
        if begin:
            self._track, self._waypoints = [], []
        record = self._record
        self._track.append((float(record["time"]), *self._states("north_m", "east_m", "depth_m")))
        if self._episodes.settings["follows_path"]:
            for point in (record["target"], record["next"])[len(self._waypoints) - int(record["reached"]) :]:
                self._waypoints.append(tuple(point[:3].tolist()))

    def scene(self) -> Scene:
        """The present moment and the track so far, as a `Scene`."""
        track = np.array(self._track)
        told = dict(zip(self._episodes.plant.inputs, self._record["command"].tolist(), strict=True))
        velocity = self._states("u_mps", "v_mps", "w_mps")
        target = self._goal(self._episodes, self._record, np.array(self._waypoints))
        return Scene(
            trail=track[:, 1:],
            time=track[:, 0],
            attitude=self._states("roll_rad", "pitch_rad", "heading_rad"),
            speed=float(np.linalg.norm(velocity)),
            commands={
                name: (told[name], (middle - limit, middle + limit))
                for name, (middle, limit) in self._limits.items()
                if limit
            },
            target=replace(target, start=track[0, 1:]) if self._waypoints else target,
            current=current_of(self._episodes, self._row),
            title=f"{self._episodes.task.name}   {self._episodes.plant.title or self._episodes.plant.name}",
            caption=f"{track[-1, 0]:.1f} s",
        )

    def _states(self, *names: str) -> tuple[Any, ...]:
        return tuple(float(self._row[self._at[name]]) for name in names)


def current_of(episodes: Episodes, row: np.ndarray) -> tuple[float, float] | None:
    """The steady current, if a plant drives the environment; drawn values override the plant's."""
    if not isinstance(episodes.driver, Plant) or episodes.by_model:
        return None
    drawn = episodes.randomised_values(row)
    paths = ("effects.current.north", "effects.current.east")
    north, east = (drawn.get(path, value_at(episodes.driver, path)) for path in paths)
    return (north, east) if north or east else None
