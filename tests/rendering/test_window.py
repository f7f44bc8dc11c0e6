import importlib
import subprocess
import sys

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot

from auv_gym.rendering import Window, window as window_module

PICTURE = np.full((60, 96, 3), 200, np.uint8)


def test_without_a_display_the_error_names_the_mode_that_works(monkeypatch):
    monkeypatch.setitem(matplotlib.rcParams, "backend", "agg")
    with pytest.raises(RuntimeError, match="render_mode='rgb_array'"):
        Window().show(PICTURE)


def test_a_toolkit_that_fails_is_reported_in_the_same_way(monkeypatch):
    def broken(*_, **__):
        raise ImportError("no tkinter here")

    monkeypatch.setattr(window_module.backend_registry, "list_builtin", lambda _: [])
    monkeypatch.setattr(pyplot, "figure", broken)
    with pytest.raises(RuntimeError, match=r"no tkinter here.*render_mode='rgb_array'"):
        Window().show(PICTURE)


def test_a_window_shows_the_last_picture_and_stays_closed_once_its_user_has_closed_it(monkeypatch):
    monkeypatch.setitem(matplotlib.rcParams, "backend", "agg")
    monkeypatch.setattr(window_module.backend_registry, "list_builtin", lambda _: [])  # agg may pass for a screen
    monkeypatch.setattr(pyplot, "show", lambda block: None)
    window = Window("test")
    window.show(PICTURE)
    window.show(PICTURE // 2)
    (number,) = pyplot.get_fignums()
    shown = pyplot.figure(number).axes[0].images[0]
    assert (shown.get_array() == 100).all()
    assert not window.closed_by_user
    pyplot.close(number)
    assert window.closed_by_user
    window.show(PICTURE)
    assert pyplot.get_fignums() == []
    window.close()
    window.show(PICTURE)
    assert len(pyplot.get_fignums()) == 1
    window.close()
    window.close()
    assert pyplot.get_fignums() == []


def test_without_matplotlib_the_error_names_the_extra(monkeypatch):
    for name in [name for name in sys.modules if name.startswith("auv_gym.rendering")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match=r"pip install '\.\[render\]'"):
        importlib.import_module("auv_gym.rendering")


def test_environments_load_no_matplotlib_until_asked():
    program = "import sys, gymnasium as g, auv_gym.envs; g.make('auv_gym/GliderHeading-v0'); "
    program += "sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
