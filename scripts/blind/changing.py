"""Vehicles whose parameters vary with time, in place of a plant in an experiment: only for simulating logs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, final

import numpy as np

from auv_gym.plant import Plant
from auv_gym.plant.cruise import find_cruise
from identification.experiments.float_dives import Swim
from identification.experiments.manoeuvres import steered
from scripts.blind.own_torpedo import SENSORS

At = Callable[[float], Plant]  # the plant at a time, s, as the log counts
_RUN_IN = 30.0  # s, before a glider's log begins


@final
class Changing:
    """A plant for `closed_loop` or `hover` of `identification.experiments`; it counts its steps.

    run_in: s, before the log begins.
    """

    def __init__(self, plant: Plant, at: At, run_in: float = 0.0):
        self._plant, self._at, self._steps = plant, at, -round(run_in / plant.dt)

    @classmethod
    def glider(cls, plant: Plant, at: At) -> Changing:
        """A glider under heading control, whose log begins once it is under way."""
        return cls(plant, at, _RUN_IN)

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
class ChangingTorpedo:
    """A torpedo for `scripts.blind.own_torpedo.manoeuvred`."""

    plant: Plant
    at: At

    @cached_property
    def cruising(self) -> np.ndarray:
        """The inputs in steady flight."""
        return find_cruise(self.plant).commands

    def start(self, states: np.ndarray) -> np.ndarray:
        every = np.zeros(len(self.plant.family.states))
        every[: len(states)] = states
        return self.at(0.0).settled(every, self.cruising)

    def reading(self, x: np.ndarray, time: float) -> dict[str, float]:
        values = dict(zip(self.plant.outputs, self.at(time).output(x).tolist(), strict=True))
        return {name: values[name] for outputs in SENSORS.values() for name in outputs}

    def onward(self, x: np.ndarray, told: np.ndarray, time: float, duration: float) -> np.ndarray:
        u = self.cruising.copy()
        u[[self.plant.inputs.index(name) for name in steered(self.plant)]] = told
        return self.at(time).step_over(x, u, duration)


@final
@dataclass(frozen=True, eq=False)
class ChangingSwim:
    """A float under way, see `identification.experiments.float_dives.Swim`."""

    swim: Swim
    at: At

    @classmethod
    def starting(cls, plant: Plant, at: At) -> Callable[..., ChangingSwim]:
        """A function that starts the float."""
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
