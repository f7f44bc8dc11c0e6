"""Figures of an order search: the error of every model and the criteria's choices; singular values.

Needs the extra `render`.  Functions return a matplotlib Figure, for `figure.savefig`; `drawing.svg` turns it into text.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym.channels import channel
from identification.linear.polynomials.orders import CRITERIA, Cell, OrderSearch
from identification.pages.drawing import INK, QUIET, grid, new_figure, shown_values, with_unit
from identification.pages.model_figures import LOOKS, legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = {"aic": "#d55e00", "mdl": "#0072b2", "bic": "#00785a", "held_out": "#b0558f", "parsimony": "#b07d00"}
_MARKS = {"aic": "s", "mdl": "o", "bic": "D", "held_out": "^", "parsimony": "v"}
_WRITTEN = 48  # most cells of a map whose values are printed in them
_DARK = 0.55  # of the colour scale; white letters are used below it
_ROOM = 1.35  # range of the y axis, over the largest value next to a choice


def order_figure(search: OrderSearch) -> Figure:
    """One-step error over the orders, and criteria over the number of parameters, per output, with choices marked.

    The map has the best model for each n_a and n_b, over all n_c and delays.  Criteria are drawn as errors: the root of
    AIC and MDL, and of exp(BIC / N), which ranks models like BIC.  Models beyond the panel are worse.
    """
    outputs = search.outputs
    judged = "held_out" in search.criteria
    figure = new_figure(3.1 * len(outputs) + 0.4)
    panels = figure.subplots(len(outputs), 3 if judged else 2, squeeze=False)
    for (left, middle, *right), output in zip(panels, outputs):
        cells = [cell for cell in search.of(output) if not cell.problem]
        chosen = {name: search.best(output, name) for name in search.criteria}
        _draw_map(left, cells, chosen, output)
        _draw_criteria(middle, cells, chosen, output, search.rows[output])
        if right:
            _draw_held_out(right[0], cells, chosen, output)
    legend(figure, panels[:, 1])
    return figure


def singular_value_figure(fit: Any) -> Figure:
    """Singular values of a subspace fit, from which its order was chosen.  fit: has `singular_values` and `order`."""
    values = np.asarray(fit.singular_values, dtype=float)
    order = int(fit.order)
    figure = new_figure(2.9)
    axes = grid(figure, 1, 1)[0]
    number = np.arange(1, values.size + 1)
    seen = np.maximum(values, 1e-16 * values.max(initial=1e-300))
    kept = number <= order
    axes.semilogy(number, seen, color=QUIET, linewidth=0.9, zorder=1.5)
    axes.semilogy(number[kept], seen[kept], "o", color=LOOKS[0]["color"], markersize=6, label=f"kept: order {order}")
    axes.semilogy(number[~kept], seen[~kept], "o", color=QUIET, markerfacecolor="white", markersize=5, label="left out")
    axes.axvline(order + 0.5, color=INK, linewidth=0.8, linestyle=":")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_title("singular value (no unit)", loc="left")
    axes.set_xlabel("number of the state")
    legend(figure, [axes])
    return figure


def _draw_map(axes, cells: Sequence[Cell], chosen: dict[str, Cell], output: str) -> None:
    from matplotlib.colors import LogNorm

    rows, columns = (sorted({getattr(cell, name) for cell in cells}) for name in ("n_a", "n_b"))
    errors = np.full((len(rows), len(columns)), np.nan)
    for cell in cells:
        at = rows.index(cell.n_a), columns.index(cell.n_b)
        errors[at] = np.fmin(errors[at], _root(output, cell.loss))
    floor = max(float(np.nanmin(errors)), 1e-12 * float(np.nanmax(errors)), 1e-300)
    shown = np.maximum(errors, floor)
    norm = LogNorm(floor, max(float(np.nanmax(shown)), floor * (1.0 + 1e-6)))
    axes.imshow(shown, norm=norm, cmap="YlGnBu_r", origin="lower", aspect="auto")
    if errors.size <= _WRITTEN:
        for (i, j), value in np.ndenumerate(errors):
            if np.isfinite(value):
                colour = "white" if norm(max(value, floor)) < _DARK else INK
                axes.text(j, i - 0.28, f"{value:.3g}", ha="center", va="center", fontsize=7.0, color=colour)
    places: dict[tuple[int, int], list[str]] = {}
    for name, cell in chosen.items():
        places.setdefault((columns.index(cell.n_b), rows.index(cell.n_a)), []).append(name)
    for (x, y), names in places.items():
        for k, name in enumerate(names):
            shift = 0.16 * (k - 0.5 * (len(names) - 1))
            axes.plot(x + shift, y + 0.12, _MARKS[name], color=_COLOURS[name], markersize=6, markeredgecolor="white")
    axes.set_yticks(range(len(rows)), [str(n) for n in rows])
    alike = all(len(set(column)) == 1 for column in columns)
    told = [str(column[0]) if alike else ", ".join(map(str, column)) for column in columns]
    every = int(np.ceil(len(told) / 12))
    axes.set_xticks(range(0, len(told), every), told[::every], rotation=0 if alike or len(told) < 9 else 60)
    axes.grid(False)
    axes.set_title(with_unit(f"error of {channel(output).label} one step ahead", output), loc="left")
    axes.set_xlabel("n_b" if alike else "n_b, of each input")
    axes.set_ylabel("n_a")


def _draw_criteria(axes, cells: Sequence[Cell], chosen: dict[str, Cell], output: str, count: int) -> None:
    values = {"loss": lambda cell: cell.loss, "aic": lambda cell: cell.aic, "mdl": lambda cell: cell.mdl}
    values["bic"] = lambda cell: float(np.exp(cell.bic / count))
    least = min(cell.parameters for cell in chosen.values())
    near = []
    for name, value in values.items():
        best: dict[int, float] = {}
        for cell in cells:
            best[cell.parameters] = min(best.get(cell.parameters, np.inf), _root(output, value(cell)))
        numbers = np.array(sorted(best))
        curve = np.array([best[n] for n in numbers])
        near += list(curve[numbers >= least])
        look = {"color": _COLOURS.get(name, QUIET), "linestyle": "-" if name in CRITERIA else ":"}
        axes.plot(numbers, curve, linewidth=1.2, label=None if name in CRITERIA else "error itself", **look)
    for name, cell in chosen.items():
        spot = _root(output, values.get(name, values["loss"])(cell))
        look = {"color": _COLOURS[name], "markersize": 7, "markeredgecolor": "white", "linestyle": "none", "zorder": 3}
        axes.plot(cell.parameters, spot, marker=_MARKS[name], label=CRITERIA[name], **look)
        near.append(spot)
    low, high = min(near), max(near)
    spread = max(high - low, 1e-3 * high, 1e-12)
    axes.set_ylim(low - 0.1 * spread, low + _ROOM * spread)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_title(with_unit("criteria as errors", output), loc="left")
    axes.set_xlabel("parameters")


def _draw_held_out(axes, cells: Sequence[Cell], chosen: dict[str, Cell], output: str) -> None:
    finite = [cell for cell in cells if np.isfinite(cell.held_out)]
    axes.plot([c.parameters for c in finite], [c.held_out for c in finite], ".", color=QUIET, markersize=4)
    for name, cell in chosen.items():
        look = {"color": _COLOURS[name], "markersize": 7, "markeredgecolor": "white", "zorder": 3}
        axes.plot(cell.parameters, cell.held_out, marker=_MARKS[name], **look)
    best = max(cell.held_out for cell in finite)
    shown = [c.held_out for c in (*finite, *chosen.values()) if np.isfinite(c.held_out) and c.held_out > best - 60.0]
    margin = 0.08 * max(best - min(shown), 0.5)
    axes.set_ylim(min(shown) - margin, best + margin)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_title(f"free runs of {channel(output).label}, held-out fit, %", loc="left")
    axes.set_xlabel("parameters")


def _root(output: str, square: float) -> float:
    return float(shown_values(output, np.sqrt(max(square, 0.0))))
