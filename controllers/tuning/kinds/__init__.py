"""Tuning of each kind of vehicle: one module per kind, each with a `KIND`."""

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
SEGMENT = 30.0  # s per time scale of the vehicle, duration of a target; a run has two
_GPC = {"effort": 1.0, "drift_factor": 1.0}  # tuned settings of predictive control, and their default values
OFF = 0.05  # of an actuator's range, its offset in the variants


class Trial(NamedTuple):
    """Steps of the targets, constant targets, s of a run, s of the vehicle's time scale, and the start of a run.

    alone: channels that move while all others are constant.
    """

    steps: Steps
    held: Mapping[str, float]
    duration: float
    scale: float
    start: Callable[[Plant], Start]
    alone: tuple[str, ...] = ()


class Moved(NamedTuple):
    """The input, or axis of the wrench, that moves a channel, its range, and the share of it used to excite a loop."""

    command: str
    span: float
    share: float = 0.025


def _nothing(plant: Plant) -> dict[str, float]:
    return {}


@dataclass(frozen=True)
class TuningKind:
    """The properties of a kind of vehicle for tuning.

    trial: for testing its loops.  first: initial gains, from a plant and a law ("pid", "s_plane").
    loops: from a plant and a law, by channel the loops that are tuned together.  moved_by: from a plant and a channel.
    mirror: from a plant, a channel and the share of bow planes: by input, how far it moves with the one that moves a
    channel.  offsets: of the actuators in the variants, by path.  besides: uncertain coefficients in addition to those
    of the family.
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
    """Settings of a Pid; a derivative of the opposite sign is left out."""
    found = {"proportional": proportional, "integral": integral}
    if derivative * proportional > 0.0:
        found["derivative"] = derivative
    return {**found, **settings}


KINDS: Kinds[TuningKind] = Kinds("controllers.tuning.kinds", "Tuning knows")


def loops_of(plant: Plant, law: str) -> Mapping[str, tuple[str, ...]]:
    """The loops that are tuned together, by channel; predictive control has a separate one for each."""
    loops = KINDS.of(plant.family).loops
    return {name: (name,) for name in loops(plant, "pid")} if law == "gpc" else loops(plant, law)


def first_loops(plant: Plant, law: str) -> Loops:
    """Initial gains of a law."""
    if law == "gpc":
        return dict.fromkeys(loops_of(plant, law), _GPC)
    return KINDS.of(plant.family).first(plant, law)
