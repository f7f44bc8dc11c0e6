"""Frozen rollouts: presets fly as they did, changes are noticed, and the program says so."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import list_vehicles, load_vehicle
from scripts.frozen_rollouts import FOLDER, Rollout, Stored, differences, main, read, roll_out, write

# Rounding of another processor or mathematical library: sines and roots moved to the next number change 3e-14 of a
# range, and the autopilot's bisections for speeds resolve 2e-11 m/s.
TOLERANCE = 1e-10
STORED, _ = read()


def worst(rollout: Rollout) -> float:
    return max(d.relative for d in differences(rollout, STORED[rollout.vehicle]))


@pytest.fixture
def one_preset(monkeypatch):
    monkeypatch.setattr("scripts.frozen_rollouts.list_vehicles", lambda: {"slocum": ""})


def test_every_preset_is_frozen():
    assert set(STORED) == set(list_vehicles())


@pytest.mark.parametrize("name", list_vehicles())
def test_a_preset_flies_as_it_did(name):
    assert worst(roll_out(load_vehicle(name))) <= TOLERANCE


@pytest.mark.parametrize("name", list_vehicles())
def test_a_changed_parameter_is_noticed(name):
    plant = load_vehicle(name)
    path = next(path for path in plant.family.coefficients if value_at(plant, path) != 0.0)
    changed = replace_at(plant, path, value_at(plant, path) * (1.0 + 1e-6))
    assert worst(roll_out(changed)) > 10.0 * TOLERANCE


@pytest.mark.parametrize("name", list_vehicles())
def test_the_stored_rollout_moves_all_inputs_and_outputs(name):
    channels = dict(zip(STORED[name].hashes, STORED[name].kept.T, strict=True))
    plant = load_vehicle(name)
    still = [
        *(c for c in plant.inputs if np.ptp(channels[f"input {c}"]) == 0.0),
        *(c for c in plant.outputs if np.ptp(channels[f"output {c}"]) == 0.0),
    ]
    assert still == []
    assert {f"state {c}" for c in plant.states} < set(channels)


def test_differences_are_by_bits_and_over_the_range():
    values = np.linspace([0.0, 5.0, 0.0], [2.0, 5.0, 0.0], 61)
    rollout = Rollout("one", ("ramp", "constant", "zero"), values)
    stored = Stored(rollout.hashes(), rollout.kept)
    assert [(d.same_bits, d.relative) for d in differences(rollout, stored)] == [(True, 0.0)] * 3
    moved = replace(rollout, values=values + 0.1)
    found = differences(moved, stored)
    assert [d.same_bits for d in found] == [False] * 3
    assert [d.relative for d in found] == pytest.approx([0.05, 0.02, 0.1])
    found = differences(replace(rollout, channels=("ramp", "constant", "new")), stored)
    assert {d.channel: d.relative for d in found} == {"ramp": 0.0, "constant": 0.0, "zero": np.inf, "new": np.inf}
    # a sample between those stored is in the hash
    fine = replace(rollout, values=np.repeat(values, 2, axis=0)[:121])
    stored = Stored(fine.hashes(), fine.kept)
    fine.values[1, 0] += 1e-9
    assert [(d.same_bits, d.relative) for d in differences(fine, stored)] == [(False, 0.0), (True, 0.0), (True, 0.0)]


def test_the_program_stores_and_compares(one_preset, tmp_path, capsys):
    assert main(["--folder", str(tmp_path)]) == 1
    assert "store today's with --write" in capsys.readouterr().err
    assert main(["--write", "--folder", str(tmp_path)]) == 0
    first = (tmp_path / "rollouts.npz").read_bytes()
    assert main(["--write", "--folder", str(tmp_path)]) == 0
    assert (tmp_path / "rollouts.npz").read_bytes() == first
    capsys.readouterr()
    assert main(["--folder", str(tmp_path), "--tolerance", "0"]) == 0
    assert "21 21 0" in " ".join(capsys.readouterr().out.split())

    index = json.loads((tmp_path / "rollouts.json").read_text())
    index["vehicles"]["slocum"]["state r_radps"] = "0" * 64
    index["made_with"]["numpy"] = "0.9"
    (tmp_path / "rollouts.json").write_text(json.dumps(index))
    assert main(["--folder", str(tmp_path), "--all"]) == 0  # other bits are no failure
    printed = " ".join(capsys.readouterr().out.split())
    assert "21 20 0" in printed
    assert "state r_radps" in printed
    assert "numpy 0.9" in printed

    plant = load_vehicle("slocum")
    rollout = roll_out(replace_at(plant, "hull.n_r", 1.001 * plant.hull.n_r))
    write([rollout], tmp_path)
    assert main(["--folder", str(tmp_path)]) == 1
    assert "more than 1e-10 of the range: slocum" in " ".join(capsys.readouterr().out.split())


def test_a_preset_without_a_stored_rollout_is_named(one_preset, capsys):
    assert main(["--folder", str(FOLDER)]) == 1
    assert re.search("no longer a preset: .*ganeshblue,", capsys.readouterr().err)


@pytest.mark.parametrize("tolerance", ["-1", "nan", "inf"])
def test_an_impossible_tolerance_is_refused(tolerance, capsys):
    with pytest.raises(SystemExit):
        main(["--tolerance", tolerance])
    assert "needs a number from 0 up" in capsys.readouterr().err
