"""The study of LS-SVM models of the torpedo: its experiments, judgements and tables; what it finds is in the docs."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.vehicles.body.learned_hull import LearnedHull
from scripts.reproduce.ls_svm import study
from scripts.reproduce.ls_svm.experiments import (
    BANG,
    MANOEUVRES,
    NOISE,
    bang_bang_runs,
    circled,
    judged,
    run_from_rest,
    vehicle,
)
from scripts.reproduce.ls_svm.study import STUDY, compared, failures, steered
from scripts.reproduce.ls_svm.surrogates import FREE, SHARES, STEP, run_of
from scripts.reproduce.ls_svm.tables import PUBLISHED
from scripts.reproduce.s_plane import CASES
from scripts.studies.harness import Found
from scripts.studies.identified_rollouts import off


def test_bang_bang_runs_go_from_stop_to_stop_from_rest_and_share_the_voltages():
    runs = bang_bang_runs((3.0, 4.0), 5, runs=3)
    assert [float(run["propeller_V"][0]) for run in runs] == [3.0, 4.0, 3.0]
    for run in runs:
        assert set(np.round(np.abs(run["rudder_rad"]), 12)) == {round(BANG, 12)}
        assert set(np.round(np.abs(run["stern_plane_rad"]), 12)) == {round(BANG, 12)}
        assert run["u_mps"][0] == 0.0
        assert run["depth_m"].min() > 0.0
    again = bang_bang_runs((3.0, 4.0), 5, runs=3)
    assert np.array_equal(again[2]["v_mps"], runs[2]["v_mps"])
    assert not np.array_equal(runs[0]["rudder_rad"], runs[2]["rudder_rad"])


def test_noisy_records_hold_what_a_vehicle_measures_and_no_position():
    clean, noisy = (bang_bang_runs((4.0,), 1, noise=noise, runs=1)[0] for noise in (None, NOISE))
    for name, size in NOISE.items():
        assert np.std(noisy[name] - clean[name]) == pytest.approx(size, rel=0.15)  # 600 samples: 3 %, five times over
    assert not noisy.has("north_m")


@pytest.mark.parametrize("manoeuvre", MANOEUVRES, ids=lambda one: one.title)
def test_circles_dive_between_five_and_fifteen_metres_and_close(manoeuvre):
    run = circled(manoeuvre)
    assert run["depth_m"].min() > 4.0
    assert 14.0 < run["depth_m"].max() < 16.0
    assert abs(run["heading_rad"][-1]) > 2.0 * np.pi
    same = judged(run, run_from_rest(vehicle(), {name: run[name] for name in vehicle().inputs}))
    assert (same.position, same.depth, same.outside) == (0.0, 0.0, 0.0)


def test_a_judgement_is_in_percent_of_the_path_and_knows_what_is_outside():
    true = circled(MANOEUVRES[0])
    moved = true.with_channels({"north_m": true["north_m"] + 3.0, "depth_m": true["depth_m"] - 0.5})
    learned = replace(vehicle(), learned=LearnedHull.silent())  # one centre, at rest, with a reach of 1 m/s
    found = judged(true, moved, learned)
    path = np.hypot(np.diff(true["north_m"]), np.diff(true["east_m"])).sum()
    assert found.position == pytest.approx(300.0 / path)
    assert found.depth == pytest.approx(0.5)
    assert 0.5 < found.outside < 1.0
    assert found.distance == pytest.approx(np.sqrt(sum(true[c] ** 2 for c in vehicle().family.states[:6])).max())


def test_one_step_a_sample_is_as_good_as_five():
    for manoeuvre in (MANOEUVRES[0], MANOEUVRES[3]):
        found = judged(circled(manoeuvre), run_of(replace(vehicle(), longest_step=STEP), circled(manoeuvre)))
        assert found.farthest < 1e-3  # %
        assert found.depth < 1e-3


def test_control_of_a_vehicle_with_wrong_coefficients_differs_and_with_its_own_does_not():
    case = CASES[2]
    own, wrong = steered(case), off(vehicle(), FREE, SHARES)
    assert compared(case, own, steered(case, vehicle())).value == 0.0
    different = compared(case, own, steered(case, wrong))
    assert different.percent == pytest.approx(100.0 * different.value / 5.0)
    assert different.value > 1e-3
    assert len(FREE) == len(set(FREE))
    assert SHARES == (0.8, 1.2)


def test_tables_show_medians_worst_and_what_failed():
    circle = {"position": 0.5, "farthest": 0.6, "depth": 0.02, "outside": 0.25, "distance": 1.5}
    worse = {**circle, "position": 2.5, "depth": 0.4}
    control = [{"percent": 0.1 * number, "value": 0.01} for number in (1, 2, 30)]
    settings, shares = [{"penalty": 1e3, "sigma": 6.0}], [0.01] * 6
    runs = [
        {"settings": settings, "shares": shares, "circles": [one] * 4, "control": control}
        for one in (circle, circle, worse)
    ]
    row = {"data": "4 V", "seed": 0, "method": "ARX"}
    noisy = [{**row, "manoeuvre": one.title, **circle} for one in MANOEUVRES[:3]] + [{**row, "failed": "diverged"}]
    each = {**runs[0], "settings": settings * 6}
    found = Found(
        {"4 V, LS-SVM": dict(enumerate(runs)), "4 V, LS-SVM, each axis": {0: each}, "4 V, noisy": {0: noisy}}, {}
    )
    tuned, circles, controlled, others = STUDY.sheets(found)
    assert [one[0] for one in tuned.rows] == list(PUBLISHED)
    assert tuned.rows[0][3:] == ["1e+03", "6", "1"] * 2
    assert [one[3] for one in circles.rows if one] == ["0.50 (2.50)"] * 4
    assert [one[-1] for one in circles.rows if one] == ["2 of 3"] * 4
    assert [one[-1] for one in controlled.rows if one] == ["3 of 3", "3 of 3", "0 of 3"]
    assert others.rows[0] == ["4 V", "ARX", *["0.50 (0.50)\n0.020 (0.020) m"] * 3, "-", "1"]
    assert failures(found) == ["4 V, ARX: diverged: 1 times"]


@pytest.mark.slow
def test_a_hull_learned_from_few_runs_is_judged(monkeypatch):
    monkeypatch.setattr(study, "RUNS", 3)
    found = STUDY.find(range(1), ["4 V, LS-SVM with a trend"])
    (run,) = found.of("4 V, LS-SVM with a trend")
    assert run["settings"] == [{"penalty": 1e4, "sigma": 12.0}]
    assert max(one["position"] for one in run["circles"][:1]) < 10.0  # % of the path, of 3 runs in place of 40
    assert max(one["percent"] for one in run["control"]) < 20.0
