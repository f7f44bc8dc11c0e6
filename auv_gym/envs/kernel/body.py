"""Shared hooks for vehicles in six degrees of freedom: sensors, initial state, envelope, and a learned hull's support.

The functions are templates for a compiled step; see `kernel.hooks`.
"""

from __future__ import annotations

from math import pi, sqrt

from auv_gym.compiled import OPEN
from auv_gym.envs.kernel.hooks import Vehicle
from auv_gym.envs.kernel.layout import NO_REASON, OWN
from auv_gym.vehicles.body.learned_hull import ROOM, support_distance

# Reasons for termination.
BROACHED, TOO_DEEP, PITCHED, ROLLED, TOO_FAST, SPINNING, ARRIVED = range(OWN, OWN + 7)

SENSORS = {
    "depth": ("depth_m",),
    "compass": ("heading_rad",),
    "inclinometer": ("roll_rad", "pitch_rad"),
    "gyros": ("p_radps", "q_radps", "r_radps"),
    "dvl_ground": ("u_dvl_mps", "v_dvl_mps", "w_dvl_mps"),
    "dvl_water": ("u_mps", "v_mps", "w_mps"),
    "position": ("north_m", "east_m"),
}
# fields of a plan: initial values, a state that commands hold, and the meaning of actions
BEGINNING = {
    "start_depth": 2, "kept_state": "states", "kept_command": "inputs", "limit": "actuators", "middle": "actuators",
    "action_of": "actuators",
}  # fmt: skip
# fields of a plan that an info also shows
LIMITS = {"depth_limit": 1, "speed_limit": 1, "pitch_limit": 1, "roll_limit": 1, "rate_limit": 1}
SHOWN = {"reached": 1, "support_distance": 1}
# channels of an initial state that may be given
START = (
    "north_m", "east_m", "depth_m", "roll_rad", "pitch_rad", "heading_rad",
    "u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps",
)  # fmt: skip
REASONS = {
    BROACHED: ("broached: depth_m is {value:.3g}", ""),
    TOO_DEEP: ("too deep: depth_m is {value:.4g}, the limit {limit:.4g}", "depth_limit"),
    PITCHED: ("out of its envelope: pitch_rad is {value:.3g}, the limit {limit:.3g}", "pitch_limit"),
    ROLLED: ("out of its envelope: roll_rad is {value:.3g}, the limit {limit:.3g}", "roll_limit"),
    TOO_FAST: ("out of its envelope: the speed is {value:.3g} m/s, the limit {limit:.3g}", "speed_limit"),
    SPINNING: ("out of its envelope: the rate of turn is {value:.3g} rad/s, the limit {limit:.3g}", "rate_limit"),
    ARRIVED: ("arrived at the last waypoint", ""),
}

vehicle: Vehicle = OPEN
STATES = INPUTS = ACTUATORS = SHARES = 0
U = V = W = P = Q = R = DEPTH = ROLL = PITCH = HEADING = WAVE_PHASE = 0


def place(plan, drawn, t, e, row):
    """The initial state that the commands hold at a drawn depth and heading, and these commands."""
    at, draws = int(t.state_at), int(t.draws_at)
    for i in range(STATES):
        row[at + i] = t.kept_state[i]
    row[at + DEPTH] = t.start_depth[0] + (t.start_depth[1] - t.start_depth[0]) * row[draws]
    row[at + HEADING] = pi * (2.0 * row[draws + 1] - 1.0)
    row[at + WAVE_PHASE] = 2.0 * pi * row[draws + 2]
    e.reached = 0.0
    for j in range(INPUTS):
        e.command[j] = t.kept_command[j]
    for j in range(ACTUATORS):
        e.features[SHARES + j] = (e.command[j] - t.middle[j]) / t.limit[j] if t.limit[j] > 0.0 else 0.0


def beyond(x, t):
    """The reason why a finite state ends the episode, and the number responsible."""
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


def doubt(x, derived, e, work):
    """The distance of the vehicle's velocity from a learned hull's training data, relative to their reach."""
    p = vehicle.parameters(derived)
    e.support_distance = support_distance(p, x, work[:ROOM]) if p.computed.learned != 0.0 else 0.0
