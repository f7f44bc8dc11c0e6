"""One step of an environment, and the start of an episode, as compiled code; for one environment and for many.

The functions are templates: names in capitals and the vehicle's functions are open, and `bind_kernel` gives them their
meaning for a kind of vehicle; what differs between kinds is in `torpedo_kernel` and `float_kernel`. `layout` says what
the numbers of a plan and a row are. All randomness is in numbers that were drawn before and lie in the row, so that one
environment and many do the same with the same generators.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, isnan
from typing import Any

import numpy as np

from auv_gym.compiled import bind, ready, view_as
from auv_gym.envs import float_kernel, torpedo_kernel
from auv_gym.envs.layout import (
    DIVERGED,
    LAYOUTS,
    NO_REASON,
    OVER,
    REFUSED,
    RUNNING,
    SAMPLING,
    TERMINATED,
    TRUNCATED,
    offset,
    plan_type,
    row_type,
    size,
)
from auv_gym.physics.frames import wrapped
from auv_gym.physics.sampling import sampled
from auv_gym.plant.rollout import bind_family, scratch_for
from auv_gym.vehicles.family import Family

START_DRAWS = 3  # of the first state
CHANGE_DRAWS = 3  # of a new target or leg
_LARGEST = 1e9  # a state beyond it counts as diverged: positions and angles no longer resolve a step
_EFFECTS = len(SAMPLING)

# Open names of the templates, bound per kind of vehicle.
STATES = ACTUATORS = INPUTS = OUTPUTS = WORK = SENSED = 0
PLAN_FIXED = ROW_FIXED = OBSERVATION_AT = COMMAND_AT = RAW_AT = 0
view: Any
view_plan: Any
view_row: Any
vehicle_step: Any
read: Any
settle: Any
shape: Any
derive: Any
command: Any
beyond: Any
fault: Any
score: Any
aim: Any
sample: Any
look: Any
observe: Any
pass_time: Any
steps_left: Any
ages: Any
place: Any
set_out: Any
doubt: Any
draw_target: Any
outcome: Any
advance: Any
begin: Any
prange: Any


def _fault(x, t):
    """Why this state ends the episode, and the number that does (of a diverged state, its index)."""
    for i in range(x.shape[0]):
        if not abs(x[i]) < _LARGEST:
            return DIVERGED, float(i)
    return beyond(x, t)


def _target_error(value, t, e):
    """The target minus a value of its channel."""
    error = e.target[0] - value
    return wrapped(error) if t.is_angle != 0.0 else error


def _draw_target(t, e, row):
    """A new target where the present one has had its time."""
    if isnan(t.fixed_target) and e.time >= e.change_at - 1e-9:
        at = int(t.draws_at) + START_DRAWS + int(t.randomised) + CHANGE_DRAWS * (int(e.change) % int(t.changes))
        e.change += 1.0
        step = t.target_step[0] + (t.target_step[1] - t.target_step[0]) * row[at]
        if row[at + 1] < 0.5:
            step = -step
        if e.target[0] + step < t.target_band[0] or e.target[0] + step > t.target_band[1]:
            step = -step
        e.target[0] = min(max(e.target[0] + step, t.target_band[0]), t.target_band[1])
        if t.is_angle != 0.0:
            e.target[0] = wrapped(e.target[0])
        e.change_at = e.time + t.target_hold[0] + (t.target_hold[1] - t.target_hold[0]) * row[at + 2]


def _first_target(x, t, e, row):
    """The first target of an episode: a step from where the vehicle is, or what was given."""
    e.target[0] = x[int(t.true_index)]
    draw_target(t, e, row)
    if not isnan(t.fixed_target):
        e.target[0] = t.fixed_target
    if not isnan(e.first_target):
        e.target[0] = e.first_target


def _sample(t, e, row, fresh):
    """What the sensors read of e.raw now, into the features; fresh: there is nothing older to read."""
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


def _observe(plan, t, e, row):
    """The observation, from the features that the readings give."""
    look(t, e, row)
    f = e.features
    observation = row[OBSERVATION_AT : OBSERVATION_AT + 16].view(np.float32)
    at = int(t.observed_at)
    for k in range(int(t.observations)):
        value = (f[int(plan[at])] - plan[at + 1]) / plan[at + 2]
        observation[k] = min(max(value, -1.0), 1.0)
        at += 3


def _outcome(plan, derived, row, t, e):
    """What follows from the state that the vehicle or the model has reached: reward, reading, target, observation.

    Returns the status.  A diverged state is put back to the last finite one, and what was read then stays.
    """
    state_at, previous_at, count = int(t.state_at), int(t.previous_at), int(t.full_state)
    x, before = row[state_at : state_at + count], row[previous_at : previous_at + count]
    e.step += 1.0
    pass_time(t, e, row)
    left = steps_left(t, e)
    reason, e.reason_value = fault(x, t)
    e.reason = reason
    if reason != NO_REASON:
        for i in range(3):
            e.term[i] = -t.weight[i] * (left + 1.0)
    else:
        score(x, before, t, e)
    e.reward = e.term[0] + e.term[1] + e.term[2]
    if reason == DIVERGED:
        for i in range(count):
            x[i] = before[i]
        e.over = 1.0
        return TERMINATED
    if t.by_model == 0.0:
        read(x, derived, row[RAW_AT : RAW_AT + OUTPUTS])
    sample(t, e, row, False)
    if reason == NO_REASON:
        aim(plan, x, t, e, row)
    observe(plan, t, e, row)
    if e.reason == NO_REASON and left > 0.0:
        return RUNNING
    e.over = 1.0
    return TERMINATED if e.reason != NO_REASON else TRUNCATED


def _advance(plan, derived, row, t, e, work):
    """One step of an environment whose action is in the row; the status."""
    command(t, e)
    state_at, previous_at, count = int(t.state_at), int(t.previous_at), int(t.full_state)
    x = row[state_at : state_at + count]
    for i in range(count):
        row[previous_at + i] = x[i]
    # a slice, since a field of the row has a type of its own, for which the step would be compiled once more
    inputs = row[COMMAND_AT : COMMAND_AT + INPUTS]
    vehicle_step(x, inputs, ages(plan, t, row), t.longest_step, derived, work)
    doubt(x, derived, e, work)
    return outcome(plan, derived, row, t, e)


def _begin(vector, plan, derived, row):
    """The start of an episode in a row whose numbers are drawn: parameters, state, target and first observation.

    vector: the parameters before randomisation.  The vehicle starts with its actuators where its first commands have
    them, except for what row.start gives.
    """
    t, e = view_plan(plan[:PLAN_FIXED]), view_row(row[:ROW_FIXED])
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
        derive(drawn, derived)
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
    place(plan, drawn, t, e, row)
    for i in range(STATES):
        if not isnan(e.start[i]):
            x[i] = e.start[i]
    p = view(derived)
    memory = x[STATES + ACTUATORS : STATES + 2 * ACTUATORS]
    past = x[count - int(t.history) * ACTUATORS :].reshape((int(t.history), ACTUATORS))
    for _ in range(2):  # the first time for the play, which starts in its middle
        shape(row[COMMAND_AT : COMMAND_AT + INPUTS], memory, p, past[0])
        for j in range(ACTUATORS):
            memory[j] = past[0, j]
    for j in range(ACTUATORS):
        x[STATES + j] = past[0, j]
        for k in range(int(t.history)):
            past[k, j] = past[0, j]
    settle(x, derived)
    doubt(x, derived, e, np.empty(WORK))
    for i in range(count):
        row[previous_at + i] = x[i]
    set_out(plan, x, t, e, row)
    read(x, derived, row[RAW_AT : RAW_AT + OUTPUTS])
    if t.by_model == 0.0:
        sample(t, e, row, True)
        observe(plan, t, e, row)


def _begin_one(vector, buffer):
    """The start of an episode in the buffer of a single environment."""
    plan_size = int(buffer[0])
    row_at = plan_size + int(buffer[2])
    row = buffer[row_at : row_at + int(buffer[1])]
    begin(vector, buffer[:plan_size], buffer[plan_size:row_at], row)


def _step_one(buffer):
    """One step of a single environment; the status: REFUSED where the action is not finite, OVER after the end."""
    plan_size = int(buffer[0])
    row_at = plan_size + int(buffer[2])
    work_at = row_at + int(buffer[1])
    row = buffer[row_at:work_at]
    t, e = view_plan(buffer[:PLAN_FIXED]), view_row(row[:ROW_FIXED])
    if e.over != 0.0:
        return OVER
    for k in range(INPUTS):
        if not abs(e.action[k]) < np.inf:
            return REFUSED
    return advance(buffer[:plan_size], buffer[plan_size:row_at], row, t, e, buffer[work_at:])


def _command_one(buffer):
    """The commands for a model that drives a single environment; its status as that of `step_one`."""
    plan_size = int(buffer[0])
    row_at = plan_size + int(buffer[2])
    row = buffer[row_at : row_at + int(buffer[1])]
    t, e = view_plan(buffer[:PLAN_FIXED]), view_row(row[:ROW_FIXED])
    if e.over != 0.0:
        return OVER
    for k in range(INPUTS):
        if not abs(e.action[k]) < np.inf:
            return REFUSED
    command(t, e)
    for i in range(int(t.full_state)):
        row[int(t.previous_at) + i] = row[int(t.state_at) + i]
    return RUNNING


def _look_one(buffer):
    """The first observation of a single environment whose state and outputs are a model's."""
    plan_size = int(buffer[0])
    row_at = plan_size + int(buffer[2])
    row = buffer[row_at : row_at + int(buffer[1])]
    plan = buffer[:plan_size]
    t, e = view_plan(plan[:PLAN_FIXED]), view_row(row[:ROW_FIXED])
    sample(t, e, row, True)
    observe(plan, t, e, row)


def _outcome_one(buffer):
    """What follows from a model's state and outputs in the buffer of a single environment; the status."""
    plan_size = int(buffer[0])
    row_at = plan_size + int(buffer[2])
    plan, row = buffer[:plan_size], buffer[row_at : row_at + int(buffer[1])]
    return outcome(plan, buffer[plan_size:row_at], row, view_plan(plan[:PLAN_FIXED]), view_row(row[:ROW_FIXED]))


def _step_many(vector, plan, derived, rows, begins, observations, rewards, terminated, truncated):
    """One step of every row, on all cores; rows in `begins` start an episode instead, with reward 0.

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
            e = view_row(row[:ROW_FIXED])
            status = advance(plan, derived[own * i], row, view_plan(plan[:PLAN_FIXED]), e, np.empty(WORK))
            rewards[i] = e.reward
        terminated[i] = status == TERMINATED
        truncated[i] = status == TRUNCATED
        found = row[OBSERVATION_AT : OBSERVATION_AT + 16].view(np.float32)
        for k in range(observations.shape[1]):
            observations[i, k] = found[k]


def _begin_many(vector, plan, derived, rows, begins, observations):
    """The start of an episode in the rows in `begins`, on all cores; observations of the other rows stay."""
    own = 1 if derived.shape[0] > 1 else 0
    for i in prange(rows.shape[0]):
        if begins[i]:
            begin(vector, plan, derived[own * i], rows[i])
            found = rows[i, OBSERVATION_AT : OBSERVATION_AT + 16].view(np.float32)
            for k in range(observations.shape[1]):
                observations[i, k] = found[k]


@dataclass(frozen=True, eq=False)
class Kernel:
    """The compiled programs of a kind of vehicle; each is compiled when first called, and found in the cache after."""

    begin_one: Any
    step_one: Any
    command_one: Any
    look_one: Any
    outcome_one: Any
    begin_many: Any
    step_many: Any


_TEMPLATES = {"body": torpedo_kernel.TEMPLATES, "float": float_kernel.TEMPLATES}
_BEFORE, _AFTER = (_target_error, _draw_target, _first_target), (_fault, _sample, _observe, _outcome, _advance, _begin)
_CALLED = ("aim", "lead_on", "begin")  # too long, or too rare, to be compiled into those that call them
_BOUND: dict[str, Kernel] = {}


def bind_kernel(family: Family) -> Kernel:
    """The programs for a family's kind."""
    program = family.program or family.kind
    if program in _BOUND:
        return _BOUND[program]
    kind, programs = family.kind, bind_family(family)
    plan, row, layout = plan_type(family), row_type(family), LAYOUTS[family.kind]

    known: dict[str, Any] = {
        "STATES": len(family.states),
        "ACTUATORS": len(family.actuators),
        "INPUTS": len(family.inputs),
        "OUTPUTS": len(family.outputs),
        "SENSED": len(layout.sensors),
        "WORK": scratch_for(family).size,
        "START_DRAWS": START_DRAWS,
        "CHANGE_DRAWS": CHANGE_DRAWS,
        "PLAN_FIXED": size(plan),
        "ROW_FIXED": size(row),
        "OBSERVATION_AT": offset(row, "observation"),
        "COMMAND_AT": offset(row, "command"),
        "RAW_AT": offset(row, "raw"),
        "SHARES": len(family.outputs) + len(layout.geometry),
        **{name.upper(): len(family.outputs) + index for index, name in enumerate(layout.geometry)},
        **{_symbol(name): index for index, name in enumerate(family.states)},
        **{f"READ_{_symbol(name)}": index for index, name in enumerate(family.outputs)},
        **{f"IN_{_symbol(name)}": index for index, name in enumerate(family.inputs)},
        **{f"{role.upper()}_INPUT": at for role, at in _helm(family).items()},
        "view": family.view,
        "view_plan": view_as(plan, f"plan_{program}"),
        "view_row": view_as(row, f"row_{program}", writable=True),
        "vehicle_step": programs.step,
        "read": programs.read,
        "settle": programs.settle,
        "shape": family.hooks["shape"],
        "derive": programs.derive,
    }
    for template in (*_BEFORE, *_TEMPLATES[kind], *_AFTER):  # each after those that it calls
        name = template.__name__[1:]
        known[name] = bind(template, program, inline=name not in _CALLED, **known)
    _BOUND[program] = Kernel(
        begin_one=ready(bind(_begin_one, program, inline=False, **known)),
        step_one=ready(bind(_step_one, program, inline=False, **known)),
        command_one=ready(bind(_command_one, program, inline=False, **known)),
        look_one=ready(bind(_look_one, program, inline=False, **known)),
        outcome_one=ready(bind(_outcome_one, program, inline=False, **known)),
        begin_many=ready(bind(_begin_many, program, parallel=True, **known)),
        step_many=ready(bind(_step_many, program, parallel=True, **known)),
    )
    return _BOUND[program]


def _helm(family: Family) -> dict[str, int]:
    """The first input of each role; -1 where there is none."""
    roles = family.body.by_role() if family.body else {}
    return {role: family.inputs.index(roles[role][0]) if role in roles else -1 for role in ("yaw", "pitch", "surge")}


def _symbol(channel: str) -> str:
    return channel.rpartition("_")[0].upper()
