from math import radians

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from scripts.reproduce_glider_heading import main, pool_run, reproduce


@pytest.fixture(scope="module")
def found():
    return reproduce()


def test_the_papers_numbers(found):
    # to the digits that are printed
    assert found.damping == pytest.approx(-2.732, abs=5e-4)
    assert found.rudder == pytest.approx(-0.381, abs=5e-4)
    assert found.ratio == pytest.approx(6.7, abs=0.05)


def test_the_corrected_vehicle_turns_at_the_rate_of_equation_15(found):
    # K_y3 alone: K_y4 leaves next to nothing of the rudder's moment, K_y1 of 2e-8 bends the ramp by 1e-4 in 200 s
    assert found.turn_corrected == pytest.approx(-0.02086, rel=1e-3)


def test_runs_are_odd_in_the_rudder_and_proportional_to_it(found):
    for name in ("ganeshblue", "ganeshblue_corrected"):
        port, starboard = found.runs[name, -15.0]["heading_rad"], found.runs[name, 15.0]["heading_rad"]
        np.testing.assert_allclose(port, -starboard, atol=1e-12)
        np.testing.assert_allclose(found.runs[name, 30.0]["heading_rad"], 2.0 * starboard, atol=1e-12)


def test_the_analytic_run_is_the_closed_form(found):
    run = found.runs["ganeshblue", 15.0]
    t, a, b = run.time, found.damping, found.rudder
    closed = -b / a * radians(15.0) * (t + (1.0 - np.exp(a * t)) / a)
    np.testing.assert_allclose(run["heading_rad"], closed, atol=1e-6)  # RK4 in steps of 0.1 s at a pole of 2.7 1/s


def test_a_pool_run_starts_straight_ahead():
    run = pool_run(load_vehicle("ganeshblue_corrected"), radians(-15.0), 20.0)
    assert run["heading_rad"][0] == 0.0
    assert run.duration_s == 20.0
    assert set(run["rudder_rad"]) == {radians(-15.0)}


def test_main_prints_the_tables_and_draws_the_figures(tmp_path, capsys):
    assert main(["--out", str(tmp_path), "--duration", "20"]) == 0
    text = capsys.readouterr().out
    assert all(number in text for number in ("-2.732", "-0.381", "6.68", "6.7"))
    figures = sorted(path.name for path in tmp_path.iterdir())
    assert figures == ["glider_heading_negative_rudder.png", "glider_heading_positive_rudder.png"]
    assert all((tmp_path / name).read_bytes().startswith(b"\x89PNG") for name in figures)


def test_main_says_what_is_wrong(capsys, tmp_path):
    (tmp_path / "file").write_text("")
    assert main(["--out", str(tmp_path / "file" / "figures")]) == 1
    assert capsys.readouterr().err.startswith("Error: ")
