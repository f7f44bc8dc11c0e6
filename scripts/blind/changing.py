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
SURFACED = 600.0  # s, from the last sample of a dive to the first of the next


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


@dataclass(eq=False)
class _Dives:
    """The clock of a log of dives: when the present dive began, and the time of its latest sample, s."""

    begun: float = -SURFACED
    sampled: float = 0.0

    def begin(self) -> float:
        """Begin a dive; return its time."""
        self.begun, self.sampled = self.begun + self.sampled + SURFACED, 0.0
        return self.begun


@final
@dataclass(frozen=True, eq=False)
class ChangingSwim:
    """A float under way, see `identification.experiments.float_dives.Swim`."""

    swim: Swim
    at: At
    dives: _Dives

    @classmethod
    def starting(cls, plant: Plant, at: At) -> Callable[..., ChangingSwim]:
        """A function that starts the float for each dive."""
        dives = _Dives()
        return lambda given, *where: cls(Swim.start(replace(at(dives.begin()), dt=given.dt), *where), at, dives)

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
        self.dives.sampled, swim = self.swim.time, self.swim.onward(inputs, duration)
        now = self.at(self.dives.begun + swim.time)
        return replace(self, swim=replace(swim, plant=replace(now, dt=swim.plant.dt)))


@final
@dataclass(eq=False)
class ChangingFlight:
    """A flying glider for `identification.experiments.glider_dives.yo_mission`, whose clock is `elapsed_s`."""

    plant: Plant
    at: At
    dt: float
    longest_step: float

    def __post_init__(self) -> None:
        self._given: Plant | None = None
        self._now = self._at(0.0)

    @classmethod
    def of(cls, plant: Plant, at: At) -> ChangingFlight:
        return cls(plant, at, plant.dt, plant.longest_step)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.plant, name)

    def _at(self, time: float) -> Plant:
        given = self.at(time)
        if given is not self._given:  # a new plant compiles nothing, but derives all of its numbers
            self._given, self._now = given, replace(given, dt=self.dt, longest_step=self.longest_step)
        return self._now

    def initial(self, y0: np.ndarray) -> np.ndarray:
        return self._now.initial(y0)

    def output(self, x: np.ndarray) -> np.ndarray:
        return self._now.output(x)

    def step(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return self._at(float(u[self.plant.inputs.index("elapsed_s")])).step(x, u)
