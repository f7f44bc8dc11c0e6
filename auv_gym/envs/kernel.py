"""One step of a torpedo environment, and the start of an episode, as compiled code; for one environment and for many.

The functions are templates: names in capitals and the vehicle's functions are open, and `bind_kernel` gives them their
meaning for a kind of vehicle. `layout` says what the numbers of a plan and a row are. All randomness is in numbers that
were drawn before and lie in the row, so that one environment and many do the same with the same generators.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, floor, isnan, pi, sin, sqrt
from typing import Any

import numpy as np

from auv_gym.compiled import bind, view_as
from auv_gym.envs.layout import (
    ARRIVED,
    BROACHED,
    DIVERGED,
    GEOMETRY,
    NO_REASON,
    OVER,
    PITCHED,
    REFUSED,
    ROLLED,
    RUNNING,
    SAMPLING,
    SENSORS,
    SPINNING,
    TERMINATED,
    TOO_DEEP,
    TOO_FAST,
    TRUNCATED,
    offset,
    plan_type,
    row_type,
    size,
)
from auv_gym.envs.path import leg_axes, leg_between, point_ahead
from auv_gym.physics.frames import wrapped
from auv_gym.physics.sampling import sampled
from auv_gym.rollout import bind_family, scratch_for
from auv_gym.vehicles.family import Family

START_DRAWS = 3  # depth, heading, phase of the waves
CHANGE_DRAWS = 3  # of a new target or leg
_LARGEST = 1e9  # a state beyond it counts as diverged: positions and angles no longer resolve a step
_SENSORS, _EFFECTS = len(SENSORS), len(SAMPLING)

# Open names of the templates, bound per kind of vehicle.
STATES = ACTUATORS = INPUTS = OUTPUTS = DERIVED = WORK = 0
PLAN_FIXED = ROW_FIXED = OBSERVATION_AT = COMMAND_AT = RAW_AT = SHARES = 0
U = V = W = P = Q = R = NORTH = EAST = DEPTH = ROLL = PITCH = HEADING = WAVE_PHASE = 0
READ_W = READ_Q = READ_R = READ_V = READ_NORTH = READ_EAST = READ_DEPTH = READ_PITCH = READ_HEADING = 0
view: Any
view_plan: Any
view_row: Any
vehicle_step: Any
read: Any
settle: Any
shape: Any
derive: Any
command: Any
fault: Any
score: Any
aim: Any
lead_on: Any
sample: Any
observe: Any
outcome: Any
advance: Any
begin: Any
prange: Any


def _command(t, e):
    """The commands of an action, and what the regulators hold, into e.command, and what their change costs into e.term.

    Fins outside the action keep the cruise, by linear feedback of the readings: the rudder the heading and the stern
    plane the depth at which the episode began.
    """
    travel = 0.0
    for j in range(INPUTS):
        a = int(t.action_of[j])
        if a >= 0:
            share = min(max(e.action[a], -1.0), 1.0)
            travel += abs(share - e.features[SHARES + j])
            e.command[j], e.features[SHARES + j] = share * t.limit[j], share
    if t.action_of[0] < 0.0:
        k = t.rudder_gains
        off = wrapped(e.features[READ_HEADING] - e.held[1])
        value = k[0] * (e.features[READ_V] - t.cruise_state[V]) + k[1] * e.features[READ_R] + k[2] * off
        e.command[0] = min(max(t.cruise_command[0] - value, -t.limit[0]), t.limit[0])
        e.features[SHARES] = e.command[0] / t.limit[0]
    if t.action_of[1] < 0.0:
        k = t.plane_gains
        deep = min(max(e.features[READ_DEPTH] - e.held[0], -t.held_depth_error), t.held_depth_error)
        value = k[0] * (e.features[READ_W] - t.cruise_state[W]) + k[1] * e.features[READ_Q]
        value += k[2] * (e.features[READ_PITCH] - t.cruise_state[PITCH]) + k[3] * deep
        e.command[1] = min(max(t.cruise_command[1] - value, -t.limit[1]), t.limit[1])
        e.features[SHARES + 1] = e.command[1] / t.limit[1]
    e.term[1] = -t.weight[1] * 0.5 * travel / t.actions


def _fault(x, t):
    """Why this state ends the episode, and the number that does (of a diverged state, its index)."""
    for i in range(x.shape[0]):
        if not abs(x[i]) < _LARGEST:
            return DIVERGED, float(i)
    if x[DEPTH] < 0.0:
        return BROACHED, x[DEPTH]
    if x[DEPTH] > t.depth_limit:
        return TOO_DEEP, x[DEPTH]
    square = x[U] * x[U] + x[V] * x[V] + x[W] * x[W]
    if square > t.speed_limit * t.speed_limit:
        return TOO_FAST, sqrt(square)
    square = x[P] * x[P] + x[Q] * x[Q] + x[R] * x[R]
    if square > t.rate_limit * t.rate_limit:
        return SPINNING, sqrt(square)
    if abs(x[PITCH]) > t.pitch_limit:
        return PITCHED, x[PITCH]
    if abs(x[ROLL]) > t.roll_limit:
        return ROLLED, x[ROLL]
    return NO_REASON, 0.0


def _score(x, before, t, e):
    """The reward terms of the true state x, for the target that the action was chosen for."""
    if t.follows_path == 0.0:
        error = e.target[0] - x[int(t.true_index)]
        if t.is_angle != 0.0:
            error = wrapped(error)
        e.term[0] = -t.weight[0] * min(abs(error) / t.error_scale, 1.0)
        return
    _, across, below = leg_axes(x[NORTH] - e.origin[0], x[EAST] - e.origin[1], x[DEPTH] - e.origin[2], e.course, e.sink)
    moved, _, _ = leg_axes(x[NORTH] - before[NORTH], x[EAST] - before[EAST], x[DEPTH] - before[DEPTH], e.course, e.sink)
    e.term[0] = -t.weight[0] * min(sqrt(across * across + below * below) / t.error_scale, 1.0)
    e.term[2] = -t.weight[2] * min(abs(t.path_speed - moved / t.dt) / t.path_speed, 1.0)


def _lead_on(plan, t, e, row):
    """The waypoint after the present one into e.next, given or drawn, and the leg to it."""
    count = int(t.waypoints)
    k = int(e.reached) + 1
    if count > 0:
        at = int(t.waypoints_at) + 3 * min(k, count - 1)
        e.next[0], e.next[1], e.next[2] = plan[at], plan[at + 1], plan[at + 2]
        e.next_course, e.next_sink = e.course, e.sink
        if k < count:
            e.next_course, e.next_sink, _ = leg_between(
                e.target[0], e.target[1], e.target[2], e.next[0], e.next[1], e.next[2]
            )
        return
    at = int(t.draws_at) + START_DRAWS + int(t.randomised) + CHANGE_DRAWS * (int(e.change) % int(t.changes))
    e.change += 1.0
    length = t.leg[0] + (t.leg[1] - t.leg[0]) * row[at]
    course = e.course + t.turn * (2.0 * row[at + 1] - 1.0)
    sink = t.slope * (2.0 * row[at + 2] - 1.0)
    depth = e.target[2] + length * sin(sink)
    if depth < t.target_band[0] or depth > t.target_band[1]:
        sink = -sink
    north, east, depth = point_ahead(e.target[0], e.target[1], e.target[2], course, sink, length)
    e.next[0], e.next[1] = north, east
    e.next[2] = min(max(depth, t.target_band[0]), t.target_band[1])
    e.next_course, e.next_sink, _ = leg_between(e.target[0], e.target[1], e.target[2], e.next[0], e.next[1], e.next[2])


def _aim(plan, x, t, e, row):
    """A new target or leg where the present one has had its time or is reached; e.reason where it was the last."""
    if t.follows_path == 0.0:
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
        return
    north, east, down = x[NORTH] - e.origin[0], x[EAST] - e.origin[1], x[DEPTH] - e.origin[2]
    along, _, _ = leg_axes(north, east, down, e.course, e.sink)
    north, east, down = e.target[0] - x[NORTH], e.target[1] - x[EAST], e.target[2] - x[DEPTH]
    near = north * north + east * east + down * down < t.radius * t.radius
    if near or along >= e.length:
        e.reached += 1.0
        if t.waypoints > 0.0 and e.reached >= t.waypoints:
            e.reason = ARRIVED
            return
        for i in range(3):
            e.origin[i] = e.target[i]
            e.target[i] = e.next[i]
        e.course, e.sink, e.length = leg_between(
            e.origin[0], e.origin[1], e.origin[2], e.target[0], e.target[1], e.target[2]
        )
        lead_on(plan, t, e, row)


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
            uniform = 1.0 if fresh else row[noise_at + rows * OUTPUTS + used * _SENSORS + s]
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
    """Errors and directions as the readings show them into the features, and the observation from the features."""
    f = e.features
    if t.follows_path == 0.0:
        error = e.target[0] - f[int(t.read_index)]
        if t.is_angle != 0.0:
            error = wrapped(error)
            f[OUTPUTS + 1], f[OUTPUTS + 2] = sin(error), cos(error)
        f[OUTPUTS], f[OUTPUTS + 3] = error, e.target[0]
    else:
        along, across, below = leg_axes(
            f[READ_NORTH] - e.origin[0], f[READ_EAST] - e.origin[1], f[READ_DEPTH] - e.origin[2], e.course, e.sink
        )
        turn, next_turn = e.course - f[READ_HEADING], e.next_course - f[READ_HEADING]
        f[OUTPUTS + 4], f[OUTPUTS + 5], f[OUTPUTS + 6] = across, below, e.length - along
        f[OUTPUTS + 7], f[OUTPUTS + 8], f[OUTPUTS + 9] = sin(turn), cos(turn), e.sink
        f[OUTPUTS + 10], f[OUTPUTS + 11], f[OUTPUTS + 12] = sin(next_turn), cos(next_turn), e.next_sink
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
    e.time = e.step * t.dt
    reason, e.reason_value = fault(x, t)
    e.reason = reason
    if reason != NO_REASON:
        for i in range(3):
            e.term[i] = -t.weight[i] * (t.steps - e.step + 1.0)
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
    if e.reason == NO_REASON and e.step < t.steps:
        return RUNNING
    e.over = 1.0
    return TERMINATED if e.reason != NO_REASON else TRUNCATED


def _advance(plan, derived, row, t, e, work):
    """One step of an environment whose action is in the row; the status."""
    command(t, e)
    state_at, previous_at, ages_at = int(t.state_at), int(t.previous_at), int(t.ages_at)
    count = int(t.full_state)
    x = row[state_at : state_at + count]
    for i in range(count):
        row[previous_at + i] = x[i]
    # a slice, since a field of the row has a type of its own, for which the step would be compiled once more
    inputs = row[COMMAND_AT : COMMAND_AT + INPUTS]
    vehicle_step(x, inputs, plan[ages_at : ages_at + int(t.history) + 1], t.longest_step, derived, work)
    return outcome(plan, derived, row, t, e)


def _begin(vector, plan, derived, row):
    """The start of an episode in a row whose numbers are drawn: parameters, state, target and first observation.

    vector: the parameters before randomisation.  The vehicle starts in cruise, with its actuators where they belong,
    except for what row.start gives.
    """
    t, e = view_plan(plan[:PLAN_FIXED]), view_row(row[:ROW_FIXED])
    draws, randomised = int(t.draws_at), int(t.randomised)
    sampling_from = int(t.sampling_from)
    if randomised > 0:
        drawn = vector.copy()
        at = int(t.randomised_at)
        for k in range(randomised):
            low, high = plan[at + 1], plan[at + 2]
            drawn[int(plan[at])] = min(max(low + (high - low) * row[draws + START_DRAWS + k], low), high)
            at += 3
        derive(drawn, derived)
        for i in range(_SENSORS * _EFFECTS):
            e.sampling[i] = drawn[sampling_from + i]
    else:
        for i in range(_SENSORS * _EFFECTS):
            e.sampling[i] = vector[sampling_from + i]

    state_at, previous_at, count = int(t.state_at), int(t.previous_at), int(t.full_state)
    x = row[state_at : state_at + count]
    for i in range(count):
        x[i] = t.cruise_state[i] if i < STATES else 0.0
    x[DEPTH] = t.start_depth[0] + (t.start_depth[1] - t.start_depth[0]) * row[draws]
    x[HEADING] = pi * (2.0 * row[draws + 1] - 1.0)
    x[WAVE_PHASE] = 2.0 * pi * row[draws + 2]
    for i in range(STATES):
        if not isnan(e.start[i]):
            x[i] = e.start[i]
    p = view(derived)
    memory = x[STATES + ACTUATORS : STATES + 2 * ACTUATORS]
    past = x[count - int(t.history) * ACTUATORS :].reshape((int(t.history), ACTUATORS))
    for _ in range(2):  # the first time for the play, which starts in its middle
        shape(t.cruise_command, memory, p, past[0])
        for j in range(ACTUATORS):
            memory[j] = past[0, j]
    for j in range(ACTUATORS):
        x[STATES + j] = past[0, j]
        for k in range(int(t.history)):
            past[k, j] = past[0, j]
    settle(x, derived)
    for i in range(count):
        row[previous_at + i] = x[i]

    e.step, e.over, e.time, e.reward, e.reason, e.reason_value = 0.0, 0.0, 0.0, 0.0, float(NO_REASON), 0.0
    e.change, e.change_at, e.noise_used, e.reached = 0.0, 0.0, 0.0, 0.0
    for i in range(e.features.shape[0]):
        e.features[i] = 0.0
    for i in range(e.term.shape[0]):
        e.term[i] = 0.0
    for j in range(INPUTS):
        e.command[j] = t.cruise_command[j]
        e.features[SHARES + j] = e.command[j] / t.limit[j] if t.limit[j] > 0.0 else 0.0
    e.held[0], e.held[1] = x[DEPTH], x[HEADING]
    e.target[0] = e.target[1] = e.target[2] = 0.0
    if t.follows_path == 0.0:
        e.target[0] = x[int(t.true_index)]
        aim(plan, x, t, e, row)
        if not isnan(t.fixed_target):
            e.target[0] = t.fixed_target
        if not isnan(e.first_target):
            e.target[0] = e.first_target
    else:
        e.origin[0], e.origin[1], e.origin[2] = x[NORTH], x[EAST], x[DEPTH]
        e.target[0], e.target[1], e.target[2] = x[NORTH], x[EAST], x[DEPTH]
        e.course, e.reached = x[HEADING], -1.0
        lead_on(plan, t, e, row)
        e.reached = 0.0
        for i in range(3):
            e.target[i] = e.next[i]
        e.course, e.sink, e.length = leg_between(
            e.origin[0], e.origin[1], e.origin[2], e.target[0], e.target[1], e.target[2]
        )
        lead_on(plan, t, e, row)
    read(x, derived, row[RAW_AT : RAW_AT + OUTPUTS])
    if t.by_model == 0.0:
        sample(t, e, row, True)
        observe(plan, t, e, row)


def _begin_one(vector, buffer):
    """The start of an episode in the buffer of a single environment."""
    plan_size = int(buffer[0])
    row_at = plan_size + DERIVED
    row = buffer[row_at : row_at + int(buffer[1])]
    begin(vector, buffer[:plan_size], buffer[plan_size:row_at], row)


def _step_one(buffer):
    """One step of a single environment; the status: REFUSED where the action is not finite, OVER after the end."""
    plan_size = int(buffer[0])
    row_at = plan_size + DERIVED
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
    row = buffer[plan_size + DERIVED : plan_size + DERIVED + int(buffer[1])]
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
    row = buffer[plan_size + DERIVED : plan_size + DERIVED + int(buffer[1])]
    plan = buffer[:plan_size]
    t, e = view_plan(plan[:PLAN_FIXED]), view_row(row[:ROW_FIXED])
    sample(t, e, row, True)
    observe(plan, t, e, row)


def _outcome_one(buffer):
    """What follows from a model's state and outputs in the buffer of a single environment; the status."""
    plan_size = int(buffer[0])
    row_at = plan_size + DERIVED
    plan, row = buffer[:plan_size], buffer[row_at : row_at + int(buffer[1])]
    return outcome(plan, buffer[plan_size:row_at], row, view_plan(plan[:PLAN_FIXED]), view_row(row[:ROW_FIXED]))


def _step_many(vector, plan, derived, rows, begins, observations, rewards, terminated, truncated):
    """One step of every row, on all cores; rows in `begins` start an episode instead, with reward 0.

    derived: (n, DERIVED), or (1, DERIVED) for all rows.  observations: (n, ...) float32.  rewards: (n,).
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


_BOUND: dict[str, Kernel] = {}


def bind_kernel(family: Family) -> Kernel:
    """The programs for a family; its inputs are rudder, stern plane, bow plane and propulsion, in this order."""
    if family.kind in _BOUND:
        return _BOUND[family.kind]
    kind, programs = family.kind, bind_family(family)
    plan, row = plan_type(family), row_type(family)

    known: dict[str, Any] = {
        "STATES": len(family.states),
        "ACTUATORS": len(family.actuators),
        "INPUTS": len(family.inputs),
        "OUTPUTS": len(family.outputs),
        "DERIVED": family.derived,
        "WORK": scratch_for(family).size,
        "PLAN_FIXED": size(plan),
        "ROW_FIXED": size(row),
        "OBSERVATION_AT": offset(row, "observation"),
        "COMMAND_AT": offset(row, "command"),
        "RAW_AT": offset(row, "raw"),
        "SHARES": len(family.outputs) + len(GEOMETRY),
        **{_symbol(name): index for index, name in enumerate(family.states)},
        **{f"READ_{_symbol(name)}": index for index, name in enumerate(family.outputs)},
        "view": family.view,
        "view_plan": view_as(plan, f"plan_{kind}"),
        "view_row": view_as(row, f"row_{kind}", writable=True),
        "vehicle_step": programs.step,
        "read": programs.read,
        "settle": programs.settle,
        "shape": family.hooks["shape"],
        "derive": programs.derive,
    }
    for template in (_command, _fault, _score, _lead_on, _aim, _sample, _observe, _outcome, _advance, _begin):
        known[template.__name__[1:]] = bind(template, kind, inline=template not in (_aim, _lead_on, _begin), **known)
    _BOUND[kind] = Kernel(
        begin_one=bind(_begin_one, kind, inline=False, **known),
        step_one=bind(_step_one, kind, inline=False, **known),
        command_one=bind(_command_one, kind, inline=False, **known),
        look_one=bind(_look_one, kind, inline=False, **known),
        outcome_one=bind(_outcome_one, kind, inline=False, **known),
        begin_many=bind(_begin_many, kind, parallel=True, **known),
        step_many=bind(_step_many, kind, parallel=True, **known),
    )
    return _BOUND[kind]


def _symbol(channel: str) -> str:
    return channel.rpartition("_")[0].upper()
