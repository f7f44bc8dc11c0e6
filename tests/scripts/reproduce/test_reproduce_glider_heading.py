from math import degrees, radians

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from scripts.reproduce.glider_heading import CASE, STUDY, pool_run, vehicles


@pytest.fixture(scope="module")
def found():
    return STUDY.find([0])


def test_the_papers_numbers(found):
    (one,) = found.of(CASE)
    # to the digits that are printed
    assert one["damping"] == pytest.approx(-2.732, abs=5e-4)
    assert one["rudder"] == pytest.approx(-0.381, abs=5e-4)
    assert one["turn_analytic"] / one["turn_corrected"] == pytest.approx(6.7, abs=0.05)
    # K_y3 alone: K_y4 leaves next to nothing of the rudder's moment, K_y1 of 2e-8 bends the ramp by 1e-4 in 200 s
    assert one["turn_corrected"] == pytest.approx(-0.02086, rel=1e-3)
    coefficients, runs = STUDY.sheets(found)
    assert [row[1] for row in coefficients.rows if row[2]] == ["-2.732", "-0.381", "6.68"]
    assert runs.rows[0][1:] == [f"{degrees(one['ends'][plant.name][0]):.1f}" for plant in vehicles()]


def test_runs_are_odd_in_the_rudder_and_proportional_to_it():
    for plant in vehicles():
        port, starboard, twice = (pool_run(plant, radians(angle), 25.0)["heading_rad"] for angle in (-15.0, 15.0, 30.0))
        np.testing.assert_allclose(port, -starboard, atol=1e-12)
        np.testing.assert_allclose(twice, 2.0 * starboard, atol=1e-12)


def test_the_analytic_run_is_the_closed_form(found):
    (one,) = found.of(CASE)
    run = pool_run(vehicles()[0], radians(15.0), 25.0)
    t, a, b = run.time, one["damping"], one["rudder"]
    closed = -b / a * radians(15.0) * (t + (1.0 - np.exp(a * t)) / a)
    np.testing.assert_allclose(run["heading_rad"], closed, atol=1e-6)  # RK4 in steps of 0.1 s at a pole of 2.7 1/s


def test_a_pool_run_starts_straight_ahead():
    run = pool_run(load_vehicle("ganeshblue_corrected"), radians(-15.0), 20.0)
    assert run["heading_rad"][0] == 0.0
    assert run.duration_s == 20.0
    assert set(run["rudder_rad"]) == {radians(-15.0)}


def test_a_figure_to_each_side(found):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    pictures = STUDY.pictures(found)
    assert sorted(pictures) == ["glider_heading_negative_rudder.png", "glider_heading_positive_rudder.png"]
    assert all(len(draw().axes) == 2 for draw in pictures.values())
