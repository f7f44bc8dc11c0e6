"""The open parts of the compiled step: what differs between kinds of vehicle, and the vehicle's own programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, eq=False)
class Hooks:
    """A kind's part of the compiled step, as templates (see `compiled.bind`).

    Arguments: `plan`, the whole plan, and `t`, the record at its start; `row`, a whole row, and `e`, the record at its
    start; `x`, the full state in the row, of the vehicle or of a model in its place.

    A hook may use `vehicle`, a `Vehicle`, and the numbers of `programs.open_numbers`: sizes such as ACTUATORS, and
    indices of states (DEPTH), readings (READ_DEPTH), inputs (IN_BUOYANCY_VOLUME) and features (ERROR).
    """

    # (plan, t, e): put the commands of e.action into e.command and e.features, and the cost of their change into
    # e.term[1]
    command: Callable[[Any, Any, Any], None]
    # (x, t): why a finite state ends the episode, a code of `EnvKind.reasons` or NO_REASON, and the number responsible
    beyond: Callable[[Any, Any], tuple[int, float]]
    # (x, before, t, e): put the other reward terms into e.term, for the target that the action was chosen for
    score: Callable[[Any, Any, Any, Any], None]
    # (plan, x, t, e, row): set a new target if the present one has expired or is reached
    aim: Callable[[Any, Any, Any, Any, Any], None]
    # (t, e, row): put features for observations, other than readings and commands, into e.features
    look: Callable[[Any, Any, Any], None]
    # (t, e, row): put the time after one more step into e.time
    pass_time: Callable[[Any, Any, Any], None]
    # (t, e): number of steps left in the episode
    steps_left: Callable[[Any, Any], float]
    # (plan, t, row): times, s, of the commands that the vehicle's state keeps, ending at 0, then the end of the step
    ages: Callable[[Any, Any, Any], Any]
    # (plan, drawn, t, e, row): the initial state and commands of an episode; drawn: its parameters
    place: Callable[[Any, Any, Any, Any, Any], None]
    # (plan, x, t, e, row): the first target of an episode
    set_out: Callable[[Any, Any, Any, Any, Any], None]
    # (x, derived, e, work): set the distance of the state from a learned hull's training data
    doubt: Callable[[Any, Any, Any, Any], None]


@dataclass(frozen=True, eq=False)
class Vehicle:
    """The compiled functions of a family that the step calls."""

    parameters: Callable[[Any], Any]  # (derived): the parameters as a record
    derive: Callable[[Any, Any], None]  # (vector, derived)
    shape: Callable[[Any, Any, Any, Any], None]  # (inputs, memory, p, shaped), see `Family.hooks`
    settle: Callable[[Any, Any], None]  # (x, derived): the sensors' states
    step: Callable[[Any, Any, Any, float, Any, Any], None]  # (x, inputs, ages, longest_step, derived, work)
    read: Callable[[Any, Any, Any], None]  # (x, derived, y): the outputs


@dataclass(frozen=True, eq=False)
class Records:
    """The records of named numbers at the start of a plan and of a row."""

    plan: Callable[[Any], Any]
    row: Callable[[Any], Any]
