"""The part of a campaign that its page shows: a few of the runs, and the outputs of interest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from auv_gym.channels import set_point_of
from auv_gym.records.record import Record
from identification.campaign.index import Row
from identification.campaign.report.wording import grid_cell_label
from identification.pages.drawn_channels import outputs_of

DETAILED = 3  # runs shown individually


def representative_runs(rows: Sequence[Row], most: int = DETAILED) -> list[Row]:
    """A few runs with different settings: the first of each cell of the grid, spread evenly over the cells."""
    firsts: dict[str, Row] = {}
    for row in rows:
        firsts.setdefault(grid_cell_label(row.cell), row)
    cells = list(firsts.values())
    if len(cells) < most:
        cells += [row for row in rows if row not in cells][: most - len(cells)]
    return [cells[i] for i in np.unique(np.linspace(0, len(cells) - 1, min(most, len(cells))).astype(int))]


def outputs_in_question(fits: Sequence[Mapping[str, Any]], records: Sequence[Record]) -> list[str]:
    """The outputs that have a set point or that a linear model predicts; a vehicle has a dozen others."""
    if not records:
        return []
    aimed = [name for name in outputs_of(records[0]) if records[0].has(set_point_of(name))]
    given = [name for fit in fits if fit["file"].endswith(".npz") for name in fit["outputs"]]
    return list(dict.fromkeys([*aimed, *given])) or outputs_of(records[0])


def fit_limited_to_outputs(fit: Mapping[str, Any], wanted: Sequence[str]) -> dict[str, Any]:
    """The result of a fit, limited to these outputs."""

    def kept(of: Mapping[str, Any]) -> dict[str, Any]:
        return {name: of[name] for name in wanted if name in of}

    return {
        **fit,
        "outputs": [name for name in wanted if name in fit["outputs"]],
        "scores": {run: kept(scores) for run, scores in fit["scores"].items()},
        "vehicle_scores": {run: kept(scores) for run, scores in fit["vehicle_scores"].items()},
        "residuals": kept(fit["residuals"]),
    }
