"""Identified models in the vehicles' place: how near they stay, what is printed and drawn."""

import json

import numpy as np
import pytest

from auv_gym.param import value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from scripts.identified_rollouts import METHODS, SCENES, UNKNOWN, Outcome, as_json, attempt, draw, main, off, study


def test_models_of_a_glider_follow_it_closer_than_what_they_began_from():
    outcome = attempt("slocum", 0)
    assert not outcome.failed
    assert max(outcome.percent[name] for name in METHODS) < 0.5 < 1.5 < outcome.percent[UNKNOWN]
    assert len(outcome.runs["armax"]) == len(outcome.vehicle)


def test_a_linear_model_of_depth_takes_a_floats_place():
    outcome = attempt("qiandao_float", 0, methods=("armax",))
    assert not outcome.failed
    assert outcome.percent["armax"] < 6.0
    assert outcome.rmse["armax"] == pytest.approx(0.01 * outcome.percent["armax"] * 5.0, rel=1e-6)


def test_the_vehicle_itself_does_not_deviate(monkeypatch):
    monkeypatch.setattr("scripts.identified_rollouts.SHARES", (1.0, 1.0))
    assert attempt("qiandao_float", 1, methods=()).percent == {UNKNOWN: pytest.approx(0.0, abs=1e-9)}


def test_coefficients_begin_off_in_turn():
    plant, free = load_vehicle("remus100"), SCENES["remus100"].free
    ratios = [value_at(off(plant, free), path) / value_at(plant, path) for path in free]
    assert ratios == pytest.approx([0.85, 1.15, 0.85, 1.15])


def _outcome(seed):
    time = np.arange(0.0, 40.0, 4.0)
    run = Record.from_arrays(time, {"heading_rad": np.sin(time), "heading_cmd_rad": np.ones(time.size)})
    return Outcome({"armax": 1.0 + seed, UNKNOWN: 4.0}, {"armax": 0.02, UNKNOWN: 0.08}, {}, run, {"armax": run})


def test_the_program_prints_draws_and_tells_what_failed(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("scripts.identified_rollouts.attempt", lambda vehicle, seed: _outcome(seed))
    given = ["--vehicle", "slocum", "--seeds", "3", "--out", str(tmp_path)]
    assert main(given) == 0
    assert "1.00 to 3.00" in capsys.readouterr().out
    assert (tmp_path / "identified_slocum.png").read_bytes()[:4] == b"\x89PNG"
    assert main(["--vehicle", "slocum", "--seeds", "2", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["slocum"]["models"]
    assert told["armax"]["percent"] == [1.0, 2.0]
    assert told["grey_box"]["percent"] == [None, None]
    failed = Outcome({}, {}, {"armax": "too short"}, _outcome(0).vehicle, {})
    monkeypatch.setattr("scripts.identified_rollouts.attempt", lambda vehicle, seed: failed)
    assert main(["--vehicle", "slocum", "--seeds", "1"]) == 1
    assert "slocum, armax: too short" in capsys.readouterr().out


def test_nothing_to_do_is_refused():
    with pytest.raises(ValueError, match="at least 1, got 0"):
        study(["slocum"], [])


@pytest.mark.slow
def test_identified_models_stay_within_a_few_percent(tmp_path):
    found = study(list(SCENES), range(5))
    told = as_json(found)
    linear = {"npsauv": 2.5, "remus100": 3.0, "slocum": 0.5, "qiandao_float": 5.0}  # %
    for vehicle, outcomes in found.items():
        assert not any(outcome.failed for outcome in outcomes)
        models = told[vehicle]["models"]
        assert max(models["armax"]["percent"] + models["n4sid"]["percent"]) < linear[vehicle]
        assert max(models["grey_box"]["percent"]) < 0.5
        assert draw(vehicle, outcomes[0], tmp_path).is_file()
