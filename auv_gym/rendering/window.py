"""A window on the screen that shows a sequence of pictures."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.registry import BackendFilter, backend_registry

_DPI = 100.0


class Window:
    """A matplotlib window, opened by the first picture; once its user has closed it, pictures are ignored."""

    def __init__(self, title: str = "auv-gym"):
        self.title = title
        self._figure: Any = None
        self._image: Any = None

    def show(self, picture: np.ndarray) -> None:
        """Show a picture, shape (height, width, 3), uint8; raises RuntimeError if no window can be opened."""
        if self._figure is None:
            self._figure, self._image = self._opened(picture)
        if self.closed_by_user:
            return
        self._image.set_data(picture)
        self._figure.canvas.draw_idle()
        self._figure.canvas.flush_events()

    @property
    def closed_by_user(self) -> bool:
        """Whether the window was opened and then closed."""
        from matplotlib import pyplot

        return self._figure is not None and not pyplot.fignum_exists(self._figure.number)

    def close(self) -> None:
        """Close the window; the next picture opens a new one."""
        if self._figure is not None:
            from matplotlib import pyplot

            pyplot.close(self._figure)
            self._figure = self._image = None

    def _opened(self, picture: np.ndarray) -> tuple[Any, Any]:
        from matplotlib import pyplot  # importing pyplot chooses a backend, so it waits until a window is needed

        backend = matplotlib.get_backend()
        if backend.lower() in backend_registry.list_builtin(BackendFilter.NON_INTERACTIVE):
            raise RuntimeError(_no_window(f"matplotlib has chosen {backend!r}, which only writes files"))
        height, width = picture.shape[:2]
        try:
            with matplotlib.rc_context({"toolbar": "None"}):
                figure = pyplot.figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI)
        except (ImportError, RuntimeError) as error:
            raise RuntimeError(_no_window(str(error))) from error
        if figure.canvas.manager is not None:
            figure.canvas.manager.set_window_title(self.title)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        image = axes.imshow(picture, interpolation="bilinear")
        pyplot.show(block=False)
        return figure, image


def _no_window(reason: str) -> str:
    return (
        f"render_mode='human' needs a display and a toolkit for windows, such as tkinter or PyQt ({reason}): "
        "use render_mode='rgb_array' instead."
    )
