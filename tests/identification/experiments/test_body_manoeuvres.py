"""Simulated manoeuvres of torpedoes: what they visit, what they repeat, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.cruise import find_cruise
from identification.experiments.manoeuvres import steer


@pytest.mark.parametrize("vehicle", ["npsauv", "heu_torpedo", "remus100", "vt690"])
def test_it_turns_dives_and_changes_speed_under_control(vehicle):
    plant = load_vehicle(vehicle)
    length, speed = plant.hull.length, find_cruise(plant).speed
    lap = length / speed
    record = steer(plant, rng=np.random.default_rng(3), duration=150.0 * lap)
    assert np.ptp(record["heading_rad"]) > 0.3
    assert np.ptp(record["depth_m"]) > 0.5 * length
    assert record["depth_m"].min() > 5.0 * length
    assert np.ptp(record["u_mps"]) > 0.1 * speed
    away = record["heading_rad"] - record["heading_cmd_rad"]
    assert np.median(np.abs(away)) < 0.15  # most of the time it is where it was told to be
    assert np.median(np.abs(record["depth_m"] - record["depth_cmd_m"])) < 0.5 * length
    assert set(np.round(np.unique(record["excitation_rudder_rad"]), 9)) == {
        round(side * 0.15 * float(plant.parts.rudder.limit), 9) for side in (-1, 1)
    }


def test_one_seed_is_one_experiment_whatever_the_effects():
    plant = load_vehicle("remus100", dt=0.2)
    one, again, moved = (
        steer(p, rng=np.random.default_rng(1), duration=60.0)
        for p in (plant, plant, replace_at(plant, "effects.rudder.offset", 0.05))
    )
    np.testing.assert_array_equal(one["depth_m"], again["depth_m"])
    for name in ("heading_cmd_rad", "depth_cmd_m", "u_cmd_mps", "excitation_stern_plane_rad"):
        np.testing.assert_array_equal(one[name], moved[name])
    assert np.abs(one["heading_rad"] - moved["heading_rad"]).max() > 1e-3


def test_a_sensor_keeps_the_noise_of_the_vehicle():
    plant = replace_at(load_vehicle("heu_torpedo"), "effects.sampling.depth.noise", 0.5)
    record = steer(plant, rng=np.random.default_rng(1), duration=60.0)
    assert np.std(np.diff(record["depth_m"])) == pytest.approx(0.5 * np.sqrt(2.0), rel=0.15)


def test_what_cannot_be_steered_is_refused():
    with pytest.raises(ValueError, match="six degrees of freedom"):
        steer(load_vehicle("slocum"), rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="duration needs a number above 0"):
        steer(load_vehicle("remus100"), rng=np.random.default_rng(0), duration=-1.0)
    sinking = replace_at(load_vehicle("remus100"), "effects.load.net_buoyancy", -60.0)
    with pytest.raises(ValueError, match="was cut short"):
        steer(sinking, rng=np.random.default_rng(0), duration=300.0)
    with pytest.raises(ValueError, match="gains"):
        steer(replace(load_vehicle("remus100"), dt=1.0), rng=np.random.default_rng(0))
