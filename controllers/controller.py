"""The controller protocol: from a reading and a target to a command, with the memory passed in and returned."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan
from typing import Protocol, TypeVar, runtime_checkable

State = TypeVar("State")


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

        reading: measured channels, and `dt_s`, the time since the last call, s.  target: wanted values by channel.
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
