"""The study of choices that should not matter: what counts as the same name, and what each choice does to a log."""

import numpy as np
import pytest

from auv_gym import Record
from auv_gym.param import spec_at
from scripts.real.log import Log
from scripts.studies import choices
from scripts.studies.harness import Found


@pytest.mark.parametrize(
    "whole, other, same",
    [
        ([["a"]], [["a"]], 1),
        ([["a", "b"]], [["b", "c"]], 1),  # a member of its tie is named
        ([["a", "b"], ["b", "c"]], [["b"]], 1),  # one name is not two
        ([["a"]], [["b"]], 0),
        ([], [["b"]], 0),
        ([["a", "c"], ["b"]], [["b", "c"], ["a"]], 2),  # whichever comes first
    ],
)
def test_a_name_is_kept_where_one_of_its_tie_is_named(whole, other, same):
    assert choices.kept(whole, other) == same


def test_cuts_leave_out_what_they_say():
    record = Record.from_arrays(np.arange(100.0), {"heading_rad": np.arange(100.0)})
    left = {name: cut(record).time for name, cut in choices.CUTS.items()}
    assert {name: (time[0], time[-1]) for name, time in left.items()} == {
        "without the first 7 samples": (7.0, 99.0),
        "without the first tenth": (10.0, 99.0),
        "without the last tenth": (0.0, 89.0),
        "first half": (0.0, 49.0),
        "second half": (50.0, 99.0),
    }


def test_every_choice_is_diagnosed_and_a_refusal_is_told(monkeypatch, tmp_path):
    """With a log that is there, and a diagnosis that only notes what it was asked."""
    asked = []

    def diagnosed(record, plant, **settings):
        asked.append((len(record), {k: v for k, v in settings.items() if k != "source"}))
        raise ValueError("too short")

    record = Record.from_arrays(np.arange(40.0), {"heading_rad": np.zeros(40)})
    log = next(log for log in choices.logs() if log.vehicle == "slocum")
    monkeypatch.setattr(Log, "record", lambda self, data, files, needs=None: record)
    monkeypatch.setattr(Log, "missing", lambda self, data: [])
    monkeypatch.setattr(choices, "diagnose", diagnosed)
    told = choices.attempt(log.name, 0, str(tmp_path))
    assert [r["choice"] for r in told] == list(choices.CHOICES)
    assert {(r["verdict"], r["why"]) for r in told} == {("refused", "too short")}
    usual = {"window": None, "settle": None}
    assert asked[0] == (40, usual)
    for other in ((40, usual | {"window": 72.0}), (20, usual), (40, usual | {"doubt": 0.05})):
        assert other in asked


def test_a_log_that_is_not_there_is_an_error_with_its_name(tmp_path):
    log = next(log for log in choices.logs() if log.name.startswith("SG561"))
    with pytest.raises(ValueError, match=r"p5610002.nc is not in"):
        choices.attempt(log.name, 0, str(tmp_path))


def test_the_table_counts_names_that_are_kept_and_new_ones():
    whole = {"choice": choices.WHOLE, "verdict": "named", "groups": [["a", "b"]]}
    other = {"choice": "first half", "verdict": "tied", "groups": [["b"], ["c"]]}
    (sheet,) = choices.sheets(Found({"log": {0: [whole, other]}}, {}))
    assert [row[1:5] for row in sheet.rows if row] == [
        [choices.WHOLE, "named", "1 of 1", "0"],
        ["first half", "tied", "1 of 1", "1"],
    ]


def test_simulated_logs_have_one_effect_that_is_large_enough(monkeypatch):
    """The first log of the seed whose effect is four times as large as it would just show, and its believed vehicle."""
    asked = []

    def diagnosed(record, plant, **settings):
        asked.append((record, plant, settings["window"], settings["settle"]))
        raise ValueError("too short")

    monkeypatch.setattr(choices, "diagnose", diagnosed)
    monkeypatch.setattr(choices, "CHOICES", (choices.WHOLE, "free runs 0.6 times as long"))
    told = choices.attempt("glider", 5, "")
    assert [r["choice"] for r in told] == [choices.WHOLE, "free runs 0.6 times as long"]
    first = next(d for d in (choices._drawn("glider", 5, k) for k in range(99)) if d is not None and choices.large(d))
    ((path, value),) = first.effects.items()
    assert abs(value - spec_at(first.true, path).neutral) >= 4.0 * first.detectable[path]
    assert np.array_equal(asked[0][0]["heading_rad"], first.record["heading_rad"])
    assert asked[0][2] is None
    assert asked[1][2] == 0.6 * first.believed.window


def test_the_table_of_simulated_logs_counts_those_with_the_same_names_of_those_that_are_named(monkeypatch):
    monkeypatch.setattr(choices, "CHOICES", (choices.WHOLE, "first half"))
    runs = {
        0: [("named", [["a"]]), ("tied", [["a", "b"]])],
        1: [("named", [["a"]]), ("unexplained", [["a"], ["c"]])],
        2: [("unexplained", [["a"]]), ("named", [["a"]])],  # nothing is named that could be kept
        3: [("named", [["a"]]), ("refused", [])],  # too short
    }
    told = {
        seed: [{"choice": c, "verdict": v, "groups": g} for c, (v, g) in zip(choices.CHOICES, run, strict=True)]
        for seed, run in runs.items()
    }
    (sheet,) = choices.sheets(Found({"glider": told}, {}))
    assert [row[1:] for row in sheet.rows if row] == [
        ["first half", "2", "50.0 (1.3 to 98.7)", "1", "1"],
        ["all", "2", "50.0 (1.3 to 98.7)", "", ""],
    ]
