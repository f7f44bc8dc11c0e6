"""`auv-gym tune`: gains that are written, judged, loaded again, and refused in words."""

import json

import pytest

from auv_gym import load_vehicle
from auv_gym.cli import main
from controllers.autopilots import autopilot
from controllers.gains import gains_for, read_gains, write_gains

QUICK = ("--evaluations", "4", "--draws", "2")


@pytest.mark.slow
def test_gains_are_tuned_judged_and_loaded_and_a_page_is_written(tmp_path, capsys):
    out, page, found = tmp_path / "gains.toml", tmp_path / "tune.html", tmp_path / "diagnosis.json"
    write_gains([gains_for("slocum", 4.0)], out)
    size = {"path": "effects.rudder.offset", "value": 0.03, "ci95": [0.01, 0.05]}
    found.write_text(json.dumps({"effects": [size], "coefficients": []}))
    given = ["tune", "ganeshblue", "--out", str(out), "--report", str(page), "--uncertain", str(found), *QUICK]
    assert main(given) == 0
    said = capsys.readouterr().out
    over = "the vehicle itself and 3 vehicles drawn from the 95 % intervals of 1 parameter."
    assert f"All requirements are met on {over}" in said
    assert [entry.vehicle for entry in read_gains(out)] == ["ganeshblue", "slocum"]
    assert autopilot(load_vehicle("ganeshblue"), gains=out)
    text = page.read_text(encoding="utf-8")
    assert "effects.rudder.offset" in text
    assert "sensitivity peak" in text
    assert text.count("<svg") == 1


def test_a_requirement_that_is_not_met_is_exit_code_1_and_gains_of_ones_own_are_only_judged(tmp_path, capsys):
    out, mine = tmp_path / "gains.toml", tmp_path / "mine.toml"
    write_gains([gains_for("slocum", 4.0)], mine)
    given = ["tune", "slocum", "--out", str(out), "--gains", str(mine), "--evaluations", "0", "--draws", "0"]
    assert main([*given, "--require", "phase_margin_deg>=80", "--require", "heading_rad.settling_s<=5000"]) == 1
    said = capsys.readouterr().out
    assert "Some requirements are not met: phase margin ≥ 80 deg in the heading loop (met on 0 of 1 vehicles)." in said
    assert "To meet them, allow more evaluations or relax the requirement, or narrow the intervals." in said
    assert "rudder effectiveness N_dr (hull.n_delta), 0.0000791 to 0.000612" in said
    assert "FAIL" in said
    assert "pass" in said
    assert read_gains(out)[0].loops == read_gains(mine)[0].loops


def test_an_unexplained_log_and_the_worst_vehicle_are_told_in_the_output_the_page_and_the_file(tmp_path, capsys):
    out, page, found = tmp_path / "gains.toml", tmp_path / "tune.html", tmp_path / "diagnosis.json"
    size = {"path": "effects.rudder.offset", "value": 0.03, "ci95": [0.01, 0.05]}
    found.write_text(json.dumps({"verdict": "unexplained", "effects": [size]}))
    given = ["tune", "slocum", "--out", str(out), "--report", str(page), "--uncertain", str(found)]
    main([*given, "--evaluations", "0", "--draws", "2"])
    notes = read_gains(out)[0].notes["pid"]
    warning = "The diagnosis did not explain its log"
    for text in (capsys.readouterr().out, page.read_text(encoding="utf-8"), "\n".join(notes)):
        assert f"Warning: {warning}" in text
        assert "orst vehicle" in text
    assert "effects.rudder.offset = 0.0" in notes[-1]
    assert "95 % interval drawn from" in page.read_text(encoding="utf-8")
    main(["tune", "slocum", "--out", str(out), "--kind", "gpc", "--evaluations", "0", "--draws", "0"])
    assert read_gains(out)[0].notes["pid"] == notes  # those of another kind stay


@pytest.mark.parametrize("kind", ["pid", "gpc"])
def test_the_oil_volume_of_a_float_is_tuned(kind, tmp_path):
    given = ["tune", "mermaid", "--kind", kind, "--out", str(tmp_path / "gains.toml")]
    assert main([*given, "--evaluations", "0", "--draws", "0"]) in (0, 1)
    assert [entry.vehicle for entry in read_gains(tmp_path / "gains.toml")] == ["mermaid"]


@pytest.mark.parametrize("vehicle", ["seaglider", "seawing"])
def test_a_vehicle_without_gains_is_refused_with_those_that_have_some(vehicle, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("auv_gym.cli.options.console.errors.width", 400)
    assert main(["tune", vehicle, "--out", str(tmp_path / "gains.toml")]) == 1
    said = capsys.readouterr().err
    assert f"Gains cannot be tuned for '{vehicle}', whose autopilot follows from its model and needs no gains" in said
    assert "remus100, slocum, vt690" in said
    assert "module" not in said


@pytest.mark.parametrize(
    "more, words",
    [
        (("--require", "phase_margin>=45"), "No quantity 'phase_margin' in 'phase_margin>=45'. Did you mean"),
        (("--require", "phase_margin_deg<=45"), "phase_margin_deg needs >=, got 'phase_margin_deg<=45'"),
        (("--require", "depth_m.phase_margin_deg>=45"), "No loop 'depth_m' in"),
        (("--require", "fast"), "A requirement needs QUANTITY>=NUMBER"),
        (("--require", "phase_margin_deg"), "Put it in quotes, since > redirects in a shell"),
        (("--kind", "lqr"), "The kind of controller needs to be pid or gpc, got 'lqr'"),
        (("--uncertain", "nothing.json"), "There is no file nothing.json"),
    ],
)
def test_what_cannot_be_is_refused_in_words(more, words, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("auv_gym.cli.options.console.errors.width", 250)
    assert main(["tune", "slocum", "--out", str(tmp_path / "gains.toml"), *more]) == 1
    assert words in capsys.readouterr().err
    assert not (tmp_path / "gains.toml").exists()


def test_uncertain_parameters_of_another_vehicle_are_refused(tmp_path, capsys):
    found = tmp_path / "diagnosis.json"
    found.write_text(json.dumps({"coefficients": [{"path": "hull.wing", "value": 1.0, "ci95": [0.0, 2.0]}]}))
    assert main(["tune", "slocum", "--out", str(tmp_path / "gains.toml"), "--uncertain", str(found)]) == 1
    assert "is of another vehicle than 'slocum', which has no hull.wing" in " ".join(capsys.readouterr().err.split())
