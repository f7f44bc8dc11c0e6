"""What environments have to know about a kind of vehicle, and what it makes of a task; `kinds` holds one of each."""

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
    actions: the inputs that an action commands; it goes from -limit to limit about a middle.  start: channels of a
    first state that may be given.  randomise: ranges where none are asked for.  effects: values by parameter path that
    options stand for.  read: outputs that a model must have; `read_for`: those that it must have where it has an input.
    driven: inputs that it must have.  shortest: s, between two changes of the target.  least_dt: s, the shortest step.
    plan: fields of the plan.  tables: numbers by the field that says where in the plan they are, with a field for how
    many rows.  observed: what is observed besides the task's.  own_ages: each row keeps the ages of its commands, since
    steps differ in length.  target_limits: by channel, lowest and highest target that may be given; equal where the
    vehicle cannot control the channel.
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
    target_limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)


class View(Protocol):
    """Follows one environment, whose row it reads, and says what a picture of it shows."""

    def follow(self, begin: bool = False) -> None:
        """Take the present moment into the track, of a new episode if it begins."""
        ...

    def scene(self) -> Any:
        """The present moment and how it came there, as `rendering` draws it."""
        ...


def _as_it_is(plant: Plant, dt: float | None) -> Plant:
    return plant


def _no_numbers(family: Family) -> Mapping[str, int]:
    return {}


@dataclass(frozen=True, eq=False)
class EnvKind:
    """A kind of vehicle, as environments know it.

    title: what a task for it needs.  layout: what its plans and rows hold.  hooks: its part of the compiled step.
    scale: makes a task one of a vehicle, called as scale(task, plant, duration=, target=, and `options`), which are
    those that only this kind has.  view: of an `Episodes` and a row, made when a picture is wanted.  reasons: why an
    episode was terminated, by code: words with {value} and {limit}, and the field of the plan that is the limit.
    readings: what an info shows as measured, by channel the name of its feature; by default all outputs.  infos: single
    numbers of an info, by name the field of the row.  numbers: further open names of the hooks.
    prepare: the vehicle as environments step it, of the one that was given and of dt=.
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
