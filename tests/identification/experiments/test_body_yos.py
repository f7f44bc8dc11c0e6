"""The standard experiment of a glider in six degrees of freedom: what its record has, and its settings."""

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from identification.experiments.kinds import KINDS
from identification.experiments.missions import run_mission

SEAWING = load_vehicle("seawing")
pytestmark = pytest.mark.slow  # as those of its environment


def flown(plant=SEAWING, seed=0, **settings):
    return run_mission(plant, np.random.default_rng(seed), **settings)


def test_a_record_has_what_a_glider_logs():
    record = flown(duration=600.0)
    assert set(record.names) == {
        "depth_m", "roll_rad", "pitch_rad", "heading_rad", "p_radps", "q_radps", "r_radps", "north_m", "east_m",
        "ballast_m3", "battery_m", "battery_rad", "heading_cmd_rad",
    }  # fmt: skip
    assert len(record) == 601
    assert np.ptp(record["heading_cmd_rad"]) > 0.3
    assert record["pitch_rad"].min() < -0.3 < 0.3 < record["pitch_rad"].max()


def test_one_seed_gives_one_experiment_and_its_settings_act():
    one, same, other = flown(duration=300.0), flown(duration=300.0), flown(duration=300.0, seed=1)
    assert np.array_equal(one["depth_m"], same["depth_m"])
    assert not np.array_equal(one["heading_cmd_rad"], other["heading_cmd_rad"])
    steep = flown(duration=300.0, pitch=0.7)
    assert steep["pitch_rad"].min() < -0.6 < one["pitch_rad"].min()


def test_a_run_that_is_cut_short_says_why():
    with pytest.raises(ValueError, match="was cut short: touched the bottom"):
        flown(replace_at(SEAWING, "effects.load.payload", 0.6), duration=900.0)


@pytest.mark.slow
def test_its_designs_are_missions_that_can_be_flown():
    kind = KINDS.of(SEAWING.family)
    for design in kind.designs(SEAWING):
        settings = dict(design.tables(SEAWING, 120.0)["experiment"])
        assert settings.pop("kind") == "mission"
        assert len(flown(**settings)) == 121
    assert 0.0 < kind.minutes(SEAWING)[0] < kind.minutes(SEAWING)[1]
