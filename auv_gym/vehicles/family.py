"""What a vehicle family is: a parameter tree and the compiled functions that the rollout is bound to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from auv_gym.compiled import compiled


def _no_problem(parameters: Any) -> str:
    return ""


@dataclass(frozen=True, eq=False)
class Family:
    """A right-hand side with its channels.

    inputs: all input channels; `required` must be in a record, the others fall back to the parameter that `constants`
    names, or to zero.  states: kept between samples; hooks `enter(x, z)` and `leave(z, x)` go to the `integrated`
    states of RK4 and back.  actuators: one per commanded input, which come first in `inputs`, in the same order.
    coefficients: the paths that a first fit frees.  twins: effects that act as a coefficient does.  shared: states that
    do not change in a segment and whose value nobody knows, each with the effect that acts as it does; none where the
    parameter `shared_unless` is not zero.  stepped: inputs that change now and then, so that free runs lie between.
    kind: what compiled code is shared by.  derived: length of what `derive(vector, derived)` makes of the parameters for the other hooks,
    which see it through `view`.  problem: words about impossible parameters, or nothing.  scratch: length of the last
    argument of `derivative(z, actuators, inputs, p, dz, scratch)`.  block: steps after which `stable_step` is asked again.  Other hooks: `stable_step(z, inputs, p)`,
    `shape(inputs, memory, p, shaped)`, `actuator_times(index, p)`, `sense(before, z, sensors, duration, p)`,
    `settle_sensors(x, actuators, sensors, p)`, `output(x, actuators, sensors, p, y)`.
    """

    name: str
    kind: str
    title: str
    parameters: type
    inputs: tuple[str, ...]
    required: tuple[str, ...]
    states: tuple[str, ...]
    integrated: int
    actuators: tuple[str, ...]
    sensors: tuple[str, ...]
    outputs: tuple[str, ...]
    coefficients: tuple[str, ...]
    derived: int
    view: Callable[..., Any]
    hooks: Mapping[str, Callable[..., Any]]
    scratch: int = 0
    block: int = 1_000_000
    problem: Callable[[Any], str] = _no_problem
    constants: Mapping[str, str] = field(default_factory=dict)
    twins: Mapping[str, str] = field(default_factory=dict)
    shared: Mapping[str, str] = field(default_factory=dict)
    shared_unless: str = ""
    stepped: tuple[str, ...] = ()


@compiled
def copied(source, target):
    """The entries of source in target: `enter`, `leave` and `derive` of a family that needs no other form."""
    for i in range(min(source.shape[0], target.shape[0])):
        target[i] = source[i]
