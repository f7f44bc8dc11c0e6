"""The hooks of flying gliders: masses, energy, dead reckoning and fixes; see `kernel.hooks`."""

from __future__ import annotations

from math import cos, pi, sin, tan

from auv_gym.envs.kernel.hooks import Hooks
from auv_gym.envs.kernel.layout import NO_REASON, OWN
from auv_gym.envs.kernel.path import begin_path, go_on, leg_axes, look_along, score_from_above
from auv_gym.envs.kernel.pump import energy_term
from auv_gym.envs.kernel.targets import ages, doubt, pass_time, put_constants, steps_left

# Reasons for termination.
GROUNDED, ARRIVED = range(OWN, OWN + 2)

# Placeholders in the templates, which are compiled.
ACTUATORS = SHARES = ACROSS = SINKING = RECKONED_NORTH = RECKONED_EAST = 0
CURRENT_NORTH = CURRENT_EAST = CURRENT_ALONG = CURRENT_ACROSS = 0
NORTH = EAST = DEPTH = HEADING = READ_NORTH = READ_EAST = READ_DEPTH = READ_PITCH = READ_HEADING = 0
IN_BUOYANCY_VOLUME = 0

_SURFACED = 1.0  # m; above this depth, the antenna is out of the water
_DIVED = 600.0  # s; fixes further apart than this give an estimate of the current
_FLAT = 0.1  # rad of pitch; below this, a glider is turning between dive and climb and makes no headway


def command(plan, t, e):
    """Put the commands of an action into e.command, and the energy of pump and hotel load over the step into e.term."""
    for j in range(ACTUATORS):
        a = int(t.action_of[j])
        if a >= 0:
            share = min(max(e.action[a], -1.0), 1.0)
            e.command[j], e.features[SHARES + j] = t.middle[j] + share * t.limit[j], share
    e.term[1] = energy_term(e.command[IN_BUOYANCY_VOLUME], e.features[READ_DEPTH], t, e)


def beyond(x, t):
    """The reason why a finite state ends the episode, and the number responsible."""
    if x[DEPTH] > t.bottom:
        return GROUNDED, x[DEPTH]
    return NO_REASON, 0.0


def aim(plan, x, t, e, row):
    """Set the next leg if a waypoint is reached; sets e.reason after the last one."""
    if go_on(plan, x[NORTH], x[EAST], 0.0, t, e, row):
        e.reason = ARRIVED


def look(t, e, row):
    """Put the glider's position by dead reckoning, and the leg relative to it, into the features.

    The speed through the water is computed from the depth rate, and the path angle from the pitch and a usual angle of
    attack.  At the surface, a fix replaces the reckoned position; the difference since the last fix gives the current
    of the dive, which is used for further reckoning.
    """
    f = e.features
    f[SINKING] = (f[READ_DEPTH] - e.last_depth) / t.dt if e.step > 0.0 else 0.0
    e.last_depth = f[READ_DEPTH]
    if abs(f[READ_PITCH]) > _FLAT:
        way = abs(f[SINKING]) * t.dt / tan(abs(f[READ_PITCH]) + t.usual_attack)
        e.flown[0] += way * cos(f[READ_HEADING])
        e.flown[1] += way * sin(f[READ_HEADING])
    since = e.time - e.fix_time
    if f[READ_DEPTH] < _SURFACED:
        if since > _DIVED:
            e.drift[0] = (f[READ_NORTH] - e.fix[0] - e.flown[0]) / since
            e.drift[1] = (f[READ_EAST] - e.fix[1] - e.flown[1]) / since
        e.fix[0], e.fix[1], e.fix_time = f[READ_NORTH], f[READ_EAST], e.time
        e.flown[0], e.flown[1], since = 0.0, 0.0, 0.0
    f[RECKONED_NORTH] = e.fix[0] + e.flown[0] + e.drift[0] * since
    f[RECKONED_EAST] = e.fix[1] + e.flown[1] + e.drift[1] * since
    f[CURRENT_NORTH], f[CURRENT_EAST] = e.drift[0], e.drift[1]
    f[CURRENT_ALONG], f[CURRENT_ACROSS], _ = leg_axes(e.drift[0], e.drift[1], 0.0, e.course, 0.0)
    look_along(f[RECKONED_NORTH], f[RECKONED_EAST], 0.0, f[READ_HEADING], e, ACROSS)


def place(plan, drawn, t, e, row):
    """Set the initial state, afloat on a drawn heading, and the commands that keep it there."""
    at = int(t.state_at)
    row[at + HEADING] = pi * (2.0 * row[int(t.draws_at)] - 1.0)
    put_constants(plan, drawn, t, e)
    for j in range(ACTUATORS):
        if t.action_of[j] >= 0.0:
            e.command[j] = t.middle[j]
    e.engine = t.middle[IN_BUOYANCY_VOLUME] + t.limit[IN_BUOYANCY_VOLUME]
    e.command[IN_BUOYANCY_VOLUME], e.features[SHARES + IN_BUOYANCY_VOLUME] = e.engine, 1.0
    e.energy, e.reached, e.last_depth, e.fix_time = 0.0, 0.0, 0.0, 0.0
    for i in range(2):
        e.fix[i], e.flown[i], e.drift[i] = 0.0, 0.0, 0.0


def set_out(plan, x, t, e, row):
    """Set the first leg of an episode, and its starting point."""
    e.fix[0], e.fix[1], e.last_depth = x[NORTH], x[EAST], x[DEPTH]
    begin_path(plan, x[NORTH], x[EAST], 0.0, x[HEADING], t, e, row)


HOOKS = Hooks(command, beyond, score_from_above, aim, look, pass_time, steps_left, ages, place, set_out, doubt)
