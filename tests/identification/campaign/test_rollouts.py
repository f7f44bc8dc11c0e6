"""Tests of a campaign's rollouts: models follow the vehicle accurately, with its inputs and with its controller."""

import json

import numpy as np

from auv_gym.records.record import Record
from identification.campaign import rollouts as rolling
from identification.campaign.fits import VEHICLE
from identification.campaign.index import read_index
from identification.campaign.rollouts import compare_rollouts, load_rollout, read_rollouts

KEY = "vehicle.effects.rudder.offset"


def of(study, kind, offset):
    return next(r for r in study.rollouts if r["kind"] == kind and r["cell"][KEY] == offset)


def test_every_kind_is_made_on_the_runs_that_were_asked_for(study):
    assert [(r["kind"], r["seed"], r["status"]) for r in study.rollouts] == [
        (kind, 2, "done") for kind in ("open", "open", "closed", "closed")
    ]
    assert set(of(study, "closed", 0.0)["models"]) == {"line-offset=0.0", "offset"}
    assert set(of(study, "open", 0.05)["models"]) == {"line-offset=0.05", "offset", VEHICLE}


def test_the_model_with_the_right_effect_follows_the_vehicle_that_has_it(study):
    for kind in ("open", "closed"):
        scores = {n: m["scores"]["heading_rad"]["percent"] for n, m in of(study, kind, 0.05)["models"].items()}
        assert scores["offset"] < 5.0, kind
    opened = of(study, "open", 0.05)["models"]
    better, worse = (opened[name]["scores"]["heading_rad"]["percent"] for name in ("offset", VEHICLE))
    assert better < 0.5 * worse


def test_scores_are_those_of_the_records_beside_them(study):
    entry = of(study, "closed", 0.05)
    true, model = (load_rollout(study.folder, file) for file in (entry["file"], entry["models"]["offset"]["file"]))
    error = model["heading_rad"] - true["heading_rad"]
    score = entry["models"]["offset"]["scores"]["heading_rad"]
    assert np.isclose(score["rmse"], np.sqrt(np.mean(error**2)))
    assert np.isclose(score["percent"], 100.0 * score["rmse"] / score["step"])
    assert np.isclose(score["step"], 0.4, atol=0.01)  # from 0.2 to 0.6 rad


def test_the_vehicle_in_closed_loop_is_the_run_itself(study):
    entry = of(study, "closed", 0.0)
    row = next(row for row in read_index(study.folder) if row.id == entry["run"])
    run, again = Record.load(row.path(study.folder)), load_rollout(study.folder, entry["file"])
    for name in ("heading_rad", "rudder_rad", "heading_cmd_rad"):
        np.testing.assert_array_equal(run[name], again[name])


def test_what_is_there_is_not_compared_again(study, monkeypatch):
    monkeypatch.setattr(rolling, "_compared", lambda folder, task: None)
    assert compare_rollouts(study.campaign, study.folder) == json.loads(json.dumps(study.rollouts))
    read = read_rollouts(study.folder)
    assert [r["run"] for r in read["open"] + read["closed"]] == [r["run"] for r in study.rollouts]
    assert read_rollouts(study.folder / "runs") == {"open": [], "closed": []}
