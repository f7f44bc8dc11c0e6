"""Plan view of a heading task as an image: track, compass rose with heading and target, rudder."""

from __future__ import annotations

from math import cos, degrees, pi, sin

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

_INK, _PALE, _VEHICLE, _TARGET, _RUDDER = "#1d2b38", "#c9d5dd", "#0b6e99", "#d1495b", "#e09f3e"
_GLIDER = np.array(  # plan of a glider, nose at (1, 0), length 2: hull, swept wings, tail
    [
        (1.0, 0.0), (0.88, 0.10), (0.30, 0.13), (-0.05, 0.80), (-0.20, 0.80), (-0.05, 0.13), (-0.75, 0.10),
        (-0.90, 0.28), (-1.0, 0.28), (-0.97, 0.0),
    ]
)  # fmt: skip


def draw_plan_view(
    trail: np.ndarray, *, heading: float, target: float, rudder: float, rudder_limit: float, caption: str
) -> np.ndarray:
    """An RGB image, shape (640, 960, 3), uint8, north up.

    trail: positions north, east, m, oldest first, shape (n, 2).  Angles in rad, clockwise from north.
    """
    figure = Figure(figsize=(9.6, 6.4), dpi=100, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    figure.text(0.07, 0.93, caption, color=_INK, fontsize=12)
    figure.text(0.82, 0.93, f"heading {degrees(heading) % 360.0:.1f}°", color=_VEHICLE, fontsize=13, ha="center")
    figure.text(0.82, 0.88, f"target {degrees(target) % 360.0:.1f}°", color=_TARGET, fontsize=13, ha="center")
    _draw_track(figure.add_axes((0.07, 0.10, 0.56, 0.80)), trail, heading, target)
    _draw_rose(figure.add_axes((0.68, 0.36, 0.28, 0.42), projection="polar"), heading, target)
    _draw_rudder(figure.add_axes((0.68, 0.13, 0.28, 0.05)), rudder, rudder_limit)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _draw_track(axes, trail: np.ndarray, heading: float, target: float) -> None:
    north, east = trail[:, 0], trail[:, 1]
    half = max(0.62 * max(np.ptp(north), np.ptp(east)), 15.0)
    middle_north, middle_east = 0.5 * (north.min() + north.max()), 0.5 * (east.min() + east.max())
    size = 0.07 * half
    axes.plot(east, north, color=_VEHICLE, linewidth=1.6, alpha=0.65, solid_capstyle="round")
    axes.plot(east[0], north[0], "o", color="white", markeredgecolor=_VEHICLE, markersize=6)
    tip = (east[-1] + 0.30 * half * sin(target), north[-1] + 0.30 * half * cos(target))
    axes.plot([east[-1], tip[0]], [north[-1], tip[1]], color=_TARGET, linewidth=1.4, linestyle=(0, (4, 3)))
    outline = np.vstack([_GLIDER, _GLIDER[::-1] * (1.0, -1.0)]) * size
    forward, starboard = outline[:, 0], outline[:, 1]
    points = np.column_stack(
        [
            east[-1] + forward * sin(heading) + starboard * cos(heading),
            north[-1] + forward * cos(heading) - starboard * sin(heading),
        ]
    )
    axes.add_patch(Polygon(points, closed=True, facecolor=_VEHICLE, edgecolor="white", linewidth=0.8, zorder=5))
    axes.set_xlim(middle_east - half, middle_east + half)
    axes.set_ylim(middle_north - half, middle_north + half)
    axes.set_aspect("equal")
    axes.grid(color=_PALE, linewidth=0.6)
    axes.tick_params(colors=_INK, labelsize=9)
    axes.set_xlabel("east, m", color=_INK)
    axes.set_ylabel("north, m", color=_INK)
    for spine in axes.spines.values():
        spine.set_color(_PALE)


def _draw_rose(axes, heading: float, target: float) -> None:
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    axes.set_ylim(0.0, 1.0)
    axes.set_yticks([])
    axes.set_xticks(
        np.arange(12) * pi / 6.0, ["N", "30", "60", "E", "120", "150", "S", "210", "240", "W", "300", "330"]
    )
    axes.tick_params(colors=_INK, labelsize=9, pad=1)
    axes.grid(color=_PALE, linewidth=0.6)
    axes.spines["polar"].set_color(_PALE)
    axes.plot([target, target], [0.0, 0.92], color=_TARGET, linewidth=1.6, linestyle=(0, (4, 3)))
    axes.plot(target, 0.95, "D", color=_TARGET, markersize=7, clip_on=False)
    axes.annotate(
        "", (heading, 0.90), (heading + pi, 0.35), arrowprops={"arrowstyle": "-|>", "color": _VEHICLE, "lw": 3}
    )


def _draw_rudder(axes, rudder: float, limit: float) -> None:
    stop = degrees(limit)
    axes.add_patch(Rectangle((-stop, 0.0), 2.0 * stop, 1.0, facecolor="#f1f5f7", edgecolor=_PALE))
    axes.add_patch(Rectangle((0.0, 0.0), degrees(rudder), 1.0, facecolor=_RUDDER))
    axes.axvline(0.0, color=_INK, linewidth=1.0)
    axes.set_xlim(-stop, stop)
    axes.set_ylim(0.0, 1.0)
    axes.set_yticks([])
    axes.set_xticks([-stop, 0.0, stop], [f"{-stop:.0f}", "0", f"{stop:.0f}"])
    axes.tick_params(colors=_INK, labelsize=9)
    axes.set_title(f"rudder command {degrees(rudder):+5.1f}°", color=_INK, fontsize=11, pad=6)
    for spine in axes.spines.values():
        spine.set_visible(False)
