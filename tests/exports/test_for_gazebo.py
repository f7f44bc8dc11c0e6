"""The SDF against Gazebo's documentation, and the acceleration that its numbers give against the vehicle's own."""

import re
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from auv_gym.exports import gazebo_world
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle

TETHYS = Path(__file__).parents[2] / "examples" / "vehicles" / "tethys.toml"
FLIP = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])  # forward-starboard-down to forward-port-up, and back
# Elements of each system in the headers of gz-sim 8 (Harmonic)
ELEMENTS = {
    "Physics": set(),
    "UserCommands": set(),
    "SceneBroadcaster": set(),
    "Buoyancy": {"uniform_fluid_density"},
    "LiftDrag": {"link_name", "control_joint_name", "control_joint_rad_to_cl", "air_density", "area", "a0", "cp", "cla"}
    | {"cda", "cma", "alpha_stall", "cla_stall", "cda_stall", "forward", "upward"},
    "Thruster": {"joint_name", "fluid_density", "velocity_control", "use_angvel_cmd", "propeller_diameter", "alpha_1"}
    | {"wake_fraction", "alpha_2", "max_thrust_cmd", "min_thrust_cmd"},
    "JointPositionController": {"joint_name", "use_velocity_commands"},
    "BuoyancyEngine": {"link_name", "namespace", "fluid_density", "min_volume", "neutral_volume", "default_volume"}
    | {"max_volume", "max_inflation_rate"},
}
HYDRODYNAMICS = re.compile(r"link_name|[xyzkmn][UVWPQR](abs)?[UVWPQR]?")


def numbers(text):
    return np.array([float(word) for word in text.split()])


def cross(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def at(force, place):
    return np.concatenate([force, np.cross(place, force)])


class Gazebo:
    """What gz-sim computes from an SDF file, in its own axes; sources: Hydrodynamics.cc, LiftDrag.cc, dartsim."""

    def __init__(self, xml):
        self.world = ElementTree.fromstring(xml).find("world")
        self.model = self.world.find("model")
        inertial = self.model.find("link[@name='base_link']/inertial")
        mass, self.centre = float(inertial.findtext("mass")), numbers(inertial.findtext("pose"))[:3]
        tensor = np.zeros((3, 3))
        for entry in inertial.find("inertia"):
            i, j = ("xyz".index(letter) for letter in entry.tag[1:])
            tensor[i, j] = tensor[j, i] = float(entry.text)
        arm = cross(self.centre)
        self.matrix = np.block([[mass * np.eye(3), -mass * arm], [mass * arm, tensor - mass * arm @ arm]])
        for entry in inertial.find("fluid_added_mass"):
            i, j = ("xyzpqr".index(letter) for letter in entry.tag)
            self.matrix[i, j] += float(entry.text)
            self.matrix[j, i] += float(entry.text) * (i != j)
        self.gravity = -numbers(self.world.findtext("gravity"))[2]
        self.weight = mass * self.gravity
        cylinder = self.model.find("link/collision/geometry/cylinder")
        radius, length = float(cylinder.findtext("radius")), float(cylinder.findtext("length"))
        density = float(self.plugin("Buoyancy", self.world).findtext("uniform_fluid_density"))
        self.buoyancy = density * self.gravity * np.pi * radius**2 * length
        self.lifted_at = numbers(self.model.findtext("link/collision/pose"))[:3]

    def plugin(self, name, parent=None):
        return (self.model if parent is None else parent).find(f"plugin[@name='gz::sim::systems::{name}']")

    def hydrodynamics(self, nu):
        force = np.zeros(6)
        for entry in self.plugin("Hydrodynamics"):
            if entry.tag == "link_name":
                continue
            axis, velocities = (
                "xyzkmn".index(entry.tag[0]),
                ["UVWPQR".index(v) for v in entry.tag[1:].replace("abs", "")],
            )
            value = float(entry.text) * nu[velocities[0]]
            for second in velocities[1:]:
                value *= abs(nu[second]) if "abs" in entry.tag else nu[second]
            force[axis] += value
        return force

    def coriolis(self, nu):
        momentum = self.matrix @ nu
        linear, angular = momentum[:3], momentum[3:]
        return -np.concatenate([np.cross(nu[3:], linear), np.cross(nu[3:], angular) + np.cross(nu[:3], linear)])

    def lift(self, name, nu, angle):
        for plugin in self.model.findall("plugin[@name='gz::sim::systems::LiftDrag']"):
            if plugin.findtext("control_joint_name") == f"{name}_joint":
                get = {entry.tag: entry.text for entry in plugin}
        cp, forward, upward = (numbers(get[key]) for key in ("cp", "forward", "upward"))
        flow = nu[:3] + np.cross(nu[3:], cp)
        span = np.cross(forward, upward)
        plane = flow - flow @ span * span
        direction = np.cross(span, plane)
        direction /= np.linalg.norm(direction)
        alpha = np.copysign(np.arccos(np.clip(direction @ upward, -1, 1)), direction @ forward)
        cl = float(get["cla"]) * alpha + float(get["control_joint_rad_to_cl"]) * angle
        size = 0.5 * float(get["air_density"]) * plane @ plane * cl * float(get["area"])
        return at(size * direction, cp)

    def thrust(self, name, newtons):
        place = numbers(self.model.findtext(f"link[@name='{name}']/pose"))[:3]
        axis = numbers(self.model.findtext(f"joint[@name='{name}_joint']/axis/xyz"))
        return at(newtons * axis / np.linalg.norm(axis), place)

    def acceleration(self, nu, up, forces):
        """nu: of the body; up: the upward direction in its axes."""
        total = self.coriolis(nu) + self.hydrodynamics(nu) + sum(forces, np.zeros(6))
        total += at(-self.weight * up, self.centre) + at(self.buoyancy * up, self.lifted_at)
        return np.linalg.solve(self.matrix, total)


def ours(plant, nu, roll, pitch, u):
    """The vehicle's accelerations in its own axes."""
    pytest.importorskip("casadi", reason="the extra `casadi` is not installed")
    from auv_gym.exports import casadi_model

    model = casadi_model(plant)
    x = np.zeros(len(model.states))
    x[:6], x[9:11] = nu, (roll, pitch)
    full = plant.settled(x[: len(plant.family.states)], u)
    x[len(plant.family.states) :] = full[
        [plant.states.index(name) for name in model.states[len(plant.family.states) :]]
    ]
    return np.array(model.rhs(x, u)).ravel()[:6]


def assert_same_acceleration(plant, nu, u, actuators):
    gazebo = Gazebo(gazebo_world(plant).xml)
    roll, pitch = 0.3, -0.4
    up = FLIP[:3] * -np.array([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])
    theirs = FLIP * gazebo.acceleration(FLIP * nu, up, actuators(gazebo, FLIP * nu))
    own = ours(plant, nu, roll, pitch, u)
    assert theirs == pytest.approx(own, rel=1e-9, abs=1e-9 * np.abs(own).max())


@pytest.mark.parametrize("name", ["bluerov2_heavy", "remus100", "npsauv"])
def test_the_hull_accelerates_as_ours(name):
    """With added mass made symmetric and no strips, what SDF holds; the commands are at rest."""
    plant = load_vehicle(name)
    matrix = plant.hull.added_mass
    symmetric = {"x_vdot": 0.0, "k_vdot": matrix.y_pdot, "m_wdot": matrix.z_qdot, "n_vdot": matrix.y_rdot}
    plant = replace_at(
        plant,
        {f"hull.added_mass.{key}": value for key, value in symmetric.items()}
        | {"hull.added_mass.n_pdot": matrix.k_rdot, "hull.cross_flow.drag_y": 0.0, "hull.cross_flow.drag_z": 0.0}
        | ({"parts.propeller.wake.c_t1": 0.0} if hasattr(plant.parts, "propeller") else {}),
    )
    u = np.array([plant.constants.get(channel, 0.0) for channel in plant.inputs])
    rng = np.random.default_rng(5)
    for _ in range(5):
        assert_same_acceleration(plant, rng.uniform(-1, 1, 6) * [2, 0.5, 0.5, 0.5, 0.5, 0.5], u, lambda gazebo, nu: [])


def test_thrusters_push_where_ours_do():
    plant = load_vehicle("bluerov2_heavy")
    rng = np.random.default_rng(6)
    u = np.array([*rng.uniform(-1, 1, 8), plant.constants["supply_V"], 0.0])
    parts = plant.family.body.parts
    thrusts = [np.interp(c, *part.found.thrusts(getattr(plant.parts, part.name))) for c, part in zip(u, parts)]

    def pushes(gazebo, nu):
        return [gazebo.thrust(part.name, newtons) for part, newtons in zip(parts, thrusts)]

    assert_same_acceleration(plant, rng.uniform(-0.5, 0.5, 6), u, pushes)


def test_planes_and_propeller_do_as_ours_on_a_straight_run():
    plant = load_vehicle("remus100")
    u = np.array([0.2, -0.1, 1200.0])
    shaft = u[2] * np.pi / 30
    own = replace_at(plant, {"parts.propeller.q_nn": 0.0})

    def pushes(gazebo, nu):
        get = {entry.tag: entry.text for entry in gazebo.plugin("Thruster")}
        size, density = float(get["propeller_diameter"]), float(get["fluid_density"])
        newtons = (
            density * size**4 * float(get["alpha_1"]) * shaft**2 + density * size**3 * float(get["alpha_2"]) * shaft
        )
        assert float(get["max_thrust_cmd"]) == pytest.approx(plant.parts.propeller.limit * np.pi / 30)
        return [
            gazebo.lift("rudder", nu, u[0]),
            gazebo.lift("stern_plane", nu, u[1]),
            gazebo.thrust("propeller", newtons),
        ]

    assert_same_acceleration(own, np.array([1.7, 0, 0, 0, 0, 0]), u, pushes)


def test_fins_and_a_buoyancy_engine():
    """Lift in a straight flow, which our fins have across the flow, too; the engine's volumes, and what is said."""
    plant = load_vehicle(TETHYS)
    world = gazebo_world(plant)
    gazebo, angle = Gazebo(world.xml), 0.1
    for part in plant.family.body.parts:
        if part.kind != "fin":
            continue
        own = getattr(plant.parts, part.name)
        lift = 0.5 * plant.hull.density * own.area * own.lift_slope * angle * 1.5**2
        force = (0, lift, 0) if part.choice == "yaw" else (0, 0, -lift)
        expected = FLIP * at(np.array(force), np.array([own.x, own.y, own.z]))
        assert gazebo.lift(part.name, np.array([1.5, 0, 0, 0, 0, 0]), angle) == pytest.approx(expected, abs=1e-12)
    (engine,) = (part.name for part in plant.family.body.parts if part.kind == "buoyancy_engine")
    own, found = getattr(plant.parts, engine), gazebo.plugin("BuoyancyEngine")
    assert [float(found.findtext(f"{key}_volume")) for key in ("min", "neutral", "max")] == [
        own.low,
        own.neutral,
        own.high,
    ]
    assert any("Gazebo has no plugin for moving_mass" in line for line in world.left_out)


def test_a_learned_hull_is_refused():
    with pytest.raises(ValueError, match="a learned hull"):
        gazebo_world(replace(load_vehicle("remus100"), learned=object()))


@pytest.mark.parametrize("name", ["bluerov2_heavy", "remus100", "npsauv", "vt690", "heu_torpedo", TETHYS])
def test_its_elements_are_gazebos(name):
    world = ElementTree.fromstring(gazebo_world(load_vehicle(name)).xml).find("world")
    plugins = [*world.findall("plugin"), *world.findall("model/plugin")]
    for plugin in plugins:
        system = plugin.get("name").removeprefix("gz::sim::systems::")
        assert plugin.get("filename") == "gz-sim-" + re.sub(r"(?<!^)(?=[A-Z])", "-", system).lower() + "-system"
        for entry in plugin:
            assert HYDRODYNAMICS.fullmatch(entry.tag) if system == "Hydrodynamics" else entry.tag in ELEMENTS[system]
    links = {link.get("name") for link in world.findall("model/link")}
    joints = {joint.get("name"): joint for joint in world.findall("model/joint")}
    for joint in joints.values():
        assert {joint.findtext("parent"), joint.findtext("child")} <= links
    for plugin in plugins:
        for tag in ("joint_name", "control_joint_name"):
            assert plugin.find(tag) is None or plugin.findtext(tag) in joints


def test_what_it_cannot_hold_is_said_and_written():
    world = gazebo_world(load_vehicle("npsauv"))
    said = " ".join(world.left_out)
    assert "Cross-flow drag" in said
    assert "drag of the deflected fin in cross flow (drag_slip = 24.47 kg/m); actuator lag (0.1 s)." in said
    assert all(line in world.xml for line in world.left_out)


def test_a_flow_that_is_taken_elsewhere_is_said_with_both_places():
    plant = replace_at(load_vehicle("npsauv"), {"parts.rudder.inflow": 1.0, "parts.rudder.station": -1.0})
    lift_at = plant.parts.rudder.moment / plant.parts.rudder.lift
    (said,) = (line for line in gazebo_world(plant).left_out if line.startswith("rudder"))
    assert "the flow at x = -1 m makes (Gazebo takes the flow where the lift acts, at x = " in said
    assert f"at x = {lift_at:.3g} m)" in said


def test_a_float_is_refused():
    with pytest.raises(ValueError, match="SDF needs a vehicle with a hull and parts, such as remus100"):
        gazebo_world(load_vehicle("mermaid"))


def test_the_bindings_of_sdformat_read_it():
    names = [f"sdformat{version}" for version in (14, 15, 16)]
    found = [import_module(name) for name in names if find_spec(name)]
    found = [module for module in found if hasattr(module, "Root")]
    if not found:
        pytest.skip("Gazebo's Python bindings of SDFormat are not installed")
    root = found[0].Root()
    root.load_sdf_string(gazebo_world(load_vehicle("remus100")).xml)
    assert root.world_by_index(0).model_by_index(0).name() == "remus100"
