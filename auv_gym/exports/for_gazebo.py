"""A vehicle in six degrees of freedom as an SDF world for Gazebo, with the plugins that move it.

SDF axes are forward, port, up.  Gazebo's physics includes M_RB and, from `fluid_added_mass`, M_A with its Coriolis
forces; its Hydrodynamics plugin adds coefficients times products of two velocities, the form of our polynomials.
Sources: gz-sim, systems hydrodynamics, thruster, lift_drag, buoyancy, buoyancy_engine; SDFormat 1.11.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi, sqrt
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from auv_gym.param import list_paths, spec_at, value_at
from auv_gym.physics.hydrodynamics import cross_flow_drag
from auv_gym.physics.polynomials import TERMS
from auv_gym.physics.propulsion import RADPS_PER_RPM
from auv_gym.physics.rigid_body import coriolis_forces
from auv_gym.plant import Plant
from auv_gym.writing import write_text

# Signs of u v w p q r, and of the six forces, from forward-starboard-down to forward-port-up.
SIGNS = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
_AXES, _VELOCITIES = "xyzkmn", "uvwpqr"
_MASS_NAMES = "xyzpqr"
_SMALL = 1e-3  # kg, mass of a link that only carries a fin or a propeller
_AT_ONCE = 1e3  # m^3/s, rate of a buoyancy engine without a rate limit
# Effects that are included in the hull's coefficients, and so in the file.
_IN_THE_HULL = ("effects.hull.", "effects.load.payload", "effects.load.net_buoyancy", "effects.load.x_g")
_IN_THE_HULL += ("effects.load.y_g", "effects.load.z_g", "effects.water.density", "effects.discovered.")
# Words for parameters that no plugin has.
_DRAGS = {
    "drag": "drag of the deflected fin",
    "drag_rate": "drag of the deflected fin in a turn",
    "drag_slip": "drag of the deflected fin in cross flow",
}
_FIN_DRAGS = {"drag": "drag without lift", "induced": "drag that comes with lift", "plate": "drag across the flow"}
_NO_CURVE = "the curve from command to thrust (Gazebo's command is the thrust in N)"


@dataclass(frozen=True)
class GazeboWorld:
    """An SDF world, and the properties of the vehicle that it cannot represent, one sentence each."""

    xml: str
    left_out: tuple[str, ...]

    def save(self, file: Path) -> None:
        """Write the SDF file."""
        write_text(file, self.xml)


def gazebo_world(plant: Plant) -> GazeboWorld:
    """A Gazebo world with a vehicle in water.  Raises ValueError if it has no hull and parts, or a learned hull.

    Example:

        >>> from auv_gym import load_vehicle
        >>> from auv_gym.exports import gazebo_world
        >>> world = gazebo_world(load_vehicle("remus100"))
        >>> world.save("remus100.sdf")
        >>> world.left_out[0]
        'rudder, stern_plane: actuator lag (0.1 s); actuator rate limit (slowness = 1.91 s/rad).'
    """
    if plant.family.body is None or plant.learned is not None:
        what = "a learned hull" if plant.learned is not None else f"one of family {plant.family.name!r}"
        raise ValueError(
            f"SDF needs a vehicle with a hull and parts, such as remus100, got {what}: choose another vehicle."
        )
    hull, p = plant.hull, plant.family.view(plant.derived)
    water = float(hull.density * p.computed.density)
    sdf = ElementTree.Element("sdf", version="1.11")
    world = _add(sdf, "world", name="water")
    _add(world, "gravity", f"0 0 {-hull.gravity!r}")
    for system in ("physics", "user-commands", "scene-broadcaster"):
        _plugin(world, system)
    _plugin(world, "buoyancy", uniform_fluid_density=water)
    model = _add(world, "model", name=plant.name)
    left_out = [*_base_link(model, plant, p, water), *_hydrodynamics(model, plant, p, water)]
    lost_by_parts: dict[str, list[str]] = {}
    for part in plant.family.body.parts:
        make = _PARTS.get(part.kind)
        own = getattr(plant.parts, part.name)
        lost = (
            make(model, part, own, hull, water) if make else [f"all of it, since Gazebo has no plugin for {part.kind}"]
        )
        if lost:
            lost_by_parts.setdefault("; ".join(lost), []).append(part.name)
    left_out += [f"{', '.join(names)}: {lost}." for lost, names in lost_by_parts.items()]
    active = [path for path in list_paths(plant) if path.startswith("effects.") and not path.startswith(_IN_THE_HULL)]
    active = [path for path in active if value_at(plant, path) != spec_at(plant, path).neutral]
    if active:
        left_out.append(f"Effects without a counterpart in SDF: {', '.join(active)}.")
    heading = f"{plant.title or plant.name}. This file cannot represent:"
    sdf.insert(0, ElementTree.Comment("\n".join(["", heading, *left_out, ""]).replace("--", "-")))
    ElementTree.indent(sdf)
    return GazeboWorld(ElementTree.tostring(sdf, encoding="unicode") + "\n", tuple(left_out))


def _add(parent: Any, tag: str, text: Any = None, **attributes: str) -> Any:
    child = ElementTree.SubElement(parent, tag, attributes)
    if isinstance(text, bool):
        child.text = str(text).lower()
    elif text is not None:
        child.text = repr(text + 0.0) if isinstance(text, float) else str(text)  # + 0.0: no -0.0
    return child


def _plugin(parent: Any, system: str, **settings: Any) -> Any:
    """A plugin of Gazebo; settings: its elements."""
    name = "".join(word.capitalize() for word in system.split("-"))
    plugin = _add(parent, "plugin", filename=f"gz-sim-{system}-system", name=f"gz::sim::systems::{name}")
    for tag, value in settings.items():
        _add(plugin, tag, value)
    return plugin


def _place(x: float, y: float, z: float, turn: str = "0 0 0") -> str:
    return f"{x + 0.0!r} {0.0 - y!r} {0.0 - z!r} {turn}"


def _base_link(model: Any, plant: Plant, p: Any, water: float) -> list[str]:
    """The hull: mass, inertia about its centre, added mass about the origin, and a cylinder of the displaced volume."""
    hull, computed, left_out = plant.hull, p.computed, []
    rigid, added = np.array(computed.rigid_mass), np.array(computed.mass) - np.array(computed.rigid_mass)
    mass, centre = float(rigid[0, 0]), np.array([computed.x_g, computed.y_g, computed.z_g], dtype=float)
    turn = np.diag(SIGNS[3:])
    inertia = turn @ (rigid[3:, 3:] - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))) @ turn
    moments = np.linalg.eigvalsh(inertia)
    if not moments[0] > 0.0 or moments[0] + moments[1] < moments[2]:
        left_out.append(
            f"Inertia: no rigid body has principal moments of {', '.join(f'{m:.4g}' for m in moments)} kg m^2, and "
            "SDFormat reports an error."
        )
    link = _add(model, "link", name="base_link")
    inertial = _add(link, "inertial")
    _add(inertial, "pose", _place(*centre.tolist()))
    _add(inertial, "mass", mass)
    tensor = _add(inertial, "inertia")
    for i in range(3):
        for j in range(i, 3):
            _add(tensor, f"i{'xyz'[i]}{'xyz'[j]}", float(inertia[i, j]))
    if np.abs(added - added.T).max() > 1e-9 * np.abs(added).max():
        left_out.append("Added mass that is not symmetric: SDF holds only the symmetric part.")
    added = 0.5 * SIGNS[:, None] * (added + added.T) * SIGNS
    fluid = _add(inertial, "fluid_added_mass")
    for i in range(6):
        for j in range(i, 6):
            _add(fluid, _MASS_NAMES[i] + _MASS_NAMES[j], float(added[i, j]))
    volume = float(computed.buoyancy) / (water * hull.gravity)
    for kind in ("collision", "visual"):
        shape = _add(link, kind, name=f"hull_{kind}")
        _add(shape, "pose", _place(hull.x_b, hull.y_b, hull.z_b, f"0 {pi / 2!r} 0"))
        cylinder = _add(_add(shape, "geometry"), "cylinder")
        _add(cylinder, "radius", sqrt(volume / (pi * hull.length)))
        _add(cylinder, "length", float(hull.length))
    return left_out


def _hydrodynamics(model: Any, plant: Plant, p: Any, water: float) -> list[str]:
    """The Hydrodynamics plugin with all coefficients, corrected for what Gazebo adds or leaves out."""
    computed, left_out = p.computed, []
    terms = [*TERMS, *(f"{v}|u|" for v in _VELOCITIES[1:])]
    found: dict[str, float] = {}

    def count(axis: int, term: str, value: float) -> None:
        """Add a coefficient in our axes: `uv` for a product, `v|u|` and `v_v` with the magnitude of the second."""
        first, second, sized = term[0], term[-1] if len(term) == 2 else "", "_" in term or "|" in term
        if sized:
            second = term.strip("|")[-1]
        velocities = first if sized else term
        sign = SIGNS[axis] * np.prod([SIGNS[_VELOCITIES.index(v)] for v in velocities])
        name = _AXES[axis] + first.upper() + ("abs" if sized else "") + second.upper()
        found[name] = found.get(name, 0.0) + float(sign * value)

    for axis in range(6):
        for k in range(int(computed.ends[axis]), int(computed.ends[axis + 1])):
            count(axis, terms[int(computed.terms[k])], float(computed.coefficients[k]))
    # Gazebo adds the Coriolis forces of all of M_A; the vehicle has those of `momentum`
    rigid = np.array(computed.rigid_mass)
    added = np.array(computed.mass) - rigid
    extra = np.array(computed.momentum) - rigid - 0.5 * (added + added.T)
    coriolis: Any = getattr(coriolis_forces, "py_func", coriolis_forces)
    unit = np.eye(6)
    for a in range(6):
        for b in range(a, 6):
            force = np.array(coriolis(extra, *(unit[a] + unit[b] * (a != b))))
            if a != b:
                force -= np.array(coriolis(extra, *unit[a])) + np.array(coriolis(extra, *unit[b]))
            for axis in np.flatnonzero(force):
                count(int(axis), _VELOCITIES[a] + _VELOCITIES[b], float(force[axis]))
    if computed.has_cross_flow != 0.0:
        left_out.append(
            "Cross-flow drag in two motions at once: Gazebo does not integrate over strips of the hull, so the drag is "
            "exact only for sway, heave, pitch or yaw alone."
        )
        strips: Any = getattr(cross_flow_drag, "py_func", cross_flow_drag)
        drags = (computed.cross_y, computed.cross_z, water, plant.hull.length)
        for velocity, axis in zip("vwqr", (1, 2, 4, 5), strict=True):
            alone = [1.0 if velocity == v else 0.0 for v in "vwqr"]
            count(axis, f"{velocity}_{velocity}", strips(*alone, *drags)["vwqr".index(velocity)])
    if computed.has_environment != 0.0:
        left_out.append("Discovered forces that depend on depth or heading.")
    _plugin(
        model, "hydrodynamics", link_name="base_link", **{name: found[name] for name in sorted(found) if found[name]}
    )
    return left_out


def _jointed(model: Any, name: str, pose: str, axis: str, limit: float | None) -> None:
    """A small link on a joint to the hull that turns about an axis; limit: rad, None for free rotation."""
    _carrier(model, name, pose)
    joint = _add(model, "joint", name=f"{name}_joint", type="revolute")
    _add(joint, "parent", "base_link")
    _add(joint, "child", name)
    turning = _add(joint, "axis")
    _add(turning, "xyz", axis)
    stops = _add(turning, "limit")
    _add(stops, "lower", -1e16 if limit is None else -limit)
    _add(stops, "upper", 1e16 if limit is None else limit)


def _carrier(model: Any, name: str, pose: str) -> None:
    link = _add(model, "link", name=name)
    _add(link, "pose", pose)
    inertial = _add(link, "inertial")
    _add(inertial, "mass", _SMALL)
    tensor = _add(inertial, "inertia")
    for moment in ("ixx", "iyy", "izz"):
        _add(tensor, moment, _SMALL * 1e-2)


def _surface(model: Any, part: Any, own: Any, hull: Any, water: float) -> list[str]:
    """A control surface, with its lift at the position given by its moment over its lift."""
    if own.lift == 0.0:
        return ["all of it, since a moment without a lift has no place where LiftDrag could act"]
    yaw = part.choice == "yaw"
    x = (1.0 if yaw else -1.0) * own.moment / own.lift
    slope = 2.0 * own.lift / water
    _steered(
        model,
        part.name,
        yaw,
        (x, 0.0, 0.0),
        own,
        water,
        1.0,
        abs(slope) * own.inflow,
        slope,
        "0 -1 0" if yaw else "0 0 -1",
    )
    wake = any(value_at(own.wake, path) for path in list_paths(own.wake))
    lost = ["the forces that a propeller's wake adds"] if wake else []
    if own.inflow and own.station != x:
        lost.append(
            f"the angle of attack that the flow at x = {own.station:.3g} m makes (Gazebo takes the flow where the lift "
            f"acts, at x = {x:.3g} m)"
        )
    return [*_set(own, _DRAGS), *lost, *_slow(own)]


def _fin(model: Any, part: Any, own: Any, hull: Any, water: float) -> list[str]:
    """A fin given by its geometry."""
    yaw, place = part.choice == "yaw", (own.x, own.y, own.z)
    slope = own.lift_slope
    _steered(model, part.name, yaw, place, own, water, own.area, slope, slope, "0 -1 0" if yaw else "0 0 1")
    return [*_set(own, _FIN_DRAGS), *_slow(own)]


def _steered(
    model: Any,
    name: str,
    yaw: bool,
    place: tuple[float, float, float],
    own: Any,
    water: float,
    area: float,
    cla: float,
    slope: float,
    up: str,
) -> None:
    """A fin on a joint, whose position is our angle, and a LiftDrag that acts on the hull at the fin's position."""
    _jointed(model, name, _place(*place), "0 0 -1" if yaw else "0 -1 0", float(own.limit))
    lift = {"air_density": water, "area": float(area), "a0": 0.0, "cla": float(cla), "alpha_stall": float(own.stall)}
    none = dict.fromkeys(("cda", "cma", "cla_stall", "cda_stall"), 0.0)
    where = {"cp": _place(*place, turn="").strip(), "forward": "1 0 0", "upward": up}
    joint = {"control_joint_name": f"{name}_joint", "control_joint_rad_to_cl": float(slope)}
    _plugin(model, "lift-drag", link_name="base_link", **joint, **lift, **none, **where)
    _plugin(model, "joint-position-controller", joint_name=f"{name}_joint", use_velocity_commands=True)


def _propeller(model: Any, part: Any, own: Any, hull: Any, water: float) -> list[str]:
    """A propeller at the stern; for shaft speed n, with T = t_nn n|n| + t_nu |n| u, else with its largest thrust."""
    _jointed(model, part.name, _place(-0.5 * hull.length, 0.0, 0.0), "1 0 0", None)
    common = {"joint_name": f"{part.name}_joint", "fluid_density": water, "velocity_control": True}
    lost = []
    if part.choice == "shaft_speed":
        size, fastest = float(hull.diameter), float(RADPS_PER_RPM * own.limit)
        _plugin(
            model, "thruster", **common, use_angvel_cmd=True, propeller_diameter=size, wake_fraction=0.0,
            alpha_1=float(own.t_nn / (hull.density * size**4)), alpha_2=float(own.t_nu / (hull.density * size**3)),
            max_thrust_cmd=fastest, min_thrust_cmd=-fastest,
        )  # fmt: skip
        lost += ["its torque on the hull"] if own.q_nn or own.q_nu else []
    else:
        most = float(own.t_cc * own.limit**2) or max(value_at(own.table, path) for path in list_paths(own.table))
        _plugin(model, "thruster", **common, max_thrust_cmd=most, min_thrust_cmd=-most)
        lost.append(_NO_CURVE)
    lost += ["its torque on the hull"] if own.torque_arm else []
    lost += ["the faster flow in its wake"] if own.wake.c_t1 else []
    return [*lost, *_slow(own)]


def _thruster(model: Any, part: Any, own: Any, hull: Any, water: float) -> list[str]:
    """A thruster along its direction, commanded in N between its thrusts at the largest commands."""
    way = np.array([own.to_x, -own.to_y, -own.to_z])
    way /= np.linalg.norm(way)
    _jointed(model, part.name, _place(own.x, own.y, own.z), " ".join(map(repr, way.tolist())), None)
    thrusts = part.found.thrusts(own)[1]
    _plugin(
        model, "thruster", joint_name=f"{part.name}_joint", fluid_density=water, velocity_control=True,
        max_thrust_cmd=float(thrusts[-1]), min_thrust_cmd=float(thrusts[0]),
    )  # fmt: skip
    lost = [_NO_CURVE]
    lost += ["its torque on the hull"] if own.torque_arm else []
    return [*lost, *_slow(own)]


def _engine(model: Any, part: Any, own: Any, hull: Any, water: float) -> list[str]:
    """A buoyancy engine on a link of its own, at its position."""
    _carrier(model, part.name, _place(own.x, own.y, own.z))
    joint = _add(model, "joint", name=f"{part.name}_joint", type="fixed")
    _add(joint, "parent", "base_link")
    _add(joint, "child", part.name)
    _plugin(
        model, "buoyancy-engine", link_name=part.name, namespace=part.name, fluid_density=water,
        min_volume=float(own.low), neutral_volume=float(own.neutral), default_volume=float(own.neutral),
        max_volume=float(own.high),
        max_inflation_rate=1.0 / own.slowness if own.slowness else _AT_ONCE,
    )  # fmt: skip
    return [f"actuator lag ({own.lag:g} s)"] if own.lag else []


def _slow(own: Any) -> list[str]:
    """The properties of an actuator that no plugin has."""
    return [*([f"actuator lag ({own.lag:g} s)"] if own.lag else []), *_set(own, {"slowness": "actuator rate limit"})]


def _set(own: Any, words: Mapping[str, str]) -> list[str]:
    """Descriptions of those parameters of a part that are not 0, with name, value and unit."""
    found = []
    for name, text in words.items():
        value, unit = value_at(own, name), spec_at(own, name).unit
        found += [f"{text} ({name} = {value:.4g} {unit})".replace(" 1)", ")")] if value else []
    return found


_PARTS = {"surface": _surface, "fin": _fin, "propeller": _propeller, "thruster": _thruster, "buoyancy_engine": _engine}
