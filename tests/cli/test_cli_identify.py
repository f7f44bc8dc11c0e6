"""The commands `auv-gym identify` and `auv-gym compare`: their files, and what they say to bad input."""

import json

import numpy as np
import pytest

from auv_gym.cli import main
from auv_gym.models.files import load_model, model_header, save_model
from auv_gym.models.linear import Polynomial
from auv_gym.plant import load_vehicle
from identification.experiments.heading_control import closed_loop
from tests.identification.linear.known_systems import TRUTH, record_of


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs")
    for seed, name in enumerate(("train.nc", "test.nc")):
        record_of(TRUTH, 300, np.random.default_rng(seed), noise=0.02).save(path / name)
    closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(2), duration=900.0, track_noise=None).save(
        path / "glider.nc"
    )
    return path


CHANNELS = ["--input", "bow_plane_rad", "--input", "stern_plane_rad", "--output", "depth_m", "--output", "pitch_rad"]


def run(*arguments):
    return main([str(a) for a in arguments])


def test_a_model_is_fitted_judged_and_written(folder, tmp_path, capsys):
    out, page = tmp_path / "model.npz", tmp_path / "page.html"
    given = ["--method", "arx", *CHANNELS, "--set", "n_a=3,2", "--validate", folder / "test.nc"]
    assert run("identify", folder / "train.nc", "--out", out, *given) == 0
    said = capsys.readouterr().out
    assert "a1[depth_m]" in said
    assert "b2[pitch_rad, stern_plane_rad]" in said
    assert "Free runs over 1 record to validate on" in said
    assert "white" in said
    assert "Poles, in discrete time" in said
    assert "RMS prediction error, by horizon" in said
    model = load_model(out)
    assert isinstance(model, Polynomial)
    np.testing.assert_allclose(model.a, TRUTH.a, atol=0.05)
    attrs = model_header(out)["attrs"]
    assert attrs["method"] == "arx"
    assert attrs["settings"] == {"n_a": [3, 2]}
    assert attrs["records"] == ["train.nc"]
    assert attrs["judged_on"] == ["test.nc"]
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    assert run("identify", folder / "train.nc", "--out", out, *given[:-2], "--report", page) == 0
    assert "Free runs over the last third" in capsys.readouterr().out
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")


def test_a_vehicle_s_parameters_are_fitted_to_a_vehicle_file(folder, tmp_path, capsys):
    out = tmp_path / "fitted.toml"
    given = ["--method", "grey_box", "--vehicle", "slocum", "--free", "hull.n_delta", "--free", "hull.n_r"]
    assert run("identify", folder / "glider.nc", "--out", out, *given) == 0
    assert "hull.n_delta" in capsys.readouterr().out
    truth, fitted = load_vehicle("slocum"), load_vehicle(out)
    assert fitted.hull.n_delta != truth.hull.n_delta
    assert fitted.hull.n_delta == pytest.approx(truth.hull.n_delta, rel=0.1)


def test_models_are_compared_over_a_record(folder, tmp_path, capsys):
    wrong = Polynomial(TRUTH.a, 1.2 * TRUTH.b, TRUTH.inputs, TRUTH.outputs, TRUTH.dt)
    save_model(TRUTH, tmp_path / "truth.npz")
    save_model(wrong, tmp_path / "wrong.npz")
    models = [tmp_path / "truth.npz", tmp_path / "wrong.npz"]
    assert run("compare", *models, "--record", folder / "test.nc", "--horizon", 1, "--horizon", 5) == 0
    said = capsys.readouterr().out
    assert "2 models over test.nc" in said
    assert "20 s" in said  # 5 samples ahead
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    out = tmp_path / "deep" / "out"
    assert run("compare", *models, "--record", folder / "test.nc", "--record", folder / "train.nc", "--out", out) == 0
    assert {p.name for p in out.iterdir()} == {"report.html", "scores.json"}
    found = json.loads((out / "scores.json").read_text())
    assert found["scores"]["truth"]["pitch_rad"]["rmse"] < found["scores"]["wrong"]["pitch_rad"]["rmse"]
    assert found["failed"] == {}
    assert set(found["horizons_s"]["truth"]["depth_m"]) == {"4.0", "12.0", "40.0", "120.0", "400.0"}


@pytest.mark.parametrize("more", [["{}"], ["--validate", "{}"]])
def test_a_record_that_is_given_twice_is_refused(folder, tmp_path, capsys, more):
    """Neither counts twice, nor is a model judged on what it was fitted to."""
    train, out = folder / "train.nc", tmp_path / "model.npz"
    again = [one.format(train) for one in more]
    assert run("identify", train, *again, "--out", out, "--method", "arx", *CHANNELS) == 1
    assert "was given twice" in " ".join(capsys.readouterr().err.split())
    assert not out.exists()


def test_bad_input_is_refused_in_words(folder, tmp_path, capsys):
    train, out = folder / "train.nc", tmp_path / "m.npz"
    save_model(TRUTH, tmp_path / "truth.npz")
    fast = Polynomial(TRUTH.a, TRUTH.b, TRUTH.inputs, TRUTH.outputs, 1.0)
    save_model(fast, tmp_path / "fast.npz")
    (tmp_path / "junk.npz").write_text("junk")
    arx = ["--method", "arx", "--out", out, *CHANNELS]
    cases = {
        ("identify", train, "--method", "arq", "--out", out): "Did you mean 'arx'",
        ("identify", train, "--method", "arx", "--out", out): "arx needs inputs",
        ("identify", train, *arx, "--set", "na=3"): "Did you mean 'n_a'",
        ("identify", train, *arx, "--set", "n_a"): "KEY=VALUE",
        ("identify", train, *arx, "--set", "foo=2"): "n_a (a whole number, a list of whole numbers or a list of lists",
        ("identify", train, *arx, "--set", "n_a=x"): "cannot take n_a = 'x': give a whole number, a list of",
        ("identify", train, *arx, "--free", "hull.n_r"): "no setting 'free'",
        ("identify", train, "--method", "arx", "--out", tmp_path / "m.toml", *CHANNELS): "ends in .npz",
        ("identify", train, "--method", "arx", "--out", tmp_path / "no" / "m.npz", *CHANNELS): "create it first",
        ("identify", train, "--method", "grey_box", "--out", tmp_path / "m.toml"): "grey_box needs a vehicle: give a",
        ("identify", tmp_path / "none.nc", *arx): "There is no file",
        ("identify", train, "--method", "arx", "--out", out, "--input", "rudder_rad", "--output", "pitch_rad"): (
            "no channel 'rudder_rad'"
        ),
        ("identify", train, *arx, "--resample", "200"): "at least 4 samples per coefficient",
        ("compare", tmp_path / "fast.npz", "--record", train): "fast has a time step of 1 s",
        ("compare", tmp_path / "fast.npz", tmp_path / "truth.npz", "--record", train): "fast 1 s, truth 4 s",
        ("compare", tmp_path / "junk.npz", "--record", train): "no .npz file",
        ("compare", tmp_path / "truth.npz", tmp_path / "truth.npz", "--record", train): "listed twice",
        ("compare", "slocum", "--record", train): "rudder_rad",
    }
    for arguments, words in cases.items():
        assert run(*arguments) == 1, arguments
        said = " ".join(capsys.readouterr().err.split())
        assert words in said, said
        assert not out.exists()
