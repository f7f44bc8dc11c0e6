"""The study of changes: drawn logs, tables from made-up results, and runs that are kept."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from identification.changes.forms import Sized
from identification.changes.missions import Changed, Common, Comparison
from scripts.blind.logs import Conditions
from scripts.studies import changes
from scripts.studies.changes import FORMS, MISSIONS, ONSETS, SEVERAL, STUDY, attempt, changing_log, exact
from scripts.studies.harness import Found

OFFSET, USUAL = "effects.rudder.offset", Conditions(1.0, 1.0, 600.0)


def test_what_cannot_be_run_is_refused_in_words(capsys):
    with pytest.raises(SystemExit):
        STUDY.main(["--vehicle", "submarine"])
    assert "invalid choice: 'submarine'" in capsys.readouterr().err
    assert STUDY.main(["--case", "log: tides"]) == 1
    assert "No case is called 'log: tides'; there are: missions: the same; " in capsys.readouterr().err


def test_a_share_of_correct_runs_has_its_exact_interval():
    """Clopper and Pearson 1934: with no miss in 19, the lower limit is the nineteenth root of 2.5 %."""
    assert exact(19, 19) == f"19 of 19 ({100.0 * 0.025 ** (1.0 / 19.0):.0f} to 100 %)"
    assert exact(0, 12) == f"0 of 12 (0 to {100.0 * (1.0 - 0.025 ** (1.0 / 12.0)):.0f} %)"
    assert exact(0, 0) == "–"


def test_an_effect_acts_in_the_log_when_its_case_says():
    shares = {case: [shape(t, (0.3, 0.6)) for t in (0.0, 0.29, 0.3, 0.59, 0.6, 1.0)] for case, shape in ONSETS.items()}
    assert shares["log: nothing"] == [0.0] * 6
    assert shares["log: effect throughout"] == [1.0] * 6
    assert shares["log: effect from a time on"] == [0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
    assert shares["log: effect off, on, off"] == [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]
    assert shares["log: effect on, off, on"] == [1.0, 1.0, 0.0, 0.0, 1.0, 1.0]
    assert shares["log: effect that grows"] == [0.0, 0.29, 0.3, 0.59, 0.6, 1.0]


def test_a_log_is_clean_until_its_effect_begins():
    plant = load_vehicle("slocum")
    bent = replace_at(plant, OFFSET, 0.05)
    clean = changing_log(plant, plant, OFFSET, USUAL, 3, lambda t: 0.0)
    found = changing_log(plant, bent, OFFSET, USUAL, 3, lambda t: float(t >= 300.0))
    same = found["heading_rad"] == clean["heading_rad"]
    first = float(found.time[np.argmin(same)])
    assert 300.0 < first < 320.0
    whole = changing_log(plant, bent, OFFSET, USUAL, 3, lambda t: 1.0)
    assert not np.array_equal(whole["heading_rad"], found["heading_rad"])


@pytest.mark.parametrize("case, there", MISSIONS.items())
def test_missions_have_the_effect_where_their_case_says(monkeypatch, case, there):
    """A log is only the offset of its vehicle, and the comparison finds a change tied with it, and something else."""
    seen, zero, half = [], Sized(0.0, (-1.0, 1.0)), Sized(0.5, (-9.0, 9.0))

    def compared(before, after, plant):
        seen.extend([before, after])
        own = Changed("effects.yaw.moment", "", "", zero, half, half, 30.0, (f"after {OFFSET}",))
        other = Changed("hull.n_r", "", "", zero, half, half, 30.0)
        return Comparison(plant, ((), ()), (own, other), (Common(OFFSET, "", "", half, 30.0),), (), 1, {})

    def drawn(plant, conditions, seed, rng):
        return OFFSET, replace_at(plant, OFFSET, 0.05)

    monkeypatch.setattr(changes, "compare_missions", compared)
    monkeypatch.setattr(changes, "drawn_effect", drawn)
    monkeypatch.setattr(changes, "log_of", lambda plant, conditions, seed: value_at(plant, OFFSET))
    found = attempt(case, 1, "slocum")
    path = OFFSET if any(there) else ""
    assert (found["vehicle"], found["path"]) == ("slocum", path)
    assert found["truth"] == ([0.05 * effect for effect in there] if path else [])
    assert found["changed"] == ["effects.yaw.moment", "hull.n_r"]
    assert found["right_change"] == found["right_common"] == bool(path)
    assert found["false_changes"] == (["hull.n_r"] if path else ["effects.yaw.moment", "hull.n_r"])
    assert not found["sized"]
    assert seen == [0.05 * effect for effect in there]


MISSION = {
    "vehicle": "slocum", "path": OFFSET, "changed": [OFFSET], "common": [], "right_change": True, "false_changes": [],
    "right_common": False, "covered": True, "sized": True, "seconds": 10.0,
}  # fmt: skip
LOG = {
    "vehicle": "slocum", "path": OFFSET, "found": [["from", OFFSET]], "named": True, "forms": ["from"],
    "changing": [OFFSET], "flagged": True, "false": [], "near": True, "holds": False, "timed": True, "seconds": 4.0,
}  # fmt: skip
SET = {
    "vehicle": "slocum", "path": OFFSET, "verdict": "explained", "found": [[OFFSET, 0.1]], "right": True, "false": [],
    "covered": True, "sized": True, "seconds": 60.0,
}  # fmt: skip


def test_tables_count_what_is_right_and_list_what_is_not():
    missed = MISSION | {"changed": [], "common": ["hull.n_r"], "right_change": False, "sized": False, "seconds": 30.0}
    runs = {
        "missions: effect new": {1: MISSION, 2: missed},
        "missions: the same": {1: MISSION | {"changed": [], "path": "", "sized": False}},
        "three logs: effect in one": {1: SET, 2: SET | {"right": False, "false": ["hull.n_r"]}},
        "log: effect from a time on": {1: LOG, 2: LOG | {"forms": ["until"], "timed": False}},
    }
    missions, sets, logs, misses = STUDY.sheets(Found(runs, {}))
    assert missions.rows[0] == [
        "missions: effect new", exact(1, 2), exact(0, 2), exact(1, 1), "20",
    ]  # fmt: skip
    assert missions.rows[1][1:4] == [exact(1, 1), exact(0, 1), "–"]
    assert sets.rows == [["three logs: effect in one", exact(1, 2), exact(1, 2), exact(2, 2), "60"]]
    assert logs.rows == [
        ["log: effect from a time on", exact(1, 2), exact(2, 2), exact(0, 2), exact(1, 1), exact(0, 1), "4"]
    ]
    assert misses.rows == [
        ["missions: effect new", "2", "slocum", OFFSET, "hull.n_r"],
        ["three logs: effect in one", "2", "slocum", OFFSET, f"explained; {OFFSET}"],
        ["log: effect from a time on", "2", "slocum", OFFSET, f"from {OFFSET}"],
    ]
    for sheet in (missions, sets, logs, misses):
        assert all(len(row) == len(sheet.heads) for row in sheet.rows)
    assert set(FORMS) <= set(ONSETS)
    assert set(STUDY.cases) == {*MISSIONS, *SEVERAL, *ONSETS}


def test_finished_runs_are_kept_and_those_of_another_vehicle_refused(tmp_path, capsys):
    begun = []

    def tried(case, seed, vehicle):
        begun.append((case, seed, vehicle))
        return LOG

    study, case = replace(STUDY, attempt=tried), "log: effect from a time on"
    given = ["--case", case, "--seeds", "2", "--out", str(tmp_path), "--vehicle", "slocum"]
    assert study.main(given) == 0
    assert begun == [(case, 9000, "slocum"), (case, 9001, "slocum")]
    assert "Changes within a log" in capsys.readouterr().out
    assert study.main([*given[:3], "3", *given[4:]]) == 0
    assert begun[2:] == [(case, 9002, "slocum")]
    assert (tmp_path / "logs.csv").read_text().count(case) == 1
    assert study.main([*given[:-1], "npsauv"]) == 1
    assert "other settings (see study.json there)" in capsys.readouterr().err
