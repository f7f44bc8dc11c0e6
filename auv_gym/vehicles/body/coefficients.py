"""Coefficients of a hull and its parts: which are free or uncertain, equivalent effects, impossible values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from auv_gym.param import list_paths, pack, value_at
from auv_gym.vehicles.body import derived as derived_numbers
from auv_gym.vehicles.body.body import Part

_AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
HULL_COEFFICIENTS = (
    *("hull.surge.u_u", "hull.sway.uv", "hull.sway.ur", "hull.heave.uw", "hull.heave.uq"),
    *("hull.pitch.uw", "hull.pitch.uq", "hull.yaw.uv", "hull.yaw.ur"),
)

# the same for a hull that thrusters move in all directions: its drag
DRAG_COEFFICIENTS = tuple(
    f"hull.{axis}.{term}"
    for axis, velocity in zip(_AXES, "uvwpqr", strict=True)
    for term in (velocity, f"{velocity}_{velocity}")
)

# time in which drag stops a hovering vehicle, s, and speed for the same with quadratic drag, m/s or rad/s
_STOPS_IN_S, _STOPS_FROM = 1.0, 0.3

# parts of the hull with coefficients that a first fit does not free, but that are equally uncertain
_DOUBTED = ("i_xx", "i_yy", "i_zz", "added_mass.", *(f"{axis}." for axis in _AXES), "cross_flow.drag")


def mass_problem(parameters: Any, derive: Callable[..., Any], record: np.dtype) -> str:
    """The problem of the mass matrix, or nothing: its symmetric part must be positive definite."""
    numbers = np.zeros(record.itemsize // 8)
    derive(pack(parameters), numbers)
    computed = numbers.view(record)[0].computed
    rigid, whole = computed.rigid_mass, computed.mass
    for name, matrix in (
        ("mass matrix of the rigid body", rigid),
        ("mass matrix with added mass", 0.5 * (whole + whole.T)),
    ):
        values, vectors = np.linalg.eigh(matrix)
        if values[0] <= 0.0:
            axis = _AXES[int(np.argmax(np.abs(vectors[:, 0])))]
            return (
                f"the {name} is not positive definite (smallest eigenvalue {values[0]:.3g}, mostly in {axis}): "
                "check hull.mass, the inertias, the centre of gravity and hull.added_mass (negative there)"
            )
    return ""


def places_outside(parts: Sequence[Part], parameters: Any) -> list[str]:
    """Warnings about parts farther outside the hull than its length, as after a wrong unit."""
    length, radius = parameters.hull.length, 0.5 * parameters.hull.diameter
    found = []
    for part_ in parts:
        for key in part_.found.place:
            place = getattr(getattr(parameters.parts, part_.name), key)
            farthest = length + (0.5 * length if key.endswith("x") else radius)
            if abs(place) > farthest:
                found.append(
                    f"parts.{part_.name}.{key} = {place:g} m is more than a length outside the hull, which is "
                    f"{length:g} m long: check its unit and sign"
                )
    return found


def doubted_in(parts: Sequence[Part], parameters: Any) -> list[str]:
    """The paths of all nonzero hydrodynamic coefficients and inertias, which published tables do not give exactly."""
    hull = [f"hull.{path}" for path in list_paths(parameters.hull) if path.startswith(_DOUBTED)]
    own = [f"parts.{part_.name}.{name}" for part_ in parts for name in part_.found.doubted]
    return [path for path in (*hull, *own) if value_at(parameters, path) != 0.0]


def unstated_drag(parameters: Any) -> dict[str, float]:
    """The standard deviation, by path, of each drag coefficient that is zero, for a vehicle that hovers.

    It lets an axis come to rest within a second (mass and added mass over 1 s), or from 0.3 m/s or rad/s for quadratic
    drag, as fast as such vehicles do.  Without it, a fit could give any drag to an axis that no sensor measures.
    """
    hull, added = parameters.hull, parameters.hull.added_mass
    masses = (
        *(hull.mass - added.x_udot, hull.mass - added.y_vdot, hull.mass - added.z_wdot),
        *(hull.i_xx - added.k_pdot, hull.i_yy - added.m_qdot, hull.i_zz - added.n_rdot),
    )
    found = {}
    for linear, square, mass in zip(DRAG_COEFFICIENTS[::2], DRAG_COEFFICIENTS[1::2], masses, strict=True):
        found |= {linear: mass / _STOPS_IN_S, square: mass / _STOPS_IN_S / _STOPS_FROM}
    return {path: deviation for path, deviation in found.items() if value_at(parameters, path) == 0.0}


def coefficients_of(parts: Sequence[Part], parameters: Any) -> dict[str, tuple[str, Callable[[float, float], float]]]:
    """The effects that only change one coefficient of a vehicle with these parameters; see `Family`."""

    def scaled(given: float, size: float) -> float:
        return given * (1.0 + size)

    hull = parameters.hull
    found: dict[str, tuple[str, Callable[[float, float], float]]] = {
        f"effects.hull.added_mass_{axis}": (f"hull.added_mass.{name}", scaled)
        for axis, name in zip(_AXES, ("x_udot", "y_vdot", "z_wdot", "k_pdot", "m_qdot", "n_rdot"), strict=True)
    }
    crossed = hull.cross_flow.drag_y != 0.0 or hull.cross_flow.drag_z != 0.0
    for axis in _AXES:
        terms = getattr(hull, axis)
        acting = [term for term in derived_numbers.DAMPING_TERMS if getattr(terms, term) != 0.0]
        if len(acting) == 1 and not (crossed and axis in ("sway", "heave")):
            found[f"effects.hull.damping_{axis}"] = (f"hull.{axis}.{acting[0]}", scaled)
    for part_ in parts:
        for effect, (name, law) in part_.found.same.items():
            found[f"effects.{part_.name}.{effect}"] = (f"parts.{part_.name}.{name}", law)
    return found


def part_problem(parts: Sequence[Part], parameters: Any) -> str:
    """The problem with the numbers of a part, or nothing."""
    for part_ in parts:
        own, kind = getattr(parameters.parts, part_.name), part_.found
        found = kind.problem(own) or kind.problem_with_hull(own, parameters.hull)
        if found:
            return f"parts.{part_.name}{found}".replace("{}", f"parts.{part_.name}")
    return ""
