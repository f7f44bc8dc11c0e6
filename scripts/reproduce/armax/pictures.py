"""Pictures of the models of the vertical plane: their orders, their free runs, and control with them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from auv_gym.channels import set_point_of
from auv_gym.model import Model
from auv_gym.models.linear.differences import rate_of, with_differences
from auv_gym.records.record import Record
from identification.pages.drawing import COMMAND, INK, downwards, new_figure, quantity_label, shown_values
from identification.pages.model_figures import looks, rollout_figure
from scripts.reproduce.armax.control import END, LEGS, PITCH_LIMIT, SHALLOW
from scripts.reproduce.armax.models import DEPTH, PITCH, free_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MARKED = {DEPTH: " (dotted: target)", PITCH: " (dashed: limits)"}
_SHOWN = (DEPTH, PITCH, "stern_plane_rad", "bow_plane_rad")


def verification_figure(models: Mapping[str, Model], record: Record) -> Figure:
    """Figures 11 and 12: pitch and depth differences of free runs over data that no fit has seen."""
    runs = {name: with_differences(free_run(model, record)[0], DEPTH) for name, model in models.items()}
    # the pitch that the depth loop asked for is of no concern here
    measured = with_differences(record.without([set_point_of(PITCH)]), DEPTH)
    return rollout_figure(measured, runs, (PITCH, rate_of(DEPTH)), "measured")


def control_figure(runs: Mapping[str, Record]) -> Figure:
    """True motion and planes under each controller."""
    figure = new_figure(8.0)
    panels = figure.subplots(len(_SHOWN), 1, sharex=True, height_ratios=[1.6, 1.0, 0.8, 0.8])
    for axes, name in zip(panels, _SHOWN, strict=True):
        for (label, run), look in zip(runs.items(), looks(len(runs)), strict=True):
            steps = "steps-post" if name.endswith("plane_rad") else "default"
            axes.plot(run.time, shown_values(name, run[name]), linewidth=1.2, drawstyle=steps, label=label, **look)
        axes.set_title(quantity_label(name) + _MARKED.get(name, ""), loc="left")
        axes.margins(x=0.0)
        downwards(axes, name)
    times = np.array([0.0, *(begin for begin, _ in LEGS), END])
    wanted = [SHALLOW, *(target for _, target in LEGS), LEGS[-1][1]]
    panels[0].plot(times, wanted, color=COMMAND, linestyle=":", drawstyle="steps-post")
    for side in (-PITCH_LIMIT, PITCH_LIMIT):
        panels[1].axhline(float(np.degrees(side)), color=INK, linewidth=0.7, linestyle="--")
    panels[-1].set_xlabel("time, s")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=3)
    return figure
