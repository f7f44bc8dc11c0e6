"""Gain scheduling for fins: a controller designed for one speed, used at any speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any, NamedTuple

from controllers.composed.loops import commanded_inputs, targets_of
from controllers.controller import Controller

_SLOWEST, _FASTEST = 0.5, 1.5  # of the speed; beyond this range, fin angles are not scaled further


class ScheduledState(NamedTuple):
    """Memory of the controller, the fin angles commanded, and the factor applied to its own."""

    inner: Any
    given: Mapping[str, float]
    factor: float = 1.0


@dataclass(frozen=True)
class Scheduled:
    """A controller designed for `speed`, m/s, with fin angles scaled by the square of `speed` over the present speed.

    limits: rad, by fin, either side.  The controller reads the equivalent fin angles at `speed`.  Without a reading of
    `u_mps`, the last one is used.

    Example:

        >>> from controllers import Pid, Scheduled
        >>> loop = Scheduled(Pid(0.5), speed=1.0, limits={"rudder_rad": 0.4})
        >>> reading = {"heading_rad": 0.0, "u_mps": 2.0, "dt_s": 1.0}
        >>> command, memory = loop.act(loop.start(), reading, {"heading_rad": 0.4})
        >>> round(command["rudder_rad"], 3)
        0.089
    """

    controller: Controller
    speed: float
    limits: Mapping[str, float]

    def __post_init__(self) -> None:
        if not self.speed > 0.0 or not all(limit > 0.0 for limit in self.limits.values()):
            raise ValueError(f"Scheduled needs a speed and limits above 0, got {self.speed!r} and {dict(self.limits)}.")

    @property
    def targets(self) -> tuple[str, ...]:
        return targets_of(self.controller)

    @property
    def commands(self) -> tuple[str, ...]:
        return commanded_inputs(self.controller)

    def start(self) -> ScheduledState:
        return ScheduledState(self.controller.start(), {})

    def act(
        self, state: ScheduledState, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], ScheduledState]:
        forward, factor = reading.get("u_mps", float("nan")), state.factor
        if isfinite(forward):
            factor = min(max(forward / self.speed, _SLOWEST), _FASTEST) ** -2.0
        angles = {name: reading.get(name, state.given.get(name)) for name in self.limits}
        seen = {name: angle / factor for name, angle in angles.items() if angle is not None}
        command, inner = self.controller.act(state.inner, {**reading, **seen}, target)
        given = {
            name: min(max(factor * command[name], -limit), limit)
            for name, limit in self.limits.items()
            if name in command
        }
        return {**command, **given}, ScheduledState(inner, given, factor)
