"""What a kind of vehicle makes of a task: units, commands, envelope and the rest that `episodes` builds a plan of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Setting:
    """The part of `Episodes` that differs between kinds of vehicle.

    units: of the vehicle, by `tasks.Unit`.  duration: s.  stands_for: the vehicle's channels for names in a task.
    actions: the inputs that an action commands; it goes from -limit to limit about a middle.  start: channels of a
    first state that may be given.  randomise: ranges where none are asked for.  read: outputs that a model must have;
    `read_for`: those that it must have where it has an input.  driven: inputs that it must have.
    shortest: s, between two changes of the target.  least_dt: s, the shortest step.  plan: fields of the plan.
    tables: numbers by the field that says where in the plan they are, with a field for how many rows.
    own_ages: each row keeps the ages of its commands, since steps differ in length.
    """

    units: Mapping[str, float]
    duration: float
    stands_for: Mapping[str, str]
    actions: tuple[str, ...]
    middles: np.ndarray
    limits: np.ndarray
    start: tuple[str, ...]
    randomise: Mapping[str, tuple[float, float]]
    read: tuple[str, ...]
    driven: tuple[str, ...]
    shortest: float
    least_dt: float
    plan: Mapping[str, Any]
    tables: Mapping[str, Any] = field(default_factory=dict)
    read_for: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    own_ages: bool = False
