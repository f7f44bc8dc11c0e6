"""Tests of a campaign's fits: the right runs, recovery of the truth, files that can be read, and isolated failures."""

import json

from auv_gym.param import value_at
from identification.campaign import fits as fitting
from identification.campaign.fits import fit_models, load_fitted, read_fits
from identification.campaign.index import read_index

KEY = "vehicle.effects.rudder.offset"


def named(study, name):
    return next(fit for fit in study.fits if fit["name"] == name)


def test_each_fit_has_its_runs_and_is_judged_on_others(study):
    rows = {row.id: row for row in read_index(study.folder)}
    assert [fit["name"] for fit in study.fits] == ["line-offset=0.0", "line-offset=0.05", "offset", "hopeless"]
    for fit, offset in ((study.fits[0], 0.0), (study.fits[1], 0.05), (study.fits[2], 0.05)):
        assert [rows[id].seed for id in fit["trained_on"]] == [0, 1]
        assert [rows[id].seed for id in fit["scores"]] == [2]
        assert {rows[id].cell[KEY] for id in (*fit["trained_on"], *fit["scores"])} == {offset}


def test_a_failed_fit_says_why_and_the_others_go_on(study):
    failed = named(study, "hopeless")
    assert failed["status"] == "failed"
    assert "Arx needs at least 4 samples per coefficient" in failed["reason"]
    assert [fit["status"] for fit in study.fits[:3]] == ["done"] * 3


def test_the_grey_box_starts_from_the_vehicle_as_designed_and_finds_the_offset(study):
    fit = named(study, "offset")
    (estimate,) = fit["parameters"]
    assert estimate["name"] == "effects.rudder.offset"
    assert abs(estimate["value"] - 0.05) < 4.0 * estimate["error"] < 0.02
    assert value_at(load_fitted(study.folder, fit), "effects.rudder.offset") == estimate["value"]
    (run,) = fit["scores"]
    assert fit["scores"][run]["heading_rad"]["rmse"] < 0.5 * fit["vehicle_scores"][run]["heading_rad"]["rmse"]


def test_results_come_back_from_the_folder(study):
    assert read_fits(study.folder) == json.loads(json.dumps(study.fits))
    fit = named(study, "line-offset=0.0")
    model = load_fitted(study.folder, fit)
    assert (list(model.inputs), list(model.outputs)) == (fit["inputs"], fit["outputs"])
    assert [share for share, _ in study.told] == [0.25, 0.5, 0.75, 1.0]
    assert read_fits(study.folder / "runs") == []


def test_what_is_there_is_not_fitted_again(study, monkeypatch):
    made = []
    monkeypatch.setattr(fitting, "_fill", lambda result, task, folder: made.append(task.name))
    monkeypatch.setattr("identification.campaign.running.shelf.write_json", lambda path, content: None)
    assert fit_models(study.campaign, study.folder)[:3] == json.loads(json.dumps(study.fits[:3]))
    assert made == ["hopeless"]
