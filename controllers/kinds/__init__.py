"""Controllers for each kind of vehicle: one module per kind, each with a `KIND`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from auv_gym.kinds import Kinds
from auv_gym.plant import Plant
from controllers.controller import Controller
from controllers.gains import Gains

Ranges = dict[str, tuple[float, float]]
ANGLE_ERROR = 0.15  # rad; an error with the same cost in a plan as half an input's range moved in a sample


def _nothing(plant: Plant) -> tuple[str, ...]:
    return ()


def _every_sample(plant: Plant) -> float:
    return plant.dt


@dataclass(frozen=True)
class ControlKind:
    """Autopilots of a kind of vehicle.

    targets: channels that they follow by default, and `asked` further ones that PID follows on request.  plans: by
    channel, function of a plant and the settings of a Gpc that makes the predictive controller.  ranges: the lowest and
    the highest of each command.  pid, s_plane: functions of a plant, targets, tuned gains and, for PID, the limit of
    pitch, rad, instead of the tuned one; None if there is no such law.  placed: instead of `pid`, PID with gains from
    the model: function of a plant, targets, s between calls and its own settings.  joined: combines several plans into
    one controller, from a plant, the plans and its own settings, named in `shared`; by default they act side by side.
    held: channels that plans hold at 0 without a target.  able: the channels that a particular vehicle can follow;
    default: all.  alternatives: channels of which an autopilot follows one.  every: s between two plans.  on_board: the
    controller that represents the one that steered a log, by default the autopilot; logged: the targets that a log may
    have, by default all.
    """

    targets: tuple[str, ...]
    plans: Mapping[str, Callable[[Plant, dict[str, Any]], Controller]]
    ranges: Callable[[Plant], Ranges]
    pid: Callable[[Plant, tuple[str, ...], Gains, float | None], Controller] | None = None
    placed: Callable[..., Controller] | None = None
    joined: Callable[..., Controller] | None = None
    shared: tuple[str, ...] = ()
    asked: tuple[str, ...] = ()
    held: Callable[[Plant], tuple[str, ...]] = _nothing
    able: Callable[[Plant], tuple[str, ...]] | None = None
    alternatives: tuple[tuple[str, ...], ...] = ()
    s_plane: Callable[[Plant, tuple[str, ...], Gains], Controller] | None = None
    every: Callable[[Plant], float] = _every_sample
    on_board: Callable[[Plant, tuple[str, ...]], Controller] | None = None
    logged: Callable[[Plant], tuple[str, ...]] | None = None

    @property
    def followed(self) -> tuple[str, ...]:
        """All channels that any autopilot of such a vehicle can follow."""
        return tuple(dict.fromkeys((*self.targets, *self.plans, *self.asked)))


KINDS: Kinds[ControlKind] = Kinds("controllers.kinds", "Controllers know")
