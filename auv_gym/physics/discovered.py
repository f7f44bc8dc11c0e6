"""Moments and forces of the terms that a search may add to the models of heading and of vertical motion."""

from __future__ import annotations

from math import cos, sin, sqrt

from auv_gym.compiled import compiled
from auv_gym.physics.discovered_terms import HEAVE_TERMS

_W, _W_W = list(HEAVE_TERMS).index("w"), list(HEAVE_TERMS).index("w_w")


@compiled
def any_term(coefficients, count):
    """Whether one of the coefficients is not zero; without a way out of the loop, so that it takes some nanoseconds."""
    found = 0
    for k in range(count):
        found += 1 if coefficients[k] != 0.0 else 0
    return found > 0


@compiled
def yaw_moment(c, psi, r, rudder, inputs):
    """Moment, N m, of the terms with coefficients c over YAW_TERMS; inputs: as in the heading family."""
    u, w, pitch, roll = inputs[3], inputs[4], inputs[6], inputs[7]
    plain = c[0] * r + c[1] * u + c[2] * w + c[3] * pitch + c[4] * rudder
    plain += u * (c[7] * r + c[10] * u + c[11] * w + c[12] * roll + (c[13] + c[14] * u) * rudder)
    plain += c[8] * w * r + c[9] * abs(r) * r + c[15] * abs(rudder) * rudder
    return plain + c[5] * sin(psi) + c[6] * cos(psi) + c[16] * sin(2.0 * psi) + c[17] * cos(2.0 * psi)


@compiled
def heave_force(c, depth, w, piston, temperature, time):
    """Force down, N, of the terms with coefficients c over HEAVE_TERMS.

    w: m/s, down through the water.  piston: m, and temperature: K, from where the float is neutral.  time: s, since the
    dive began.  The roots keep the sign of what is under them.
    """
    root_w = sqrt(w) if w > 0.0 else -sqrt(-w)
    root_depth = sqrt(depth) if depth > 0.0 else -sqrt(-depth)
    force = c[0] * depth + c[1] * w + c[2] * temperature + c[3] * time + c[4] * piston + c[5] * depth * depth
    force += (c[6] * abs(w) + c[7] * w + c[9] * depth + c[10] * piston + c[12] * w * w) * w
    return force + c[8] * root_w + c[11] * piston * piston + c[13] * root_depth


@compiled
def heave_damping(c, w):
    """Slope of the terms that damp by themselves, w and w |w|, kg/s, for the longest stable step."""
    return abs(c[_W]) + 2.0 * abs(c[_W_W] * w)
