"""Figures of models compared over a record: how their predictions worsen with the horizon.

Needs the extra `render`.  Free runs and residual tests are drawn as in a campaign's report.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from auv_gym.channels import channel
from identification.campaign.figures import LOOKS
from identification.drawing import grid, new_figure, shown_values, unit_label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = 1e-5  # of the largest error; what is smaller is rounding


def horizon_figure(sweeps: Mapping[str, Mapping[str, Mapping[float, float]]]) -> Figure:
    """Root mean square error of predictions over how far ahead they look, per output, a line for each model.

    sweeps: model -> channel -> horizon in s -> error in SI.
    """
    names = list(dict.fromkeys(name for of in sweeps.values() for name in of))
    figure = new_figure(2.6 * ((len(names) + 1) // 2) + 0.3)
    panels = grid(figure, len(names), 2)
    for axes, name in zip(panels, names):
        largest = 0.0
        for number, (label, of) in enumerate(sweeps.items()):
            if name in of:
                seconds, errors = np.array(list(of[name].items())).T
                largest = max(largest, float(shown_values(name, errors).max()))
                look = LOOKS[number % len(LOOKS)]
                axes.loglog(seconds, shown_values(name, errors), marker="o", markersize=3, label=label, **look)
        if largest > 0.0:
            axes.set_ylim(bottom=max(axes.get_ylim()[0], _SHOWN * largest))
        axes.set_title(f"error of {channel(name).label}, {unit_label(name)} (root mean square)", loc="left")
        axes.set_xlabel("seconds ahead")
    handles = {label: h for axes in panels for h, label in zip(*axes.get_legend_handles_labels())}
    figure.legend(list(handles.values()), list(handles), loc="outside upper left", ncols=5)
    return figure
