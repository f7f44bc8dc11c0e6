"""Models in the vehicle's place in its environment."""

from dataclasses import replace

import gymnasium
import pytest

import auv_gym  # noqa: F401  # registers the environments
from auv_gym.models.linear import Polynomial
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from controllers.pid import heading_pid
from identification.compare.closed_loop import compare_closed, stand_in


def make_env(model=None):
    return gymnasium.make("auv_gym/GliderHeading-v0", vehicle="slocum", duration=200.0, model=model)


def test_models_in_the_vehicle_s_place_under_the_same_controller():
    plant = make_env().unwrapped.plant
    slow = replace_at(plant, "hull.n_delta", 0.6 * plant.hull.n_delta)
    late = replace(plant, dt=2.0 * plant.dt)
    wanted = {"heading_rad": [(0.0, 0.0), (40.0, 1.0)]}
    found = compare_closed(
        make_env,
        heading_pid(plant),
        {"same": plant, "slow": slow, "late": late},
        seed=4,
        targets=wanted,
        start={"heading_rad": 0.0},
    )
    assert found.scales["heading_rad"] == pytest.approx(1.0, abs=0.1)  # the step, from where the compass began
    assert found.deviations["same"]["heading_rad"].rmse == 0.0
    slower = found.deviations["slow"]["heading_rad"]
    assert 1.0 < slower.percent < 50.0
    assert slower.rmse == pytest.approx(slower.percent / 100.0 * found.scales["heading_rad"])
    time, difference = found.difference("slow", "heading_rad")
    assert time.size == difference.size == len(found.vehicle.record)
    assert "dt=" in found.failed["late"]


def test_an_environment_that_ignores_its_model_is_refused():
    plant = make_env().unwrapped.plant
    slow = replace_at(plant, "hull.n_delta", 0.6 * plant.hull.n_delta)
    with pytest.raises(ValueError, match="make_env needs to put the model that it is given into the environment"):
        compare_closed(lambda model: make_env(), heading_pid(plant), {"slow": slow}, seed=4)


def test_a_model_of_some_channels_is_spliced_into_the_vehicle():
    plant = load_vehicle("npsauv", dt=1.0)
    pitch = Polynomial.from_coefficients(
        a={"pitch_rad": [-1.5, 0.7]}, b={"pitch_rad": {"stern_plane_rad": [-0.1]}}, dt=1.0
    )
    stood_in = stand_in(plant, pitch)
    assert stood_in.outputs == plant.outputs
    assert stood_in.driven == ("pitch_rad",)
    assert stand_in(plant, plant) is plant
    everything = replace(plant, name="other")
    assert stand_in(plant, everything) is everything
