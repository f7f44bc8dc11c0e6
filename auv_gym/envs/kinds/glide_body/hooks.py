"""The hooks of gliders in six degrees of freedom: volume and masses, energy; see `kernel.hooks`."""

from __future__ import annotations

from auv_gym.envs.kernel.body import ARRIVED, beyond, doubt, place
from auv_gym.envs.kernel.hooks import Hooks
from auv_gym.envs.kernel.path import begin_path, go_on, look_along, score_from_above
from auv_gym.envs.kernel.pump import energy_term
from auv_gym.envs.kernel.targets import ages, pass_time, steps_left

# Placeholders in the templates, which are compiled.
ACTUATORS = SHARES = ACROSS = SINKING = ENGINE = 0
NORTH = EAST = HEADING = READ_NORTH = READ_EAST = READ_DEPTH = READ_HEADING = 0


def command(plan, t, e):
    """Put the commands of an action into e.command, and the energy of pump and hotel load over the step into e.term."""
    for j in range(ACTUATORS):
        a = int(t.action_of[j])
        if a >= 0:
            share = min(max(e.action[a], -1.0), 1.0)
            e.command[j], e.features[SHARES + j] = t.middle[j] + share * t.limit[j], share
    e.term[1] = energy_term(e.command[ENGINE], e.features[READ_DEPTH], t, e)


def aim(plan, x, t, e, row):
    """Set the next leg if a waypoint is reached; sets e.reason after the last one."""
    if go_on(plan, x[NORTH], x[EAST], 0.0, t, e, row):
        e.reason = ARRIVED


def look(t, e, row):
    """Put the rate of the measured depth, and the leg according to the readings, into the features."""
    f = e.features
    f[SINKING] = (f[READ_DEPTH] - e.last_depth) / t.dt if e.step > 0.0 else 0.0
    e.last_depth = f[READ_DEPTH]
    look_along(f[READ_NORTH], f[READ_EAST], 0.0, f[READ_HEADING], e, ACROSS)


def set_out(plan, x, t, e, row):
    """Set the first leg of an episode; the engine is at the first commands."""
    e.engine, e.energy = e.command[ENGINE], 0.0
    begin_path(plan, x[NORTH], x[EAST], 0.0, x[HEADING], t, e, row)


HOOKS = Hooks(command, beyond, score_from_above, aim, look, pass_time, steps_left, ages, place, set_out, doubt)
