"""Compiled programs: one step of an environment, and the start of an episode, for one environment or many.

The functions are templates. A plain name that they call is the template of that name, bound before; `hooks`, `vehicle`
and `records` are the kind's part of the step, the family's programs, and the records of plan and row. Names in capitals
are numbers, see `open_numbers`. `bind_kernel` combines them. `layout` describes the numbers of a plan and a row. All
random numbers are drawn beforehand and stored in the row, so that single and vector environments with the same
generators behave the same.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import floor, isnan
from typing import Any

import numpy as np

from auv_gym.compiled import OPEN, bind, namespace, ready, view_as
from auv_gym.envs.kernel.hooks import Hooks, Records, Vehicle
from auv_gym.envs.kernel.layout import (
    DIVERGED,
    NO_REASON,
    OVER,
    REFUSED,
    RUNNING,
    SAMPLING,
    START_DRAWS,
    TERMINATED,
    TRUNCATED,
    offset,
    plan_type,
    row_type,
    size,
)
from auv_gym.envs.kind import EnvKind
from auv_gym.physics.sensors import sampled
from auv_gym.plant.rollout import bind_family, scratch_for
from auv_gym.vehicles.family import Family

_LARGEST = 1e9  # a larger state counts as diverged: positions and angles would no longer resolve a step
_EFFECTS = len(SAMPLING)

hooks: Hooks = OPEN
vehicle: Vehicle = OPEN
records: Records = OPEN
prange: Any = OPEN
STATES = ACTUATORS = INPUTS = OUTPUTS = SENSED = WORK = 0
PLAN_FIXED = ROW_FIXED = OBSERVATION_AT = COMMAND_AT = RAW_AT = 0
IN_ELAPSED = -1


def fault(x, t):
    """The reason why a state ends the episode, and the number responsible (for a diverged state, its index)."""
    for i in range(x.shape[0]):
        if not abs(x[i]) < _LARGEST:
            return DIVERGED, float(i)
    return hooks.beyond(x, t)


def sample(t, e, row, fresh):
    """Put the sensors' readings of e.raw into the features; fresh: whether there are no older readings."""
    if t.sampled == 0.0:
        for i in range(OUTPUTS):
            e.features[i] = e.raw[i]
        return
    kept, now, at = int(t.delayed), int(e.step), int(t.delayed_at)
    for k in range(kept):
        if fresh or k == now % kept:
            for i in range(OUTPUTS):
                row[at + k * OUTPUTS + i] = e.raw[i]
    used, rows, noise_at = int(e.noise_used), int(t.noise_rows), int(t.noise_at)
    for i in range(OUTPUTS):
        s = int(t.sensor_of[i])
        if s < 0:
            e.features[i] = e.raw[i]
            continue
        delay = floor(e.sampling[_EFFECTS * s] / t.dt + 0.5)
        normal, uniform = 0.0, 1.0
        if rows > 0:
            normal = row[noise_at + used * OUTPUTS + i]
            uniform = 1.0 if fresh else row[noise_at + rows * OUTPUTS + used * SENSED + s]
        e.features[i] = sampled(
            row[at + (now - delay) % kept * OUTPUTS + i],
            e.features[i],
            e.sampling[_EFFECTS * s + 1],
            e.sampling[_EFFECTS * s + 2],
            e.sampling[_EFFECTS * s + 3],
            normal,
            uniform,
        )
    e.noise_used += 1.0


def observe(plan, t, e, row):
    """Compute the observation from the features and readings."""
    hooks.look(t, e, row)
    f = e.features
    observation = row[OBSERVATION_AT : OBSERVATION_AT + 16].view(np.float32)
    at = int(t.observed_at)
    for k in range(int(t.observations)):
        value = (f[int(plan[at])] - plan[at + 1]) / plan[at + 2]
        observation[k] = min(max(value, -1.0), 1.0)
        at += 3


def outcome(plan, derived, row, t, e):
    """Compute the outcome of the state that the vehicle or the model has reached: reward, reading, target, observation.

    Returns the status.  A diverged state is replaced by the last finite one, and its readings are kept.
    """
    state_at, previous_at, count = int(t.state_at), int(t.previous_at), int(t.full_state)
    x, before = row[state_at : state_at + count], row[previous_at : previous_at + count]
    e.step += 1.0
    hooks.pass_time(t, e, row)
    left = hooks.steps_left(t, e)
    reason, e.reason_value = fault(x, t)
    e.reason = reason
    if reason != NO_REASON:
        for i in range(3):
            e.term[i] = -t.weight[i] * (left + 1.0)
    else:
        hooks.score(x, before, t, e)
    e.reward = e.term[0] + e.term[1] + e.term[2]
    if reason == DIVERGED:
        for i in range(count):
            x[i] = before[i]
        e.over = 1.0
        return TERMINATED
    if t.by_model == 0.0:
        vehicle.read(x, derived, row[RAW_AT : RAW_AT + OUTPUTS])
    sample(t, e, row, False)
    if reason == NO_REASON:
        hooks.aim(plan, x, t, e, row)
    observe(plan, t, e, row)
    if e.reason == NO_REASON and left > 0.0:
        return RUNNING
    e.over = 1.0
    return TERMINATED if e.reason != NO_REASON else TRUNCATED


def command(plan, t, e):
    """Compute the commands of the row's action, and the length of the step if it varies for this vehicle."""
    hooks.command(plan, t, e)
    if IN_ELAPSED >= 0:
        e.command[IN_ELAPSED] = e.time


def advance(plan, derived, row, t, e, work):
    """Advance an environment with the action in the row by one step; returns the status."""
    command(plan, t, e)
    state_at, previous_at, count = int(t.state_at), int(t.previous_at), int(t.full_state)
    x = row[state_at : state_at + count]
    for i in range(count):
        row[previous_at + i] = x[i]
    # a slice, since a field of the row has its own type, for which the step would be compiled again
    inputs = row[COMMAND_AT : COMMAND_AT + INPUTS]
    vehicle.step(x, inputs, hooks.ages(plan, t, row), t.longest_step, derived, work)
    hooks.doubt(x, derived, e, work)
    return outcome(plan, derived, row, t, e)


def begin(vector, plan, derived, row):
    """Start an episode in a row with drawn numbers: parameters, state, target and first observation.

    vector: the parameters before randomisation.  The vehicle's actuators start at its first commands, except for values
    given in row.start.
    """
    t, e = records.plan(plan[:PLAN_FIXED]), records.row(row[:ROW_FIXED])
    draws, randomised = int(t.draws_at), int(t.randomised)
    sampling_from = int(t.sampling_from)
    drawn = vector
    if randomised > 0:
        drawn = vector.copy()
        at = int(t.randomised_at)
        for k in range(randomised):
            low, high = plan[at + 1], plan[at + 2]
            drawn[int(plan[at])] = min(max(low + (high - low) * row[draws + START_DRAWS + k], low), high)
            at += 3
        vehicle.derive(drawn, derived)
    for i in range(SENSED * _EFFECTS):
        e.sampling[i] = drawn[sampling_from + i]

    e.step, e.over, e.time, e.reward, e.reason, e.reason_value = 0.0, 0.0, 0.0, 0.0, float(NO_REASON), 0.0
    e.change, e.change_at, e.noise_used = 0.0, 0.0, 0.0
    for i in range(e.features.shape[0]):
        e.features[i] = 0.0
    for i in range(e.term.shape[0]):
        e.term[i] = 0.0
    for i in range(e.target.shape[0]):
        e.target[i] = 0.0
    state_at, previous_at, count = int(t.state_at), int(t.previous_at), int(t.full_state)
    x = row[state_at : state_at + count]
    for i in range(count):
        x[i] = 0.0
    hooks.place(plan, drawn, t, e, row)
    for i in range(STATES):
        if not isnan(e.start[i]):
            x[i] = e.start[i]
    p = vehicle.parameters(derived)
    memory = x[STATES + ACTUATORS : STATES + 2 * ACTUATORS]
    past = x[count - int(t.history) * ACTUATORS :].reshape((int(t.history), ACTUATORS))
    for _ in range(2):  # the first pass sets the play, which starts in its middle
        vehicle.shape(row[COMMAND_AT : COMMAND_AT + INPUTS], memory, p, past[0])
        for j in range(ACTUATORS):
            memory[j] = past[0, j]
    for j in range(ACTUATORS):
        x[STATES + j] = past[0, j]
        for k in range(int(t.history)):
            past[k, j] = past[0, j]
    vehicle.settle(x, derived)
    hooks.doubt(x, derived, e, np.empty(WORK))
    for i in range(count):
        row[previous_at + i] = x[i]
    hooks.set_out(plan, x, t, e, row)
    vehicle.read(x, derived, row[RAW_AT : RAW_AT + OUTPUTS])
    if t.by_model == 0.0:
        sample(t, e, row, True)
        observe(plan, t, e, row)


def begin_one(vector, buffer):
    """Start an episode in the buffer of a single environment."""
    plan_size = int(buffer[0])
    row_at = plan_size + int(buffer[2])
    row = buffer[row_at : row_at + int(buffer[1])]
    begin(vector, buffer[:plan_size], buffer[plan_size:row_at], row)


def step_one(buffer):
    """Advance a single environment by one step; the status is REFUSED for a non-finite action, OVER after the end."""
    plan_size = int(buffer[0])
    row_at = plan_size + int(buffer[2])
    work_at = row_at + int(buffer[1])
    row = buffer[row_at:work_at]
    t, e = records.plan(buffer[:PLAN_FIXED]), records.row(row[:ROW_FIXED])
    if e.over != 0.0:
        return OVER
    for k in range(INPUTS):
        if not abs(e.action[k]) < np.inf:
            return REFUSED
    return advance(buffer[:plan_size], buffer[plan_size:row_at], row, t, e, buffer[work_at:])


def command_one(buffer):
    """Compute the commands for a model that drives a single environment; status as for `step_one`."""
    plan_size = int(buffer[0])
    row_at = plan_size + int(buffer[2])
    plan, row = buffer[:plan_size], buffer[row_at : row_at + int(buffer[1])]
    t, e = records.plan(plan[:PLAN_FIXED]), records.row(row[:ROW_FIXED])
    if e.over != 0.0:
        return OVER
    for k in range(INPUTS):
        if not abs(e.action[k]) < np.inf:
            return REFUSED
    command(plan, t, e)
    for i in range(int(t.full_state)):
        row[int(t.previous_at) + i] = row[int(t.state_at) + i]
    return RUNNING


def look_one(buffer):
    """Compute the first observation of a single environment from a model's state and outputs."""
    plan_size = int(buffer[0])
    row_at = plan_size + int(buffer[2])
    row = buffer[row_at : row_at + int(buffer[1])]
    plan = buffer[:plan_size]
    t, e = records.plan(plan[:PLAN_FIXED]), records.row(row[:ROW_FIXED])
    sample(t, e, row, True)
    observe(plan, t, e, row)


def outcome_one(buffer):
    """Compute the outcome of a model's state and outputs in the buffer of a single environment; returns the status."""
    plan_size = int(buffer[0])
    row_at = plan_size + int(buffer[2])
    plan, row = buffer[:plan_size], buffer[row_at : row_at + int(buffer[1])]
    return outcome(plan, buffer[plan_size:row_at], row, records.plan(plan[:PLAN_FIXED]), records.row(row[:ROW_FIXED]))


def step_many(vector, plan, derived, rows, begins, observations, rewards, terminated, truncated):
    """Advance every row by one step, on all cores; rows in `begins` start an episode instead, with reward 0.

    derived: (n, ...), or (1, ...) for all rows.  observations: (n, ...) float32.  rewards: (n,).
    terminated, truncated: (n,) bool.
    """
    own = 1 if derived.shape[0] > 1 else 0
    for i in prange(rows.shape[0]):
        row = rows[i]
        if begins[i]:
            begin(vector, plan, derived[own * i], row)
            status, rewards[i] = RUNNING, 0.0
        else:
            e = records.row(row[:ROW_FIXED])
            status = advance(plan, derived[own * i], row, records.plan(plan[:PLAN_FIXED]), e, np.empty(WORK))
            rewards[i] = e.reward
        terminated[i] = status == TERMINATED
        truncated[i] = status == TRUNCATED
        found = row[OBSERVATION_AT : OBSERVATION_AT + 16].view(np.float32)
        for k in range(observations.shape[1]):
            observations[i, k] = found[k]


def begin_many(vector, plan, derived, rows, begins, observations):
    """Start an episode in the rows in `begins`, on all cores; observations of the other rows are unchanged."""
    own = 1 if derived.shape[0] > 1 else 0
    for i in prange(rows.shape[0]):
        if begins[i]:
            begin(vector, plan, derived[own * i], rows[i])
            found = rows[i, OBSERVATION_AT : OBSERVATION_AT + 16].view(np.float32)
            for k in range(observations.shape[1]):
                observations[i, k] = found[k]


@dataclass(frozen=True, eq=False)
class Kernel:
    """The compiled programs of a kind of vehicle; each is compiled at its first call, and then cached."""

    begin_one: Any
    step_one: Any
    command_one: Any
    look_one: Any
    outcome_one: Any
    begin_many: Any
    step_many: Any


_BOUND: dict[str, Kernel] = {}
_CALLED = ("aim", "begin")  # too long, or too rarely called, to be inlined


def bind_kernel(family: Family, kind: EnvKind) -> Kernel:
    """The programs of a family; its kind supplies the hooks."""
    program = family.program or family.kind
    if program in _BOUND:
        return _BOUND[program]
    physics = bind_family(family)
    own = Vehicle(
        parameters=family.view,
        derive=physics.derive,
        shape=family.hooks.shape,
        settle=physics.settle,
        step=physics.step,
        read=physics.read,
    )
    plan, row = plan_type(family, kind.layout), row_type(family, kind.layout)
    views = Records(plan=view_as(plan, f"plan_{program}"), row=view_as(row, f"row_{program}", writable=True))
    known: dict[str, Any] = {**open_numbers(family, kind), "vehicle": namespace(own)}
    filled = {
        hook.name: bind(getattr(kind.hooks, hook.name), program, inline=hook.name not in _CALLED, **known)
        for hook in fields(Hooks)
    }
    known |= {"hooks": namespace(Hooks(**filled)), "records": namespace(views)}
    for template in (fault, sample, observe, outcome, command, advance, begin):  # each comes after those that it calls
        known[template.__name__] = bind(template, program, inline=template.__name__ not in _CALLED, **known)
    _BOUND[program] = Kernel(
        begin_one=ready(bind(begin_one, program, inline=False, **known)),
        step_one=ready(bind(step_one, program, inline=False, **known)),
        command_one=ready(bind(command_one, program, inline=False, **known)),
        look_one=ready(bind(look_one, program, inline=False, **known)),
        outcome_one=ready(bind(outcome_one, program, inline=False, **known)),
        begin_many=ready(bind(begin_many, program, parallel=True, **known)),
        step_many=ready(bind(step_many, program, parallel=True, **known)),
    )
    return _BOUND[program]


def open_numbers(family: Family, kind: EnvKind) -> dict[str, int]:
    """The numbers that templates need about a family: sizes, and indices of states, readings, inputs and features.

    Names are those of channels without the unit: DEPTH is the index of depth_m among the states, READ_DEPTH among the
    readings, IN_DEPTH among the inputs.  ERROR, or another name of `Layout.geometry`, is an index among the features;
    SHARES is that of the first command's share of its limit.
    """
    plan, row, outputs = plan_type(family, kind.layout), row_type(family, kind.layout), len(family.outputs)
    return {
        "STATES": len(family.states),
        "ACTUATORS": len(family.actuators),
        "INPUTS": len(family.inputs),
        "OUTPUTS": outputs,
        "SENSED": len(kind.layout.sensors),
        "WORK": scratch_for(family).size,
        "PLAN_FIXED": size(plan),
        "ROW_FIXED": size(row),
        "OBSERVATION_AT": offset(row, "observation"),
        "COMMAND_AT": offset(row, "command"),
        "RAW_AT": offset(row, "raw"),
        "SHARES": outputs + len(kind.layout.geometry),
        **{name.upper(): outputs + index for index, name in enumerate(kind.layout.geometry)},
        **{_symbol(name): index for index, name in enumerate(family.states)},
        **{f"READ_{_symbol(name)}": index for index, name in enumerate(family.outputs)},
        **{f"IN_{_symbol(name)}": index for index, name in enumerate(family.inputs)},
        **kind.numbers(family),
    }


def _symbol(channel: str) -> str:
    return channel.rpartition("_")[0].upper()
