"""What is a body's own in a compiled step: its commands, envelope, targets and paths; see `kernel.hooks`."""

from __future__ import annotations

from math import cos, pi, sin, sqrt

from auv_gym.compiled import OPEN, outlined
from auv_gym.envs.kernel.hooks import Hooks, Vehicle
from auv_gym.envs.kernel.layout import CHANGE_DRAWS, NO_REASON, OWN, START_DRAWS
from auv_gym.envs.kernel.targets import (
    ages,
    draw_target,
    first_target,
    pass_time,
    steps_left,
    target_error,
    tracking_term,
)
from auv_gym.envs.kinds.body.path import leg_axes, leg_between, point_ahead
from auv_gym.physics.frames import wrapped
from auv_gym.vehicles.body.learned_hull import ROOM, support_distance

# Why an episode was terminated.
BROACHED, TOO_DEEP, PITCHED, ROLLED, TOO_FAST, SPINNING, ARRIVED = range(OWN, OWN + 7)

vehicle: Vehicle = OPEN
STATES = INPUTS = ACTUATORS = OUTPUTS = SHARES = YAW_INPUT = PITCH_INPUT = 0
U = V = W = P = Q = R = NORTH = EAST = DEPTH = ROLL = PITCH = HEADING = WAVE_PHASE = 0
READ_W = READ_Q = READ_R = READ_V = READ_NORTH = READ_EAST = READ_DEPTH = READ_PITCH = READ_HEADING = 0


def command(t, e):
    """The commands of an action, and what the regulators hold, into e.command, and what their change costs into e.term.

    Fins outside the action keep the cruise, by linear feedback of the readings: the rudder the heading and the stern
    plane the depth at which the episode began.
    """
    travel = 0.0
    for j in range(ACTUATORS):
        a = int(t.action_of[j])
        if a >= 0:
            share = min(max(e.action[a], -1.0), 1.0)
            travel += abs(share - e.features[SHARES + j])
            e.command[j], e.features[SHARES + j] = t.middle[j] + share * t.limit[j], share
    if t.action_of[YAW_INPUT] < 0.0:
        k = t.rudder_gains
        off = wrapped(e.features[READ_HEADING] - e.held[1])
        value = k[0] * (e.features[READ_V] - t.cruise_state[V]) + k[1] * e.features[READ_R] + k[2] * off
        limit = t.limit[YAW_INPUT]
        e.command[YAW_INPUT] = min(max(t.cruise_command[YAW_INPUT] - value, -limit), limit)
        e.features[SHARES + YAW_INPUT] = e.command[YAW_INPUT] / limit
    if t.action_of[PITCH_INPUT] < 0.0:
        k = t.plane_gains
        deep = min(max(e.features[READ_DEPTH] - e.held[0], -t.held_depth_error), t.held_depth_error)
        value = k[0] * (e.features[READ_W] - t.cruise_state[W]) + k[1] * e.features[READ_Q]
        value += k[2] * (e.features[READ_PITCH] - t.cruise_state[PITCH]) + k[3] * deep
        limit = t.limit[PITCH_INPUT]
        e.command[PITCH_INPUT] = min(max(t.cruise_command[PITCH_INPUT] - value, -limit), limit)
        e.features[SHARES + PITCH_INPUT] = e.command[PITCH_INPUT] / limit
    e.term[1] = -t.weight[1] * 0.5 * travel / t.actions


def beyond(x, t):
    """Why a finite state ends the episode, and the number that does."""
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


def score(x, before, t, e):
    """The reward terms of the true state x, for the target that the action was chosen for."""
    if t.follows_path == 0.0:
        e.term[0] = tracking_term(x, t, e)
        return
    _, across, below = leg_axes(x[NORTH] - e.origin[0], x[EAST] - e.origin[1], x[DEPTH] - e.origin[2], e.course, e.sink)
    moved, _, _ = leg_axes(x[NORTH] - before[NORTH], x[EAST] - before[EAST], x[DEPTH] - before[DEPTH], e.course, e.sink)
    e.term[0] = -t.weight[0] * min(sqrt(across * across + below * below) / t.error_scale, 1.0)
    e.term[2] = -t.weight[2] * min(abs(t.path_speed - moved / t.dt) / t.path_speed, 1.0)


@outlined
def lead_on(plan, t, e, row):
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


def aim(plan, x, t, e, row):
    """A new target or leg where the present one has had its time or is reached; e.reason where it was the last."""
    if t.follows_path == 0.0:
        draw_target(t, e, row)
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


def look(t, e, row):
    """Errors and directions as the readings show them into the features."""
    f = e.features
    if t.follows_path == 0.0:
        error = target_error(f[int(t.read_index)], t, e)
        if t.is_angle != 0.0:
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


def place(plan, drawn, t, e, row):
    """The first state, in cruise, and the commands that keep it; drawn: the parameters of this episode."""
    at, draws = int(t.state_at), int(t.draws_at)
    for i in range(STATES):
        row[at + i] = t.cruise_state[i]
    row[at + DEPTH] = t.start_depth[0] + (t.start_depth[1] - t.start_depth[0]) * row[draws]
    row[at + HEADING] = pi * (2.0 * row[draws + 1] - 1.0)
    row[at + WAVE_PHASE] = 2.0 * pi * row[draws + 2]
    e.reached = 0.0
    for j in range(INPUTS):
        e.command[j] = t.cruise_command[j]
    for j in range(ACTUATORS):
        e.features[SHARES + j] = (e.command[j] - t.middle[j]) / t.limit[j] if t.limit[j] > 0.0 else 0.0


def set_out(plan, x, t, e, row):
    """The first target or leg of an episode, and what the held fins keep."""
    e.held[0], e.held[1] = x[DEPTH], x[HEADING]
    if t.follows_path == 0.0:
        first_target(x, t, e, row)
        return
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


def doubt(x, derived, e, work):
    """How far the vehicle's velocity is from those that a learned hull was trained with, over their reach."""
    p = vehicle.parameters(derived)
    e.support_distance = support_distance(p, x, work[:ROOM]) if p.computed.learned != 0.0 else 0.0


HOOKS = Hooks(
    command=command,
    beyond=beyond,
    score=score,
    aim=aim,
    look=look,
    pass_time=pass_time,
    steps_left=steps_left,
    ages=ages,
    place=place,
    set_out=set_out,
    doubt=doubt,
)
