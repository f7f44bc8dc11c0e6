"""Frozen logs diagnosed again: what has changed is said, what has not is not, and a run goes on where it stopped."""

import json

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle, save_vehicle
from identification.diagnosis import as_json, diagnose
from identification.experiments.heading_control import closed_loop
from scripts.frozen_verdicts import brief, changes_of, main

BEFORE = {
    "verdict": "tied",
    "effects": {"effects.rudder.offset": [0.05, 0.04, 0.06], "effects.compass.lag": [3.0, 2.0, 4.0]},
    "tied": [["effects.rudder.offset", "effects.yaw.moment"]],
    "unexplained": False,
    "coefficients_wrong": [],
    "seconds": 1.0,
}


def test_nothing_is_said_of_sizes_within_a_tenth_of_their_interval():
    moved = {"effects.rudder.offset": [0.0519, 0.04, 0.06], "effects.compass.lag": [2.9, 2.0, 4.0]}
    assert changes_of(BEFORE, BEFORE | {"effects": moved, "seconds": 9.0}) == ()


def test_every_change_is_said():
    effects = {"effects.rudder.offset": [0.0525, 0.04, 0.06], "effects.rudder.gain": [0.8, 0.7, 0.9]}
    now = BEFORE | {"verdict": "named", "effects": effects, "tied": [], "unexplained": True}
    said = changes_of(BEFORE, now)
    assert said[:4] == ("tied -> named", "something is left", "gone: compass.lag", "new: rudder.gain")
    assert said[4].startswith("rudder.offset: 0.05 -> 0.0525 (0.1")
    assert said[5:] == ("tie gone: rudder.offset or yaw.moment",)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two cases, of which the second one's stored verdict is another than today's."""
    believed, root = load_vehicle("slocum"), tmp_path_factory.mktemp("frozen")
    for name, effects, verdict in (("00000", {}, None), ("00001", {"effects.rudder.offset": 0.05}, "unexplained")):
        case, truth = root / name, root / "truth" / name
        case.mkdir()
        truth.mkdir(parents=True)
        log = closed_loop(replace_at(believed, effects), rng=np.random.default_rng(0), duration=600.0)
        log.save(case / "log.nc")
        save_vehicle(believed, case / "vehicle.toml")
        (case / "frame.json").write_text('{"window": null, "settle": null}')
        said = as_json(diagnose(log, believed))
        (case / "verdict.json").write_text(json.dumps(said | ({"verdict": verdict} if verdict else {})))
        kind = {"number": int(name), "kind": "one" if effects else "none", "family": "glider", "vehicle": "slocum"}
        (truth / "truth.json").write_text(json.dumps({"case": kind, "effects": effects, "wrong": {}, "cause": ""}))
    return root


@pytest.mark.slow
def test_the_program_compares_keeps_and_writes(folder, tmp_path, capsys):
    out, kept = tmp_path / "out", tmp_path / "new.json"
    told = [str(folder), "--out", str(out), "--jobs", "1"]
    assert main([*told, "--write", str(kept)]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "1 of 2 cases as before." in said
    assert "unexplained ->" in said
    assert "now 2 of 2." in said
    stored = json.loads(kept.read_text())
    assert stored["00000"]["verdict"] == "none"
    assert stored["00001"] == brief(json.loads((folder / "00001" / "verdict.json").read_text())) | {
        "verdict": stored["00001"]["verdict"],
        "seconds": stored["00001"]["seconds"],
    }
    assert main([*told, "--baseline", str(kept)]) == 0
    (out / "00000.json").write_text(json.dumps(stored["00000"] | {"verdict": "named"}))  # what is there is kept
    assert main([*told, "--baseline", str(kept), "--case", "00000"]) == 1
    assert "none -> named" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    "more, words", [(["--case", "7"], "has no case '7'"), (["--jobs", "0"], "--jobs needs at least 1")]
)
def test_bad_options_are_refused(folder, tmp_path, capsys, more, words):
    with pytest.raises(SystemExit):
        main([str(folder), "--out", str(tmp_path / "out"), *more])
    assert words in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([str(folder / "truth"), "--out", str(tmp_path / "out")])
    assert "holds no cases" in capsys.readouterr().err
