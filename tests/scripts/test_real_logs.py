"""The table of measured logs: what it says of a diagnosis, what is left out, and what is kept."""

import json

from scripts import real_logs
from scripts.real_logs import HEADS, Log, main, row_of
from scripts.studies.harness import Sheet

SAID = {
    "verdict": "tied",
    "unexplained": True,
    "tied": [["effects.rudder.offset", "effects.yaw.moment"]],
    "effects": [
        {"path": "effects.rudder.offset", "value": 0.1, "ci95": [0.09, 0.11], "unit": "rad", "frequency": 0.7},
        {"path": "effects.rudder.gain", "value": 0.8, "ci95": [0.7, 0.9], "unit": "1", "frequency": None},
    ],
    "error": {
        stage: {"heading_rad": {"rmse": rmse}} for stage, rmse in (("as_given", 0.3), ("before", 0.2), ("after", 0.1))
    },
    "seconds": {"judging": 2.0, "searching effects": 10.4},
    "samples": 1200,
}


def test_a_row_says_verdict_effects_ties_errors_and_time():
    name, samples, verdict, effects, sizes, seconds = row_of(Log("a log", "slocum"), SAID)
    assert (name, samples, verdict, seconds) == ("a log", "1200", "tied, something left", "12")
    first, second = effects.split("; ")
    assert first == "`effects.rudder.offset` 5.73 deg (5.16 to 6.3 deg), 70 %, or `effects.yaw.moment`"
    assert second == "`effects.rudder.gain` 0.8 (0.7 to 0.9)"
    assert sizes == "heading 17.2 deg, 11.5 deg, 5.73 deg"


def test_logs_that_are_not_there_are_left_out_and_kept_diagnoses_are_not_made_again(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(real_logs, "LOGS", (Log("one, two", "slocum"), Log("three", "slocum", "three.csv")))
    monkeypatch.setattr(real_logs, "diagnosed", lambda log, data: SAID)
    assert main(["--out", str(tmp_path)]) == 0
    assert "three is left out" in capsys.readouterr().err
    table = Sheet("", "Measured logs", HEADS, [row_of(Log("one, two", "slocum"), SAID)]).markdown()
    assert (tmp_path / "real_logs.md").read_text() == table
    kept = tmp_path / "one_two.json"
    kept.write_text(json.dumps(SAID | {"samples": 7}))
    assert main(["--out", str(tmp_path), "--only", "one"]) == 0
    assert "| one, two | 7 |" in capsys.readouterr().out
