"""Pictures of a run, one after the other, drawn or shown in a window."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.rendering.renderer import Renderer
from auv_gym.rendering.window import Window


class Camera:
    """Draws a view, which has `follow(begin)` and `scene()`; window: the title of a window to show it in."""

    def __init__(self, view: Any, window: str = ""):
        self._renderer = Renderer()
        self._window = Window(window) if window else None
        self._view = view

    def follow(self, begin: bool = False) -> None:
        """Add the present moment to the track, a new one with `begin`; show it if there is a window."""
        self._view.follow(begin)
        if self._window is not None:
            self._window.show(self.picture())

    def picture(self) -> np.ndarray:
        """An RGB image of the present moment, shape (height, width, 3), uint8."""
        return self._renderer.draw(self._view.scene())

    def close(self) -> None:
        """Close the window and free the drawing surface."""
        self._renderer.close()
        if self._window is not None:
            self._window.close()
