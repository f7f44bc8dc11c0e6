"""`auv-gym compare-missions`, `auv-gym onset` and `auv-gym monitor`."""

import json

import numpy as np
import pytest

from auv_gym.cli import main
from auv_gym.cli.compare_missions import spread
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from identification.experiments.heading_control import closed_loop
from scripts.blind.changing import ChangingGlider


def test_with_takes_all_logs_that_follow():
    args = ["a", "b", "--with", "c", "d", "--out", "x", "e"]
    assert spread(args) == ["a", "b", "--with", "c", "--with", "d", "--out", "x", "e"]


def test_sides_are_given_once_and_each_mission_on_one(tmp_path, capsys):
    common = ["compare-missions", "a.csv", "--vehicle", "slocum", "--out", str(tmp_path)]
    assert main(common) == 1
    assert main([*common, "--with", "b.csv", "--series"]) == 1
    assert main([*common, "--with", "a.csv"]) == 1
    told = " ".join(capsys.readouterr().err.split())
    assert told.count("ask for trends with --series") == 2
    assert "leave out a.csv on one side" in told


@pytest.mark.slow
def test_missions_without_a_change_and_a_log_without_an_onset(tmp_path, capsys):
    plant, files = load_vehicle("slocum"), []
    for seed in range(2):
        files.append(str(tmp_path / f"m{seed}.nc"))
        closed_loop(plant, rng=np.random.default_rng(seed), duration=600.0).save(files[-1])
    out = tmp_path / "out"
    assert main(["compare-missions", files[0], "--with", files[1], "--vehicle", "slocum", "--out", str(out)]) == 0
    assert "These missions show no change." in capsys.readouterr().out
    assert json.loads((out / "changes.json").read_text())["changed"] == []
    assert main(["onset", files[0], "--vehicle", "slocum", "--out", str(out)]) == 0
    assert "Nothing is missing" in capsys.readouterr().out
    assert json.loads((out / "onset.json").read_text())["found"] == []


@pytest.mark.slow
def test_a_monitor_raises_an_alarm_and_names_what_went_wrong(tmp_path, capsys):
    plant, out = load_vehicle("slocum"), tmp_path / "out"
    bent = replace_at(plant, "effects.rudder.offset", 0.03)
    moving = ChangingGlider(plant, lambda t: bent if t >= 800.0 else plant)
    clean, log = str(tmp_path / "clean.nc"), str(tmp_path / "log.nc")
    closed_loop(plant, rng=np.random.default_rng(1), duration=2000.0).save(clean)
    closed_loop(moving, rng=np.random.default_rng(5), duration=1400.0).save(log)
    given = ["monitor", log, "--clean", clean, "--vehicle", "slocum", "--doubt", "0", "--out", str(out)]
    assert main(given) == 0
    assert "Around the first alarm, the diagnosis found:" in capsys.readouterr().out
    told = json.loads((out / "monitor.json").read_text())
    assert 800.0 < told["alarms"][0]["time"] < 1000.0
    first = told["timeline"]["found"][0]
    assert any(name.endswith("effects.rudder.offset") for name in (first["path"], *first["tied"]))
    assert "svg" in (out / "monitor.html").read_text()
