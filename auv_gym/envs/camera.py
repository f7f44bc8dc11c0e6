"""Pictures of a run, made only by an environment with a render mode; drawing needs `render`."""

from __future__ import annotations

import numpy as np

from auv_gym.envs.episodes import Episodes
from auv_gym.envs.float_view import FloatView
from auv_gym.envs.torpedo_view import TorpedoView


class Camera:
    """Follows one environment, whose row it reads, and draws it."""

    def __init__(self, episodes: Episodes, row: np.ndarray, human: bool):
        from auv_gym.rendering import Renderer, Window  # with matplotlib, so not before it is wanted

        self._renderer = Renderer()
        self._window = Window(f"{episodes.task.name}, {episodes.plant.name}") if human else None
        self._view = (FloatView if episodes.task.kind == "float" else TorpedoView)(episodes, row)

    def follow(self, begin: bool = False) -> None:
        """Take the present moment into the track, of a new episode if it begins; show it where there is a window."""
        self._view.follow(begin)
        if self._window is not None:
            self._window.show(self.picture())

    def picture(self) -> np.ndarray:
        """An RGB image of the present moment, shape (height, width, 3), uint8."""
        return self._renderer.draw(self._view.scene())

    def close(self) -> None:
        """Close the window and free the paper."""
        self._renderer.close()
        if self._window is not None:
            self._window.close()
