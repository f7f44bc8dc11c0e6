"""A controller of a wrench for a vehicle with thrusters, among which the wrench is allocated within their limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from auv_gym.channels import set_point_of
from auv_gym.plant.thrusters import Thrusters
from controllers.allocation import AXES, Allocation
from controllers.composed.loops import targets_of
from controllers.controller import Controller

SHORT = tuple(f"{name.rpartition('_')[0]}_short_{name.rpartition('_')[2]}" for name in AXES)


class AllocatedState(NamedTuple):
    """Memory of the controller, the wrench reached, and its shortfall from the wanted one, (6,) each."""

    inner: Any
    reached: np.ndarray
    short: np.ndarray


@dataclass(frozen=True, eq=False)
class Allocated:
    """A controller of forces and moments in body axes (`surge_N` to `yaw_Nm`), allocated to thrusters.

    Under these names it reads the wrench that the thrusters reached in the last sample, and under `surge_short_N` to
    `yaw_short_Nm` its shortfall from the wanted one, for anti-windup. A target with a name of the wrench is added to
    the controller's output, so that axes can be excited or moved manually.
    controller: None for a vehicle that is only moved by such targets.
    Reports the wrench reached and the one wanted (`surge_cmd_N`), by the controller's own model of the thrusters: an
    unknown loss or low supply is not included.
    """

    controller: Controller | None
    allocation: Allocation
    thrusters: Thrusters

    @property
    def targets(self) -> tuple[str, ...]:
        return () if self.controller is None else targets_of(self.controller)

    @property
    def commands(self) -> tuple[str, ...]:
        return self.thrusters.channels

    @property
    def adds(self) -> tuple[str, ...]:
        """Targets that are added to the controller's output."""
        return AXES

    def start(self) -> AllocatedState:
        inner = None if self.controller is None else self.controller.start()
        return AllocatedState(inner, np.zeros(6), np.zeros(6))

    def act(
        self, state: AllocatedState, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], AllocatedState]:
        wanted, inner, reports = np.zeros(6), state.inner, {}
        if self.controller is not None:
            told = dict(zip((*AXES, *SHORT), (*state.reached.tolist(), *state.short.tolist()), strict=True))
            command, inner = self.controller.act(state.inner, {**reading, **told}, target)
            wanted += [command.get(name, 0.0) for name in AXES]
            reports = {name: value for name, value in command.items() if name not in AXES}
        wanted += [target.get(name, 0.0) for name in AXES]
        shared = self.allocation.share(wanted)
        given = self.thrusters.commands(self.allocation.commandable(shared.thrusts))
        return {
            **reports,
            **dict(zip(self.thrusters.channels, given.tolist(), strict=True)),
            **dict(zip(AXES, shared.reached.tolist(), strict=True)),
            **dict(zip(map(set_point_of, AXES), wanted.tolist(), strict=True)),
        }, AllocatedState(inner, shared.reached, wanted - shared.reached)
