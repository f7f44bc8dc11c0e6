"""Effects in six degrees of freedom act as documented: loads, damage, errors of coefficients, actuators, sensors."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auv_gym.param import replace_at, spec_at
from auv_gym.physics.polynomials import ENVIRONMENT_TERMS, TERMS
from auv_gym.plant import Plant, load_vehicle
from auv_gym.vehicles import Part, compose

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
FINS = ("rudder", "stern_plane", "bow_plane")
FAMILY = compose(
    [
        Part("rudder", "surface", "yaw"),
        Part("stern_plane", "surface", "pitch"),
        Part("bow_plane", "surface", "pitch"),
        Part("propeller", "propeller", "shaft_speed"),
    ]
)
GRAVITY = 9.81
HULL = {
    "buoyancy": 480.0, "x_b": 0.01, "z_b": -0.01, "z_g": 0.02, "x_g": 0.005, "i_xx": 1.0, "i_yy": 6.0, "i_zz": 6.0,
    "added_mass.x_udot": -2.0, "added_mass.y_vdot": -40.0, "added_mass.z_wdot": -42.0, "added_mass.y_rdot": 1.5,
    "added_mass.n_vdot": 1.5, "added_mass.k_pdot": -0.3, "added_mass.m_qdot": -5.0, "added_mass.n_rdot": -5.0,
    "surge.u": -1.0, "surge.u_u": -4.0, "surge.vr": 30.0, "sway.v": -9.0, "sway.v_v": -90.0, "sway.uv": -30.0,
    "sway.ur": 5.0, "sway.wp": 20.0, "heave.w": -8.0, "heave.w_w": -80.0, "heave.uw": -31.0, "heave.uq": -6.0,
    "roll.p": -0.2, "roll.p_p": -0.4, "roll.up": -0.3, "pitch.q": -2.0, "pitch.q_q": -20.0, "pitch.uq": -3.0,
    "pitch.uw": 15.0, "pitch.vp": -1.0, "yaw.r": -2.5, "yaw.r_r": -25.0, "yaw.ur": -4.0, "yaw.uv": -14.0,
    "cross_flow.drag_y": 0.6, "cross_flow.drag_z": 0.5, "cross_flow.height": 0.2, "cross_flow.breadth": 0.2,
}  # fmt: skip
PARTS = {
    "rudder.lift": 8.0, "rudder.moment": -6.0, "rudder.drag": -5.0, "rudder.drag_slip": 0.5,
    "stern_plane.lift": -8.0, "stern_plane.moment": -6.0, "stern_plane.drag": -5.0, "stern_plane.drag_rate": 0.4,
    "bow_plane.lift": -3.0, "bow_plane.moment": 2.0, "bow_plane.drag": -1.0,
    "stern_plane.wake.drag": -1.0, "stern_plane.wake.lift": -2.0, "stern_plane.wake.moment": -1.0,
    "propeller.wake.c_t1": 0.1, "propeller.wake.pitch": 0.012, "propeller.wake.z_uw": -1.5,
    "propeller.wake.k_up": -0.1,
    "propeller.t_nn": 0.001, "propeller.t_nu": -0.01, "propeller.q_nn": 3e-5, "propeller.q_nu": -1e-4,
    "propeller.limit": 1500.0, "propeller.torque_arm": 0.01,
}  # fmt: skip
MOTION = np.array([1.2, 0.2, -0.15, 0.3, -0.1, 0.2])
ATTITUDE = np.array([0.2, -0.3, 0.8])  # roll, pitch, heading
ACTUATORS = (0.1, -0.15, 0.2, 1100.0)
TURNED = Rotation.from_euler("ZYX", ATTITUDE[::-1]).as_matrix()
DOWN = TURNED[2]


def vehicle(changes: dict[str, float] | None = None, effects: dict[str, float] | None = None) -> Plant:
    """A vehicle with a little of everything, with these values of hull and parts in place of its own, and effects."""
    values = {place(path): value for path, value in {**HULL, **PARTS, **(changes or {})}.items()}
    values |= {f"effects.{path}": value for path, value in (effects or {}).items()}
    return Plant("vehicle", FAMILY, replace_at(FAMILY.parameters(), values), dt=0.1, longest_step=0.05)


def place(path: str) -> str:
    """Where in the parameters a value of the hull or of a part is."""
    return f"parts.{path}" if path.startswith((*FINS, "propeller")) else f"hull.{path}"


def state(plant: Plant, motion=MOTION, attitude=ATTITUDE, position=(1.0, 2.0, 12.0)) -> np.ndarray:
    x = np.zeros(len(plant.states))
    x[:12] = *motion, *position, *attitude
    return x


def rates(plant: Plant, motion=MOTION, actuators=ACTUATORS) -> np.ndarray:
    z, dz, scratch = np.empty(14), np.empty(14), np.empty(plant.family.scratch)
    plant.family.hooks.enter(np.ascontiguousarray(state(plant, motion)[:13]), z)
    commands = np.array(actuators)
    plant.family.hooks.derivative(z, commands, commands, plant.family.view(plant.derived), dz, scratch)
    return dz


def mass_matrix(plant: Plant) -> np.ndarray:
    return np.linalg.inv(np.array(plant.family.view(plant.derived).computed.inverse_mass))


def added_forces(effects: dict[str, float], motion=MOTION) -> np.ndarray:
    """What effects add to the forces and moments."""
    change = rates(vehicle(effects=effects), motion)[:6] - rates(vehicle(), motion)[:6]
    return mass_matrix(vehicle()) @ change


def moment_of(force, at) -> np.ndarray:
    return np.r_[force, np.cross(at, force)]


def body_axes(north=0.0, east=0.0, down=0.0) -> np.ndarray:
    return TURNED.T @ [north, east, down]


SPEED = MOTION[:3]
LOADS = {
    "force x": ({"load.force_x": 2.0}, [2, 0, 0, 0, 0, 0]),
    "force y": ({"load.force_y": 2.0}, [0, 2, 0, 0, 0, 0]),
    "force z": ({"load.force_z": 2.0}, [0, 0, 2, 0, 0, 0]),
    "moment x": ({"load.moment_x": 0.5}, [0, 0, 0, 0.5, 0, 0]),
    "moment y": ({"load.moment_y": 0.5}, [0, 0, 0, 0, 0.5, 0]),
    "moment z": ({"load.moment_z": 0.5}, [0, 0, 0, 0, 0, 0.5]),
    "net buoyancy": ({"load.net_buoyancy": 3.0}, moment_of(-3.0 * DOWN, [0.01, 0.0, -0.01])),
    "tether": (
        {"load.tether_north": 3.0, "load.tether_east": -1.0, "load.tether_down": -2.0, "load.tether_station": -0.9},
        moment_of(body_axes(3.0, -1.0, -2.0), [-0.9, 0.0, 0.0]),
    ),
    "tether drag": (
        {"load.tether_drag": 0.7, "load.tether_station": 0.4},
        moment_of(-0.7 * np.linalg.norm(SPEED) * SPEED, [0.4, 0.0, 0.0]),
    ),
}


@pytest.mark.parametrize("effects, forces", LOADS.values(), ids=LOADS)
def test_a_load_is_a_force_and_a_moment(effects, forces):
    # differences of accelerations of order 1, times a mass matrix of order 100
    assert added_forces(effects) == pytest.approx(np.array(forces, dtype=float), abs=1e-12)


@pytest.mark.parametrize("axis", range(6))
def test_a_discovered_term_is_a_force(axis):
    u, v, w, p, q, r = MOTION
    known = {"u": u, "v_v": v * abs(v), "pp": p * p, "wr": w * r, "qr": q * r}
    known |= {"depth": 12.0, "sin_heading": math.sin(0.8), "cos_heading": math.cos(0.8)}
    assert set(known) < {*TERMS, *ENVIRONMENT_TERMS}
    for term, value in known.items():
        found = added_forces({f"discovered.{AXES[axis]}.{term}": 1.5})
        assert found == pytest.approx(1.5 * value * np.eye(6)[axis], abs=1e-12), term


@pytest.mark.parametrize(
    "effects, mass, centre",
    [
        ({"load.payload": 4.0}, 54.0, (0.005, 0.0, 0.02)),
        ({"load.x_g": 0.03}, 50.0, (0.035, 0.0, 0.02)),
        ({"load.y_g": -0.02}, 50.0, (0.005, -0.02, 0.02)),
        ({"load.z_g": 0.01}, 50.0, (0.005, 0.0, 0.03)),
        ({"load.payload": 4.0, "load.x_g": 0.03}, 54.0, (0.035, 0.0, 0.02)),
    ],
)
def test_payload_and_trim_move_inertia_and_weight(effects, mass, centre):
    at_rest = np.zeros(6)
    laden, plain = vehicle(effects=effects), vehicle()
    jacobian = np.c_[np.eye(3), -np.cross(centre, np.eye(3)).T]
    before = np.c_[np.eye(3), -np.cross((0.005, 0.0, 0.02), np.eye(3)).T]
    # as if what came were points at the new centre, and what went at the old: the inertia about the centre is kept
    expected = mass * jacobian.T @ jacobian - 50.0 * before.T @ before
    assert mass_matrix(laden) - mass_matrix(plain) == pytest.approx(expected, abs=1e-11)
    gained = mass_matrix(laden) @ rates(laden, at_rest)[:6] - mass_matrix(plain) @ rates(plain, at_rest)[:6]
    weight = moment_of(mass * GRAVITY * DOWN, centre) - moment_of(50.0 * GRAVITY * DOWN, (0.005, 0.0, 0.02))
    assert gained == pytest.approx(weight, abs=1e-11)


@pytest.mark.parametrize("path", ["load.x_g", "load.y_g", "load.z_g", "load.payload"])
@pytest.mark.parametrize("name", ["npsauv", "heu_torpedo", "remus100", "vt690"])
def test_no_trim_or_payload_makes_a_mass_matrix_that_cannot_be(name, path):
    plant = load_vehicle(name)
    for value in (*spec_at(plant, f"effects.{path}").bounds, 0.1):
        if plant.hull.mass + value > 0.0 or path != "load.payload":
            assert plant.family.problem(replace_at(plant, f"effects.{path}", value).parameters) == ""


def scaled(factor: float, *groups: str) -> dict[str, float]:
    """The values of hull and parts in these groups times a factor."""
    return {path: factor * value for path, value in {**HULL, **PARTS}.items() if path.startswith(groups)}


HYDRODYNAMIC = ("added_mass", *AXES)
FIN_FORCES = tuple(f"{fin}.{kind}" for fin in FINS for kind in ("lift", "moment", "drag"))
WAKE = ("stern_plane.wake", "propeller.wake.z", "propeller.wake.k")
THRUST = ("propeller.t_nn", "propeller.t_nu", "propeller.q")
OTHER_HULLS = {
    "density": (
        {"water.density": 0.02},
        scaled(1.02, "buoyancy", "cross_flow.drag", *HYDRODYNAMIC, *FIN_FORCES, *WAKE, *THRUST),
    ),
    "fouling": (
        {"hull.fouling": 0.2},
        {
            path: 1.2 * value
            for path, value in HULL.items()
            if path.startswith("cross_flow.drag")
            or (path.startswith(AXES) and ("_" in path.split(".")[1] or len(path.split(".")[1]) == 1))
        },
    ),
    "thrust loss": ({"propeller.lost": 0.3}, scaled(0.7, *THRUST)),
    "torque": ({"propeller.torque": 0.02}, {"propeller.torque_arm": 0.03}),
    "rudder lost": ({"rudder.lost": 0.4}, scaled(0.6, "rudder.lift", "rudder.moment", "rudder.drag")),
    "stern plane lost": (
        {"stern_plane.lost": 0.4},
        {
            **scaled(0.6, "stern_plane.lift", "stern_plane.moment", "stern_plane.drag"),
            **scaled(0.6, "stern_plane.wake"),
        },
    ),
    "bow plane lost": (
        {"bow_plane.lost": 1.0},
        scaled(0.0, "bow_plane.lift", "bow_plane.moment", "bow_plane.drag"),
    ),
    "damping surge": ({"hull.damping_surge": 0.2}, scaled(1.2, "surge.u")),
    "damping sway": (
        {"hull.damping_sway": 0.2},
        scaled(1.2, "sway.v", "sway.u", "cross_flow.drag_y"),
    ),
    "damping heave": ({"hull.damping_heave": 0.2}, scaled(1.2, "heave.w", "heave.u", "cross_flow.drag_z")),
    "damping roll": ({"hull.damping_roll": 0.2}, scaled(1.2, "roll")),
    "damping pitch": ({"hull.damping_pitch": 0.2}, scaled(1.2, "pitch.q", "pitch.u")),
    "damping yaw": ({"hull.damping_yaw": 0.2}, scaled(1.2, "yaw.r", "yaw.u")),
    **{
        f"added mass {axis}": ({f"hull.added_mass_{axis}": 0.3}, scaled(1.3, f"added_mass.{name}"))
        for axis, name in zip(AXES, ("x_udot", "y_vdot", "z_wdot", "k_pdot", "m_qdot", "n_rdot"))
    },
}


@pytest.mark.parametrize("effects, changes", OTHER_HULLS.values(), ids=OTHER_HULLS)
def test_an_error_of_coefficients_is_another_hull(effects, changes):
    found, expected = rates(vehicle(effects=effects)), rates(vehicle(changes))
    assert not np.array_equal(found, rates(vehicle()))
    assert found == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("index, fin", list(enumerate(FINS)))
def test_a_stuck_fin_stands_where_it_is_stuck(index, fin):
    stuck = {f"{fin}.stuck": 1.0, f"{fin}.stuck_at": 0.25}
    actuators = list(ACTUATORS)
    for share, angle in ((1.0, 0.25), (0.5, 0.5 * ACTUATORS[index] + 0.125)):
        actuators[index] = angle
        found = rates(vehicle(effects={**stuck, f"{fin}.stuck": share}))
        assert found == pytest.approx(rates(vehicle(), actuators=tuple(actuators)), abs=1e-13)


# Actuators


def driven(plant: Plant, u, samples: int) -> np.ndarray:
    """The full states after each sample, from rest."""
    x, states = plant.initial(np.zeros(len(plant.outputs))), []
    for _ in range(samples):
        x = plant.step(x, np.array(u, dtype=float))
        states.append(x)
    return np.array(states)


def position(plant: Plant, states: np.ndarray, actuator: str) -> np.ndarray:
    return states[:, plant.states.index(f"{actuator} position")]


def limited_lag(t: np.ndarray, step: float, lag: float, rate: float) -> np.ndarray:
    """Position after a step: at full rate until lag times rate are left, and exponentially from there."""
    run = max(step / rate - lag, 0.0)
    return np.where(t < run, rate * t, step - (step - rate * run) * np.exp(-np.maximum(t - run, 0.0) / lag))


@pytest.mark.parametrize("fin", FINS)
@pytest.mark.parametrize("lag, slowness", [(0.3, 2.0), (0.3, 1e-9), (1e-9, 4.0)])
def test_a_fin_has_a_lag_and_a_rate_limit_of_its_own(fin, lag, slowness):
    plant = vehicle({f"{fin}.lag": lag, f"{fin}.slowness": slowness})
    command = [0.3 if name == f"{fin}_rad" else 0.0 for name in plant.inputs]
    t = 0.1 * np.arange(1, 31)
    found = position(plant, driven(plant, command, 30), f"{fin}_rad")
    assert found == pytest.approx(limited_lag(t, 0.3, lag, 1.0 / slowness), abs=1e-8)


def test_the_vehicles_own_lag_and_the_effects_add():
    own = vehicle({"rudder.lag": 0.3, "rudder.slowness": 2.0, "propeller.lag": 1.0, "propeller.slowness": 3.0})
    both = vehicle(
        {"rudder.lag": 0.1, "rudder.slowness": 1.5, "propeller.lag": 0.4, "propeller.slowness": 1.0},
        {"rudder.lag": 0.2, "rudder.slowness": 0.5, "propeller.lag": 0.6, "propeller.slowness": 2.0},
    )
    u = (0.3, 0.0, 0.0, 1200.0)
    assert driven(both, u, 20) == pytest.approx(driven(own, u, 20), abs=1e-9)


def test_the_propellers_rate_limit_is_a_time_to_full():
    plant = vehicle({"propeller.slowness": 5.0})
    found = position(plant, driven(plant, (0, 0, 0, 1500.0), 60), "propeller_rpm")
    assert found == pytest.approx(np.minimum(300.0 * 0.1 * np.arange(1, 61), 1500.0), abs=1e-9)


@pytest.mark.parametrize(
    "effects, command, expected",
    [
        ({}, 2000.0, 1500.0),
        ({}, -2000.0, -1500.0),
        ({"gain": 0.8}, 1000.0, 800.0),
        ({"offset": 0.1}, 1000.0, 1150.0),
        ({"deadband": 0.1}, 1000.0, 850.0),
        ({"deadband": 0.1}, -100.0, 0.0),
        ({"lost_travel": 0.2}, 1400.0, 1200.0),
    ],
)
def test_sizes_of_propeller_effects_are_shares_of_full_command(effects, command, expected):
    plant = vehicle(effects={f"propeller.{name}": value for name, value in effects.items()})
    found = position(plant, driven(plant, (0, 0, 0, command), 1), "propeller_rpm")
    assert found == pytest.approx([expected], rel=1e-14)


@pytest.mark.parametrize("index, fin", list(enumerate(FINS)))
def test_a_fin_stops_at_its_limit(index, fin):
    plant = vehicle({f"{fin}.limit": 0.2 + 0.1 * index}, {f"{fin}.offset": 0.05, f"{fin}.lost_travel": 0.03})
    for command, expected in ((0.1, 0.15), (0.9, 0.17 + 0.1 * index), (-0.9, -0.17 - 0.1 * index)):
        u = np.zeros(4)
        u[index] = command
        assert position(plant, driven(plant, u, 1), f"{fin}_rad") == pytest.approx([expected], rel=1e-14)


@pytest.mark.parametrize("dead_time", [0.25, 0.35])
def test_a_dead_time_delays_the_propeller(dead_time):
    plant = vehicle(effects={"propeller.dead_time": dead_time})
    found = position(plant, driven(plant, (0, 0, 0, 1000.0), 6), "propeller_rpm")
    assert np.array_equal(found, [0.0, 0.0, 1000.0 if dead_time == 0.25 else 0.0, 1000.0, 1000.0, 1000.0])


# Sensors


def read(effects: dict[str, float], x: np.ndarray | None = None) -> dict[str, float]:
    plant = vehicle(effects=effects)
    y = plant.output(state(plant) if x is None else x)
    return dict(zip(plant.outputs, y, strict=True))


def turned(a: float, b: float, angle: float) -> tuple[float, float]:
    return math.cos(angle) * a + math.sin(angle) * b, math.cos(angle) * b - math.sin(angle) * a


def test_neutral_sensors_read_the_state():
    found = read({})
    names = ("u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps", "north_m", "east_m", "depth_m")
    assert [found[name] for name in names] == [*MOTION, 1.0, 2.0, 12.0]
    assert [found[name] for name in ("roll_rad", "pitch_rad", "heading_rad")] == list(ATTITUDE)
    assert [found[name] for name in ("u_dvl_mps", "v_dvl_mps", "w_dvl_mps")] == list(MOTION[:3])


U, V, W, P, Q, R = MOTION
GROUND = MOTION[:3] + body_axes(0.4, -0.2, 0.1)
ALONG, ABEAM = turned(U, V, 0.1)
CURRENT = {"current.north": 0.4, "current.east": -0.2, "current.down": 0.1}
READINGS = {
    "depth": ({"depth.bias": 0.5, "depth.scale": 0.02}, {"depth_m": 12.0 * 1.02 + 0.5}),
    "inclinometer": (
        {"inclinometer.roll_bias": 0.01, "inclinometer.pitch_bias": -0.02},
        {"roll_rad": 0.21, "pitch_rad": -0.32},
    ),
    "compass": (
        {"compass.bias": 0.1, "compass.deviation_sin": 0.05, "compass.deviation_cos": -0.02},
        {"heading_rad": 0.9 + 0.05 * math.sin(0.8) - 0.02 * math.cos(0.8)},
    ),
    "gyro bias and scale": (
        {"gyros.bias_p": 0.01, "gyros.bias_q": 0.02, "gyros.bias_r": 0.03, "gyros.scale": 0.1},
        {"p_radps": 1.1 * P + 0.01, "q_radps": 1.1 * Q + 0.02, "r_radps": 1.1 * R + 0.03},
    ),
    "gyros turned": (
        {"gyros.misalignment": 0.1},
        dict(zip(("p_radps", "q_radps"), turned(P, Q, 0.1))),
    ),
    "log through the water": (
        {
            "dvl_water.misalignment": 0.1,
            "dvl_water.scale": 0.05,
            "dvl_water.bias_u": 0.01,
            "dvl_water.bias_v": 0.02,
            "dvl_water.bias_w": 0.03,
        },
        {"u_mps": 1.05 * ALONG + 0.01, "v_mps": 1.05 * ABEAM + 0.02, "w_mps": 1.05 * W + 0.03},
    ),
    "log over ground in a current": (
        {**CURRENT, "dvl_ground.scale": -0.05, "dvl_ground.bias_v": 0.02, "dvl_ground.bias_w": 0.03},
        {"u_dvl_mps": 0.95 * GROUND[0], "v_dvl_mps": 0.95 * GROUND[1] + 0.02, "w_dvl_mps": 0.95 * GROUND[2] + 0.03},
    ),
    "log over ground, turned": (
        {**CURRENT, "dvl_ground.misalignment": -0.2, "dvl_ground.bias_u": 0.01},
        {
            "u_dvl_mps": turned(*GROUND[:2], -0.2)[0] + 0.01,
            "v_dvl_mps": turned(*GROUND[:2], -0.2)[1],
            "w_dvl_mps": GROUND[2],
        },
    ),
    "log over ground in a shear": (
        {"current.shear_east": 0.02, "current.reference_depth": 2.0},
        dict(zip(("u_dvl_mps", "v_dvl_mps", "w_dvl_mps"), MOTION[:3] + body_axes(0.0, 0.2, 0.0))),
    ),
}


@pytest.mark.parametrize("effects, changed", READINGS.values(), ids=READINGS)
def test_the_reading_of_a_sensor_with_errors(effects, changed):
    assert read(effects) == pytest.approx({**read({}), **changed}, abs=1e-14)


LAGS = {
    "depth": ("depth.lag", "depth_m"),
    "gyros": ("gyros.lag", "r_radps"),
    "log through the water": ("dvl_water.lag", "u_mps"),
    "log over ground": ("dvl_ground.lag", "u_dvl_mps"),
    "compass": ("compass.lag", "heading_rad"),
}


@pytest.mark.parametrize("path, channel", LAGS.values(), ids=LAGS)
def test_a_sensor_with_lag_is_a_first_order_filter_of_the_signal(path, channel):
    lag, dt, samples = 0.7, 0.02, 250
    plain = vehicle(effects={"current.north": 0.3, "current.shear_east": 0.01})
    plain = Plant("vehicle", FAMILY, plain.parameters, dt=dt, longest_step=dt)
    lagging = replace_at(plain, f"effects.{path}", lag)

    def signal(plant):
        x, y = state(plant), []
        for _ in range(samples):
            y.append(plant.output(x)[plant.outputs.index(channel)])
            x = plant.step(x, np.array([0.1, -0.05, 0.0, 1000.0]))
        return np.array(y)

    true, filtered = signal(plain), [signal(plain)[0]]
    for before, after in pairwise(true):
        slope = (after - before) / dt
        filtered.append(after - slope * lag + (filtered[-1] - before + slope * lag) * math.exp(-dt / lag))
    found = signal(lagging)
    assert np.abs(found - true).max() > 1e-3
    # ramps between samples, in both
    assert found == pytest.approx(np.array(filtered), abs=1e-9)


def test_at_first_a_lagging_depth_sensor_has_been_diving_all_along():
    plant = vehicle(effects={"depth.lag": 2.0, "current.down": 0.1})
    y = np.zeros(len(plant.outputs))
    for name, value in (("u_mps", 1.5), ("pitch_rad", -0.2), ("depth_m", 10.0)):
        y[plant.outputs.index(name)] = value
    x = plant.initial(y)
    assert plant.output(x)[plant.outputs.index("depth_m")] == pytest.approx(10.0, abs=1e-12)
    assert x[plant.states.index("depth_m")] == pytest.approx(10.0 + 2.0 * (1.5 * math.sin(0.2) + 0.1), rel=1e-12)
