"""A thruster vehicle by code of its own moves as the project's does, and is read as its sensors say."""

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from scripts.blind import own_rov
from scripts.blind.own_forces import DAMPING
from scripts.blind.own_rov import driven
from scripts.studies.driven import CASES, STUDY, truth_of
from scripts.studies.harness import Found
from tests.scripts.following import assert_it_follows

VEHICLE = load_vehicle("bluerov2_heavy")


def test_it_moves_as_the_compiled_vehicle_does(monkeypatch):
    """Commands of a drive, given to both: what is left are their steps of integration and of the thrusters' lag."""
    for name in ("TILT", "HEADING", "RATE", "SPEED", "DEPTH"):
        monkeypatch.setattr(own_rov, name, 0.0)
    current = {"effects.current.north": 0.1, "effects.current.east": -0.05}
    fine = load_vehicle("bluerov2_heavy", dt=own_rov.STEP)
    plant = replace_at(fine, {**current, "effects.t3.lost": 0.4, "effects.t5.lag": 0.4})
    log = driven(plant, np.random.default_rng(3), 20.0, push=0.0)
    assert np.ptp(log["heading_rad"]) > 1.0
    states = plant.family.states
    x = plant.initial(np.zeros(len(plant.outputs)))
    x[[states.index(name) for name in ("u_mps", "v_mps", "depth_m")]] = -0.1, 0.05, 5.0  # at rest over ground
    assert_it_follows(plant, x, log, own_rov.EVERY, depth=0.006, other=2e-3)  # depth is read in cm


def test_its_sensors_err_as_they_say():
    plant = replace_at(VEHICLE, {"effects.gyros.bias_p": 0.2, "effects.dvl_ground.misalignment": 0.3})
    plain, off = (driven(one, np.random.default_rng(4), 20.0) for one in (VEHICLE, plant))
    assert off["p_radps"] - plain["p_radps"] == pytest.approx(0.2)
    read = plain.readings("u_dvl_mps")
    assert 0.4 < read.mean() < 0.5  # of half the rate, and some are lost
    assert read[1::2].sum() == 0
    u, v, turned = plain["u_dvl_mps"][read], plain["v_dvl_mps"][read], off["u_dvl_mps"][read]
    assert turned == pytest.approx(np.cos(0.3) * u + np.sin(0.3) * v, abs=0.15)  # six deviations of the noise
    assert np.std(turned - u) > 0.03


def test_it_does_not_pass_the_vertical(monkeypatch):
    monkeypatch.setattr(own_rov, "PUSHES", np.array([0.0, 0.0, 0.0, 0.0, 30.0, 0.0]))
    with pytest.raises(ValueError, match="came near the vertical after"):
        driven(VEHICLE, np.random.default_rng(0), 20.0, push=1.0)


def test_damping_is_what_the_study_draws():
    plant = truth_of("a thruster weak", np.random.default_rng(0))
    assert (plant.effects.t3.lost, plant.effects.current.north) == (0.4, 0.1)
    moved = {path for path in plant.coefficients if value_at(plant, path) != value_at(VEHICLE, path)}
    assert moved == {path for path in DAMPING if value_at(VEHICLE, path) != 0.0}
    assert len(moved) == 9
    assert plant.hull.mass == VEHICLE.hull.mass


def test_the_table_counts_what_is_right_and_what_is_not():
    run = {
        "verdict": "named", "effects": {"effects.current.north": [0.1, 0.09, 0.11], "effects.t1.lost": [0.2, 0.1, 0.3]},
        "tied": [], "left": [], "process": {}, "seconds": 61.0,
    }  # fmt: skip
    (sheet,) = STUDY.sheets(Found({"a thruster weak": {5: run}}, {}))
    assert sheet.rows[0][0] == "a thruster weak, 5"
    assert list(sheet.rows[0][4:]) == ["1 of 3", "1", "1 of 1", "nothing", "none", "61"]
    tied = {**run, "tied": [["effects.t1.lost", "effects.t3.lost"]], "swell": [{"period_s": 6.04, "pushes": {}}]}
    (sheet,) = STUDY.sheets(Found({"a thruster weak": {5: tied}}, {}))
    assert list(sheet.rows[0][4:]) == ["2 of 3", "0", "1 of 1", "nothing", "swell of 6.0 s", "61"]
    assert set(STUDY.cases) == set(CASES)
