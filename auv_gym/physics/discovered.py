"""Candidate terms for the models of heading and of vertical motion: yaw moments and forces down.

Each is a coefficient times a product of quantities of those models: states, inputs, and the true rudder angle. In a
name, `r_r` is r |r|, and `uu` is u u. The library of the six-degree-of-freedom vehicles is in `polynomials`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import make_dataclass
from math import cos, sin, sqrt

from auv_gym.compiled import compiled
from auv_gym.param import param

# name: (unit, words); the simplest first, numbered in this order by the functions below
YAW_TERMS: Mapping[str, tuple[str, str]] = {
    "r": ("N m s", "r"),
    "u": ("N s", "u"),
    "w": ("N s", "w"),
    "pitch": ("N m/rad", "pitch"),
    "rudder": ("N m/rad", "the rudder angle"),
    "sin_heading": ("N m", "sin heading"),
    "cos_heading": ("N m", "cos heading"),
    "ur": ("kg m", "u r"),
    "wr": ("kg m", "w r"),
    "r_r": ("N m s^2", "r |r|"),
    "uu": ("kg", "u u"),
    "uw": ("kg", "u w"),
    "u_roll": ("N s/rad", "u roll"),
    "u_rudder": ("N s/rad", "u times the rudder angle"),
    "uu_rudder": ("kg/rad", "u u times the rudder angle"),
    "rudder_rudder": ("N m/rad^2", "rudder |rudder|"),
    "sin_2heading": ("N m", "sin 2 heading"),
    "cos_2heading": ("N m", "cos 2 heading"),
}
HEAVE_TERMS: Mapping[str, tuple[str, str]] = {
    "depth": ("N/m", "depth"),
    "w": ("kg/s", "w"),
    "temperature": ("N/K", "temperature"),
    "elapsed": ("N/s", "time"),
    "piston": ("N/m", "the piston"),
    "depth_squared": ("N/m^2", "depth squared"),
    "w_w": ("kg/m", "w |w|"),
    "ww": ("kg/m", "w w"),
    "root_w": ("N s^0.5/m^0.5", "the root of w"),
    "depth_w": ("kg/(m s)", "depth times w"),
    "piston_w": ("kg/(m s)", "the piston times w"),
    "piston_squared": ("N/m^2", "the piston squared"),
    "www": ("kg s/m^2", "w cubed"),
    "root_depth": ("N/m^0.5", "the root of depth"),
}


def _group(name: str, what: str, terms: Mapping[str, tuple[str, str]], doc: str) -> type:
    fields = [(t, float, param(0.0, unit, f"discovered {what} from {words}")) for t, (unit, words) in terms.items()]
    return make_dataclass(
        name, fields, frozen=True, namespace={"as_array": True, "__doc__": doc, "__module__": __name__}
    )


DiscoveredYaw = _group("DiscoveredYaw", "yaw moment", YAW_TERMS, "Coefficients of a yaw moment found in data, N m.")
DiscoveredHeave = _group("DiscoveredHeave", "force down", HEAVE_TERMS, "Coefficients of a force down found in data, N.")
N_YAW, N_HEAVE = len(YAW_TERMS), len(HEAVE_TERMS)
_W, _W_W = list(HEAVE_TERMS).index("w"), list(HEAVE_TERMS).index("w_w")


@compiled
def any_term(coefficients, count):
    """Whether one of the coefficients is not zero; the loop has no early exit, which makes it fast."""
    found = 0
    for k in range(count):
        found += 1 if coefficients[k] != 0.0 else 0
    return found > 0


@compiled
def discovered_yaw_moment(c, psi, r, rudder, inputs):
    """Moment, N m, of the terms with coefficients c over YAW_TERMS; inputs: as in the heading family."""
    u, w, pitch, roll = inputs[3], inputs[4], inputs[6], inputs[7]
    plain = c[0] * r + c[1] * u + c[2] * w + c[3] * pitch + c[4] * rudder
    plain += u * (c[7] * r + c[10] * u + c[11] * w + c[12] * roll + (c[13] + c[14] * u) * rudder)
    plain += c[8] * w * r + c[9] * abs(r) * r + c[15] * abs(rudder) * rudder
    return plain + c[5] * sin(psi) + c[6] * cos(psi) + c[16] * sin(2.0 * psi) + c[17] * cos(2.0 * psi)


@compiled
def discovered_heave_force(c, depth, w, piston, temperature, time):
    """Force down, N, of the terms with coefficients c over HEAVE_TERMS.

    w: m/s, down through the water.  piston: m, and temperature: K, relative to the float's neutral.  time: s, since the
    dive began.  The roots keep the sign of their argument.
    """
    root_w = sqrt(w) if w > 0.0 else -sqrt(-w)
    root_depth = sqrt(depth) if depth > 0.0 else -sqrt(-depth)
    force = c[0] * depth + c[1] * w + c[2] * temperature + c[3] * time + c[4] * piston + c[5] * depth * depth
    force += (c[6] * abs(w) + c[7] * w + c[9] * depth + c[10] * piston + c[12] * w * w) * w
    return force + c[8] * root_w + c[11] * piston * piston + c[13] * root_depth


@compiled
def discovered_heave_damping(c, w):
    """Slope of the terms that are pure damping, w and w |w|, kg/s, for the longest stable step."""
    return abs(c[_W]) + 2.0 * abs(c[_W_W] * w)
