"""Seawing's steady glides and spirals, against the published equations solved apart by root finding."""

import numpy as np
import pytest
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from auv_gym.envs.task_env import TaskEnv
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.cruise import find_cruise
from auv_gym.plant.record_check import needs_of
from controllers.autopilots import autopilot


def skew(r) -> np.ndarray:
    x, y, z = r
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def steady(volume: float, way: float, angle: float, guess: np.ndarray) -> np.ndarray:
    """[u v w p q r roll pitch] of a steady glide or spiral, from the numbers of Zhang et al. 2013, tables 1 and 3.

    Kirchhoff's equations with all derivatives zero: P x omega + F = 0, Pi x omega + P x v + T = 0.  volume: m^3 over
    neutral.  way: m, of the block from 0.4016 m.  angle: rad, of the block.
    """
    density, gravity = 1025.0, 9.81
    turned = Rotation.from_rotvec([angle, 0.0, 0.0])
    blocks = [
        (54.28, np.array([-0.0814, 0.0, 0.0032]), np.diag([0.60, 15.27, 15.32])),
        (
            11.0,
            np.array([0.4016 + way, 0.0, 0.0]) + turned.apply([0.0, 0.0, 0.014]),
            turned.as_matrix() @ np.diag([0.02, 10.16, 0.17]) @ turned.as_matrix().T,
        ),
    ]
    mass = np.diag([1.48, 49.58, 65.92, 0.53, 7.88, 10.18])
    mass[1, 5] = mass[5, 1] = -2.57
    mass[2, 4] = mass[4, 2] = -3.61
    for m, r, inertia in blocks:
        s = skew(r)
        mass += np.block([[m * np.eye(3), -m * s], [m * s, inertia - m * s @ s]])

    def residual(unknown: np.ndarray) -> np.ndarray:
        u, v, w, roll, pitch, turn = unknown
        to_body = Rotation.from_euler("ZYX", [0.0, pitch, roll]).inv()
        down = to_body.apply([0.0, 0.0, 1.0])
        velocity, omega = np.array([u, v, w]), turn * down
        momentum = mass @ np.concatenate([velocity, omega])
        linear, angular = momentum[:3], momentum[3:]
        speed = np.linalg.norm(velocity)
        alpha, beta = np.arctan2(w, u), np.arcsin(v / speed)
        p, q, r = omega
        drag, side = 7.19 + 386.29 * alpha**2, -115.65 * beta
        lift = -0.36 + 440.99 * alpha
        moment = np.array([-58.27 * beta - 19.83 * p, -0.28 - 65.84 * alpha - 205.64 * q, -34.10 * beta - 389.30 * r])
        # flow axes: turned by -alpha about y, then by beta about z
        from_flow = Rotation.from_euler("y", -alpha) * Rotation.from_euler("z", beta)
        force = from_flow.apply(speed**2 * np.array([-drag, side, -lift]))
        force = force + gravity * (sum(m for m, *_ in blocks) - 65.28 - density * volume) * down
        torque = from_flow.apply(speed**2 * moment) + sum(np.cross(r, m * gravity * down) for m, r, _ in blocks)
        return np.concatenate(
            [np.cross(linear, omega) + force, np.cross(angular, omega) + np.cross(linear, velocity) + torque]
        )

    found = root(residual, guess[[0, 1, 2, 6, 7, 5]], tol=1e-13)
    assert np.abs(found.fun).max() < 1e-9
    u, v, w, roll, pitch, turn = found.x
    omega = turn * Rotation.from_euler("ZYX", [0.0, pitch, roll]).inv().apply([0.0, 0.0, 1.0])
    return np.array([u, v, w, *omega, roll, pitch])


def settled(plant: Plant, commands: np.ndarray, samples: int) -> np.ndarray:
    """[u v w p q r roll pitch] after a long time, from a slow level start."""
    x = plant.initial(np.zeros(len(plant.outputs)))
    x[0], x[8] = 0.3, 50.0
    for _ in range(samples):
        x = plant.step(x, commands)
    return x[[0, 1, 2, 3, 4, 5, 9, 10]]


@pytest.mark.parametrize(
    "volume, way, angle",
    [
        (-0.0004878, 0.03, 0.0),  # down
        (0.0004878, -0.03, 0.0),  # up
        (-0.0003, 0.01, 0.0),
        (-0.0004878, 0.03, np.radians(40.0)),  # spirals
        (-0.0004878, 0.03, np.radians(-40.0)),
        (0.0004, -0.02, np.radians(60.0)),
    ],
)
def test_it_settles_in_the_steady_motion_of_the_published_equations(volume, way, angle):
    plant = load_vehicle("seawing")
    found = settled(plant, np.array([volume, way, angle]), 1500)
    expected = steady(volume, way, angle, found)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    if angle:
        assert abs(found[5]) > 1e-3  # rad/s: it does turn
    else:
        assert np.sign(found[7]) == -np.sign(way)  # the bow goes where the block goes


def test_the_spiral_is_mirrored_with_the_block():
    plant = load_vehicle("seawing")
    left, right = (settled(plant, np.array([-0.0004878, 0.03, side]), 800) for side in (-0.7, 0.7))
    np.testing.assert_allclose(left, right * [1, -1, 1, -1, 1, -1, -1, 1], atol=1e-12)


def test_ten_steady_glides_lie_on_the_published_polar():
    """Drag and lift of Zhang et al. 2013, table 3, balance the net weight along and across the path."""
    plant, speeds = load_vehicle("seawing"), []
    for volume in (-0.0004878, -0.0003, -0.00015, 0.0003, 0.0004878):
        for way in (0.02, 0.035):
            u, v, w, *rates, _, pitch = settled(plant, np.array([volume, -np.sign(volume) * way, 0.0]), 1500)
            np.testing.assert_allclose([v, *rates], 0.0, atol=1e-9)
            attack, square = np.arctan2(w, u), u**2 + w**2
            path, weight = pitch - attack, -9.81 * 1025.0 * volume
            assert (7.19 + 386.29 * attack**2) * square == pytest.approx(-weight * np.sin(path), rel=1e-6)
            assert (-0.36 + 440.99 * attack) * square == pytest.approx(weight * np.cos(path), rel=1e-6)
            speeds.append(np.sqrt(square))
    assert 0.2 < min(speeds) < max(speeds) < 0.8  # m/s


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda plant: TaskEnv("Depth", plant), "take an environment for a glider in six degrees of freedom"),
        (lambda plant: autopilot(plant, "gpc"), "no predictive control of vehicles like 'seawing': take kind 'pid'"),
        (lambda plant: autopilot(plant, "s_plane"), "S-plane control is there for"),
        (find_cruise, "needs a part that steers in yaw, which 'seawing' has not"),
    ],
)
def test_what_needs_fins_or_thrusters_refuses_it_in_words(make, words):
    with pytest.raises(ValueError, match=words):
        make(load_vehicle("seawing"))


def test_only_a_log_of_its_own_commands_is_one_of_it():
    assert needs_of(load_vehicle("seawing")).required == ("heading_rad", "ballast_m3", "battery_m", "battery_rad")
