"""Pictures of the manoeuvres: a sheet per vehicle in metres and seconds, and all vehicles in their own lengths.

Needs the extra `render`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, degrees, pi, sin
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym.records.record import Record
from identification.pages.drawing import AFTER, BEFORE, INK, INPUT, QUIET

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from scripts.studies.manoeuvres.trials import Result

TURNS: dict[str, dict[str, Any]] = {"starboard": {"color": AFTER}, "port": {"color": BEFORE, "linestyle": "--"}}
LOOKS: list[dict[str, Any]] = [
    {"color": AFTER},
    {"color": BEFORE, "linestyle": "--"},
    {"color": INPUT, "linestyle": "-."},
    {"color": "#a8527f", "linestyle": (0, (1, 1))},
    {"color": INK, "linestyle": (0, (5, 1, 1, 1, 1, 1))},
]
TRACK = 1.0  # points, thinner than the outlines on it
BEAM = 2.0  # times too wide, or a slender vehicle is a stroke on its track


def sheet(result: Result) -> Figure:
    """One vehicle: plan view, rates and speed of the turns; both zigzags; the depth change."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.6, 7.6), layout="constrained")
    grid = figure.add_gridspec(3, 4)
    trial = result.trial
    _plan(figure.add_subplot(grid[:2, :2]), result)
    for cell, name, title in (
        (grid[2, 0], "r_radps", "yaw rate in the turns, deg/s"),
        (grid[2, 1], "roll_rad", "roll in the turns, deg (starboard down)"),
        (grid[2, 2], "u_mps", "forward speed in the turns, m/s"),
    ):
        axes = figure.add_subplot(cell)
        for side, look in TURNS.items():
            run = result.runs[f"turn to {side}"]
            axes.plot(run.time, run[name] if name == "u_mps" else np.degrees(run[name]), **look)
        _time_axis(axes, title)
    axes.set_ylim(bottom=0.0)
    to_starboard = 1.0 if trial.plant.parts.rudder.moment > 0.0 else -1.0
    for row, angle in enumerate(result.zigzags):
        run, axes = result.runs[f"zigzag {angle}/{angle}"], figure.add_subplot(grid[row, 2])
        order = to_starboard * np.degrees(run["rudder_rad"][:-1])  # without the fifth execute
        axes.step(run.time[:-1], order, where="post", color=INPUT, linewidth=1.0, label="rudder order, to starboard")
        axes.plot(run.time, np.degrees(run["heading_rad"]), color=INK, label="heading")
        _time_axis(axes, f"zigzag {angle}/{angle}: heading and rudder, deg")
    dive = result.runs["depth change"]
    for row, (name, title) in enumerate(
        (
            ("depth_m", "depth change: depth, m"),
            ("pitch_rad", "pitch, deg (nose up)"),
            ("stern_plane_rad", "stern plane command, deg"),
        )
    ):
        axes = figure.add_subplot(grid[row, 3])
        values = dive[name] if name == "depth_m" else np.degrees(dive[name])
        axes.plot(dive.time, values, color=INK if name != "stern_plane_rad" else INPUT)
        if name == "depth_m":
            axes.axhline(values[0] + 10.0, color=QUIET, linewidth=0.8, linestyle=":")
            axes.invert_yaxis()
        _time_axis(axes, title)
    title = trial.plant.title or trial.plant.name
    figure.suptitle(f"{title}, at {trial.cruise.speed:.2f} m/s", x=0.01, ha="left", fontweight="bold")
    shown: dict[str, Any] = {}
    for axes in figure.axes:
        shown |= dict(zip(*axes.get_legend_handles_labels()[::-1]))
    figure.legend(list(shown.values()), list(shown), loc="outside upper right", ncols=len(shown))
    return figure


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
        _outlines(plan, run, 1.0, trial.plant.hull.diameter / length, look["color"], 1.0 / length)
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


def _plan(axes: Axes, result: Result) -> None:
    """Plan view of the turns, with the vehicle at every quarter of a turn and where 90 and 180 deg are read."""
    hull = result.trial.plant.hull
    for side, look in TURNS.items():
        run = result.runs[f"turn to {side}"]
        axes.plot(run["east_m"], run["north_m"], label=f"turn to {side}", linewidth=TRACK, **look)
        _outlines(axes, run, hull.length, hull.diameter, look["color"])
    run, turn = result.runs["turn to starboard"], result.turns["starboard"]
    _measure(axes, (0.0, 0.0), (0.0, turn.advance), (0.0, turn.advance), f"advance {turn.advance:.1f} m")
    half = int(np.argmax(np.abs(run["heading_rad"]) >= pi))
    low = float(run["north_m"][half])
    width = turn.tactical_diameter
    _measure(axes, (0.0, low), (width, low), (0.5 * width, low), f"tactical diameter {width:.1f} m")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(
        f"turning circles, rudder {degrees(result.trial.plant.parts.rudder.limit):.0f}°: north, m", loc="left"
    )
    axes.set_xlabel("east, m")


def _measure(
    axes: Axes, start: tuple[float, float], end: tuple[float, float], above: tuple[float, float], text: str
) -> None:
    """A dimension line from start to end, with its text above a point."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": "<->", "color": QUIET, "linewidth": 0.8}, zorder=1.5)
    axes.annotate(text, above, (0, 4), textcoords="offset points", ha="center", va="bottom", fontsize=8.5, color=QUIET)


def _outlines(axes: Axes, run: Record, length: float, diameter: float, color: str, scale: float = 1.0) -> None:
    """The vehicle, BEAM times as wide, at every quarter of the first turn; the run's positions are times scale."""
    turned = np.abs(run["heading_rad"] - run["heading_rad"][0])
    x, y = _outline(length, BEAM * diameter)
    north, east, heading = (run[name] for name in ("north_m", "east_m", "heading_rad"))
    for quarter in range(4):
        k = int(np.argmax(turned >= quarter * pi / 2.0))
        c, s = cos(heading[k]), sin(heading[k])
        outline = (scale * east[k] + s * x + c * y, scale * north[k] + c * x - s * y)
        axes.fill(*outline, facecolor=color, linewidth=0.0, zorder=2.5)


def _outline(length: float, diameter: float) -> tuple[np.ndarray, np.ndarray]:
    """A torpedo from above, x forward and y starboard: a round nose, a tapered tail with fins."""
    bow = np.linspace(0.0, pi / 2.0, 12)
    x = np.concatenate([[-0.5, -0.49, -0.41, -0.36, -0.25], 0.15 + 0.35 * np.sin(bow)])
    y = 0.5 * np.concatenate([[0.3, 1.6, 1.6, 0.7, 1.0], np.cos(bow)])
    return length * np.concatenate([x, x[::-1]]), diameter * np.concatenate([y, -y[::-1]])


def _time_axis(axes: Axes, title: str) -> None:
    axes.set_title(title, loc="left")
    axes.set_xlabel("time, s")
    axes.margins(x=0.0)
    axes.locator_params(axis="y", nbins=6)
