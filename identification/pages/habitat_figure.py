"""The figure of an unexplained residual: when and where it is large, and how it grows."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from auv_gym.channels import channel
from identification.diagnosis.judge.verdict import Diagnosis
from identification.pages.diagnosis_figures import AFTER, GIVEN
from identification.pages.drawing import grid, new_figure, shown_values, with_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OF_THRUSTERS = ("1", "us")  # units of commands
_TITLE = 62  # characters that fit above one of two panels


def habitat_figure(d: Diagnosis) -> Figure:
    """Shares of squared error and of samples over the quantity that the error correlates with most, and its growth."""
    habitat = d.habitat
    assert habitat is not None
    share = (habitat.found or tuple(sorted(habitat.shares, key=lambda s: s.p_value)))[0]
    figure = new_figure(3.2)
    panels = grid(figure, 1 + (habitat.growth is not None), 2)
    edges = shown_values(share.name, share.edges)
    places, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    panels[0].bar(places - 0.2 * width, share.error, 0.38 * width, color=AFTER, label="share of squared error")
    panels[0].bar(places + 0.2 * width, share.samples, 0.38 * width, color=GIVEN, label="share of samples")
    said = "" if share in habitat.found else " (no more than chance)"
    words = channel(share.name).label
    if share.name in d.given.plant.inputs and channel(share.name).unit in _OF_THRUSTERS:
        words = f"command of {words}"  # the label is a name such as t4
    panels[0].set_title(fill(f"share of squared error, by {words}{said}", _TITLE), loc="left")
    panels[0].set_xlabel(with_unit(words, share.name))
    figure.legend(loc="outside upper left", ncols=2)
    if habitat.growth is not None:
        rms = shown_values(habitat.channel, habitat.growth.rms)
        panels[1].plot(habitat.growth.time, rms, marker="o", markersize=3, color=AFTER)
        panels[1].set_ylim(bottom=0.0)
        label = with_unit(f"residual of {channel(habitat.channel).label}", habitat.channel)
        panels[1].set_title(f"{label} (RMS)", loc="left")
        panels[1].set_xlabel("time since the window's start, s")
    return figure
