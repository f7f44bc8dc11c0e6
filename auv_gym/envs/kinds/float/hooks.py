"""The hooks of profiling floats: buoyancy engine, envelope, two sampling rates; see `kernel.hooks`."""

from __future__ import annotations

from auv_gym.envs.kernel.hooks import Hooks
from auv_gym.envs.kernel.layout import NO_REASON, OWN
from auv_gym.envs.kernel.targets import aim, doubt, put_constants, set_out, target_error, tracking_term

# Reasons for termination.
FLEW, TOO_DEEP, TOO_FAST = range(OWN, OWN + 3)

# Placeholders in the templates, which are compiled.
STATES = ACTUATORS = SHARES = ERROR = POSITION = DEPTH = DEPTH_RATE = READ_DEPTH = READ_DEPTH_RATE = 0
IN_PUMPED_VOLUME = IN_VALVED_VOLUME = IN_VALVED_DEPTH = 0

_AIR = -1.0  # m; a controlled float bobs at the surface and does not leave the water


def command(plan, t, e):
    """Put the commands of an action into e.command, and the cost of their change into e.term.

    e.position: the engine's position, limited by its rate, as a share of its range. A piston gets its target and moves
    there by itself; oil is limited here, and logged as a float logs it: the volumes pumped and valved, and valved at
    depth.
    """
    j = int(t.engine)
    share = min(max(e.action[0], -1.0), 1.0)
    e.term[1] = -t.weight[1] * 0.5 * abs(share - e.features[SHARES + j])
    e.features[SHARES + j] = share
    most = t.engine_rate * e.coming_dt
    move = min(max(share - e.position, -most), most)
    e.position += move
    e.command[j] = t.engine_middle + t.engine_half * (e.position if t.holds_back != 0.0 else share)
    if t.holds_back != 0.0:
        volume = t.engine_half * move
        e.command[IN_PUMPED_VOLUME] += max(volume, 0.0)
        e.command[IN_VALVED_VOLUME] -= min(volume, 0.0)
        e.command[IN_VALVED_DEPTH] -= min(volume, 0.0) * e.features[READ_DEPTH]


def beyond(x, t):
    """The reason why a finite state ends the episode, and the number responsible."""
    if x[DEPTH] < _AIR:
        return FLEW, x[DEPTH]
    if x[DEPTH] > t.depth_limit:
        return TOO_DEEP, x[DEPTH]
    if abs(x[DEPTH_RATE]) > t.speed_limit:
        return TOO_FAST, abs(x[DEPTH_RATE])
    return NO_REASON, 0.0


def score(x, before, t, e):
    """The reward term of the true state x, for the target of the action, weighted by the step's length."""
    e.term[0] = tracking_term(x, t, e) * (e.coming_dt / t.dt)


def look(t, e, row):
    """Put error, rate, position and the length of the coming step into the features.

    The rate is that of the depth sensor's readings: their change over the step.
    """
    f = e.features
    f[READ_DEPTH_RATE] = (f[READ_DEPTH] - e.last_depth) / e.coming_dt if e.step > 0.0 else 0.0
    e.last_depth = f[READ_DEPTH]
    f[ERROR], f[POSITION] = target_error(f[READ_DEPTH], t, e), e.position
    e.coming_dt = t.near_dt if abs(f[ERROR]) < t.near else t.dt
    row[int(t.ages_at) + int(t.history)] = e.coming_dt


def pass_time(t, e, row):
    """Put the time after one more step into e.time, and update the ages of the stored commands."""
    e.time = e.step * t.dt if t.near == 0.0 else e.time + e.coming_dt
    at = int(t.ages_at)
    for k in range(at, at + int(t.history) - 1):
        row[k] = row[k + 1] - e.coming_dt


def steps_left(t, e):
    """The number of long steps left in the episode."""
    left = (t.duration - e.time) / t.dt
    return left if left > 1e-6 else 0.0


def ages(plan, t, row):
    """The times, s, of the commands in the vehicle's state, ending at 0, then the end of the step."""
    at = int(t.ages_at)
    return row[at : at + int(t.history) + 1]


def place(plan, drawn, t, e, row):
    """Set the initial state, at rest at a drawn depth, and inputs at neutral trim; drawn: this episode's parameters."""
    x_at = int(t.state_at)
    row[x_at + DEPTH] = t.start_depth[0] + (t.start_depth[1] - t.start_depth[0]) * row[int(t.draws_at)]
    put_constants(plan, drawn, t, e)
    for j in range(ACTUATORS):  # a play starts in its middle
        row[x_at + STATES + ACTUATORS + j] = e.command[j]
    j = int(t.engine)
    e.position = min(max((e.command[j] - t.engine_middle) / t.engine_half, -1.0), 1.0)
    e.features[SHARES + j] = e.position
    count = int(t.history)
    for k in range(count):
        row[int(t.ages_at) + k] = (k + 1 - count) * t.dt


HOOKS = Hooks(command, beyond, score, aim, look, pass_time, steps_left, ages, place, set_out, doubt)
