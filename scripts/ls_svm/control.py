"""The control case of the paper, figures 11 to 16: S-plane control of the vehicle and of a model in its place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auv_gym.model import Model
from identification.experiments.driving import Run
from scripts.reproduce_s_plane import CASES, Case, fly

COMMANDS = {"u_mps": "propeller_V", "heading_rad": "rudder_rad", "depth_m": "stern_plane_rad"}


@dataclass(frozen=True)
class Controlled:
    """Root mean square difference of a model's run under control from the vehicle's.

    percent: of the largest step of the target.  value: in the channel's unit.
    """

    percent: float
    value: float


def steered(case: Case, model: Model | None = None) -> Run:
    """The run of a case by S-plane, without current and noise; raises where it was cut short."""
    run = fly(case, "s_plane", None, model)
    if run.reason:
        raise ValueError(f"The run of {case.title} was cut short: {run.reason}.")
    return run


def compared(case: Case, vehicle: Run, model: Run) -> Controlled:
    """The difference of two runs of a case, of what was true."""
    values = [case.first, *(value for _, value in case.steps)]
    step = float(np.abs(np.diff(values)).max())
    rms = float(np.sqrt(np.mean((model.truth[case.channel] - vehicle.truth[case.channel]) ** 2)))
    return Controlled(100.0 * rms / step, rms)


__all__ = ["CASES", "COMMANDS", "Case", "Controlled", "compared", "steered"]
