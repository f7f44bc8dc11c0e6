"""The study of slips: what it counts and prints."""

import json

from auv_gym.plant import load_vehicle
from identification.diagnosis.slips import slips_of
from scripts.slip_study import Attempt, attempt, log_of, main

MIRRORED = "rudder"


def test_a_slip_is_right_if_named_and_a_clean_log_if_not_doubted():
    assert Attempt("slocum", 1, "", ()).right
    assert not Attempt("slocum", 1, "", (MIRRORED,)).right
    assert Attempt("slocum", 1, MIRRORED, ("other", MIRRORED)).right
    assert not Attempt("slocum", 1, MIRRORED, ()).right


def test_an_attempt_makes_the_slip_in_a_log_of_the_seed():
    plant = load_vehicle("slocum")
    texts = [slip.text for slip in slips_of(log_of(plant), plant)]
    (text,) = (t for t in texts if t.startswith("the rudder acts"))
    found = attempt("slocum", 1, text)
    assert found.right
    assert found.doubts[0] == text
    assert attempt("slocum", 1, "").right


def test_the_program_prints_a_table_or_json(monkeypatch, capsys):
    monkeypatch.setattr("scripts.slip_study.attempt", lambda vehicle, seed, text: Attempt(vehicle, seed, text, ()))
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
