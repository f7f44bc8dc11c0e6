"""The study of policies trained on models: its statistics, its models, and a tiny run that goes on."""

import json

import numpy as np
import pytest

from auv_gym.param import value_at
from auv_gym.plant import Plant
from scripts.rl import runs, settings, statistics
from scripts.rl.models import model_of
from scripts.rl.settings import SETTINGS, Study
from scripts.rl.statistics import compared, interquartile_mean, iqm, share_closed
from scripts.rl.tables import gap_of, gathered, lines_of, write_tables
from scripts.rl_study import main, wanted

TINY = {"n_envs": 4, "n_steps": 16, "batch_size": 64, "n_epochs": 1, "learning_rate": 1e-3}


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_the_interquartile_mean_leaves_out_a_quarter_at_either_end():
    assert interquartile_mean(np.array([100.0, 1.0, 2.0, -50.0])) == 1.5
    # of five, one and a quarter go at either end: 0.75 of the second and of the fourth stay
    assert interquartile_mean(np.array([0.0, 1.0, 2.0, 4.0, 100.0])) == pytest.approx((0.75 + 2.0 + 3.0) / 2.5)
    assert interquartile_mean(np.array([3.0])) == 3.0


def test_the_interval_holds_the_truth_about_as_often_as_it_says(rng, monkeypatch):
    monkeypatch.setattr(statistics, "RESAMPLES", 400)
    inside = 0
    for _ in range(300):
        found = iqm([rng.normal(size=10), rng.normal(size=10)], rng)
        inside += found.low <= 0.0 <= found.high
    assert 0.87 < inside / 300 < 0.98  # a percentile bootstrap of 20 runs is a little narrow; 300 draws: +- 0.03


def test_strata_are_resampled_apart(rng):
    # each stratum has one value: whatever is drawn within them, the mean of both stays
    found = iqm([np.full(5, -1.0), np.full(5, 1.0)], rng)
    assert (found.value, found.low, found.high) == (0.0, 0.0, 0.0)
    mixed = iqm([np.repeat([-1.0, 1.0], 5)], rng)
    assert mixed.low < -0.4
    assert mixed.high > 0.4


def test_the_share_of_a_gap(rng):
    true, believed = np.full(5, -6.0), np.full(5, -10.0)
    found = compared([true, believed, np.full(5, -7.0)], share_closed, rng)
    assert (found.value, found.low, found.high) == (0.75, 0.75, 0.75)
    unsure = compared([true, believed, np.linspace(-8.0, -6.0, 5)], share_closed, rng)
    assert unsure.low < unsure.value == 0.75 < unsure.high
    with pytest.raises(ValueError, match="one finite score or more"):
        iqm([np.array([1.0, np.nan])], rng)


def test_rows_refuse_what_they_lack(tmp_path, capsys):
    with pytest.raises(ValueError, match=r"slocum in .* has no row 'ls_svm'"):
        model_of(SETTINGS["glider"], "ls_svm", 0, tmp_path)
    with pytest.raises(ValueError, match="believed is no model that is made of a log"):
        model_of(SETTINGS["glider"], "believed", 0, tmp_path)
    with pytest.raises(ValueError, match="glider have no row 'ls_svm'"):
        wanted(["glider"], ["ls_svm"], range(2))
    with pytest.raises(ValueError, match="has no row 's_plane'"):
        runs.work("glider", "s_plane", 0, tmp_path, Study())
    assert main(["--out", str(tmp_path), "--setting", "glider", "--only", "s_plane"]) == 1
    assert "no row 's_plane'" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["--out", str(tmp_path), "--seeds", "0"])


def test_seeds_come_one_after_the_other_and_controllers_once():
    tasks = wanted(["glider"], ["true", "pid"], range(3))
    assert tasks == [("glider", "true", 0), ("glider", "pid", 0), ("glider", "true", 1), ("glider", "true", 2)]


def test_a_model_is_made_of_the_log_once(tmp_path, monkeypatch):
    found = model_of(SETTINGS["glider"], "grey_box", 0, tmp_path)
    said = json.loads((tmp_path / "grey_box_seed_0.json").read_text())
    assert value_at(found, "hull.n_r") == said["hull.n_r"]["value"]
    monkeypatch.setattr("scripts.rl.models.log_of", None)  # calling it would raise
    again = model_of(SETTINGS["glider"], "grey_box", 0, tmp_path)
    assert isinstance(found, Plant)
    assert isinstance(again, Plant)
    assert np.array_equal(again.vector, found.vector)


def test_the_diagnosis_is_told_the_log_and_the_believed_vehicle_alone(tmp_path):
    setting = SETTINGS["glider"]
    found = model_of(setting, "diagnosed", 0, tmp_path)
    path, size = setting.effect
    assert value_at(setting.believed, path) == 0.0
    assert value_at(found, path) == pytest.approx(size, rel=0.05)  # its interval is 1 % wide


def test_a_tiny_study_goes_on_where_it_was_stopped(tmp_path, monkeypatch, capsys):
    pytest.importorskip("stable_baselines3", reason="the extra `rl` is not installed")
    monkeypatch.setattr(settings, "PPO", TINY)
    monkeypatch.setattr(runs, "CHOOSING", 2)
    monkeypatch.setattr("scripts.rl_study.all_of", lambda work, tasks, *rest: [work(*task) for task in tasks])
    begun = []
    train = runs.train

    def stopped(training, folder):
        begun.append(folder.parent.name)
        if begun == ["true", "believed"]:
            raise KeyboardInterrupt
        return train(training, folder)

    monkeypatch.setattr(runs, "train", stopped)
    call = ["--out", str(tmp_path), "--setting", "glider", "--steps", "128", "--episodes", "2", "--seeds"]
    with pytest.raises(KeyboardInterrupt):
        main([*call, "1", "--only", "true", "believed", "pid"])
    assert main([*call, "1", "--only", "true", "believed", "pid"]) == 0
    assert begun == ["true", "believed", "believed"]
    assert "a constant yaw moment" in capsys.readouterr().out
    told = json.loads((tmp_path / "results.json").read_text())["glider"]
    assert {row: of["runs"] for row, of in told["rows"].items()} == {"true": 1, "believed": 1, "pid": 1}
    assert told["rows"]["pid"]["return"]["iqm"] > told["rows"]["true"]["return"]["iqm"]  # of 128 steps of learning
    for picture in ("rl_intervals.png", "rl_curves.png", "rl_episodes_glider.png"):
        assert (tmp_path / picture).stat().st_size > 10_000
    assert main([*call, "1", "--only", "true", "--seed", "4"]) == 1
    assert "other settings" in capsys.readouterr().err


def test_a_run_that_fails_leaves_the_others(tmp_path, monkeypatch, capsys):
    def made(setting, row, seed, folder):
        raise ValueError("the log does not excite it")

    monkeypatch.setattr(runs, "model_of", made)
    monkeypatch.setattr("scripts.rl_study.all_of", lambda work, tasks, *rest: [work(*task) for task in tasks])
    call = ["--out", str(tmp_path), "--setting", "glider", "--seeds", "1", "--episodes", "1", "--no-pictures"]
    assert main([*call, "--only", "armax", "pid"]) == 1
    told = capsys.readouterr().out
    assert "glider, armax, seed 0: the log does not excite it" in told
    assert "PID" in told


def test_a_share_is_told_only_where_something_is_lost(tmp_path):
    def kept(row, *means):
        for seed, mean in enumerate(means):
            path = tmp_path / "glider" / row / f"seed_{seed}.json"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps({"returns": [mean - 1.0, mean + 1.0], "cut": 0, "seed": seed}))

    kept("true", -6.0, -6.0, -6.0, -6.0)
    kept("armax", -7.0, -7.0, -7.0, -7.0)
    kept("believed", -8.0, -8.0, -8.0, -8.0)
    found = gathered(tmp_path, range(4))
    (armax,) = (line for line in lines_of(found, "glider") if line.row == "armax")
    assert armax.closed is not None
    assert armax.closed.value == 0.5
    assert armax.cost is not None
    assert armax.cost.value == pytest.approx(7.0 / 6.0)
    kept("believed", -5.0, -7.0, -5.0, -7.0)
    found = gathered(tmp_path, range(4))
    assert gap_of(found, "glider").low <= 0.0
    assert all(line.closed is None for line in lines_of(found, "glider"))
    write_tables(found, tmp_path)
    assert "| (b) ARMAX | 4 | -7.00 | 1.17 |  | 0 |" in (tmp_path / "results.md").read_text()
