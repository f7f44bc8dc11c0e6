"""Terms that a search may add to the models of heading and of vertical motion: yaw moments and forces down.

Each is a coefficient times a product of what those models know: states, inputs, and the true angle of the rudder. In a
name `r_r` is r |r|, and `uu` is u u. The library of the six-degree-of-freedom vehicles is in `polynomials`; what these
terms add up to is in `discovered`, apart from their names, which are of use without compiled code.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import make_dataclass

from auv_gym.param import param

# name: (unit, words); the simplest first, in the order in which the functions of `discovered` number them.
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
