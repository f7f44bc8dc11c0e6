"""The hybrid LRAUV Tethys, which is a file only: it trims, glides, swims, and is flown, fitted and diagnosed."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.cruise import command_ranges
from identification.diagnosis import diagnose
from identification.experiments.missions import run_mission
from identification.fit.greybox import GreyBox
from tests.plain_python import run_plain

FILE = Path(__file__).parents[3] / "examples" / "vehicles" / "tethys.toml"
BIAS = 6e-5  # m^3
pytestmark = pytest.mark.slow  # no other test uses its programs


@pytest.fixture(scope="module")
def log():
    """A log of ten minutes under its autopilot, with a ballast bias that the believed vehicle does not have."""
    return run_mission(replace_at(load_vehicle(FILE), "effects.ballast.offset", BIAS), np.random.default_rng(20261122))


def test_its_battery_trims_the_pitch_at_rest():
    """The centre of gravity lies below the centre of buoyancy when nothing moves, so that tan(pitch) = -x/z of it."""
    plant = load_vehicle(FILE)
    x = plant.initial(np.zeros(len(plant.outputs)))
    x[8] = 30.0
    commands = np.array([0.0, 0.0, 0.0, 500e-6, 0.001])
    for _ in range(6000):
        x = plant.step(x, commands)
    hull, mass = plant.hull, 31.731
    ahead = hull.mass * hull.x_g + mass * (0.563 + 0.001)
    assert x[10] == pytest.approx(-np.arctan2(ahead, hull.mass * hull.z_g), abs=2e-3)


@pytest.mark.parametrize("down", [1.0, -1.0])
def test_it_glides_down_and_up_without_its_propeller(down):
    plant = load_vehicle(FILE)
    low, rest, high = command_ranges(plant)[3]
    commands = np.array([0.0, 0.0, 0.0, low if down > 0 else high, down * 0.03])
    x = plant.initial(np.zeros(len(plant.outputs)))
    x[8] = 200.0
    for _ in range(3000):
        x = plant.step(x, commands)
    assert low < rest < high
    assert down * (x[8] - 200.0) > 20.0  # it sinks or rises
    assert x[0] > 0.1  # and goes ahead
    assert down * x[10] < -0.1  # bow first


# What takes plain Python seconds, while its composition of parts would be compiled for a minute.
PLAIN = """
import json
import sys
import gymnasium
import numpy as np
from auv_gym.plant import load_vehicle
from auv_gym.plant.cruise import find_cruise
from tests.vehicles.body.coefficient_effects import acting

cruise = find_cruise(load_vehicle(sys.argv[1]))
told = {"speed": cruise.speed, "commands": cruise.commands.tolist(), "flown": [], "acting": acting(sys.argv[1])}
for task in ("Depth", "Heading"):
    env = gymnasium.make(f"auv_gym/{task}-v0", vehicle=sys.argv[1])
    first, _ = env.reset(seed=4)
    assert env.action_space.shape == (1,)
    for _ in range(60):
        observation, reward, terminated, _, info = env.step(np.zeros(1, np.float32))
        assert not terminated and np.isfinite(observation).all() and np.isfinite(reward), info
    vector = gymnasium.make_vec(f"auv_gym/{task}-v0", 3, vectorization_mode="vector_entry_point", vehicle=sys.argv[1])
    seen, _ = vector.reset(seed=4)
    assert np.array_equal(seen[0], first) and seen.shape == (3, *first.shape)
    told["flown"].append(task)
actions = ["stern_plane_rad", "ballast_m3", "battery_m"]
env = gymnasium.make("auv_gym/Depth-v0", vehicle=sys.argv[1], actions=actions)
env.reset(seed=0)
moved = [env.step(np.array(action, np.float32))[4] for action in ([0.0, 1.0, -1.0], [0.0, 0.0, 0.0])]
told["commanded"] = [{name: info["command"][name] for name in actions} for info in moved]
print(json.dumps(told))
"""


@pytest.fixture(scope="module")
def plain():
    """What the program above tells of it."""
    return json.loads(run_plain("-c", PLAIN, FILE))


def test_it_trims_at_the_speed_at_which_thrust_and_drag_balance(plain):
    n = 300.0 * np.pi / 30.0
    assert plain["speed"] == pytest.approx(np.sqrt(0.0068992 * n**2 / 6.228), rel=1e-4)
    assert plain["commands"][3:] == [500e-6, 0.0]  # ballast and battery rest


def test_the_environments_fly_it(plain):
    assert plain["flown"] == ["Depth", "Heading"]


def test_an_effect_that_is_reported_as_a_coefficient_does_what_the_coefficient_does(plain):
    assert plain["acting"] >= 4  # most of them act


def test_its_ballast_is_an_action_over_its_range(plain):
    most, middle = plain["commanded"]
    assert most["ballast_m3"] == pytest.approx(955e-6)
    assert most["battery_m"] == pytest.approx(-0.03)
    assert middle["ballast_m3"] == pytest.approx(0.5 * (80e-6 + 955e-6))
    assert middle["battery_m"] == 0.0


def test_the_grey_box_finds_its_coefficients_again():
    true = load_vehicle(FILE)
    record = run_mission(true, np.random.default_rng(8), duration=300.0)
    paths = ("parts.rudder.lift_slope", "parts.stern_plane.lift_slope", "hull.surge.u_u")
    off = replace_at(true, dict(zip(paths, (3.2, 5.0, -8.0), strict=True)))
    fit = GreyBox(off, free=paths, window=20.0).fit(record)
    for estimate, value in zip(fit.estimates, (4.13, 4.13, -6.228), strict=True):
        assert estimate.value == pytest.approx(value, rel=0.03), estimate
        low, high = estimate.ci95
        assert low - 0.5 * (high - low) < value < high + 0.5 * (high - low)


def test_an_undeclared_ballast_bias_is_found_in_its_log(log):
    found = diagnose(log, load_vehicle(FILE))
    assert found.verdict in ("named", "tied")
    (effect,) = found.effects
    assert "effects.ballast.offset" in (effect.path, *effect.tied_with)
    if effect.path == "effects.ballast.offset":
        assert effect.ci95[0] < BIAS < effect.ci95[1]
    for channel in ("pitch_rad", "depth_m"):
        assert found.after.scores[channel].rmse < 0.5 * found.before.scores[channel].rmse


def test_a_clean_log_of_it_needs_nothing():
    plant = load_vehicle(FILE)
    assert diagnose(run_mission(plant, np.random.default_rng(5)), plant).verdict in ("none", "coefficients")


def test_the_step_may_be_halved():
    """A minute with all five actuators moving, with half its step and with a quarter of it."""
    plant, rng = load_vehicle(FILE), np.random.default_rng(3)
    low, _, high = command_ranges(plant).T
    commands = low + (high - low) * rng.uniform(0.3, 0.7, (60, 5))
    ends = []
    for step in (0.05, 0.025):
        finer = replace(plant, longest_step=step)
        x = finer.initial(np.zeros(len(plant.outputs)))
        x[0], x[8] = 1.0, 50.0
        for command in commands:
            for _ in range(5):
                x = finer.step(x, command)
        ends.append(x[:12])
    np.testing.assert_allclose(*ends, atol=1e-5)
