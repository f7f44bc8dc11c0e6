"""The study of slips: what it counts and prints."""

import json

from auv_gym.plant import load_vehicle
from identification.diagnosis.log.slips import slips_of
from scripts.slip_study import Attempt, attempt, log_of, main

MIRRORED = "rudder"


def test_a_slip_is_right_if_named_and_a_clean_log_if_not_doubted():
    assert Attempt("slocum", 1, "", ()).right
    assert not Attempt("slocum", 1, "", (MIRRORED,)).right
    assert Attempt("slocum", 1, MIRRORED, ("other", MIRRORED)).right
    assert not Attempt("slocum", 1, MIRRORED, ()).right


def test_an_attempt_makes_the_slip_in_a_log():
    plant = load_vehicle("slocum")
    record = log_of(plant)
    (slip,) = (s for s in slips_of(record, plant) if s.text.startswith("the rudder acts"))
    found = attempt("slocum", 1, record, slip)
    assert found.right
    assert found.doubts[0] == slip.text
    assert attempt("slocum", 1, record, None).right


def test_the_program_prints_a_table_or_json(monkeypatch, capsys):
    def unnoticed(vehicle, seed, record, slip):
        return Attempt(vehicle, seed, slip.text if slip else "", ())

    monkeypatch.setattr("scripts.slip_study.attempt", unnoticed)
    assert main(["--vehicle", "mermaid", "--jobs", "1"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "0 of 11" in printed
    assert "time runs at half" in printed
    assert main(["--vehicle", "mermaid", "--jobs", "1", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["right"] for row in rows] == [True] + [False] * 11


def test_nothing_to_do_is_refused(capsys):
    assert main(["--seeds", "0"]) == 1
    assert "at least 1, got 0" in capsys.readouterr().err
