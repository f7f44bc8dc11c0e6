"""Pictures of the float's dives and of the bias: figures 4 to 7 of Zhong et al. 2024 on the simulated float.

Needs the extra `render`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from auv_gym.model import Diverged
from identification.pages.drawing import AFTER, BEFORE, INK, INPUT, QUIET
from scripts.reproduce.float.consistency import CONSISTENCY, FEEDBACK, PLANNED
from scripts.reproduce.float.dives import (
    CORRECTED,
    DEPTHS,
    GREY_BOX,
    LS_SVM,
    METHODS,
    PRINTED,
    REFINED,
    RMSE,
    RWLS,
    RWLS_OF_ONE,
    TRAINING,
    Dive,
    dive,
    from_rest,
    methods,
)
from scripts.reproduce.float.tables import Comparison

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOKS: dict[str, dict[str, Any]] = {
    RWLS: {"color": BEFORE, "linestyle": "--"},
    RWLS_OF_ONE: {"color": "#e69f00", "linestyle": "-."},
    LS_SVM: {"color": "#a8527f", "linestyle": (0, (1, 1))},
    PRINTED: {"color": "#8a97a3", "linestyle": (0, (4, 1, 1, 1, 1, 1))},
    CORRECTED: {"color": AFTER},
    REFINED: {"color": "#56b4e9", "linestyle": "--"},
    GREY_BOX: {"color": INPUT},
}
ORDER = (TRAINING, *(depth for depth in DEPTHS if depth != TRAINING))  # that of figures 4 to 7
LARGE, SMALL = (RWLS, RWLS_OF_ONE, LS_SVM, PRINTED), (RWLS_OF_ONE, CORRECTED, REFINED, GREY_BOX)
LARGE_RANGE, SMALL_RANGE = 9.0, 0.6  # m
FARTHEST = 50.0  # m
LINEAR = 0.1  # m, up to which the axis of all errors is linear


class Shown(NamedTuple):
    """A dive and the free runs over it, m, of the methods that have one."""

    dive: Dive
    runs: Mapping[str, np.ndarray]


def sheet(shown: Mapping[int, Shown], seed: int) -> Figure:
    """A column for each dive: depth with all runs, piston, and the errors in two ranges."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.6, 9.0), layout="constrained")
    axes = figure.subplots(4, len(shown), sharex="col", sharey="row", height_ratios=(3.0, 1.2, 2.2, 2.2))
    for column, (depth, (flown, runs)) in enumerate(shown.items()):
        time = flown.record.time
        top, piston, large, small = axes[:, column]
        top.plot(time, flown.record["depth_m"], color=INK, linewidth=2.4, label="measured")
        for name, run in runs.items():
            top.plot(time, run, linewidth=1.3, label=name, **LOOKS[name])
        piston.plot(time, 1e3 * flown.record["piston_m"], color=QUIET, linewidth=0.8)
        for panel, names in ((large, LARGE), (small, SMALL)):
            _errors(panel, shown[depth], [name for name in names if name in runs])
        kind = "inversion, the dive that is fitted" if depth == TRAINING else "prediction"
        top.set_title(f"{depth} m: {kind}", loc="left", fontweight="bold")
        small.set_xlabel("time, s")
        small.set_xlim(0.0, time[-1])
    axes[0, 0].set_ylim(1.12 * max(DEPTHS), -3.0)
    axes[2, 0].set_ylim(-LARGE_RANGE, LARGE_RANGE)
    axes[3, 0].set_ylim(-SMALL_RANGE, SMALL_RANGE)
    for row, name in enumerate(("depth, m", "piston, mm", "error, m", "error, m (finer)")):
        axes[row, 0].set_ylabel(name)
    figure.suptitle(
        f"Free runs from rest; errors against the true depth; noise seed {seed}", x=0.01, ha="left", fontweight="bold"
    )
    figure.legend(*_handles(figure), loc="outside lower left", ncols=len(METHODS) + 1, handlelength=2.6)
    return figure


def summary(study: Comparison, shown: Shown) -> Figure:
    """The errors of all methods in the deepest dive, and the error of the damping against the number of samples."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.6 if study.biases else 6.4, 4.4), layout="constrained")
    cells = figure.subplots(1, 3, width_ratios=(1.35, 1.0, 1.0)) if study.biases else [figure.subplots()]
    axes = cells[0]
    _errors(axes, shown, list(shown.runs))
    axes.set_yscale("symlog", linthresh=LINEAR)
    axes.set_ylim(-FARTHEST, FARTHEST)
    ticks = [-10.0, -1.0, -0.1, 0.0, 0.1, 1.0, 10.0]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.margins(x=0.0)
    axes.set_xlabel("time, s")
    axes.set_title(f"dive to {DEPTHS[-1]} m: error of free runs, m", loc="left")
    for axes, piston, title in zip(
        cells[1:],
        (PLANNED, FEEDBACK),
        ("error of D/M, %: piston planned", "piston by feedback"),
    ):
        _bias(axes, study, piston)
        axes.set_title(title, loc="left")
    figure.legend(*_handles(figure), loc="outside upper left", ncols=4, handlelength=2.6)
    return figure


def _bias(axes: Axes, study: Comparison, piston: str) -> None:
    """Median of |error of D/M| over seeds, in per cent, with its range, against the number of samples."""
    lengths = sorted({n for _, _, n in study.biases})
    for method in CONSISTENCY:
        size = 100.0 * np.abs([study.biases[piston, method, n] for n in lengths])
        size = np.where(np.isfinite(size), size, np.inf)
        axes.plot(lengths, np.median(size, axis=1), marker="o", markersize=3.5, label=method, **LOOKS[method])
        if method != PRINTED:  # whose range is the whole axis
            axes.fill_between(
                lengths, *np.quantile(size, (0.25, 0.75), axis=1), color=LOOKS[method]["color"], alpha=0.15
            )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(0.01, 2e4)
    axes.set_xlabel("samples")


def _errors(axes: Axes, shown: Shown, names: list[str]) -> None:
    for name in names:
        error = shown.runs[name] - shown.dive.true_depth
        axes.plot(shown.dive.record.time, error, linewidth=1.1, label=name, **LOOKS[name])


def _handles(figure: Figure) -> tuple[list[Any], list[str]]:
    """What the panels show, each once, for one legend."""
    found: dict[str, Any] = {}
    for axes in figure.axes:
        found |= dict(zip(*axes.get_legend_handles_labels()[::-1]))
    return list(found.values()), list(found)


def runs_of(seed: int, noise: float) -> list[Shown]:
    dives = [dive(depth, seed, noise) for depth in ORDER]
    runs: list[dict[str, np.ndarray]] = [{} for _ in dives]
    for name, method in methods().items():
        try:
            model = method.fit(dives[0].record).model
            found = [from_rest(model, d.record) for d in dives]
        except (ValueError, Diverged):
            continue
        for run, values in zip(runs, found):
            run[name] = values
    return [Shown(d, run) for d, run in zip(dives, runs)]


def typical_seed(study: Comparison) -> int:
    """The number of the seed whose printed IVLS is nearest to its median, of those with finite runs; 0 for none."""
    errors = study.errors(PRINTED)[..., RMSE].max(axis=1)
    finite = np.flatnonzero(np.isfinite(errors))
    if finite.size == 0:
        return 0
    return int(finite[np.argmin(np.abs(errors[finite] - np.median(errors[finite])))])
