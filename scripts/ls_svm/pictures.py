"""Figures 9 to 16 of the paper from runs of the vehicle and of a learned model."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from auv_gym.channels import channel
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from auv_gym.writing import replacing
from identification.pages.drawing import STYLE
from scripts.ls_svm.control import CASES, COMMANDS
from scripts.ls_svm.experiments import MANOEUVRES
from scripts.ls_svm.study import flights

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRUE, MODEL = {"color": "#1b4f72", "linewidth": 1.8}, {"color": "#d35400", "linewidth": 1.2, "linestyle": "--"}
OUTSIDE = {"color": "#d35400", "alpha": 0.13, "linewidth": 0}


def draw(model: Plant, out: Path, what: str) -> list[Path]:
    """The two pictures; the files written."""
    circles, control = flights(model)
    return [
        _saved(lambda: _circles(model, circles, what), out / "ls_svm_circles.png"),
        _saved(lambda: _control(control, what), out / "ls_svm_control.png"),
    ]


def _circles(model: Plant, runs: list[tuple[Record, Record]], what: str) -> Figure:
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


def _control(runs, what: str) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 8.5), layout="constrained")
    axes = figure.subplots(len(CASES), 2)
    for (left, right), case, (true, run) in zip(axes, CASES, runs, strict=True):
        times = [t for begin, end, _ in case.legs for t in (begin, end)]
        targets = [value for _, _, value in case.legs for _ in range(2)]
        left.plot(times, _shown(case.channel, np.array(targets)), color="0.6", linewidth=1.0, label="target")
        for driven, look, label in ((true, TRUE, "vehicle"), (run, MODEL, "LS-SVM")):
            left.plot(driven.truth.time, _shown(case.channel, driven.truth[case.channel]), label=label, **look)
            name = COMMANDS[case.channel]
            right.plot(driven.record.time, _shown(name, driven.record[name]), label=label, **look)
        for ax, name in ((left, case.channel), (right, COMMANDS[case.channel])):
            unit = "deg" if channel(name).unit == "rad" else channel(name).unit
            ax.set(xlabel="time, s", ylabel=f"{channel(name).label}, {unit}")
        if case.channel == "depth_m":
            left.invert_yaxis()
    axes[0, 0].legend(loc="lower right")
    figure.suptitle(f"S-plane control of the vehicle and of the model in its place, learned {what}")
    return figure


def _shown(name: str, values: np.ndarray) -> np.ndarray:
    return np.degrees(values) if channel(name).unit == "rad" else values


def _saved(make: Callable[[], Figure], path: Path) -> Path:
    from matplotlib import rc_context

    with rc_context(STYLE), replacing(path) as new:
        make().savefig(new, format="png", dpi=110, facecolor="white")
    return path
