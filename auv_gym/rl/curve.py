"""The learning curve: as a CSV table, and drawn if matplotlib is installed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from auv_gym.writing import replacing, write_text

CURVE = "learning_curve.csv"


def write_curve(rows: Sequence[Mapping[str, float]], path: Path) -> None:
    """Write the rows, as a whole or not at all."""
    lines = [",".join(rows[0]), *(",".join(f"{value:.10g}" for value in row.values()) for row in rows)]
    write_text(path, "\n".join(lines) + "\n")


def draw_curve(rows: Sequence[Mapping[str, float]], path: Path, env: str) -> bool:
    """Draw mean and range of the returns over steps, as a PNG; False without the extra `render`."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        from auv_gym.rendering.sheet import GRID, QUIET, TARGET, VEHICLE
    except ImportError:
        return False
    steps = [row["steps"] for row in rows]
    figure = Figure(figsize=(7.2, 4.0), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.grid(color=GRID)
    axes.spines[["top", "right"]].set_visible(False)
    low, high = ([row[f"{end}_return"] for row in rows] for end in ("lowest", "highest"))
    axes.fill_between(steps, low, high, color=VEHICLE, alpha=0.15, linewidth=0.0, label="lowest to highest")
    axes.plot(steps, [row["mean_return"] for row in rows], color=VEHICLE, label="mean, without noise")
    axes.plot(steps, [row["training_return"] for row in rows], color=TARGET, linestyle="--", label="while training")
    axes.set(xlabel="steps", ylabel="return of an episode", title=f"PPO in {env}")
    axes.xaxis.label.set_color(QUIET)
    axes.yaxis.label.set_color(QUIET)
    axes.legend(frameon=False, loc="lower right")
    with replacing(path) as new:
        figure.savefig(new, format="png")
    return True
