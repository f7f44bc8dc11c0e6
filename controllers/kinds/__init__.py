"""What controllers know of each kind of vehicle: one module a kind, each with a `KIND`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from auv_gym.kinds import Kinds
from auv_gym.plant import Plant
from controllers.controller import Controller
from controllers.gains import Gains

Ranges = dict[str, tuple[float, float]]
ANGLE_ERROR = 0.15  # rad, an error that matters as much to a plan as half an input's range moved in a sample


def _every_sample(plant: Plant) -> float:
    return plant.dt


@dataclass(frozen=True)
class ControlKind:
    """Autopilots of a kind of vehicle.

    targets: channels that they follow by default.  plans: predictive control of each channel that it can follow, of a
    plant and the settings of a Gpc.  pid, s_plane: of a plant, targets, tuned gains and, for PID, the limit of pitch,
    rad, in place of the tuned one; None where there is no such law.  every: s between two plans.  ranges: the lowest
    and the highest of each command.  on_board: the controller that takes the place of the one that steered a log, by
    default the autopilot; logged: the targets that a log may have had, by default all.
    """

    targets: tuple[str, ...]
    plans: Mapping[str, Callable[[Plant, dict[str, Any]], Controller]]
    pid: Callable[[Plant, tuple[str, ...], Gains, float | None], Controller]
    ranges: Callable[[Plant], Ranges]
    s_plane: Callable[[Plant, tuple[str, ...], Gains], Controller] | None = None
    every: Callable[[Plant], float] = _every_sample
    on_board: Callable[[Plant, tuple[str, ...]], Controller] | None = None
    logged: Callable[[Plant], tuple[str, ...]] | None = None


KINDS: Kinds[ControlKind] = Kinds("controllers.kinds", "Controllers know")
