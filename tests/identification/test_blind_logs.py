"""Tests of the blind study: the truth is kept separate, and verdicts are judged correctly."""

import json

import pytest

from auv_gym.param import list_paths, spec_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from scripts.blind.kinds import kind_of
from tests.identification.blind_logs import CLEAN, VEHICLES, effects_of, judge, study, write_log


def written(folder, truth, verdict, effects, tied=(), detectable=()):
    named = [{"path": path} for path in effects]
    content = {"verdict": verdict, "effects": named, "tied": list(tied), "detectable": list(detectable)}
    (folder / "truth.json").write_text(json.dumps(truth))
    (folder / "verdict.json").write_text(json.dumps(content))
    return judge(folder)


def test_the_log_does_not_tell_the_truth(tmp_path):
    write_log(tmp_path, "slocum", "effects.rudder.offset", 3)
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert truth["effect"] == "effects.rudder.offset"
    assert abs(truth["value"]) == pytest.approx(0.03)
    record = Record.load(tmp_path / "log.nc")
    assert "offset" not in str(record.attrs)
    assert record.duration_s == 600.0


def test_a_right_name_a_tie_a_false_name_and_silence_are_told_apart(tmp_path):
    truth = {"effect": "effects.yaw.moment", "value": 0.012}
    assert written(tmp_path, truth, "named", ["effects.yaw.moment"])["right"]
    tie = written(tmp_path, truth, "tied", ["effects.rudder.offset"], [["effects.rudder.offset", "effects.yaw.moment"]])
    assert tie["right"]
    assert tie["beside"] == []
    false = written(tmp_path, truth, "named", ["effects.rudder.lag"])
    assert not false["right"]
    assert false["beside"] == ["effects.rudder.lag"]
    clean = {"effect": CLEAN, "value": None}
    assert written(tmp_path, clean, "none", [])["right"]
    assert not written(tmp_path, clean, "named", ["effects.rudder.lag"])["right"]
    assert not written(tmp_path, clean, "unexplained", [])["right"]


def test_the_study_covers_every_effect_of_the_family():
    paths = set(effects_of("slocum"))
    assert len(paths) == 20
    assert paths == set(effects_of("ganeshblue"))


def test_what_no_log_shows_is_right_if_nothing_is_named_or_claimed(tmp_path):
    truth = {"effect": "effects.depth.bias", "value": 0.15, "change": 0.15, "hidden": True}
    unseen, claimed = ({"path": "effects.depth.bias", "size": size} for size in (None, 0.05))
    assert written(tmp_path, truth, "none", [], detectable=[unseen])["right"]
    assert not written(tmp_path, truth, "none", [], detectable=[claimed])["right"]
    assert not written(tmp_path, truth, "named", ["effects.depth.lag"], detectable=[unseen])["right"]


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_every_probed_effect_is_in_the_study_or_has_a_reason_not_to_be(vehicle):
    plant = load_vehicle(vehicle)
    probed = {p for p in list_paths(plant) if p.startswith("effects.") and spec_at(plant, p).probe > 0.0}
    hidden = kind_of(plant).hidden
    assert set(effects_of(vehicle)) | set(hidden) == probed
    assert not set(effects_of(vehicle)) & set(hidden)
    assert all(len(reason) > 10 for reason in hidden.values())


@pytest.mark.parametrize("vehicle, channel", [("qiandao_float", "piston_m"), ("mermaid", "oil_volume_m3")])
def test_logs_of_floats_hold_what_they_need(tmp_path, vehicle, channel):
    write_log(tmp_path, vehicle, CLEAN, 0)
    record = Record.load(tmp_path / "log.nc")
    assert record.has("temperature_C")
    assert len(set(record[channel])) > 3
    assert record.duration_s >= 2390.0
    assert json.loads((tmp_path / "truth.json").read_text())["value"] is None


def named(vehicle, effects, seeds):
    rows = study([vehicle], effects, seeds, jobs=1)
    return {row["effect"]: row["right"] / row["logs"] for row in rows}


@pytest.mark.slow
@pytest.mark.parametrize("effect", [CLEAN, "effects.depth.lag"])
def test_effects_of_a_float_with_a_piston_are_named(effect):
    assert named("qiandao_float", [effect], [0]) == {effect: 1.0}


@pytest.mark.slow
@pytest.mark.parametrize("effect", [CLEAN, "effects.volume.compressibility"])
def test_effects_of_a_float_with_oil_are_named(effect):
    assert named("mermaid", [effect], [0]) == {effect: 1.0}


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", ["qiandao_float", "mermaid"])
def test_every_effect_of_a_float_is_named(vehicle):
    shares = named(vehicle, [CLEAN, *effects_of(vehicle)], range(4))
    assert shares[CLEAN] == 1.0
    assert {effect: share for effect, share in shares.items() if share < 0.75} == {}
