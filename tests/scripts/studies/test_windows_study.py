"""The study of names in other windows and parts of a log."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from scripts.blind.cases import Case, Drawn
from scripts.blind.logs import Conditions
from scripts.blind.scoring import same_names
from scripts.blind.sealing import seal
from scripts.studies import windows
from scripts.studies.windows import attempt, counted, main, variants

OFFSET, LAG = "effects.rudder.offset", "effects.compass.lag"
SIZE = 0.05  # rad, of the offset in the log


def said(*named: str, tied=(), verdict: str = "named") -> dict:
    return {"verdict": verdict, "effects": [{"path": p} for p in named], "tied": tied, "error": {"window_s": 100.0}}


def record() -> Record:
    time = np.arange(0.0, 1200.0, 4.0)
    return Record.from_arrays(time, {"heading_rad": np.sin(0.01 * time), "rudder_rad": np.cos(0.01 * time)})


@pytest.fixture
def folder(tmp_path):
    """Three logs: one that counts, one whose effect is too small, one that was tied."""
    plant = load_vehicle("slocum")
    true = replace_at(plant, OFFSET, SIZE)
    for number, least, verdict in ((0, SIZE / 4.1, "named"), (1, SIZE / 3.9, "named"), (2, SIZE / 4.1, "tied")):
        case = Case(7, number, "one", "glider", "slocum", Conditions(1.0, 1.0, 1200.0), None, None)
        drawn = Drawn(case, record(), true, plant, effects={OFFSET: SIZE}, detectable={OFFSET: least})
        log = seal(drawn, tmp_path)
        (log / "diagnosis.json").write_text(json.dumps(said(OFFSET, verdict=verdict)))
    return tmp_path


def test_names_are_the_same_if_each_is_named_or_tied_in_the_other():
    assert same_names(said(OFFSET, LAG), said(LAG, OFFSET), tied=False)
    assert not same_names(said(OFFSET), said(OFFSET, LAG))
    assert not same_names(said(OFFSET, LAG), said(OFFSET))
    other = said("effects.yaw.moment", tied=[["effects.yaw.moment", OFFSET]])
    assert same_names(other, said(OFFSET))
    assert not same_names(other, said(OFFSET), tied=False)
    assert not same_names(other, said(LAG))


def test_variants_have_other_windows_begin_later_or_are_halves():
    whole = record()
    made = {name: (own, window) for name, own, window in variants(whole, 100.0)}
    assert [window for _, window in made.values()] == [60.0, 80.0, 120.0, 150.0, None, None, None, None]
    assert all(made[f"windows of {length}"][0] is whole for length in (0.6, 0.8, 1.2, 1.5))
    assert made["from 0.5 window on"][0].time[0] == 52.0
    first, second = made["first half"][0], made["second half"][0]
    assert len(first) + len(second) == len(whole)
    assert first.time[-1] < second.time[0]
    assert second.time[-1] == whole.time[-1]


def test_only_large_effects_that_were_named_count(folder):
    assert counted(folder) == [0]


def test_each_variant_is_diagnosed_once_and_compared(folder, tmp_path, monkeypatch, capsys):
    asked = []

    def diagnose(own, plant, *, window, settle):
        asked.append((len(own), window))
        if len(own) < 200:
            raise ValueError("too short")
        return SimpleNamespace(window=window)

    monkeypatch.setattr(windows, "diagnose", diagnose)
    monkeypatch.setattr(windows, "as_json", lambda d: said(OFFSET if d.window != 150.0 else LAG))
    found = attempt(folder, 0)
    assert found["vehicle"] == "slocum"
    same = {name: one["same"] for name, one in found["variants"].items()}
    assert [name for name, one in same.items() if not one] == ["windows of 1.5", "first half", "second half"]
    assert found["variants"]["first half"]["verdict"] == "refused"
    asked.clear()
    for _ in range(2):  # the second time from what is kept
        assert main([str(folder), "--jobs", "1", "--out", str(tmp_path / "kept")]) == 0
    assert len(asked) == 8
    assert "5 of 8" in capsys.readouterr().out


def test_a_folder_without_logs_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main([str(tmp_path), "--out", str(tmp_path / "kept")])
    assert "has no logs" in capsys.readouterr().err
