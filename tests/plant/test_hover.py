"""A vehicle with thrusters at rest: its trim, the speeds it can reach, and its linear form there."""

import numpy as np
import pytest
from scipy.linalg import logm

from auv_gym.models.linear import linearise
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.hover import find_hover

ROVS = ("bluerov", "bluerov2", "bluerov2_heavy")
every = pytest.mark.parametrize("name", ROVS)


@every
def test_the_trim_holds_it_to_rounding(name):
    plant = load_vehicle(name)
    hover = find_hover(plant)
    begun = hover.state.copy()
    begun[plant.family.states.index("depth_m")] = 20.0
    x = plant.settled(begun, hover.commands)
    for _ in range(2000):
        x = plant.step(x, hover.commands)
    # 100 s of rounding of forces near 100 N, on 10 kg
    np.testing.assert_allclose(x[: begun.size], begun, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize(
    "name, each", [("bluerov2_heavy", (13.5 * 9.82 - 0.0134 * 1000 * 9.82) / 4), ("bluerov2", 0.9925)]
)
def test_upright_thrusters_share_the_net_weight(name, each):
    hover = find_hover(load_vehicle(name))
    np.testing.assert_allclose(hover.thrusts[:4], 0.0, atol=0.0)
    np.testing.assert_allclose(hover.thrusts[4:], each, rtol=1e-9)


def test_a_centre_of_buoyancy_ahead_is_held_by_pitching_thrusts():
    plant = replace_at(load_vehicle("bluerov2_heavy"), "hull.x_b", 0.01)
    hover = find_hover(plant)
    lifted = plant.hull.buoyancy * 0.01
    assert 0.120 * (hover.thrusts[4:] @ [1.0, 1.0, -1.0, -1.0]) == pytest.approx(-lifted, rel=1e-9)


@every
def test_it_reaches_the_speeds_that_it_says(name):
    """At full thrust along an axis, from rest, alone on that axis."""
    plant = load_vehicle(name)
    hover = find_hover(plant)
    for k, axis in enumerate(hover.axes[:2]):
        commands = hover.commands.copy()
        commands[hover.thrusters.at] = hover.thrusters.commands(
            hover.thrusts + hover.largest[axis] * hover.allocation[:, k]
        )
        held = ["u_mps", "v_mps"][k]
        x = plant.settled(hover.state, commands)
        for _ in range(2000):
            x = plant.step(x, commands)
            kept = [i for i, state in enumerate(plant.family.states) if state != held]
            x[kept] = hover.state[kept]
        assert x[plant.family.states.index(held)] == pytest.approx(hover.speeds[axis], rel=1e-6)


@pytest.mark.parametrize(
    "name, change, words",
    [
        (
            "bluerov2",
            {"hull.x_b": 0.05},
            r"its thrusters leave 5.74 N m in pitch: .* or add a thruster that pushes there",
        ),
        ("bluerov2_heavy", {"hull.buoyancy": 0.0}, "t5_share would have to give 33.1 N, and gives -30.5 to 30.5 N"),
    ],
)
def test_a_vehicle_that_cannot_hold_itself_is_refused(name, change, words):
    with pytest.raises(ValueError, match=f"'{name}' cannot hold itself at rest and level: {words}"):
        find_hover(replace_at(load_vehicle(name), change))


def slowed(linear, quadratic, speed, time):
    """What is left of a speed after a time of v' = -linear v - quadratic v^2: Bernoulli's equation in closed form."""
    left = np.exp(-linear * time)
    gone = (1.0 - left) / linear if linear else time
    return speed * left / (1.0 + quadratic * speed * gone)


def test_its_linear_form_is_that_of_the_published_equations():
    """(m - X_udot) u' = X_u u + X_u|u| |u| u of the heavy BlueROV2, from a tenth of its speed; yaw likewise."""
    plant = load_vehicle("bluerov2_heavy")
    hover = find_hover(plant)
    model = linearise(replace_at(plant, {f"parts.t{k}.lag": 0.0 for k in range(1, 9)}))
    states = [name.removesuffix(" change") for name in model.states]
    slow, turning = 0.1 * hover.speeds["surge"], 0.1 * hover.speeds["yaw"]
    u, r = states.index("u_mps"), states.index("r_radps")
    mass, inertia = 13.5 + 6.36, 0.37 + 0.222
    assert model.a[u, u] == pytest.approx(slowed(13.7 / mass, 141.0 / mass, slow, plant.dt) / slow, rel=1e-6)
    assert model.a[r, r] == pytest.approx(slowed(0.0, 1.5 / inertia, turning, plant.dt) / turning, rel=1e-6)
    rates = (logm(model.a) / model.dt).real
    assert rates[states.index("heading_rad"), r] == pytest.approx(1.0, rel=1e-3)
    assert rates[states.index("north_m"), u] == pytest.approx(1.0, rel=1e-3)
    assert set(states) == set(plant.family.states[:12])


@pytest.mark.slow
def test_a_thruster_in_its_dead_zone_still_pushes_in_the_linear_form():
    model = linearise(load_vehicle("bluerov"))
    states = [name.removesuffix(" change") for name in model.states]
    for name, state, side in (("t3_us", "u_mps", 1), ("t6_us", "v_mps", -1), ("t1_us", "q_radps", 1)):
        assert side * model.b[states.index(state), model.inputs.index(name)] > 1e-5
