"""Identified models in the vehicles' place: how near they stay, and what they began from."""

import numpy as np
import pytest

from auv_gym.param import value_at
from auv_gym.plant import load_vehicle
from scripts.studies.harness import Found
from scripts.studies.identified_rollouts import METHODS, SHARES, STUDY, TASKS, UNKNOWN, attempt, off


def test_models_of_a_glider_follow_it_closer_than_what_they_began_from(tmp_path):
    found = STUDY.find(range(1), ["slocum"])
    (outcome,) = found.of("slocum")
    assert STUDY.good(found)
    assert max(outcome["percent"][name] for name in METHODS) < 0.5 < 1.5 < outcome["percent"][UNKNOWN]
    shown, every = STUDY.sheets(found)
    assert [row[:4] for row in shown.rows] == [["slocum", "heading", name, "1"] for name in (*METHODS, UNKNOWN)]
    assert shown.rows[0][4] == f"{outcome['percent']['armax']:.2f}"
    assert shown.rows[0][6] == f"{np.degrees(outcome['rmse']['armax']):.3f} deg"
    assert len(every.rows) == 4


def test_the_vehicle_itself_does_not_deviate(monkeypatch):
    monkeypatch.setattr("scripts.studies.identified_rollouts.SHARES", (1.0, 1.0))
    assert attempt("qiandao_float", 1, methods=())["percent"] == {UNKNOWN: pytest.approx(0.0, abs=1e-9)}


def test_coefficients_begin_off_in_turn():
    plant, free = load_vehicle("remus100"), TASKS["remus100"].free
    ratios = [value_at(off(plant, free, SHARES), path) / value_at(plant, path) for path in free]
    assert ratios == pytest.approx([0.85, 1.15, 0.85, 1.15])


def test_a_model_without_a_run_is_told():
    run = {"percent": {UNKNOWN: 4.0}, "rmse": {UNKNOWN: 0.08}, "failed": {"armax": "too short"}}
    found = Found({"slocum": {0: run, 1: run}}, {})
    assert STUDY.remarks(found) == ["slocum, armax: too short"]
    assert not STUDY.good(found)
    assert STUDY.sheets(found)[0].rows[0] == ["slocum", "heading", "armax", "0", "", "", ""]


@pytest.mark.slow
def test_identified_models_stay_within_a_few_percent():
    found = STUDY.find(range(5), jobs=2)
    linear = {"npsauv": 2.5, "remus100": 3.0, "slocum": 0.5, "qiandao_float": 5.0}  # %
    assert STUDY.good(found)
    for vehicle in TASKS:
        for outcome in found.of(vehicle):
            assert max(outcome["percent"]["armax"], outcome["percent"]["n4sid"]) < linear[vehicle]
            assert outcome["percent"]["grey_box"] < 0.5
    for draw in STUDY.pictures(found).values():
        assert draw().axes
