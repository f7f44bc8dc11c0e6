"""A controller that commands a wrench, on a vehicle that has thrusters: they share the wrench within what they can."""

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
    """Memory of the controller, the wrench that was reached, and what it fell short of the wanted one, (6,) each."""

    inner: Any
    reached: np.ndarray
    short: np.ndarray


@dataclass(frozen=True, eq=False)
class Allocated:
    """A controller of forces and moments in body axes (`surge_N` to `yaw_Nm`), whose commands thrusters share.

    It reads, under these names, the wrench that the thrusters reached in the last sample, and under `surge_short_N` to
    `yaw_short_Nm` what that was short of the wanted one, so that its integrals need not wind up. A target under a name
    of the wrench is added to what the controller wants, so that axes can be excited or moved by hand.
    controller: None for a vehicle that is moved by such targets alone.
    Reports the wrench that was reached and the one that was wanted (`surge_cmd_N`), as the controller knows the
    thrusters: what it was not told of (a loss, a low supply) is not in it.
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
        """Targets that are added to what the controller wants."""
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
