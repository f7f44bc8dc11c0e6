"""The track of a float's dive, as a scene to draw."""

from __future__ import annotations

import numpy as np

from auv_gym.envs.episodes import Episodes
from auv_gym.rendering import Dive


class FloatView:
    """The view of one environment, whose row it reads."""

    def __init__(self, episodes: Episodes, row: np.ndarray):
        family, settings = episodes.plant.family, episodes.settings
        self._episodes, self._row, self._record = episodes, row, episodes.record(row)
        self._depth_at = int(settings["state_at"]) + family.states.index("depth_m")
        self._share_at = len(family.outputs) + len(episodes.kind.layout.geometry) + int(settings["engine"])
        self._middle, self._half = float(episodes.middles[0]), float(episodes.limits[0])
        self._track: list[tuple[float, ...]] = []

    def follow(self, begin: bool = False) -> None:
        """Add the present moment to the track; begin: whether an episode begins."""
        if begin:
            self._track = []
        record = self._record
        moment = (record["time"], self._row[self._depth_at], record["target"][0])
        shares = (record["features"][self._share_at], record["position"])
        self._track.append((*map(float, moment), *(self._middle + self._half * float(share) for share in shares)))

    def scene(self) -> Dive:
        """The present moment and the track so far, as a `Dive`."""
        time, depth, target, command, position = np.array(self._track).T
        plant = self._episodes.plant
        # not from the state, which a model need not have
        rate = np.diff(depth, prepend=depth[0]) / np.maximum(np.diff(time, prepend=time[0] - 1.0), 1e-9)
        return Dive(
            time=time,
            depth=depth,
            rate=rate,
            target=target,
            command=command,
            position=position,
            engine=self._episodes.actions[0],
            limits=(self._middle - self._half, self._middle + self._half),
            title=f"{self._episodes.task.name}   {plant.title or plant.name}",
            caption=f"{time[-1]:.1f} s",
        )
