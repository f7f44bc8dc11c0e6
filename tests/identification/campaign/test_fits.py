"""Fits of a campaign: the right runs, the truth recovered, files that come back, and failures that stay alone."""

import json

import numpy as np
import pytest

from auv_gym.linear import StateSpace
from auv_gym.param import value_at
from auv_gym.record import Record
from identification.campaign import fits as fitting
from identification.campaign.fits import fit_models, load_fitted, read_fits
from identification.campaign.index import read_index
from identification.campaign.judging import over_time, poles_of, residual_tests

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
    monkeypatch.setattr(fitting, "write_json", lambda path, content: None)
    assert fit_models(study.campaign, study.folder)[:3] == json.loads(json.dumps(study.fits[:3]))
    assert made == ["hopeless"]


def test_poles_of_a_known_system():
    dt, rotation = 0.5, 0.3
    turn = np.exp(-0.2 * dt) * np.array([[np.cos(rotation), np.sin(rotation)], [-np.sin(rotation), np.cos(rotation)]])
    a = np.zeros((4, 4))
    a[:2, :2], a[2, 2] = turn, 1.0
    model = StateSpace(a, np.ones((4, 1)), np.ones((1, 4)), ("rudder_rad",), ("heading_rad",), dt)
    np.testing.assert_allclose(poles_of(model), [(0.0, 0.0), (-0.2, rotation / dt), (-0.2, -rotation / dt)], atol=1e-9)


def test_residual_tests_tell_a_lacking_response_from_noise():
    rng, n = np.random.default_rng(1), 600
    u, e = rng.standard_normal(n), 0.1 * rng.standard_normal(n)
    model = StateSpace(
        np.array([[0.5]]), np.array([[1.0]]), np.array([[1.0]]), ("stern_plane_rad",), ("depth_m",), 1.0,
        k=np.array([[0.5]]),
    )  # fmt: skip
    x = np.zeros(n + 1)
    for k in range(n):
        x[k + 1] = 0.5 * x[k] + u[k] + 0.5 * e[k]
    true = Record.from_arrays(np.arange(n), {"stern_plane_rad": u, "depth_m": x[:n] + e})
    test = residual_tests(model, [true])["depth_m"]
    assert test["ahead"]
    assert test["rms"] == pytest.approx(0.1, rel=0.1)
    assert test["p_value"] > 0.01
    lags, ties = (
        np.array(test["inputs"]["stern_plane_rad"]["lags_s"]),
        np.abs(test["inputs"]["stern_plane_rad"]["correlation"]),
    )
    assert ties.max() < 3.0 * test["inputs"]["stern_plane_rad"]["bound"]
    late = true.with_channels({"depth_m": true["depth_m"] + 0.2 * np.r_[0.0, 0.0, 0.0, u[:-3]]})
    ties = np.abs(residual_tests(model, [late])["depth_m"]["inputs"]["stern_plane_rad"]["correlation"])
    assert lags[np.argmax(ties)] == 3.0


def test_errors_over_time_are_root_mean_squares_of_equal_spans():
    elapsed = np.arange(0.0, 100.0)
    curve = over_time(elapsed, np.where(elapsed < 50.0, 3.0, 4.0), 2.0)
    assert len(curve["time_s"]) == 50
    assert np.all(np.diff(curve["time_s"]) > 0.0)
    np.testing.assert_allclose(curve["percent"], [150.0] * 25 + [200.0] * 25)
