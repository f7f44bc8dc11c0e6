"""The controller protocol: from a reading and a target to a command, with the memory passed in and returned."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan
from typing import Protocol, TypeVar, runtime_checkable

from auv_gym.channels import CHANNELS, channel
from auv_gym.param import did_you_mean, listed

State = TypeVar("State")
_LISTED = frozenset(CHANNELS)


@runtime_checkable
class Controller(Protocol[State]):
    """A controller in discrete time; pure, so that a run can be repeated, cut and resumed."""

    def start(self) -> State:
        """The memory of a controller before its first call."""
        ...

    def act(
        self, state: State, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], State]:
        """The commands by channel name and the next memory; the given memory is not changed.

        reading: measured channels, and `dt_s`, the time since the last call, s.  target: wanted values by channel;
        those that it does not follow are ignored, and names that are no channels are refused.
        """
        ...


def time_step(reading: Mapping[str, float]) -> float:
    """The time since a controller's last call, s, from the reading `dt_s`; raises ValueError if there is none."""
    dt = reading.get("dt_s", nan)
    if dt > 0.0:
        return dt
    raise ValueError(
        f"A controller needs dt_s, the time since its last call in s, above 0 among its readings; got {dict(reading)}: "
        "add it, such as {**reading, 'dt_s': plant.dt}."
    )


def reading_of(controller: Controller, name: str, reading: Mapping[str, float]) -> float:
    """The reading of a channel that a controller needs; raises ValueError if there is none."""
    try:
        return reading[name]
    except KeyError:
        got = f"readings of {listed(list(reading))}" if reading else "none"
        raise ValueError(f"{type(controller).__name__} needs a reading of {name}, got {got}: add it.") from None


def target_of(controller: Controller, name: str, target: Mapping[str, float]) -> float:
    """The target of a channel that a controller needs; raises ValueError if there is none."""
    try:
        return target[name]
    except KeyError:
        check_targets(controller, target)
        got = f"targets for {listed(list(target))}" if target else "none"
        raise ValueError(f"{type(controller).__name__} needs a target for {name}, got {got}: add it.") from None


def check_targets(controller: Controller, target: Mapping[str, float]) -> None:
    """Raise if the name of a target is no channel, such as `depth`; one that the controller does not follow is allowed.

    Controllers that act together, and an environment, have one set of targets for all.
    """
    if _LISTED.issuperset(target):  # checked fast, since controllers act at every sample
        return
    for name in target:
        try:
            channel(name)
        except ValueError:
            followed = tuple(getattr(controller, "targets", ()))
            raise ValueError(
                f"There is no channel {name!r} to follow. {did_you_mean(name, followed)}This controller "
                f"follows {listed(followed)}, in SI and radians."
            ) from None
