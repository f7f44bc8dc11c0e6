"""The hooks of vehicles moved by thrusters: commands or a wrench, poses; see `kernel.hooks`."""

from __future__ import annotations

from math import cos, isnan, pi, sin, sqrt

from auv_gym.compiled import outlined
from auv_gym.envs.kernel.body import ARRIVED, beyond, doubt, place
from auv_gym.envs.kernel.hooks import Hooks
from auv_gym.envs.kernel.layout import CHANGE_DRAWS, START_DRAWS
from auv_gym.envs.kernel.path import begin_path, go_on, look_along, path_terms
from auv_gym.envs.kernel.targets import ages, pass_time, steps_left
from auv_gym.physics.frames import body_axes_of, wrapped
from auv_gym.plant.thrusters import command_of_thrust

LAST = ("last_1", "last_2", "last_3", "last_4", "last_5", "last_6")  # the shares of the last wrench, one per action

ACTUATORS = SHARES = ACROSS = LAST_1 = 0
ERROR_AHEAD = ERROR_STARBOARD = ERROR_BELOW = HEADING_ERROR_SIN = HEADING_ERROR_COS = ROLL_ERROR = PITCH_ERROR = 0
SUM_AHEAD = SUM_STARBOARD = SUM_BELOW = SUM_HEADING = 0
NORTH = EAST = DEPTH = ROLL = PITCH = HEADING = 0
READ_NORTH = READ_EAST = READ_DEPTH = READ_ROLL = READ_PITCH = READ_HEADING = 0


def command(plan, t, e):
    """Put the commands of an action into e.command, and the cost of their change into e.term; others are unchanged.

    A wrench is added to the one that holds the vehicle, and scaled down as a whole to the thrusters' limits.
    """
    travel = 0.0
    if t.by_wrench == 0.0:
        for j in range(ACTUATORS):
            a = int(t.action_of[j])
            if a >= 0:
                share = min(max(e.action[a], -1.0), 1.0)
                travel += abs(share - e.features[SHARES + j])
                e.command[j], e.features[SHARES + j] = t.middle[j] + share * t.limit[j], share
        e.term[1] = -t.weight[1] * 0.5 * travel / t.actions
        return
    axes, count = int(t.actions), int(t.thrusters)
    at, curves_at, rows = int(t.thrusters_at), int(t.curves_at), int(t.curves) // count
    for a in range(axes):
        share = min(max(e.action[a], -1.0), 1.0)
        travel += abs(share - e.features[LAST_1 + a])
        e.features[LAST_1 + a] = share
    whole = 1.0
    for k in range(count):
        one = at + k * (3 + axes)
        push, held = 0.0, plan[one + 2]
        for a in range(axes):
            push += plan[one + 3 + a] * e.features[LAST_1 + a]
        e.push[k] = push
        least, most = plan[curves_at + 2 * rows * k], plan[curves_at + 2 * rows * (k + 1) - 2]
        if push > 0.0:
            whole = min(whole, (most - held) / push)
        elif push < 0.0:
            whole = min(whole, (least - held) / push)
    for k in range(count):
        one = at + k * (3 + axes)
        j, idle = int(plan[one]), plan[one + 1]
        curve = plan[curves_at + 2 * rows * k : curves_at + 2 * rows * (k + 1)].reshape((rows, 2))
        e.command[j] = command_of_thrust(plan[one + 2] + whole * e.push[k], curve, idle)
        e.features[SHARES + j] = (e.command[j] - t.middle[j]) / t.limit[j] if t.limit[j] > 0.0 else 0.0
    e.term[1] = -t.weight[1] * 0.5 * travel / t.actions


def score(x, before, t, e):
    """The reward terms of the true state x, for the target for which the action was chosen."""
    if t.follows_path != 0.0:
        north, east, down = x[NORTH] - before[NORTH], x[EAST] - before[EAST], x[DEPTH] - before[DEPTH]
        e.term[0], e.term[2] = path_terms(x[NORTH], x[EAST], x[DEPTH], north, east, down, t, e)
        return
    north, east, down = e.target[0] - x[NORTH], e.target[1] - x[EAST], e.target[2] - x[DEPTH]
    turn, roll, pitch = wrapped(e.target[3] - x[HEADING]), wrapped(e.target[4] - x[ROLL]), e.target[5] - x[PITCH]
    off = sqrt(north * north + east * east + down * down)
    turned = sqrt(turn * turn + roll * roll + pitch * pitch)
    e.term[0] = -t.weight[0] * min(off / t.error_scale, 1.0)
    e.term[2] = -t.weight[2] * min(turned / t.attitude_scale, 1.0)


@outlined
def redraw(plan, t, e, row):
    """Draw a new pose about the present one, and its duration; fixed parts are kept."""
    begin, changes = int(t.draws_at) + START_DRAWS + int(t.randomised), int(t.changes)
    at = begin + CHANGE_DRAWS * (int(e.change) % changes)
    then = begin + CHANGE_DRAWS * ((int(e.change) + 1) % changes)
    e.change += 2.0
    away = t.target_step[0] + (t.target_step[1] - t.target_step[0]) * row[at]
    bearing = 2.0 * pi * row[at + 1]
    deeper = t.target_step[1] * (2.0 * row[at + 2] - 1.0)
    if e.target[2] + deeper < t.target_band[0] or e.target[2] + deeper > t.target_band[1]:
        deeper = -deeper
    e.target[0] += away * cos(bearing)
    e.target[1] += away * sin(bearing)
    e.target[2] = min(max(e.target[2] + deeper, t.target_band[0]), t.target_band[1])
    e.target[3] = pi * (2.0 * row[then] - 1.0)
    for i in range(6):
        if not isnan(t.fixed[i]):
            e.target[i] = t.fixed[i]
    e.change_at = e.time + t.target_hold[0] + (t.target_hold[1] - t.target_hold[0]) * row[then + 1]


def aim(plan, x, t, e, row):
    """Set a new pose or leg if the present one has expired or is reached; sets e.reason after the last one."""
    if t.follows_path != 0.0:
        if go_on(plan, x[NORTH], x[EAST], x[DEPTH], t, e, row):
            e.reason = ARRIVED
    elif t.redrawn != 0.0 and e.time >= e.change_at - 1e-9:
        redraw(plan, t, e, row)


def look(t, e, row):
    """Put errors in body axes and their sums, or the position along the leg, by the readings, into the features."""
    f = e.features
    if t.follows_path != 0.0:
        look_along(f[READ_NORTH], f[READ_EAST], f[READ_DEPTH], f[READ_HEADING], e, ACROSS)
        return
    roll, pitch, heading = f[READ_ROLL], f[READ_PITCH], f[READ_HEADING]
    north, east, down = e.target[0] - f[READ_NORTH], e.target[1] - f[READ_EAST], e.target[2] - f[READ_DEPTH]
    turn = wrapped(e.target[3] - heading)
    f[ERROR_AHEAD], f[ERROR_STARBOARD], f[ERROR_BELOW] = body_axes_of(north, east, down, roll, pitch, heading)
    f[HEADING_ERROR_SIN], f[HEADING_ERROR_COS] = sin(turn), cos(turn)
    f[ROLL_ERROR], f[PITCH_ERROR] = wrapped(e.target[4] - roll), e.target[5] - pitch
    if e.step > 0.0:  # sums stay in north, east, down, whatever the vehicle's heading
        for i in range(4):
            off = (north, east, down, turn)[i] / (t.size if i < 3 else 1.0)
            moved = e.sums[i] + t.sum_rate * min(max(off, -1.0), 1.0)
            e.sums[i] = min(max(moved, -t.sum_limit), t.sum_limit)
    f[SUM_AHEAD], f[SUM_STARBOARD], f[SUM_BELOW] = body_axes_of(e.sums[0], e.sums[1], e.sums[2], roll, pitch, heading)
    f[SUM_HEADING] = e.sums[3]


def set_out(plan, x, t, e, row):
    """Set the first pose of an episode: the vehicle's own, or one drawn about it, except for given parts; or a path."""
    for i in range(4):
        e.sums[i] = 0.0
    if t.follows_path != 0.0:
        begin_path(plan, x[NORTH], x[EAST], x[DEPTH], x[HEADING], t, e, row)
        return
    e.target[0], e.target[1], e.target[2], e.target[3] = x[NORTH], x[EAST], x[DEPTH], x[HEADING]
    if t.redrawn != 0.0:
        redraw(plan, t, e, row)
    for i in range(6):
        if not isnan(t.fixed[i]):
            e.target[i] = t.fixed[i]
        if not isnan(e.first_target[i]):
            e.target[i] = e.first_target[i]


HOOKS = Hooks(command, beyond, score, aim, look, pass_time, steps_left, ages, place, set_out, doubt)
