"""The study of policies trained on models: its statistics, its models, and a tiny run that goes on."""

import json

import gymnasium
import numpy as np
import pytest

from auv_gym.models.linear import StateSpace
from auv_gym.param import replace_at, value_at
from auv_gym.plant import Plant
from scripts.studies.harness import Found
from scripts.studies.rl import statistics, study
from scripts.studies.rl.models import model_of
from scripts.studies.rl.pictures import pictures
from scripts.studies.rl.scenarios import SCENARIOS, true_env
from scripts.studies.rl.statistics import compared, interquartile_mean, iqm, share_closed
from scripts.studies.rl.study import STUDY, seeds_of
from scripts.studies.rl.tables import by_scenario, gap_of, lines_of

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
    with pytest.raises(ValueError, match="believed is no model that is made of a log"):
        model_of(SCENARIOS["glider"], "believed", 0, tmp_path)
    assert STUDY.main(["--out", str(tmp_path), "--case", "glider, s_plane"]) == 1
    assert "No case is called 'glider, s_plane'" in capsys.readouterr().err
    assert seeds_of("glider, pid", range(3)) == range(1)  # a controller draws nothing
    assert seeds_of("glider, true", range(3)) == range(3)


def test_a_model_is_made_of_the_log_once(tmp_path, monkeypatch):
    found = model_of(SCENARIOS["glider"], "grey_box", 0, tmp_path)
    said = json.loads((tmp_path / "grey_box_seed_0.json").read_text())
    assert value_at(found, "hull.n_r") == said["hull.n_r"]["value"]
    monkeypatch.setattr("scripts.studies.rl.models.log_of", None)  # calling it would raise
    again = model_of(SCENARIOS["glider"], "grey_box", 0, tmp_path)
    assert isinstance(found, Plant)
    assert isinstance(again, Plant)
    assert np.array_equal(again.vector, found.vector)


@pytest.mark.slow  # a whole diagnosis
def test_the_diagnosis_is_told_the_log_and_the_believed_vehicle_alone(tmp_path):
    scenario = SCENARIOS["glider"]
    found = model_of(scenario, "diagnosed", 0, tmp_path)
    path, size = scenario.effect
    assert value_at(scenario.believed, path) == 0.0
    assert value_at(found, path) == pytest.approx(size, rel=0.05)  # its interval is 1 % wide


def test_a_tiny_study_goes_on_where_it_was_stopped(tmp_path, monkeypatch, capsys):
    pytest.importorskip("stable_baselines3", reason="the extra `rl` is not installed")
    monkeypatch.setattr(study, "PPO", TINY)
    monkeypatch.setattr(study, "CHOOSING", 2)
    begun = []
    train = study.train

    def stopped(training, folder):
        begun.append(folder.parent.name)
        if begun == ["true", "believed"]:
            raise KeyboardInterrupt
        return train(training, folder)

    monkeypatch.setattr(study, "train", stopped)
    cases = [f"glider, {row}" for row in ("true", "believed", "pid")]
    call = ["--out", str(tmp_path), "--steps", "128", "--episodes", "2", "--seeds", "1", "--case", *cases]
    with pytest.raises(KeyboardInterrupt):
        STUDY.main(call)
    assert STUDY.main(call) == 0
    assert begun == ["true", "believed", "believed"]
    assert "a constant yaw moment" in capsys.readouterr().out
    found = STUDY.find(range(1), cases, out=tmp_path, steps=128, episodes=2)
    lines = {line.row: line for line in lines_of(by_scenario(found), "glider")}
    assert {row: line.runs for row, line in lines.items()} == {"true": 1, "believed": 1, "pid": 1}
    assert lines["pid"].score.value > lines["true"].score.value  # of 128 steps of learning
    for picture in ("rl_intervals.png", "rl_curves.png", "rl_episodes_glider.png"):
        assert (tmp_path / picture).stat().st_size > 10_000
    assert STUDY.main([*call, "--episode-seed", "4"]) == 1
    assert "other settings" in capsys.readouterr().err


def test_a_plant_is_put_in_so_that_conditions_act_on_it():
    scenario = SCENARIOS["rov"]
    path, size = scenario.effect
    on, options = scenario.driven_by(scenario.truth)
    assert (on, options["effects"]) == ("true", {path: size})
    assert options["randomise"] == {name: [-0.22, 0.22] for name in scenario.conditions}
    # a current of the day of the log is not one of the days to come
    found = replace_at(scenario.truth, {"effects.current.north": 0.1, "hull.yaw.r_r": 1.1})
    assert scenario.driven_by(found)[1]["effects"] == {path: size, "hull.yaw.r_r": 1.1}
    with pytest.raises(ValueError, match="which act on a plant without a learned part, got StateSpace"):
        scenario.driven_by(StateSpace(np.eye(1), np.eye(1), np.eye(1), ("surge_N",), ("u_mps",), dt=scenario.dt))
    glider = SCENARIOS["glider"]
    assert glider.driven_by(glider.truth)[0] == glider.truth
    assert glider.settings == {"vehicle": "slocum", "dt": 4.0, **glider.options}


@pytest.mark.parametrize("name", ["rov", "flight"])
def test_episodes_of_all_rows_draw_the_same_currents(name):
    scenario = SCENARIOS[name]
    believed = gymnasium.make(scenario.env, **scenario.settings)
    drawn = [env.reset(seed=3)[1]["randomised"] for env in (true_env(scenario), believed)]
    assert drawn[0] == drawn[1]
    usual = gymnasium.make(scenario.env, **scenario.options).unwrapped.episodes.randomise
    assert {path: limits[1] for path, limits in scenario.conditions.items()} == pytest.approx(
        {path: limits[1] for path, limits in usual.items()},
        abs=0.005,  # the scenario's are rounded
    )
    assert set(scenario.ranges) > {*scenario.conditions, scenario.effect[0]}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rov", "flight"])
def test_a_tiny_study_in_currents_that_are_drawn(name, tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3", reason="the extra `rl` is not installed")
    imitate, duration = {"controller": "pid", "episodes": 1, "passes": 1}, 40.0 * SCENARIOS[name].dt
    tiny, told = {**TINY, "imitate": imitate, "train_env_kwargs": {"duration": duration}}, []
    monkeypatch.setattr(study, "CHOOSING", 2)
    monkeypatch.setattr(study, "EVALUATIONS", 1)
    monkeypatch.setattr(study, "learning_of", lambda scenario: told.append(scenario.shipped) or tiny)
    monkeypatch.setattr(study, "model_of", lambda scenario, *rest: scenario.truth)
    rows = ("true", "believed", "diagnosed", "randomised", "pid")
    cases = [f"{name}, {row}" for row in rows]
    found = STUDY.find(range(1), cases, out=tmp_path, steps=64, episodes=1)
    assert not found.failed
    assert told == [True] * 4
    lines = {line.row: line for line in lines_of(by_scenario(found), name)}
    assert set(lines) == set(rows)
    assert lines["diagnosed"].score.value == lines["true"].score.value  # the same plant and the same seed
    options = {
        row: json.loads((tmp_path / name / row / "seed_0" / "settings.json").read_text())["options"] for row in rows[:4]
    }
    assert options["true"]["effects"] == options["diagnosed"]["effects"] == dict([SCENARIOS[name].effect])
    assert "effects" not in options["believed"]
    assert options["true"]["randomise"] == options["believed"]["randomise"]
    assert options["randomised"]["randomise"].keys() > options["believed"]["randomise"].keys()
    for picture in ("intervals", "curves", f"episodes_{name}"):
        assert pictures(found)[f"rl_{picture}.png"]().axes


def test_a_run_that_fails_leaves_the_others(tmp_path, monkeypatch):
    def made(scenario, row, seed, folder):
        raise ValueError("the log does not excite it")

    monkeypatch.setattr(study, "model_of", made)
    found = STUDY.find(range(1), ["glider, armax", "glider, pid"], out=tmp_path, episodes=1)
    assert found.failed == {("glider, armax", 0): "the log does not excite it"}
    assert list(found.runs) == ["glider, pid"]


def test_a_share_is_told_only_where_something_is_lost():
    def found(**means):
        runs = {
            f"glider, {row}": {
                seed: {"returns": [mean - 1.0, mean + 1.0], "cut": 0, "seed": seed} for seed, mean in enumerate(of)
            }
            for row, of in means.items()
        }
        return Found(runs, {})

    lost = found(true=[-6.0] * 4, armax=[-7.0] * 4, believed=[-8.0] * 4)
    (armax,) = (line for line in lines_of(by_scenario(lost), "glider") if line.row == "armax")
    assert armax.closed is not None
    assert armax.closed.value == 0.5
    assert armax.cost is not None
    assert armax.cost.value == pytest.approx(7.0 / 6.0)
    even = found(true=[-6.0] * 4, armax=[-7.0] * 4, believed=[-5.0, -7.0] * 2)
    assert gap_of(by_scenario(even), "glider").low <= 0.0
    assert all(line.closed is None for line in lines_of(by_scenario(even), "glider"))
    assert ["(b) ARMAX", "4", "-7.00", "1.17", "", "0"] in STUDY.sheets(even)[0].rows
