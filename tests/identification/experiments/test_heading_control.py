from dataclasses import replace
from math import radians

import numpy as np
import pytest

from auv_gym.model import Diverged, simulate
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from controllers.pid import Pid
from identification.experiments.heading_control import closed_loop

VEHICLES = ["slocum", "ganeshblue", "ganeshblue_corrected"]


def record_of(plant, seed=0, **settings):
    return closed_loop(plant, rng=np.random.default_rng(seed), **{"run_in": 0.0, **settings})


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_the_record_is_what_was_asked_for(vehicle):
    plant = load_vehicle(vehicle)
    record = record_of(plant)
    limit, nominal = plant.hull.rudder_limit, plant.hull.speed
    assert record.duration_s == 600.0
    assert record.sample_interval == plant.dt
    assert set(record.names) == {
        *("heading_rad", "rudder_rad", "heading_cmd_rad", "u_mps", "roll_rad", "pitch_rad", "depth_m"),
        *("north_m", "east_m"),
    }
    assert np.abs(record["rudder_rad"]).max() == limit  # at its stop at times, never beyond
    assert np.abs(record["u_mps"] / nominal - 1.0).max() == pytest.approx(0.3)
    assert np.abs(record["roll_rad"]).max() < 0.13
    assert np.abs(record["pitch_rad"]).max() <= 0.4
    assert record["depth_m"].min() == 15.0
    assert np.abs(np.diff(record["heading_cmd_rad"])).max() > radians(19.0)


def test_it_says_nothing_of_its_effects():
    plant = replace_at(load_vehicle("slocum"), "effects.rudder.offset", 0.0637)
    attrs = record_of(plant).attrs
    assert attrs == {
        "source": "simulated",
        "vehicle": "slocum",
        "compass_noise_rad": radians(0.5),
        "track_noise_m": 1.0,
    }


def test_depth_follows_from_speed_and_pitch():
    record = record_of(load_vehicle("ganeshblue"))
    rate = np.gradient(record["depth_m"], record.time)
    expected = -record["u_mps"] * np.sin(record["pitch_rad"])
    assert np.abs(rate - expected).max() < 0.02  # a difference over 2 s of a turn that takes 8 s
    assert (record["pitch_rad"] < -0.3).any()
    assert (record["pitch_rad"] > 0.3).any()


@pytest.mark.parametrize("vehicle", ["slocum", "ganeshblue"])
def test_a_free_run_of_the_same_plant_repeats_it(vehicle):
    """The loop steps the plant; `simulate` rolls it out in one compiled call: the same numbers."""
    plant = load_vehicle(vehicle)
    record = record_of(plant, compass_noise=0.0, track_noise=0.0, gyro_noise=0.0)
    run = simulate(plant, record)
    for name in plant.outputs:
        np.testing.assert_allclose(run[name], record[name], rtol=0.0, atol=1e-12)


def test_noise_has_the_stated_size():
    plant = load_vehicle("ganeshblue")
    settings = {"duration": 3000.0, "gyro_noise": 0.01, "track_noise": 2.0}
    record = record_of(plant, compass_noise=radians(0.5), **settings)
    run = simulate(plant, record)
    # a free run from a noisy first sample: the constant of each error is not noise
    errors = {name: record[name] - run[name] for name in plant.outputs}
    assert np.std(errors["heading_rad"]) == pytest.approx(radians(0.5), rel=0.1)
    assert np.std(errors["r_radps"]) == pytest.approx(0.01, rel=0.1)
    assert np.std(np.diff(errors["north_m"])) == pytest.approx(2.0 * np.sqrt(2.0), rel=0.1)


def test_one_seed_is_one_experiment_whatever_the_effects():
    clean = load_vehicle("slocum")
    one, two = record_of(clean, 3), record_of(replace_at(clean, "effects.yaw.moment", 0.012), 3)
    again, other = record_of(clean, 3), record_of(clean, 4)
    for name in ("u_mps", "roll_rad", "pitch_rad", "heading_cmd_rad"):
        np.testing.assert_array_equal(one[name], two[name])
    assert (one["heading_rad"] != two["heading_rad"]).any()
    np.testing.assert_array_equal(one["heading_rad"], again["heading_rad"])
    assert (one["heading_rad"] != other["heading_rad"]).any()


def test_channels_that_were_not_asked_for_are_absent():
    record = record_of(load_vehicle("slocum"), track_noise=None, gyro_noise=0.001, speed=0.3)
    assert not record.has("north_m")
    assert record.has("r_radps")
    assert set(record["u_mps"]) == {0.3}


def test_the_controller_acts_on_the_noisy_compass():
    plant = load_vehicle("slocum")
    record = record_of(plant, controller=Pid(0.5, limit=1.0), rudder_excitation=0.0, speed=0.35)
    error = np.angle(np.exp(1j * (record["heading_cmd_rad"] - record["heading_rad"])))
    limit = plant.hull.rudder_limit
    np.testing.assert_allclose(record["rudder_rad"], np.clip(0.5 * error, -limit, limit), atol=1e-12)


def test_what_cannot_be_run_is_refused():
    plant = load_vehicle("slocum")
    with pytest.raises(ValueError, match=r"^duration must be at least one sample \(4 s\), got 2 s\.$"):
        record_of(plant, duration=2.0)
    for name, words in (
        ("duration", "above 0 in s"),
        ("bit_time", "above 0 in s"),
        ("rudder_excitation", "at least 0"),
    ):
        with pytest.raises(ValueError, match=f"{name} needs a number .*{words}, got 'x'"):
            record_of(plant, **{name: "x"})
    unstable = replace(replace_at(plant, {"hull.heading_stiffness": 1.0, "effects.yaw.moment": 1.0}), dt=10.0)
    with pytest.raises(Diverged, match="not finite at"):
        record_of(unstable, duration=50_000.0)


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"speed": 0.0}, "speed needs a number above 0"),
        ({"speed": 1e6}, "speed needs a number above 0 and of at most"),
        ({"compass_noise": -1.0}, "compass_noise needs a number of at least 0"),
        ({"gyro_noise": -1.0}, "gyro_noise needs a number of at least 0"),
        ({"run_in": -3.0}, "run_in needs a number of at least 0"),
        ({"rng": 7}, r"needs rng as a generator, got 7: give numpy.random.default_rng\(7\)"),
    ],
)
def test_impossible_settings_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        closed_loop(load_vehicle("slocum"), **{"rng": np.random.default_rng(0), **settings})


def test_the_run_in_is_cut_off():
    plant = load_vehicle("slocum")
    whole = record_of(plant, duration=640.0)
    cut = record_of(plant, duration=600.0, run_in=40.0)
    assert cut.time[0] == 0.0
    np.testing.assert_array_equal(cut["rudder_rad"], whole["rudder_rad"][10:])
    np.testing.assert_array_equal(cut["heading_rad"], whole["heading_rad"][10:])
