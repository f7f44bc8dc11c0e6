"""Circles with dives of the vehicle and of a learned model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from auv_gym.plant import Plant
from auv_gym.records.record import Record
from scripts.reproduce.ls_svm.experiments import MANOEUVRES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRUE, MODEL = {"color": "#1b4f72", "linewidth": 1.8}, {"color": "#d35400", "linewidth": 1.2, "linestyle": "--"}
OUTSIDE = {"color": "#d35400", "alpha": 0.13, "linewidth": 0}


def circles_figure(model: Plant, runs: list[tuple[Record, Record]], what: str) -> Figure:
    """Plan views and depths of the vehicle and of the model."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 12.0), layout="constrained")
    axes = figure.subplots(len(runs), 2, width_ratios=(1.0, 1.6))
    for (plan, depth), manoeuvre, (true, run) in zip(axes, MANOEUVRES, runs, strict=True):
        for record, look, label in ((true, TRUE, "vehicle"), (run, MODEL, "LS-SVM")):
            plan.plot(record["east_m"], record["north_m"], label=label, **look)
            depth.plot(record.time, record["depth_m"], label=label, **look)
        _mark_outside(depth, model, run)
        plan.set_aspect("equal", adjustable="datalim")
        plan.set(xlabel="east, m", ylabel="north, m", title=manoeuvre.title)
        depth.invert_yaxis()
        depth.set(xlabel="time, s", ylabel="depth, m")
    axes[0, 1].legend(loc="upper right")
    figure.suptitle(f"Circles with dives, learned {what}; shaded: velocities unlike the training data")
    return figure


def _mark_outside(axes, model: Plant, run: Record) -> None:
    """Shade the times at which the model extrapolates."""
    if model.learned is None:
        return
    far = model.learned.distance_along(run) > 1.0
    axes.fill_between(run.time, 0.0, 1.0, where=far, transform=axes.get_xaxis_transform(), **OUTSIDE)
