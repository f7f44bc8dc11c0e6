"""The wrench of thrusters, the thrusts for a wrench, and the commands for thrusts."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.thrusters import AXES, allocation, find_thrusters, served_axes, wrench_matrix

ROVS = ("bluerov", "bluerov2", "bluerov2_heavy")
every = pytest.mark.parametrize("name", ROVS)


@pytest.mark.slow
def test_the_first_bluerov_turns_by_its_arms_as_its_thesis_has_them():
    """K = 0.11 f1 - 0.11 f2 + 0.11 f6, M = 0.19 f1 + 0.19 f2 - 0.17 f5, N = 0.11 f3 - 0.11 f4; up, ahead and to port.

    Source: MrEkelund/ExjobbROV, parameterEstimation.tex.
    """
    wanted = [
        [0.0, 0.0, 1.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0, -1.0],
        [-1.0, -1.0, 0.0, 0.0, -1.0, 0.0],
        [0.11, -0.11, 0.0, 0.0, 0.0, 0.11],
        [0.19, 0.19, 0.0, 0.0, -0.17, 0.0],
        [0.0, 0.0, 0.11, -0.11, 0.0, 0.0],
    ]
    np.testing.assert_allclose(wrench_matrix(load_vehicle("bluerov")), wanted, rtol=0.0, atol=1e-16)


def test_the_heavy_bluerov2_turns_by_the_arms_of_its_paper():
    """The yaw arm is 0.189 m, as printed.  Source: von Benzon et al. 2022."""
    wrench = wrench_matrix(load_vehicle("bluerov2_heavy"))
    yaw = np.sqrt(0.5) * (0.156 + 0.111)
    np.testing.assert_allclose(wrench[5], [-yaw, yaw, yaw, -yaw, 0.0, 0.0, 0.0, 0.0], atol=1e-15)
    assert yaw == pytest.approx(0.189, abs=5e-4)
    np.testing.assert_allclose(wrench[3, 4:], [-0.218, 0.218, -0.218, 0.218], rtol=1e-15)
    np.testing.assert_allclose(wrench[4, 4:], [0.120, 0.120, -0.120, -0.120], rtol=1e-15)


def test_what_thrusters_make_is_what_they_were_built_to_make():
    """Controllers and experiments know nothing of effects: the same signals move a vehicle with and without them."""
    plant = load_vehicle("bluerov2_heavy")
    moved = replace_at(plant, {"effects.t2.shift_z": 0.05, "effects.t5.turn_x": 0.2})
    np.testing.assert_array_equal(wrench_matrix(moved), wrench_matrix(plant))


@pytest.mark.parametrize("name, missing", [("bluerov", set()), ("bluerov2", {"pitch"}), ("bluerov2_heavy", set())])
def test_thrusts_for_a_wrench_make_that_wrench(name, missing):
    wrench = wrench_matrix(load_vehicle(name))
    axes = served_axes(wrench)
    assert set(AXES) - set(axes) == missing
    rows = [AXES.index(axis) for axis in axes]
    made = wrench @ allocation(wrench)
    np.testing.assert_allclose(made[rows], np.eye(len(axes)), atol=1e-12)
    others = [i for i in range(6) if i not in rows]
    np.testing.assert_allclose(made[others], 0.0, atol=1e-12)


def test_of_axes_that_thrusters_serve_only_together_the_earlier_ones_count():
    ahead = np.array([[1.0, 0.0, 0.0, 0.0, 0.1, 0.3], [1.0, 0.0, 0.0, 0.0, 0.1, -0.3]]).T
    assert served_axes(ahead) == ("surge", "yaw")
    assert served_axes(ahead[:, :1]) == ("surge",)


@cache
def thrusters_of(name):
    return find_thrusters(load_vehicle(name))


@every
@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_a_command_for_a_thrust_gives_that_thrust(name, data):
    thrusters = thrusters_of(name)
    shares = data.draw(st.lists(st.floats(0.0, 1.0), min_size=thrusters.at.size, max_size=thrusters.at.size))
    thrusts = thrusters.least + np.array(shares) * (thrusters.most - thrusters.least)
    np.testing.assert_allclose(thrusters.thrusts(thrusters.commands(thrusts)), thrusts, rtol=0.0, atol=1e-12)


@every
def test_the_plant_accelerates_by_the_wrench_of_the_thrusts(name):
    """The change of velocity in a microsecond, from rest, times the mass, less that without thrust."""
    plant = replace_at(load_vehicle(name), {"hull.buoyancy": 0.0, "hull.z_b": 0.0})
    thrusters = find_thrusters(plant)
    mass = plant.family.view(plant.derived).computed.mass
    rng = np.random.default_rng(3)
    thrusts = rng.uniform(0.8 * thrusters.least, 0.8 * thrusters.most)
    moved = []
    for pushes in (thrusts, 0.0 * thrusts):
        commands = np.array([plant.constants.get(name, 0.0) for name in plant.inputs])
        commands[thrusters.at] = thrusters.commands(pushes)
        start = settled = plant.initial(np.array([20.0 if n == "depth_m" else 0.0 for n in plant.outputs]))
        for _ in range(100):  # until the actuators have settled
            settled = plant.step(settled, commands)
        start[len(plant.family.states) :] = settled[len(plant.family.states) :]
        moved.append((plant.step_over(start, commands, 1e-6) - start)[:6] / 1e-6)
    np.testing.assert_allclose(mass @ (moved[0] - moved[1]), thrusters.wrench @ thrusts, rtol=1e-4, atol=1e-3)


@pytest.mark.slow
def test_a_weaker_supply_takes_more_of_the_command():
    plant = load_vehicle("bluerov2")
    full, weak = find_thrusters(plant), find_thrusters(replace_at(plant, {"parts.t2.voltage": 20.0}))
    assert weak.most[1] == pytest.approx(full.most[1] * (16.0 / 20.0) ** 1.2, rel=1e-12)
    assert weak.most[0] == full.most[0]
    assert weak.commands(np.full(6, 10.0))[1] > full.commands(np.full(6, 10.0))[1]


def test_a_command_inside_a_dead_zone_gives_none_and_what_it_cannot_give_is_its_edge():
    plant = replace_at(load_vehicle("bluerov2_heavy"), {f"parts.t{k}.dead_zone": 0.12 for k in range(1, 9)})
    thrusters = find_thrusters(plant)
    assert (thrusters.thrusts(np.full(8, 0.12)) == 0.0).all()
    assert (thrusters.thrusts(np.full(8, 0.13)) > 1.2).all()
    np.testing.assert_allclose(thrusters.commands(np.full(8, 0.3)), 0.12)
    np.testing.assert_allclose(thrusters.commands(np.full(8, -0.3)), -0.12)
    assert (thrusters.commands(np.zeros(8)) == 0.0).all()
    np.testing.assert_allclose(thrusters.thrusts(thrusters.commands(np.full(8, 5.0))), 5.0, atol=1e-12)


@pytest.mark.slow
def test_a_lower_limit_ends_the_curve():
    thrusters = find_thrusters(replace_at(load_vehicle("bluerov"), {"parts.t3.limit": 0.42}))
    assert thrusters.most[2] == pytest.approx(np.interp(0.42, [0.4, 0.45], [13.7, 16.5]))
    assert thrusters.commands(np.full(6, 30.0))[2] == pytest.approx(1500.0 + 400.0 * 0.42)


@pytest.mark.slow
def test_thrusts_are_scaled_down_in_proportion():
    thrusters = find_thrusters(load_vehicle("bluerov2"))
    pushes = np.array([100.0, -20.0, 0.0, 0.0, 0.0, 0.0])
    assert thrusters.share_within(pushes) == pytest.approx(0.5)
    assert thrusters.share_within(pushes, np.array([10.0, -30.1, 0.0, 0.0, 0.0, 0.0])) == pytest.approx(0.4)
    assert thrusters.share_within(0.1 * pushes) == 1.0


def test_a_vehicle_without_thrusters_is_refused():
    with pytest.raises(ValueError, match="An allocation needs thrusters, which 'remus100' has not"):
        find_thrusters(load_vehicle("remus100"))
    with pytest.raises(ValueError, match="needs thrusters"):
        find_thrusters(load_vehicle("slocum"))


@pytest.mark.parametrize(
    "given, came", [([np.nan] * 8, "nan"), ([0.0] * 9, r"shape \(9,\)"), ([[0.0] * 8], r"shape \(1, 8\)")]
)
@pytest.mark.parametrize("method", ["commands", "thrusts"])
def test_thrusters_take_one_finite_number_each(method, given, came):
    thrusters = find_thrusters(load_vehicle("bluerov2_heavy"))
    with pytest.raises(ValueError, match=f"Thrusters need 8 finite .*, one for each of .*; got .*{came}"):
        getattr(thrusters, method)(given)
