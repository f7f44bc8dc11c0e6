"""Vehicles whose parameters follow time, in the place of a plant in an experiment: simulators of logs alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from auv_gym.plant import Plant
from identification.experiments.float_dives import Swim

At = Callable[[float], Plant]  # the plant at a time, s, as the log counts
_RUN_IN = 30.0  # s, before a glider's log begins


@final
class ChangingGlider:
    """A glider for `identification.experiments.heading_control.closed_loop`; it counts its steps."""

    def __init__(self, plant: Plant, at: At):
        self._plant, self._at, self._steps = plant, at, -round(_RUN_IN / plant.dt)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def _now(self) -> Plant:
        return self._at(self._steps * self._plant.dt)

    def output(self, x: np.ndarray) -> np.ndarray:
        return self._now().output(x)

    def step(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        now, self._steps = self._now(), self._steps + 1
        return now.step(x, u)


@final
@dataclass(frozen=True, eq=False)
class ChangingSwim:
    """A float under way, see `identification.experiments.float_dives.Swim`."""

    swim: Swim
    at: At

    @classmethod
    def starting(cls, plant: Plant, at: At) -> Callable[..., ChangingSwim]:
        """What starts it."""
        return lambda given, *where: cls(Swim.start(replace(at(0.0), dt=given.dt), *where), at)

    @property
    def depth(self) -> float:
        return self.swim.depth

    @property
    def measured(self) -> float:
        return self.swim.measured

    @property
    def time(self) -> float:
        return self.swim.time

    def onward(self, inputs: dict[str, float], duration: float) -> ChangingSwim:
        swim = self.swim.onward(inputs, duration)
        return replace(self, swim=replace(swim, plant=replace(self.at(swim.time), dt=swim.plant.dt)))
