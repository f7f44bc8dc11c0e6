"""What tuning has to know of each kind of vehicle: one module a kind, each with a `KIND`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from auv_gym.kinds import Kinds
from auv_gym.plant import Plant
from controllers.gains import Loops
from controllers.trials.trial import Steps

Start = tuple[np.ndarray, np.ndarray]
SEGMENT = 30.0  # s per time scale of the vehicle, of one target; a run has two
_GPC = {"effort": 1.0, "drift_factor": 1.0}  # what of predictive control is tuned, and its usual values
OFF = 0.05  # of an actuator's range, by which it is off its zero in the changed plants


class Trial(NamedTuple):
    """Steps of the targets, targets that stand, s of a run, s of the vehicle's time scale, and where a run starts.

    alone: channels that move while all others stand.
    """

    steps: Steps
    held: Mapping[str, float]
    duration: float
    scale: float
    start: Callable[[Plant], Start]
    alone: tuple[str, ...] = ()


class Moved(NamedTuple):
    """What moves a channel: an input or an axis of the wrench, its range, and the share of it by which a loop is shaken
    to see its response.
    """

    command: str
    span: float
    share: float = 0.025


def _nothing(plant: Plant) -> dict[str, float]:
    return {}


@dataclass(frozen=True)
class TuningKind:
    """What tuning has to know of a kind of vehicle.

    trial: what its loops are tried with.  first: gains to start from, of a plant and a law ("pid", "s_plane").
    loops: of a plant and a law, by channel the loops that are tuned together.  moved_by: of a plant and a channel.
    mirror: by input, how far it moves with the one that moves a channel, of a plant, a channel and the share of bow
    planes.  offsets: of the actuators in the changed plants, by path.  besides: coefficients that are uncertain
    besides those of the family.
    """

    trial: Callable[[Plant], Trial]
    first: Callable[[Plant, str], Loops]
    loops: Callable[[Plant, str], Mapping[str, tuple[str, ...]]]
    moved_by: Callable[[Plant, str], Moved]
    bow_share: Callable[[Plant], float] = lambda plant: 0.0
    mirror: Callable[[Plant, str, float], Mapping[str, float]] = lambda plant, name, share: {}
    offsets: Callable[[Plant], dict[str, float]] = _nothing
    besides: tuple[str, ...] = ()


def law(proportional: float, integral: float, derivative: float = 0.0, **settings: float) -> dict[str, float]:
    """Settings of a Pid; a derivative of the other sign is left out."""
    found = {"proportional": proportional, "integral": integral}
    if derivative * proportional > 0.0:
        found["derivative"] = derivative
    return {**found, **settings}


KINDS: Kinds[TuningKind] = Kinds("controllers.tuning.kinds", "Tuning knows")


def loops_of(plant: Plant, law: str) -> Mapping[str, tuple[str, ...]]:
    """By channel the loops that are tuned together; predictive control has one of its own for each."""
    loops = KINDS.of(plant.family).loops
    return {name: (name,) for name in loops(plant, "pid")} if law == "gpc" else loops(plant, law)


def first_loops(plant: Plant, law: str) -> Loops:
    """Gains to start from, of a law."""
    if law == "gpc":
        return dict.fromkeys(loops_of(plant, law), _GPC)
    return KINDS.of(plant.family).first(plant, law)
