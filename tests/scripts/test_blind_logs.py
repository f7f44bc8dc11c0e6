"""The blind study: the truth is kept apart, and judged as it says."""

import json

import pytest

from auv_gym.record import Record
from scripts.blind_logs import CLEAN, effects_of, judge, main, write_log


def written(folder, truth, verdict, effects, tied=()):
    named = [{"path": p, "ci95": ci} for p, ci in effects.items()]
    content = {"verdict": verdict, "effects": named, "tied": list(tied)}
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
    right = written(tmp_path, truth, "named", {"effects.yaw.moment": [0.01, 0.014]})
    assert right["right"]
    assert right["exact"]
    assert right["covered"]
    tie = written(
        tmp_path, truth, "tied", {"effects.rudder.offset": [0, 1]}, [["effects.rudder.offset", "effects.yaw.moment"]]
    )
    assert tie["right"]
    assert not tie["exact"]
    assert tie["beside"] == []
    false = written(tmp_path, truth, "named", {"effects.rudder.lag": [1, 2]})
    assert not false["right"]
    assert false["beside"] == ["effects.rudder.lag"]
    clean = {"effect": CLEAN, "value": None}
    assert written(tmp_path, clean, "none", {})["right"]
    assert not written(tmp_path, clean, "named", {"effects.rudder.lag": [1, 2]})["right"]
    assert not written(tmp_path, clean, "unexplained", {})["right"]


def test_the_program_prints_a_row_for_each_effect(tmp_path, capsys):
    out = tmp_path / "rows.json"
    assert main(["--vehicle", "slocum", "--effect", CLEAN, "--seeds", "2", "--jobs", "1", "--json", str(out)]) == 0
    assert "right   2 / 2" in capsys.readouterr().out
    (row,) = json.loads(out.read_text())
    assert row["logs"] == row["right"] == 2


def test_the_study_covers_every_effect_of_the_family():
    paths = set(effects_of("slocum"))
    assert len(paths) == 18
    assert paths == set(effects_of("ganeshblue"))
