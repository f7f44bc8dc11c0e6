"""A torpedo by code of its own moves as the project's does, is pushed by a swell, and read as its sensors say."""

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from scripts.blind import own_cruise
from scripts.blind.own_cruise import cruised
from scripts.studies.driven import CASES, truth_of
from tests.scripts.following import assert_it_follows

VEHICLE = load_vehicle("vt690")


def test_it_moves_as_the_compiled_vehicle_does(monkeypatch):
    """Commands of a mission, given to both: what is left are their steps of integration and of the fins' lag."""
    for name in ("TILT", "HEADING", "RATE", "SPEED", "DEPTH"):
        monkeypatch.setattr(own_cruise, name, 0.0)
    true = {"effects.current.north": 0.1, "effects.current.east": -0.05, "effects.load.net_buoyancy": 2.0}
    fins = {"effects.rudder.offset": 0.03, "effects.stern_plane.lost": 0.3, "effects.rudder.lag": 0.3}
    fine = load_vehicle("vt690", dt=own_cruise.STEP)
    plant = replace_at(fine, true | fins)
    log = cruised(plant, np.random.default_rng(3), 20.0, push=0.0, swell=0.0)
    assert np.ptp(log["heading_rad"]) > 0.5
    states = plant.family.states
    x = plant.initial(np.zeros(len(plant.outputs)))
    # a cruise through the water is over ground here, so that the vehicle starts with less or more of the current
    x[[states.index(n) for n in ("u_mps", "v_mps", "w_mps")]] = log["u_dvl_mps"][0] - 0.1, 0.05, log["w_dvl_mps"][0]
    x[states.index("depth_m")] = 8.0
    assert_it_follows(plant, x, log, own_cruise.EVERY, depth=0.03, other=4e-3)


def test_a_swell_pushes_it_at_its_period():
    still, pushed = (cruised(VEHICLE, np.random.default_rng(4), 120.0, 0.0, size) for size in (0.0, 1.0))
    spectra = [np.abs(np.fft.rfft(np.diff(log["p_radps"]))) ** 2 for log in (still, pushed)]
    frequencies = np.fft.rfftfreq(len(still) - 1, 0.1)
    near = np.abs(frequencies * own_cruise.PERIOD - 1.0) < 0.2
    assert spectra[1][near].mean() > 10.0 * spectra[0][near].mean()


def test_its_sensors_err_as_they_say():
    plant = replace_at(VEHICLE, {"effects.gyros.bias_r": 0.2, "effects.dvl_ground.misalignment": 0.3})
    plain, off = (cruised(one, np.random.default_rng(4), 20.0, 0.0, 0.0) for one in (VEHICLE, plant))
    assert off["r_radps"] - plain["r_radps"] == pytest.approx(0.2)
    read = plain.readings("u_dvl_mps")
    assert 0.4 < read.mean() < 0.5  # of half the rate, and some are lost
    u, v, turned = plain["u_dvl_mps"][read], plain["v_dvl_mps"][read], off["u_dvl_mps"][read]
    assert turned == pytest.approx(np.cos(0.3) * u + np.sin(0.3) * v, abs=0.15)  # six deviations of the noise


def test_errors_of_its_sensors_last():
    """The compass wanders, and the loops with it; the Doppler log swings, and nothing follows."""
    plain, off, swung = (
        cruised(VEHICLE, np.random.default_rng(4), 120.0, 0.0, 0.0, **errs)
        for errs in ({}, {"wander": 0.2}, {"swing": 0.3})
    )
    wander = off["heading_rad"] - np.cumsum(0.1 * off["r_radps"])  # the boat hardly rolls or pitches
    assert np.std(wander) > 3.0 * np.std(plain["heading_rad"] - np.cumsum(0.1 * plain["r_radps"]))
    read = swung.readings("w_dvl_mps")
    errors = np.where(read, swung["w_dvl_mps"], 0.0)
    power, frequencies = np.abs(np.fft.rfft(errors)) ** 2, np.fft.rfftfreq(len(errors), 0.1)
    near = np.abs(frequencies * own_cruise.SWINGING - 1.0) < 0.2
    slow = (frequencies > 0.02) & (frequencies < 2.0)
    assert power[near].mean() > 10.0 * power[slow & ~near].mean()
    assert np.std(swung["q_radps"]) == pytest.approx(np.std(plain["q_radps"]), rel=0.2)


def test_a_run_that_surfaces_is_cut_short():
    with pytest.raises(ValueError, match="was cut short after"):
        cruised(replace_at(VEHICLE, "effects.load.net_buoyancy", 300.0), np.random.default_rng(0), 60.0)


def test_coefficients_are_what_the_study_draws():
    case = "torpedo, swell, rudder offset"
    plant = truth_of(case, np.random.default_rng(0))
    assert plant.effects.rudder.offset == CASES[case].true["effects.rudder.offset"]
    factors = [value_at(plant, path) / value_at(VEHICLE, path) for path in VEHICLE.coefficients]
    assert all(0.8 <= factor <= 1.2 and factor != 1.0 for factor in factors)
