"""The track and yos of a glider as a scene to draw, shared by several kinds of glider."""

from __future__ import annotations

import numpy as np

from auv_gym.envs.episodes import Episodes
from auv_gym.envs.track import current_of
from auv_gym.rendering import Scene, Target


class YoView:
    """The view of one environment, whose row it reads."""

    def __init__(self, episodes: Episodes, row: np.ndarray):
        family, state_at = episodes.plant.family, int(episodes.settings["state_at"])
        self._episodes, self._row, self._record = episodes, row, episodes.record(row)
        self._at = [state_at + family.states.index(name) for name in ("north_m", "east_m", "depth_m", "heading_rad")]
        self._attitude = [family.outputs.index(name) for name in ("roll_rad", "pitch_rad")]
        self._track: list[tuple[float, ...]] = []
        self._waypoints: list[np.ndarray] = []

    def follow(self, begin: bool = False) -> None:
        """Add the present position to the track; begin: whether an episode begins."""
        if begin:
            self._track, self._waypoints = [], []
        record = self._record
        self._track.append((float(record["time"]), *(float(self._row[at]) for at in self._at[:3])))
        for point in (record["target"], record["next"])[len(self._waypoints) - int(record["reached"]) :]:
            self._waypoints.append(point[:3].copy())

    def scene(self) -> Scene:
        """The present moment and the track so far."""
        episodes, record = self._episodes, self._record
        track, told = np.array(self._track), dict(zip(episodes.plant.inputs, record["command"].tolist(), strict=True))
        current = current_of(episodes, self._row)
        speed = 0.0
        if len(track) > 1:
            step = np.diff(track[-2:], axis=0)[0]
            speed = float(np.linalg.norm(step[1:] / step[0] - [*(current or (0.0, 0.0)), 0.0]))
        roll, pitch = (float(record["raw"][at]) for at in self._attitude)
        return Scene(
            trail=track[:, 1:],
            time=track[:, 0],
            attitude=(roll, pitch, float(self._row[self._at[3]])),
            speed=speed,
            commands={
                name: (told[name], (middle - limit, middle + limit))
                for name, middle, limit in zip(episodes.actions, episodes.middles, episodes.limits, strict=True)
            },
            target=Target(
                waypoints=np.array(self._waypoints),
                active=int(record["reached"]),
                radius=float(episodes.settings["radius"]),
                start=track[0, 1:],
                level=True,
            ),
            current=current,
            title=f"{episodes.task.name}   {episodes.plant.title or episodes.plant.name}",
            caption=f"{track[-1, 0] / 3600.0:.2f} h, {float(record['energy']) / 1e3:.1f} kJ",
        )
