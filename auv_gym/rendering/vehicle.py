"""Drawing of a vehicle in six degrees of freedom from above and from the side, with its parts in place."""

from __future__ import annotations

from itertools import pairwise
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

_HULL, _PART, _GREY = "#8aa4b8", "#b3471d", "#555555"
_INK = 8.0  # points around a name that should be free of lines
_VIEWS = (("from above", 1, "starboard, m"), ("from the side", 2, "down, m"))


def draw_vehicle(plant: Any) -> Figure:
    """Draw the hull, its centres of gravity and buoyancy, and the sketch of each part, to scale.

    plant: a vehicle of family "body".  Raises ValueError for others, which have no parts.
    """
    body = plant.family.body
    if body is None:
        raise ValueError(
            f"A drawing needs a vehicle with a hull and parts, such as remus100; {plant.name} has none (its family is "
            f"{plant.family.name!r})."
        )
    hull = plant.hull
    ends = [np.abs(np.array(s.points)[:, 1:]).max() for p in body.parts for s in p.found.sketch(_own(plant, p))]
    wide, half = 0.625 * hull.length, 1.3 * max(0.0, *ends, 0.5 * hull.diameter, 0.17 * hull.length)
    width = min(9.0, 9.0 * wide / half * 10.6 / 16.0)  # inches; a stubby vehicle's two views still fit a page
    layout = ConstrainedLayoutEngine(w_pad=0.15, h_pad=0.08)
    figure = Figure(figsize=(width, 1.4 + 16.0 / 9.0 * width * half / wide), layout=layout)
    figure.suptitle(fill(plant.title or plant.name, int(10.0 * width)), fontsize=12)  # a letter is 7 points wide
    points = 0.85 * 72.0 * width / (2.0 * wide)  # least number of points for each metre
    for axes, (view, across, label) in zip(figure.subplots(2, 1, sharex=True), _VIEWS, strict=True):
        x, y = _outline(hull.length, hull.diameter)
        axes.fill(x, y, facecolor=_HULL, alpha=0.35, edgecolor=_HULL)
        heavy, light = (hull.x_g, hull.y_g, hull.z_g), (hull.x_b, hull.y_b, hull.z_b)
        axes.plot(heavy[0], heavy[across], "k+", zorder=3.0, label="centre of gravity of the hull")
        axes.plot(light[0], light[across], "kx", zorder=3.0, label="centre of buoyancy")
        sketches = {p: [np.array(s.points) for s in p.found.sketch(_own(plant, p))] for p in body.parts}
        marks = [np.array([heavy]), np.array([light]), *(_along(line) for of in sketches.values() for line in of)]
        inked = points * np.vstack(marks)[:, [0, across]]
        taken: list[np.ndarray] = []
        for part, lines in sketches.items():
            for line in lines:
                axes.plot(line[:, 0], line[:, across], color=_PART, linewidth=2.5, marker="o", markersize=3.5)
            if not lines:
                continue
            at = 0.5 * (np.vstack(lines).min(axis=0) + np.vstack(lines).max(axis=0))
            axes.annotate(
                part.title,
                (at[0], at[across]),
                (0, _free_row(points * at[[0, across]], points * half, part.title, taken, inked)),
                textcoords="offset points",
                ha="center",
                fontsize=8,
                color=_PART,
                bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 0.8},
                arrowprops={"arrowstyle": "-", "color": _PART, "linewidth": 0.5},
            )
        axes.set_ylabel(label)
        axes.set_title(view, loc="left", fontsize=9, color=_GREY)
        axes.set_aspect("equal")
        axes.set_xlim(-wide, wide)
        axes.set_ylim(half, -half)
        axes.grid(alpha=0.25)
    nowhere = [part.title for part, lines in sketches.items() if not lines]
    if nowhere:
        told = fill(f"not drawn (no position given): {', '.join(nowhere)}", int(9.0 * width))
        axes.set_title(told, loc="right", fontsize=9, color=_GREY)
    axes.set_xlabel("forward, m")
    axes.legend(loc="lower left", fontsize=8, frameon=False)
    return figure


def _free_row(at: np.ndarray, edge: float, text: str, taken: list[np.ndarray], inked: np.ndarray) -> int:
    """Distance of a name above its part, points, at which it meets no name of ``taken``, to which it is added.

    at: the part's middle, points to the right and down.  edge: of the picture, points above and below its middle.
    inked: (n, 2), points of lines and marks; a name covers them only if it has no other place.
    """
    size = np.array([5.0 * len(text) + 4.0, 11.0])
    rows = [sign * (26 + 12 * row) for row in range(9) for sign in (1, -1)]

    def free(row: int) -> bool:
        middle = at - np.array([0.0, row + 4.0])
        apart = all((np.abs(middle - other[0]) >= 0.5 * (size + other[1])).any() for other in taken)
        return apart and abs(middle[1]) + 8.0 < edge

    def clear(row: int) -> bool:
        middle = at - np.array([0.0, row + 4.0])
        return bool((np.abs(inked - middle) >= 0.5 * size + _INK).any(axis=1).all())

    possible = [row for row in rows if free(row)]
    row = next((row for row in possible if clear(row)), next(iter(possible), None))
    taken.append(np.array([at if row is None else at - np.array([0.0, row + 4.0]), size]))
    return rows[0] if row is None else row


def _along(line: np.ndarray) -> np.ndarray:
    """Points along a line through (n, 3) corners, close enough that no name fits between them."""
    shares = np.linspace(0.0, 1.0, 21)[:, None]
    return np.vstack([a + shares * (b - a) for a, b in pairwise(line)])


def _own(plant: Any, part: Any) -> Any:
    return getattr(plant.parameters.parts, part.name)


def _outline(length: float, diameter: float) -> tuple[np.ndarray, np.ndarray]:
    """A hull with a round nose and a tapered tail."""
    x = np.linspace(-0.5, 0.5, 201)
    nose, tail = np.clip((0.5 - x) / 0.15, 0.0, 1.0), np.clip((x + 0.5) / 0.3, 0.0, 1.0)
    half = 0.5 * diameter * np.sqrt(nose * (2.0 - nose)) * tail**0.6
    return length * np.r_[x, x[::-1]], np.r_[half, -half[::-1]]
