"""The picture of the manoeuvres: all vehicles, in units of their lengths.

Needs the extra `render`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, degrees, pi, sin
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym.records.record import Record
from identification.pages.drawing import AFTER, BEFORE, INK, INPUT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from scripts.studies.manoeuvres.trials import Result

LOOKS: list[dict[str, Any]] = [
    {"color": AFTER},
    {"color": BEFORE, "linestyle": "--"},
    {"color": INPUT, "linestyle": "-."},
    {"color": "#a8527f", "linestyle": (0, (1, 1))},
    {"color": INK, "linestyle": (0, (5, 1, 1, 1, 1, 1))},
]
TRACK = 1.0  # points; thinner than the outlines on it
BEAM = 2.0  # exaggeration of the width, since a slender vehicle would look like a line on its track


def overview(results: Sequence[Result]) -> Figure:
    """All vehicles: turning circles to starboard, zigzags and depth changes, in lengths and in times L/V."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.4, 6.2), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.25, 1.0))
    plan = figure.add_subplot(grid[:, 0])
    panels = [figure.add_subplot(grid[row, 1]) for row in range(3)]
    for result, look in zip(results, (LOOKS[i % len(LOOKS)] for i in range(len(results)))):
        trial, length = result.trial, result.trial.length
        run = result.runs["turn to starboard"]
        rudder = degrees(trial.plant.parts.rudder.limit)
        label = f"{trial.plant.name}, rudder {rudder:.0f}°"
        plan.plot(run["east_m"] / length, run["north_m"] / length, label=label, linewidth=TRACK, **look)
        _outlines(plan, run, length, trial.plant.hull.diameter, look["color"])
        seconds = length / trial.cruise.speed
        for axes, angle in zip(panels, result.zigzags):
            zigzag = result.runs[f"zigzag {angle}/{angle}"]
            axes.plot(zigzag.time / seconds, np.degrees(zigzag["heading_rad"]), **look)
        dive = result.runs["depth change"]
        panels[2].plot(dive.time / seconds, (dive["depth_m"] - dive["depth_m"][0]) / length, **look)
    plan.set_aspect("equal", adjustable="datalim")
    plan.set_title("turning circle to starboard: north, lengths", loc="left")
    plan.set_xlabel("east, lengths")
    for axes, angle in zip(panels, results[0].zigzags):
        axes.set_title(f"zigzag {angle}/{angle}: heading, deg", loc="left")
    panels[2].set_title("10 m deeper: depth, lengths", loc="left")
    panels[2].invert_yaxis()
    for axes in panels:
        axes.margins(x=0.0)
        axes.set_xlabel("time, L/V")
    figure.legend(*plan.get_legend_handles_labels(), loc="outside upper left", ncols=len(results))
    return figure


def _outlines(axes: Axes, run: Record, length: float, diameter: float, color: str) -> None:
    """The vehicle in lengths, BEAM times as wide, at every quarter of the first turn."""
    turned = np.abs(run["heading_rad"] - run["heading_rad"][0])
    x, y = _outline(BEAM * diameter / length)
    north, east, heading = (run[name] for name in ("north_m", "east_m", "heading_rad"))
    for quarter in range(4):
        k = int(np.argmax(turned >= quarter * pi / 2.0))
        c, s = cos(heading[k]), sin(heading[k])
        outline = (east[k] / length + s * x + c * y, north[k] / length + c * x - s * y)
        axes.fill(*outline, facecolor=color, linewidth=0.0, zorder=2.5)


def _outline(diameter: float) -> tuple[np.ndarray, np.ndarray]:
    """A torpedo of length 1 from above, x forward and y starboard: a round nose, a tapered tail with fins."""
    bow = np.linspace(0.0, pi / 2.0, 12)
    x = np.concatenate([[-0.5, -0.49, -0.41, -0.36, -0.25], 0.15 + 0.35 * np.sin(bow)])
    y = 0.5 * np.concatenate([[0.3, 1.6, 1.6, 0.7, 1.0], np.cos(bow)])
    return np.concatenate([x, x[::-1]]), diameter * np.concatenate([y, -y[::-1]])
