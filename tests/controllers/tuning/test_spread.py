"""Vehicles drawn from intervals: a coefficient keeps its sign and never vanishes, an offset may change sides."""

import json

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from controllers.tuning.spread import corner, drawn, known_intervals, read_uncertain

RUDDER = "hull.n_delta"


def written(tmp_path, **content):
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(content))
    return path


def test_a_wide_deviation_leaves_no_rudder_without_effect():
    plant = load_vehicle("slocum")
    low, high = known_intervals(plant)[RUDDER]
    value = value_at(plant, RUDDER)
    assert high == pytest.approx(value + 1.96 * plant.deviations[RUDDER], rel=1e-3)
    assert low / value == pytest.approx(value / high)  # lognormal: as far below the value, by factor, as above it
    rng = np.random.default_rng(0)
    for make in (drawn, corner):
        values = np.array([value_at(make(plant, known_intervals(plant), rng), RUDDER) for _ in range(300)])
        assert values.min() > 0.1 * value


def test_draws_from_a_lognormal_side_are_inside_the_interval_at_its_rate():
    plant = load_vehicle("slocum")
    intervals, rng = known_intervals(plant), np.random.default_rng(0)
    values = np.array([value_at(drawn(plant, intervals, rng), RUDDER) for _ in range(2000)])
    low, high = intervals[RUDDER]
    assert np.mean((values > low) & (values < high)) == pytest.approx(0.95, abs=0.02)  # 4 standard errors of 2000 draws


def test_an_interval_that_reaches_zero_ends_before_it_unless_it_is_that_of_an_offset(tmp_path):
    offset = "effects.rudder.offset"
    found = written(
        tmp_path,
        coefficients=[{"path": RUDDER, "value": 2e-4, "ci95": [-1e-4, 5e-4]}],
        effects=[{"path": offset, "value": 0.01, "ci95": [-0.02, 0.04]}],
    )
    plant, intervals, warnings = read_uncertain(load_vehicle("slocum"), found)
    assert intervals[RUDDER] == (pytest.approx(0.8e-4), 5e-4)
    assert intervals[offset] == (-0.02, 0.04)
    assert warnings == ()
    rng = np.random.default_rng(1)
    assert min(value_at(drawn(plant, intervals, rng), offset) for _ in range(50)) < 0.0


def test_a_measured_interval_on_one_side_of_zero_stays_as_it_is(tmp_path):
    found = written(tmp_path, coefficients=[{"path": RUDDER, "value": 2e-4, "ci95": [0.2e-4, 3.8e-4]}])
    assert read_uncertain(load_vehicle("slocum"), found).intervals == {RUDDER: (0.2e-4, 3.8e-4)}


def test_draws_stay_within_bounds():
    plant = replace_at(load_vehicle("slocum"), "effects.rudder.deadband", 0.001)
    rng = np.random.default_rng(0)
    limits = {"effects.rudder.deadband": (-1.0, 0.002)}
    assert min(value_at(drawn(plant, limits, rng), "effects.rudder.deadband") for _ in range(20)) == 0.0


def test_a_diagnosis_that_explains_nothing_is_a_warning(tmp_path):
    size = {"path": "effects.rudder.offset", "value": 0.03, "ci95": [0.01, 0.05]}
    found = written(tmp_path, verdict="unexplained", effects=[size])
    assert "did not explain its log" in read_uncertain(load_vehicle("slocum"), found).warnings[0]
    explained = written(tmp_path, verdict="effects", effects=[size])
    assert read_uncertain(load_vehicle("slocum"), explained).warnings == ()


@pytest.mark.parametrize("percent, warned", [(-659.0, True), (97.0, False), (None, False)])
def test_a_fit_that_is_worse_than_a_constant_on_held_out_data_is_a_warning(percent, warned, tmp_path):
    fit = written(
        tmp_path,
        parameters=[{"name": RUDDER, "value": 2e-4, "ci95": [1e-4, 3e-4]}],
        scores={"run": {"heading_rad": {"fit_percent": percent}}},
    )
    warnings = read_uncertain(load_vehicle("slocum"), fit).warnings
    assert bool(warnings) == warned
    assert not warned or "fit below 0 %: heading -659 %" in warnings[0]


@pytest.mark.parametrize("rate, words", [(0.37, "It is unstable (pole at 0.37 1/s)"), (-0.2, "free the coefficients")])
def test_a_poor_fit_of_an_unstable_vehicle_is_told_from_one_with_wrong_coefficients(rate, words, tmp_path):
    fit = written(
        tmp_path,
        parameters=[{"name": RUDDER, "value": 2e-4, "ci95": [1e-4, 3e-4]}],
        scores={"run": {"heading_rad": {"fit_percent": -659.0}}},
        poles=[[0.0, 0.0], [rate, 0.4], [rate, -0.4]],
    )
    assert words in read_uncertain(load_vehicle("slocum"), fit).warnings[0]
