"""Pictures of a run, one after the other, drawn or shown in a window."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.rendering.renderer import Renderer
from auv_gym.rendering.window import Window


class Camera:
    """Follows a view, which has `follow(begin)` and `scene()`, and draws it; window: the title of one to show it in."""

    def __init__(self, view: Any, window: str = ""):
        self._renderer = Renderer()
        self._window = Window(window) if window else None
        self._view = view

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
