"""The description of a kind of vehicle for environments, and a task scaled to a vehicle; see `kinds`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from auv_gym.envs.kernel.hooks import Hooks
from auv_gym.envs.kernel.layout import Layout
from auv_gym.envs.tasks import Observed
from auv_gym.plant import Plant
from auv_gym.vehicles.family import Family


@dataclass(frozen=True, eq=False)
class ScaledTask:
    """A task in the units, commands and limits of one vehicle.

    units: of the vehicle, by `tasks.Unit`.  duration: s.  stands_for: the vehicle's channels for names in a task.
    actions: the inputs that an action commands, from -limit to limit about a middle.  start: channels of an initial
    state that may be given.  randomise: default ranges.  effects: values by parameter path that result from options.
    read: outputs that a model must have; `read_for`: those that it must have if it has a certain input.  driven: inputs
    that it must have.  shortest: s, between two changes of the target.  least_dt: s, the shortest step.
    plan: fields of the plan.  tables: numbers, by the field with their position in the plan, with a field for the
    number of rows.  observed: observations in addition to the task's.  own_ages: whether each row stores the ages of
    its commands, because steps differ in length.  start_limits, target_limits: by channel, lowest and highest initial
    value and target that may be given; equal if the vehicle cannot control the channel.
    """

    units: Mapping[str, float]
    duration: float
    stands_for: Mapping[str, str]
    actions: tuple[str, ...]
    middles: np.ndarray
    limits: np.ndarray
    start: tuple[str, ...]
    read: tuple[str, ...]
    driven: tuple[str, ...]
    shortest: float
    least_dt: float
    plan: Mapping[str, Any]
    randomise: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    effects: Mapping[str, float] = field(default_factory=dict)
    tables: Mapping[str, Any] = field(default_factory=dict)
    read_for: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    observed: tuple[Observed, ...] = ()
    own_ages: bool = False
    start_limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    target_limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)


class View(Protocol):
    """The view of one environment, whose row it reads, for drawing it."""

    def follow(self, begin: bool = False) -> None:
        """Add the present moment to the track; begin: whether an episode begins."""
        ...

    def scene(self) -> Any:
        """The present moment and the track so far, as `rendering` draws it."""
        ...


def _as_it_is(plant: Plant, dt: float | None) -> Plant:
    return plant


def _no_numbers(family: Family) -> Mapping[str, int]:
    return {}


@dataclass(frozen=True, eq=False)
class EnvKind:
    """A kind of vehicle, as environments know it.

    title: the requirements of its tasks.  layout: the content of its plans and rows.  hooks: its part of the compiled
    step.
    scale: scales a task to a vehicle, called as scale(task, plant, duration=, target=, and the `options` that only this
    kind has).  view: makes a view of an `Episodes` and a row, when a picture is needed.  reasons: for termination, by
    code: words with {value} and {limit}, and the field of the plan with the limit.
    readings: shown by an info as measured, by channel the name of its feature; default: all outputs.  infos: single
    numbers of an info, by name the field of the row.  numbers: further numbers for the hooks.
    prepare: converts the given vehicle and dt= to the vehicle that environments step.
    """

    title: str
    layout: Layout
    hooks: Hooks
    scale: Callable[..., ScaledTask]
    options: tuple[str, ...]
    view: Callable[[Any, np.ndarray], View]
    reasons: Mapping[int, tuple[str, str]] = field(default_factory=dict)
    readings: Mapping[str, str] = field(default_factory=dict)
    infos: Mapping[str, str] = field(default_factory=dict)
    numbers: Callable[[Family], Mapping[str, int]] = _no_numbers
    prepare: Callable[[Plant, float | None], Plant] = _as_it_is
