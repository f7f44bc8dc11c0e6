"""Presets that thrusters move, against Newton and Euler in a few lines, and against what their sources say."""

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.vehicles.body.parts.thruster import COMMANDS, CURVES, SOURCES, read_curve

ROVS = ("bluerov", "bluerov2", "bluerov2_heavy")
TERMS = (("surge", "u"), ("sway", "v"), ("heave", "w"), ("roll", "p"), ("pitch", "q"), ("yaw", "r"))


def cross(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def turned(roll, pitch, heading):
    """Body to north, east, down."""
    (cr, cp, ch), (sr, sp, sh) = np.cos([roll, pitch, heading]), np.sin([roll, pitch, heading])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[ch, -sh, 0], [sh, ch, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


class NewtonEuler:
    """M v' + C(v) v + D(v) v = thrusts + weight + buoyancy, with C by Fossen 2021, eq. (3.46), from the whole of M."""

    def __init__(self, plant):
        hull, added = plant.hull, plant.hull.added_mass
        self.hull, self.plant = hull, plant
        g = cross([hull.x_g, hull.y_g, hull.z_g])
        inertia = np.diag([hull.i_xx, hull.i_yy, hull.i_zz])
        rigid = np.block([[hull.mass * np.eye(3), -hull.mass * g], [hull.mass * g, inertia]])
        gained = -np.diag([added.x_udot, added.y_vdot, added.z_wdot, added.k_pdot, added.m_qdot, added.n_rdot])
        self.mass, self.momentum = rigid + gained, rigid + hull.coriolis_of_added_mass * gained
        self.linear = -np.array([getattr(getattr(hull, axis), v) for axis, v in TERMS])
        self.quadratic = -np.array([getattr(getattr(hull, axis), f"{v}_{v}") for axis, v in TERMS])

    def thrust(self, commands):
        total = np.zeros(6)
        for command, part in zip(commands, self.plant.family.body.parts):
            own = getattr(self.plant.parts, part.name)
            share = (command - 1500.0) / 400.0 if part.choice == "pulse" else command
            pushes = [getattr(own.curve, name) for name in vars(own.curve)]
            along = np.array([own.to_x, own.to_y, own.to_z])
            force = np.interp(share, COMMANDS, pushes) * along / np.linalg.norm(along)
            total += np.concatenate([force, np.cross([own.x, own.y, own.z], force)])
        return total

    def slope(self, state, thrust):
        v, attitude = state[:6], turned(*state[9:12])
        m = self.momentum
        linear, angular = m[:3, :3] @ v[:3] + m[:3, 3:] @ v[3:], m[3:, :3] @ v[:3] + m[3:, 3:] @ v[3:]
        coriolis = np.block([[np.zeros((3, 3)), -cross(linear)], [-cross(linear), -cross(angular)]])
        down = attitude.T @ [0.0, 0.0, 1.0]
        weight, buoyancy = self.hull.mass * self.hull.gravity * down, -self.hull.buoyancy * down
        centre_g = [self.hull.x_g, self.hull.y_g, self.hull.z_g]
        moment = np.cross(centre_g, weight) + np.cross([self.hull.x_b, self.hull.y_b, self.hull.z_b], buoyancy)
        force = thrust + np.concatenate([weight + buoyancy, moment])
        force -= coriolis @ v + (self.linear + self.quadratic * np.abs(v)) * v
        sr, cr, tp, cp = np.sin(state[9]), np.cos(state[9]), np.tan(state[10]), np.cos(state[10])
        rates = np.array([[1, sr * tp, cr * tp], [0, cr, -sr], [0, sr / cp, cr / cp]]) @ v[3:]
        return np.concatenate([np.linalg.solve(self.mass, force), attitude @ v[:3], rates])

    def run(self, state, commands, step, count):
        thrust = self.thrust(commands)
        for _ in range(count):
            a = self.slope(state, thrust)
            b = self.slope(state + 0.5 * step * a, thrust)
            c = self.slope(state + 0.5 * step * b, thrust)
            d = self.slope(state + step * c, thrust)
            state = state + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        return state


@pytest.mark.parametrize("name", ROVS)
@pytest.mark.parametrize("seed", range(3))
def test_a_step_of_its_commands_moves_it_as_newton_and_euler_say(name, seed):
    plant = load_vehicle(name, dt=0.01)
    parts = [part.name for part in plant.family.body.parts]
    plant = replace_at(plant, {f"parts.{part}.lag": 0.0 for part in parts})
    shares = np.random.default_rng(seed).uniform(-0.5, 0.5, len(parts))
    commands = 1500.0 + 400.0 * shares if name == "bluerov" else shares
    start = np.zeros(13)
    start[[6, 7, 8, 11]] = 1.0, -2.0, 50.0, 0.4
    inputs = np.append(commands, [16.0, 0.0])
    x = plant.settled(start, inputs)
    for _ in range(150):
        x = plant.step(x, inputs)
    wanted = NewtonEuler(plant).run(start[:12], commands, 0.0025, 600)
    assert np.abs(wanted[:6]).max() > 0.3
    # two integrations of fourth order over 1.5 s: the vehicle's by 10 ms, the other's by 2.5 ms
    np.testing.assert_allclose(x[:12], wanted, rtol=0.0, atol=2e-6)


def test_the_heavy_bluerov2_weighs_more_than_it_displaces_by_what_is_printed():
    hull = load_vehicle("bluerov2_heavy").hull
    assert hull.mass * hull.gravity - hull.buoyancy == pytest.approx(0.98, abs=5e-3)
    assert hull.buoyancy == pytest.approx(1000.0 * 0.0134 * hull.gravity)


def test_the_curve_of_von_benzon_is_the_printed_polynomial_and_never_falls():
    curve = np.array(CURVES["t200_von_benzon"])
    v = curve[1:-1, 0]
    printed = -140.3 * v**9 + 389.9 * v**7 - 404.1 * v**5 + 176.0 * v**3 + 8.9 * v
    np.testing.assert_allclose(curve[1:-1, 1], printed, atol=1e-12)
    assert (np.diff(curve[:, 1]) >= 0.0).all()
    assert abs(curve[-1, 1] - (-140.3 + 389.9 - 404.1 + 176.0 + 8.9)) < 0.13
    fine = np.linspace(-0.95, 0.95, 2001)
    between = np.interp(fine, curve[:, 0], curve[:, 1])
    assert np.abs(between - np.polyval([-140.3, 0, 389.9, 0, -404.1, 0, 176.0, 0, 8.9, 0], fine)).max() < 0.15


def test_the_measured_curve_has_a_dead_zone_and_the_thrusts_of_its_source():
    curve = dict(CURVES["t200"])
    assert curve[0.05] == curve[0.0] == curve[-0.05] == 0.0
    assert (curve[1.0], curve[-1.0], curve[-0.5], curve[-0.35], curve[0.9]) == (50.0, -40.1, -16.1, -8.9, 42.9)
    assert len(read_curve("t200")) == len(COMMANDS) == len(curve)
    assert SOURCES.keys() == CURVES.keys()


def test_guesses_are_free_in_a_diagnosis_and_arms_as_well():
    plant = load_vehicle("bluerov")
    assert {f"hull.{axis}.{term}" for axis, v in TERMS for term in (v, f"{v}_{v}")} <= set(plant.coefficients)
    assert plant.deviations["parts.t1.y"] == plant.deviations["parts.t6.z"] == 0.01
    assert plant.deviations["hull.roll.p"] >= abs(plant.hull.roll.p)
    assert plant.family.leading == "heading_rad"
