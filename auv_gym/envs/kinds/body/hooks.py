"""The hooks of vehicles with fins: commands, envelope, targets and paths; see `kernel.hooks`."""

from __future__ import annotations

from math import cos, sin

from auv_gym.envs.kernel.body import ARRIVED, beyond, doubt, place
from auv_gym.envs.kernel.hooks import Hooks
from auv_gym.envs.kernel.path import begin_path, go_on, look_along, path_terms
from auv_gym.envs.kernel.targets import (
    ages,
    draw_target,
    first_target,
    pass_time,
    steps_left,
    target_error,
    tracking_term,
)
from auv_gym.physics.frames import wrapped

ACTUATORS = OUTPUTS = SHARES = YAW_INPUT = PITCH_INPUT = ACROSS = 0
V = W = NORTH = EAST = DEPTH = PITCH = HEADING = 0
READ_W = READ_Q = READ_R = READ_V = READ_NORTH = READ_EAST = READ_DEPTH = READ_PITCH = READ_HEADING = 0


def command(plan, t, e):
    """Put the commands of an action and of the regulators into e.command, and the cost of their change into e.term.

    Fins outside the action hold the cruise by linear feedback of the readings: the rudder holds the heading, and the
    stern plane the depth, at which the episode began.
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
        value = k[0] * (e.features[READ_V] - t.kept_state[V]) + k[1] * e.features[READ_R] + k[2] * off
        limit = t.limit[YAW_INPUT]
        e.command[YAW_INPUT] = min(max(t.kept_command[YAW_INPUT] - value, -limit), limit)
        e.features[SHARES + YAW_INPUT] = e.command[YAW_INPUT] / limit
    if t.action_of[PITCH_INPUT] < 0.0:
        k = t.plane_gains
        deep = min(max(e.features[READ_DEPTH] - e.held[0], -t.held_depth_error), t.held_depth_error)
        value = k[0] * (e.features[READ_W] - t.kept_state[W]) + k[1] * e.features[READ_Q]
        value += k[2] * (e.features[READ_PITCH] - t.kept_state[PITCH]) + k[3] * deep
        limit = t.limit[PITCH_INPUT]
        e.command[PITCH_INPUT] = min(max(t.kept_command[PITCH_INPUT] - value, -limit), limit)
        e.features[SHARES + PITCH_INPUT] = e.command[PITCH_INPUT] / limit
    e.term[1] = -t.weight[1] * 0.5 * travel / t.actions


def score(x, before, t, e):
    """The reward terms of the true state x, for the target for which the action was chosen."""
    if t.follows_path == 0.0:
        e.term[0] = tracking_term(x, t, e)
        return
    north, east, down = x[NORTH] - before[NORTH], x[EAST] - before[EAST], x[DEPTH] - before[DEPTH]
    e.term[0], e.term[2] = path_terms(x[NORTH], x[EAST], x[DEPTH], north, east, down, t, e)


def aim(plan, x, t, e, row):
    """Set a new target or leg if the present one has expired or is reached; sets e.reason after the last one."""
    if t.follows_path == 0.0:
        draw_target(t, e, row)
    elif go_on(plan, x[NORTH], x[EAST], x[DEPTH], t, e, row):
        e.reason = ARRIVED


def look(t, e, row):
    """Put errors and directions according to the readings into the features."""
    f = e.features
    if t.follows_path == 0.0:
        error = target_error(f[int(t.read_index)], t, e)
        if t.is_angle != 0.0:
            f[OUTPUTS + 1], f[OUTPUTS + 2] = sin(error), cos(error)
        f[OUTPUTS], f[OUTPUTS + 3] = error, e.target[0]
    else:
        look_along(f[READ_NORTH], f[READ_EAST], f[READ_DEPTH], f[READ_HEADING], e, ACROSS)


def set_out(plan, x, t, e, row):
    """Set the first target or leg of an episode, and the set points of the fins held by regulators."""
    e.held[0], e.held[1] = x[DEPTH], x[HEADING]
    if t.follows_path == 0.0:
        first_target(x, t, e, row)
        return
    begin_path(plan, x[NORTH], x[EAST], x[DEPTH], x[HEADING], t, e, row)


HOOKS = Hooks(command, beyond, score, aim, look, pass_time, steps_left, ages, place, set_out, doubt)
