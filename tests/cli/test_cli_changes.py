"""`auv-gym compare-missions`, `auv-gym onset` and `auv-gym monitor`."""

import json

import numpy as np
import pytest

from auv_gym.cli import main
from auv_gym.cli.compare_missions import spread
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.experiments.float_dives import oil_mission
from identification.experiments.heading_control import closed_loop
from scripts.blind.changing import Changing


def test_with_takes_all_logs_that_follow():
    args = ["a", "b", "--with", "c", "d", "--out", "x", "e"]
    assert spread(args) == ["a", "b", "--with", "c", "--with", "d", "--out", "x", "e"]


def test_sides_are_given_once_and_each_mission_on_one(tmp_path, capsys):
    common = ["compare-missions", "a.csv", "--vehicle", "slocum", "--out", str(tmp_path)]
    assert main(common) == 1
    assert main([*common, "--with", "b.csv", "--series"]) == 1
    assert main([*common, "--with", "a.csv"]) == 1
    told = " ".join(capsys.readouterr().err.split())
    assert "Give the later missions after --with, or add --series" in told
    assert "--series takes all missions in order: leave --with out" in told
    assert "leave out a.csv on one side" in told


@pytest.fixture(scope="module")
def dives(tmp_path_factory):
    """Two logs of a glider that overlap by 40 s, four others, and one of another vehicle."""
    folder, plant = tmp_path_factory.mktemp("dives"), load_vehicle("slocum")
    names, begins = ("first", "second", "third", "fourth", "fifth", "sixth"), (0.0, 560.0, 2e3, 1e3, 1e8, 2e8)
    for seed, (name, begin) in enumerate(zip(names, begins, strict=True)):
        record = closed_loop(plant, rng=np.random.default_rng(seed), duration=600.0)
        record.with_notes([], start_epoch_s=1.4e9 + begin).save(folder / f"{name}.nc")
    oil_mission(load_vehicle("mermaid"), (300.0, 500.0), rng=np.random.default_rng(1)).save(folder / "float.nc")
    return folder


def refused(capsys, *given):
    """What a command says that ends in an error."""
    code = main([str(one) for one in given])
    assert code in (1, 2)
    return " ".join(capsys.readouterr().err.split())


def test_what_cannot_be_compared_is_refused_in_words(dives, tmp_path, capsys):
    first, second, third, fourth, other = (dives / f"{n}.nc" for n in ("first", "second", "third", "fourth", "float"))
    common = ("--vehicle", "slocum", "--out", tmp_path)
    told = refused(capsys, "compare-missions", first, "--with", *common)
    assert "--with needs at least one later mission, got none" in told
    told = refused(capsys, "compare-missions", first, "--with", second, *common)
    assert "Missions of one vehicle cannot overlap in time" in told
    assert "begins 40 s before" in told
    told = refused(capsys, "compare-missions", first, third, first, "--with", fourth, *common)
    assert "given twice: " in told
    told = refused(capsys, "compare-missions", first, "--series", *common)
    assert "A trend needs at least 4 missions, one after the other, got 1" in told
    later = [dives / f"{n}.nc" for n in ("fifth", "sixth")]
    told = refused(capsys, "compare-missions", first, third, fourth, *later, "--series", *common)
    assert "A series needs its missions in order of time" in told
    assert "fourth.nc began before" in told
    told = refused(capsys, "compare-missions", first, "--with", third, "--scheduler", "tcp://127.0.0.1:9", *common)
    assert "--scheduler is for a series of missions: add --series" in told
    told = refused(capsys, "compare-missions", first, "--with", third, "--jobs", "4", *common)
    assert "--jobs is for a series of missions: add --series" in told
    told = refused(capsys, "compare-missions", first, "--with", other, *common)
    assert "float.nc: The record has no channel 'heading_rad'" in told
    told = refused(capsys, "compare-missions", other, "--with", first, *common)
    assert "float.nc: The record has no channel 'heading_rad'" in told


def test_logs_that_hold_the_same_are_refused(dives, tmp_path, capsys):
    first, copy = dives / "first.nc", tmp_path / "copy.nc"
    Record.load(first).with_notes([], start_epoch_s=1.7e9).save(copy)
    common, third = ("--vehicle", "slocum", "--out", tmp_path / "out"), dives / "third.nc"
    told = f"{first} and {copy} hold the same samples, which would count as twice the evidence"
    assert told in refused(capsys, "compare-missions", first, "--with", copy, *common)
    assert told in refused(capsys, "compare-missions", first, third, copy, dives / "fourth.nc", "--series", *common)
    assert told in refused(capsys, "onset", first, copy, *common)
    assert told in refused(capsys, "monitor", first, "--clean", copy, *common)
    assert f"{first} was given twice" in refused(capsys, "monitor", first, "--clean", first, *common)
    assert f"{first} was given twice" in refused(capsys, "diagnose", first, first, *common)
    assert not (tmp_path / "out").exists()


def test_onset_and_monitor_refuse_the_log_of_another_vehicle_and_a_rate_that_is_none(dives, tmp_path, capsys):
    common = ("--vehicle", "slocum", "--out", tmp_path)
    for command in ("onset", "monitor"):
        assert "no channel 'heading_rad'" in refused(capsys, command, dives / "float.nc", *common)
    told = refused(capsys, "monitor", dives / "first.nc", "--clean", dives / "float.nc", *common)
    assert "no channel 'heading_rad'" in told
    told = refused(capsys, "monitor", dives / "first.nc", *common)
    assert told.endswith("The clean log was the first quarter of the log; --clean LOG gives another.")
    for rate in ("0", "-1", "nan"):
        told = refused(capsys, "monitor", dives / "first.nc", "--rate", rate, *common)
        assert f"from 1e-06 to 10000 is needed, got {rate}" in told


@pytest.mark.slow
def test_missions_without_a_change_and_a_log_without_an_onset(tmp_path, capsys):
    plant, files = load_vehicle("slocum"), []
    for seed in range(2):
        files.append(str(tmp_path / f"m{seed}.nc"))
        closed_loop(plant, rng=np.random.default_rng(seed), duration=600.0).save(files[-1])
    out = tmp_path / "out"
    assert main(["compare-missions", files[0], "--with", files[1], "--vehicle", "slocum", "--out", str(out)]) == 0
    assert "No change was found between these missions." in capsys.readouterr().out
    assert json.loads((out / "changes.json").read_text())["changed"] == []
    assert main(["onset", files[0], "--vehicle", "slocum", "--out", str(out)]) == 0
    assert "no known effect is missing at any time" in capsys.readouterr().out
    assert json.loads((out / "onset.json").read_text())["found"] == []


@pytest.mark.slow
def test_a_monitor_raises_an_alarm_and_names_what_went_wrong(tmp_path, capsys):
    plant, out = load_vehicle("slocum"), tmp_path / "out"
    bent = replace_at(plant, "effects.rudder.offset", 0.03)
    moving = Changing.glider(plant, lambda t: bent if t >= 800.0 else plant)
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
