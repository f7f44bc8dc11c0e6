"""The track of a glider, as a scene to draw."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from auv_gym.envs.episodes import Episodes
from auv_gym.rendering import Scene, Target


class GliderView:
    """The view of one environment, whose row it reads."""

    def __init__(self, episodes: Episodes, row: np.ndarray):
        family, driver = episodes.plant.family, episodes.driver
        self._episodes, self._row, self._record = episodes, row, episodes.record(row)
        state_at = int(episodes.settings["state_at"])
        self._at = [state_at + family.states.index(name) for name in ("heading_rad", "north_m", "east_m")]
        self._speed_at = family.inputs.index("u_mps")
        self._rudder_at = family.inputs.index("rudder_rad")
        self._knows_position = {"north_m", "east_m"} <= {*driver.states, *driver.outputs}
        self._track: list[tuple[float, float, float]] = []

    def follow(self, begin: bool = False) -> None:
        """Add the present position, by dead reckoning if a model has none, to the track; begin: of a new episode."""
        if begin:
            self._track = []
        time = float(self._record["time"])
        heading, north, east = (float(self._row[at]) for at in self._at)
        if not self._knows_position:
            before, north, east = self._track[-1] if self._track else (time, 0.0, 0.0)
            run = (time - before) * float(self._record["command"][self._speed_at])
            north, east = north + run * cos(heading), east + run * sin(heading)
        self._track.append((time, north, east))

    def scene(self) -> Scene:
        """The present moment and the track so far."""
        episodes, command = self._episodes, self._record["command"]
        time, north, east = np.array(self._track).T
        return Scene(
            trail=np.column_stack([north, east, np.zeros(north.size)]),
            time=time,
            attitude=(0.0, 0.0, float(self._row[self._at[0]])),
            speed=float(command[self._speed_at]),
            commands={"rudder_rad": (float(command[self._rudder_at]), float(episodes.limits[0]))},
            target=Target(heading=float(self._record["target"][0])),
            title=f"{episodes.task.name}   {episodes.plant.title or episodes.plant.name}",
            caption=f"{time[-1]:.1f} s",
            level=True,
        )
