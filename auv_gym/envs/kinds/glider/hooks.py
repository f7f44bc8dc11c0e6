"""The hooks of gliders that turn in the plane: rudder, speed, and turn rate of the compass; see `kernel.hooks`."""

from __future__ import annotations

from math import cos, pi, sin

from auv_gym.envs.kernel.hooks import Hooks
from auv_gym.envs.kernel.layout import NO_REASON
from auv_gym.envs.kernel.targets import (
    ages,
    aim,
    doubt,
    pass_time,
    put_constants,
    set_out,
    steps_left,
    target_error,
    tracking_term,
)
from auv_gym.physics.frames import wrapped

# Placeholders in the templates, which are compiled.
SHARES = HEADING = READ_HEADING = IN_RUDDER = IN_U = ERROR_SIN = ERROR_COS = TURN_RATE = SPEED = 0


def command(plan, t, e):
    """Put the rudder command of the action into e.command, and the cost of its change into e.term."""
    share = min(max(e.action[0], -1.0), 1.0)
    e.term[1] = -t.weight[1] * 0.5 * abs(share - e.features[SHARES + IN_RUDDER])
    e.features[SHARES + IN_RUDDER] = share
    e.command[IN_RUDDER] = share * t.rudder_limit


def beyond(x, t):
    """No finite state ends the episode."""
    return NO_REASON, 0.0


def score(x, before, t, e):
    """Put the reward term of the true heading into e.term."""
    e.term[0] = tracking_term(x, t, e)


def look(t, e, row):
    """Put the heading error, the change of the reading over the last step and the speed into the features."""
    f = e.features
    error = target_error(f[READ_HEADING], t, e)
    f[ERROR_SIN], f[ERROR_COS] = sin(error), cos(error)
    f[TURN_RATE] = wrapped(f[READ_HEADING] - e.last_heading) / t.dt if e.step > 0.0 else 0.0
    e.last_heading = f[READ_HEADING]
    f[SPEED] = e.command[IN_U]


def place(plan, drawn, t, e, row):
    """Put the first state, on a drawn heading with the rudder amidships, into the row, and the speed into e.command."""
    draws = int(t.draws_at)
    row[int(t.state_at) + HEADING] = pi * (2.0 * row[draws] - 1.0)
    put_constants(plan, drawn, t, e)
    if t.speed[0] > 0.0:
        e.command[IN_U] = t.speed[0] + (t.speed[1] - t.speed[0]) * row[draws + 1]


HOOKS = Hooks(command, beyond, score, aim, look, pass_time, steps_left, ages, place, set_out, doubt)
