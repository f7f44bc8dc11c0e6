"""The picture of the float's deepest dive and of the bias: figure 7 of Zhong et al. 2024 on the simulated float.

Needs the extra `render`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from auv_gym.model import Diverged
from identification.pages.drawing import AFTER, BEFORE, INPUT
from scripts.reproduce.float.consistency import CONSISTENCY, FEEDBACK, PLANNED
from scripts.reproduce.float.dives import (
    CORRECTED,
    DEPTHS,
    GREY_BOX,
    LS_SVM,
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
ORDER = (TRAINING, *(depth for depth in DEPTHS if depth != TRAINING))  # as in figures 4 to 7
FARTHEST = 50.0  # m
LINEAR = 0.1  # m, up to which the axis of all errors is linear


class Shown(NamedTuple):
    """A dive and the free runs over it, m, of the methods that found a model."""

    dive: Dive
    runs: Mapping[str, np.ndarray]


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
        if method != PRINTED:  # its range would fill the axis
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
    """The legend's entries of all panels, each once."""
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
    """The index of the seed whose printed IVLS is nearest to its median, among those with finite runs; 0 for none."""
    errors = study.errors(PRINTED)[..., RMSE].max(axis=1)
    finite = np.flatnonzero(np.isfinite(errors))
    if finite.size == 0:
        return 0
    return int(finite[np.argmin(np.abs(errors[finite] - np.median(errors[finite])))])
