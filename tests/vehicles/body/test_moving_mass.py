"""A mass that moves in a body: momentum, the common centre of mass, energy, and the order of the integration."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auv_gym.param import list_paths, replace_at
from auv_gym.plant import Plant, load_vehicle

SLIDE, TURN = 0.037, 1.13  # m, rad: 7.4 s and 5.65 s on their way, so that they arrive inside a step
START = np.array([0.4, 0.1, -0.2, 0.3, -0.2, 0.25])  # m/s, rad/s


def in_vacuum() -> Plant:
    """A hull and a battery in free fall: no water, no buoyancy, and nothing that acts but weight."""
    given = load_vehicle("seawing")
    still = {
        p: 0.0 for p in list_paths(given) if p.startswith(("hull.added_mass.", "parts.wings.")) and "stall" not in p
    }
    return replace_at(given, {**still, "hull.buoyancy": 0.0, "parts.wings.stall": 1.0, "parts.battery.y": 0.05})


def battery(plant: Plant, way: float, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Its centre in the body, m, and its inertia about it, kg m^2."""
    b, turned = plant.parts.battery, Rotation.from_rotvec([angle, 0.0, 0.0])
    centre = np.array([b.x + way, b.y, b.z]) + turned.apply([0.0, 0.0, b.eccentricity])
    return centre, (turned.as_matrix() @ np.diag([b.i_xx, b.i_yy, b.i_zz]) @ turned.as_matrix().T)


def motion_of(plant: Plant, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Place of the common centre of mass, momentum, angular momentum about that centre, kinetic energy; all in space.

    Worked out for two rigid bodies, apart from the plant's own equations.
    """
    states = dict(zip(plant.states, x, strict=True))
    way, angle = states["battery_m position"], states["battery_rad position"]
    rate, spin = states["battery_m rate"], states["battery_rad rate"]
    turned = Rotation.from_euler("ZYX", [states["heading_rad"], states["pitch_rad"], states["roll_rad"]])
    v, omega, h = x[:3], x[3:6], plant.hull
    at = np.array([h.x_g, h.y_g, h.z_g])
    about_origin = np.diag([h.i_xx, h.i_yy, h.i_zz]) - np.array([[0, 0, h.i_xz], [0, 0, 0], [h.i_xz, 0, 0]])
    own = about_origin - h.mass * (at @ at * np.eye(3) - np.outer(at, at))
    centre, inertia = battery(plant, way, angle)
    lever = centre - np.array([plant.parts.battery.x + way, plant.parts.battery.y, plant.parts.battery.z])
    inside = np.array([rate, 0.0, 0.0]) + np.cross([spin, 0.0, 0.0], lever)
    bodies = [
        (h.mass, at, v + np.cross(omega, at), own, omega),
        (plant.parts.battery.mass, centre, v + np.cross(omega, centre) + inside, inertia, omega + [spin, 0.0, 0.0]),
    ]
    mass = sum(m for m, *_ in bodies)
    common = sum(m * r for m, r, *_ in bodies) / mass
    momentum = sum(m * w for m, _, w, *_ in bodies)
    angular = sum(m * np.cross(r - common, w) + i @ o for m, r, w, i, o in bodies)
    energy = 0.5 * sum(m * w @ w + o @ i @ o for m, _, w, i, o in bodies)
    return x[6:9] + turned.apply(common), turned.apply(momentum), turned.apply(angular), float(energy)


def fall(plant: Plant, samples: int, commands: list[tuple[float, float]]) -> np.ndarray:
    """States as the battery goes from command to command, each held for as many samples."""
    x = plant.initial(np.zeros(len(plant.outputs)))
    x[:6], x[8], x[9:12] = START, 100.0, (0.2, -0.3, 1.0)
    found = [x]
    for way, angle in commands:
        for _ in range(samples):
            found.append(plant.step(found[-1], np.array([0.0, way, angle])))
    return np.array(found)


COMMANDS = [(SLIDE, TURN), (-SLIDE, -TURN), (0.0, 0.0)]


def test_a_mass_moved_in_free_fall_leaves_momentum_and_the_common_centre_as_they_would_be():
    plant = replace(in_vacuum(), dt=1.0, longest_step=0.02)
    states = fall(plant, 18, COMMANDS)
    rates = states[:, list(plant.states).index("battery_m rate")]
    assert np.ptp(states[:, list(plant.states).index("battery_m position")]) == pytest.approx(2 * SLIDE)
    assert (rates.max() > 0.004, rates.min() < -0.004, rates[-1]) == (True, True, 0.0)  # forth, back, and at rest
    centres, momenta, angular, _ = (np.array(v) for v in zip(*(motion_of(plant, x) for x in states), strict=True))
    time, mass = np.arange(len(states))[:, None], plant.hull.mass + plant.parts.battery.mass
    falling = np.array([0.0, 0.0, plant.hull.gravity])
    np.testing.assert_allclose(momenta, momenta[0] + mass * falling * time, atol=1e-8 * mass * plant.hull.gravity * 54)
    np.testing.assert_allclose(
        centres, centres[0] + momenta[0] / mass * time + 0.5 * falling * time**2, atol=1e-8 * plant.hull.gravity * 54**2
    )
    np.testing.assert_allclose(angular, np.broadcast_to(angular[0], angular.shape), atol=2e-8)


def test_momentum_is_kept_to_the_fourth_order_of_the_step():
    errors = []
    for step in (0.5, 0.25, 0.125):
        plant = replace(in_vacuum(), dt=1.0, longest_step=step)
        states = fall(plant, 18, COMMANDS)
        errors.append(np.abs(motion_of(plant, states[-1])[2] - motion_of(plant, states[0])[2]).max())
    orders = [np.log2(coarse / fine) for coarse, fine in pairwise(errors)]
    assert all(3.8 < order < 5.3 for order in orders), (errors, orders)


def test_a_start_is_a_jump_of_momentum_that_adds_the_energy_of_the_relative_motion():
    """Of two masses in line, half their reduced mass times the square of the relative speed."""
    plant = replace(in_vacuum(), dt=1e-6, longest_step=1e-6)
    plant = replace_at(plant, {"parts.battery.y": 0.0, "parts.battery.eccentricity": 0.0, "hull.z_g": 0.0})
    x = plant.initial(np.zeros(len(plant.outputs)))
    x[0] = 0.5
    moving = plant.step(x, np.array([0.0, SLIDE, 0.0]))
    h, m = plant.hull.mass, plant.parts.battery.mass
    speed = 1.0 / plant.parts.battery.slowness
    assert moving[0] == pytest.approx(0.5 - m / (h + m) * speed, abs=1e-7)
    gained = motion_of(plant, moving)[3] - motion_of(plant, x)[3]
    assert gained == pytest.approx(0.5 * h * m / (h + m) * speed**2, rel=1e-2)


def test_a_mass_at_rest_in_a_turning_body_takes_no_power():
    """Energy of a free body is kept whatever place the battery has: its inertial forces do no work."""
    plant = replace(in_vacuum(), dt=0.5, longest_step=0.01)
    plant = replace_at(plant, {"effects.battery.slide.offset": 0.03, "effects.battery.turn.offset": 0.5})
    x = plant.initial(np.zeros(len(plant.outputs)))
    x[3:6] = 0.5, 0.3, -0.4
    u = np.zeros(3)
    for name, value in (("battery_m position", 0.03), ("battery_rad position", 0.5)):
        x[list(plant.states).index(name)] = value
    before = motion_of(plant, x)
    for _ in range(40):
        x = plant.step(x, u)
    _, momentum, angular, energy = motion_of(plant, x)
    mass, time = plant.hull.mass + plant.parts.battery.mass, 20.0
    falling = before[1] + mass * np.array([0.0, 0.0, plant.hull.gravity]) * time
    gained = (falling @ falling - before[1] @ before[1]) / (2.0 * mass)
    np.testing.assert_allclose(momentum, falling, atol=1e-9 * falling[2])
    np.testing.assert_allclose(angular, before[2], atol=1e-8)
    assert energy - before[3] == pytest.approx(gained, rel=1e-9)


def test_added_mass_shares_in_the_jump():
    """In water the vehicle gives way by less, since it takes the water along."""
    speeds = []
    for added in (0.0, -200.0):
        plant = replace(in_vacuum(), dt=1e-6, longest_step=1e-6)
        plant = replace_at(plant, {"hull.added_mass.x_udot": added, "parts.battery.y": 0.0})
        x = plant.initial(np.zeros(len(plant.outputs)))
        speeds.append(plant.step(x, np.array([0.0, SLIDE, 0.0]))[0])
    mass = plant.hull.mass + plant.parts.battery.mass
    assert speeds[0] / speeds[1] == pytest.approx((mass + 200.0) / mass, rel=0.02)
