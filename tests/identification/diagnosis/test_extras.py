"""Tests of extras of a diagnosis that fail: the result stays, and every file states what is missing."""

import json
from importlib import import_module

import numpy as np
import pytest

from auv_gym.cli import main
from auv_gym.model import Diverged
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.reading import read_record
from identification.diagnosis import diagnose, write_diagnosis
from identification.diagnosis.extras import Extras
from identification.diagnosis.judge import judging, remaining, scoring
from identification.experiments.heading_control import closed_loop
from identification.pages import diagnosis_figures as figures
from tests.identification.outline import Outline

diagnosing = import_module("identification.diagnosis.diagnose")  # the package gives its function this name


@pytest.fixture(scope="module")
def log():
    """A glider whose rudder sticks in a way that no effect is, so that all extras are asked for."""
    record = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(3), duration=600.0)
    unlike = 0.15 * np.sin(0.05 * record.time) ** 3 * np.cumsum(record["depth_m"] > np.median(record["depth_m"])) / 50.0
    return record.with_channels({"heading_rad": record["heading_rad"] + unlike})


def broken(*arguments, **settings):
    raise KeyError("heading_rad")


@pytest.fixture(scope="module")
def whole(log):
    """Its diagnosis."""
    return diagnose(log, load_vehicle("slocum"))


@pytest.fixture(scope="module")
def found(log):
    """Its diagnosis without any extra."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(judging, "closed_loop", broken)
        for name in ("residual_habitat", "discover"):
            monkeypatch.setattr(remaining, name, broken)
        monkeypatch.setattr(remaining, "_pushed", lambda bench, state: False)
        return diagnose(log, load_vehicle("slocum"))


def test_every_extra_may_fail_and_the_result_stays(whole, found):
    assert whole.verdict == "unexplained"
    assert whole.failures == ()
    assert whole.habitat is None  # random accelerations push this vehicle
    assert whole.loops
    assert found.verdict == whole.verdict
    assert found.unexplained
    assert [e.path for e in found.effects] == [e.path for e in whole.effects]
    assert found.after.scores == whole.after.scores
    assert {f.what for f in found.failures} == {
        "The closed loop with each model",
        "The search for a term that no effect is",
        "The description of what remains",
    }
    assert all("KeyError: 'heading_rad' (test_extras.py, line" in f.why for f in found.failures)


@pytest.mark.slow
def test_a_picture_that_cannot_be_drawn_is_said_on_the_page_and_in_the_file(found, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    drawn = figures.svg

    def svg(draw, d, name, label):
        return broken() if name == "growth" else drawn(draw, d, name, label)

    monkeypatch.setattr(figures, "svg", svg)
    paths = write_diagnosis(found, tmp_path)
    page, content = Outline(paths["report.html"].read_text()), json.loads(paths["diagnosis.json"].read_text())
    assert page.faults == []
    for what in ("The closed loop with each model", "The picture 'growth'"):
        assert f"{what} could not be made: KeyError: 'heading_rad'" in page.text
        assert what in [failure["what"] for failure in content["failures"]]
    assert "None" not in page.text


def test_without_a_page_the_other_files_are_there_and_an_old_page_is_not(whole, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    (tmp_path / "report.html").write_text("of an earlier diagnosis")
    monkeypatch.setattr("identification.pages.diagnosis_page._facts", broken)
    paths = write_diagnosis(whole, tmp_path)
    assert set(paths) == {"diagnosis.json", "vehicle.toml"}
    assert {p.name for p in tmp_path.iterdir()} == set(paths)
    content = json.loads(paths["diagnosis.json"].read_text())
    assert content["verdict"] == whole.verdict
    assert [failure["what"] for failure in content["failures"]] == ["The report"]


def test_a_refit_with_which_free_runs_diverge_leaves_the_vehicle_as_given_in_its_place(log, whole, monkeypatch):
    believed = load_vehicle("slocum")
    flown = scoring.free_runs

    def free_runs(plant, *arguments):
        if plant.hull.n_r != believed.hull.n_r:
            raise Diverged(12.0, "heading_rad", {"heading_rad": 7.0})
        return flown(plant, *arguments)

    monkeypatch.setattr(scoring, "free_runs", free_runs)
    found = diagnose(log, believed)
    assert found.before.scores == found.given.scores
    assert found.before.scores != whole.before.scores
    assert [f.what for f in found.failures] == [scoring.REFITTED]
    assert "heading_rad is not finite at 12.000 s" in found.failures[0].why


def test_where_free_runs_diverge_shorter_ones_are_judged(log, whole, monkeypatch):
    judge, lengths = diagnosing.judge, []

    def judged(checked, *arguments):
        lengths.append(checked.window)
        if len(lengths) < 3:
            raise Diverged(12.0, "heading_rad", {"heading_rad": 7.0})
        return judge(checked, *arguments)

    monkeypatch.setattr(diagnosing, "judge", judged)
    found = diagnose(log, load_vehicle("slocum"))
    assert found.window == pytest.approx(0.25 * whole.window)
    assert lengths == pytest.approx([whole.window, 0.5 * whole.window, 0.25 * whole.window])
    assert [e.path for e in found.effects] == [e.path for e in whole.effects]
    assert any(f"Free runs over {whole.window:g} s diverge" in note for note in found.record.notes)
    lengths.clear()
    monkeypatch.setattr(diagnosing.CheckedLog, "in_shorter_windows", lambda self: None)
    with pytest.raises(Diverged):
        diagnose(log, load_vehicle("slocum"))


def test_an_attempt_gives_what_was_made_or_the_substitute():
    extras = Extras()
    assert extras.attempt("One", lambda: 1, 0) == 1
    assert extras.attempt("Two", lambda: 1 // 0, 0) == 0
    assert extras.attempt("Two", lambda: int("two"), 0) == 0
    assert [f.what for f in extras.failures] == ["Two", "Two"]
    assert "ZeroDivisionError: integer division or modulo by zero (test_extras.py" in extras.failures[0].text
    assert "invalid literal" in extras.failures[1].why
    assert "test_extras" not in extras.failures[1].why


@pytest.mark.slow
def test_a_next_experiment_that_fails_leaves_the_files_and_says_so(tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    truth = replace_at(load_vehicle("slocum"), "effects.yaw.moment", 0.02)
    closed_loop(truth, rng=np.random.default_rng(1), duration=600.0, speed=0.35).save(tmp_path / "log.nc")
    monkeypatch.setattr("auv_gym.cli.diagnose.propose_experiments", broken)
    told = ["diagnose", str(tmp_path / "log.nc"), "--vehicle", "slocum", "--out", str(tmp_path / "out")]
    assert main([*told, "--next-experiment"]) == 0
    said = capsys.readouterr()
    assert "The next experiment could not be made: KeyError" in said.err
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"diagnosis.json", "vehicle.toml", "report.html"}
    assert "The next experiment" in (tmp_path / "out" / "diagnosis.json").read_text()


@pytest.mark.slow  # others diagnose ammonite each time
@pytest.mark.parametrize("name", ["ammonite", "amadeus", "sebastian"])
def test_every_bundled_log_is_diagnosed_without_options(name, tmp_path):
    pytest.importorskip("dbdreader", reason="the extra `slocum` is not installed")
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    try:
        read_record(f"slocum:{name}")
    except ValueError as error:
        pytest.skip(f"dbdreader cannot read its log here: {error}")
    out = tmp_path / "out"
    assert main(["diagnose", f"slocum:{name}", "--vehicle", "slocum", "--out", str(out)]) == 0
    assert {p.name for p in out.iterdir()} == {"diagnosis.json", "vehicle.toml", "report.html"}
    content = json.loads((out / "diagnosis.json").read_text())
    assert content["failures"] == []
    assert content["error"]["after"]["heading_rad"]["rmse"] > 0.0
    assert content["closed_loop"][0]["after"] is not None
