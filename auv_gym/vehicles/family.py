"""What a vehicle family is: a parameter tree and the compiled functions that the rollout is bound to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, eq=False)
class Family:
    """A right-hand side with its channels.

    inputs: all input channels; `required` must be in a record, the others fall back to the parameter that `constants`
    names, or to zero.  states: integrated by RK4.  actuators: one per commanded input, which come first in `inputs`,
    in the same order.  coefficients: the paths that a first fit frees.  twins: effects that act as a coefficient does.
    hooks: compiled `derivative(x, actuators, inputs, p, dx)`, `stable_step(x, inputs, p)`,
    `shape(inputs, memory, p, shaped)`, `actuator_times(index, p)`, `sense(before, x, sensors, duration, p)`,
    `settle_sensors(x, actuators, sensors, p)`, `output(x, actuators, sensors, p, y)`; view: flat vector to record.
    """

    name: str
    title: str
    parameters: type
    inputs: tuple[str, ...]
    required: tuple[str, ...]
    states: tuple[str, ...]
    actuators: tuple[str, ...]
    sensors: tuple[str, ...]
    outputs: tuple[str, ...]
    coefficients: tuple[str, ...]
    view: Callable[..., Any]
    hooks: Mapping[str, Callable[..., Any]]
    constants: Mapping[str, str] = field(default_factory=dict)
    twins: Mapping[str, str] = field(default_factory=dict)
