"""The page about measured logs: what it says of a diagnosis, what is left out, and what is kept."""

import json

import pytest

from scripts import real_logs
from scripts.real.log import Log
from scripts.real.tables import figure, left_out, named, sheets, summary
from scripts.real_logs import main

SAID = {
    "verdict": "tied",
    "unexplained": True,
    "tied": [["effects.rudder.offset", "effects.yaw.moment"]],
    "effects": [
        {"path": "effects.rudder.offset", "value": 0.1, "ci95": [0.09, 0.11], "unit": "rad", "frequency": 0.7},
        {"path": "effects.rudder.gain", "value": 0.8, "ci95": [0.7, 0.9], "unit": "1", "frequency": None},
    ],
    "error": {
        stage: {"heading_rad": {"rmse": rmse}} for stage, rmse in (("as_given", 0.3), ("refitted", 0.2), ("after", 0.1))
    },
    "log_notes": ["50 % of the log is left out.", "x: left out, since its unit is not known."],
}
FITS = SAID | {"fits": {"2": {"p_radps": [30.0, 50.0, None, 99]}}}
DIVE = {"dive": "one, 3", "given": [[0.1, 0.2]], "after": [[0.0, -0.2, 0.01, 0.02]], "operators": [0.1, 0.1]}
DIVES = SAID | {
    "errors": [
        {
            "signal": "vertical velocity",
            "unit": "cm/s",
            "stages": [1.5, 1.4, 0.5],
            "others": 2.0,
            "intervals": [[1.3, 1.7], [1.2, 1.6], [0.4, 0.6], [1.8, 2.25]],
        },
        {"signal": "depth over half-dives", "unit": "m", "stages": [14.0, 13.0, 3.0], "others": None},
    ],
    "constants": [
        {"name": "hd_a, 1/deg", "given": 8.91e-4, "stated": True, "value": 1e-3, "ci95": [9e-4, 1.1e-3]},
        {"name": "volmax - vbdbias, cm³", "given": 53029.52, "stated": False, "value": None, "ci95": None},
    ],
}
LOGS = (
    Log("one, two", "slocum", ("slocum:one",), "a source", "nothing"),
    Log(
        "three",
        "bluerov",
        ("three.bag",),
        "a source",
        "nothing",
        horizons=(2.0,),
        signals=("p_radps",),
        rivals={"roll rate": 60.0},
    ),
    Log("dives", "seaglider", ("p1.nc",), "a source", "nothing", rival="operators"),
)
RESULTS = list(zip(LOGS, (SAID, FITS, DIVES | {"currents": [DIVE]}), strict=True))


def test_effects_come_with_interval_share_of_the_halves_and_ties():
    first, second = named(SAID)
    assert first == "`effects.rudder.offset` 5.73 deg (5.16 to 6.3 deg), 70 %, or `effects.yaw.moment`"
    assert second == "`effects.rudder.gain` 0.8 (0.7 to 0.9)"
    unnamed = [e | {"tied_with": ["effects.yaw.moment"]} for e in SAID["effects"][:1]]
    assert named(SAID | {"effects": [], "tied": [], "acts_like": unnamed}) == [f"acts like {first}"]
    found = {"holds": True, "terms": [{"words": "a yaw moment of 0.02 N m times cos heading", "frequency": 0.94}]}
    assert named(SAID | {"discovered": found})[2] == "no effect, but a yaw moment of 0.02 N m times cos heading, 94 %"
    assert len(named(SAID | {"discovered": found | {"holds": False}})) == 2


def test_tables_have_the_errors_of_each_log_beside_those_of_others():
    table, sources, constants, currents = sheets(RESULTS)
    assert table.rows[0][:7] == ["one, two", "heading, deg", "17.2", "11.5", "5.73", "-", "tied, something left"]
    assert table.rows[1][1:6] == ["roll rate, %", "70", "50", "-", "60"]  # 100 less the fit percent
    assert table.rows[2][1:6] == [
        "vertical velocity, cm/s<br>depth over half-dives, m",
        "1.5 (1.3 to 1.7)<br>14",
        "1.4 (1.2 to 1.6)<br>13",
        "0.5 (0.4 to 0.6)<br>3",
        "2 (1.8 to 2.25)<br>-",
    ]
    assert constants.rows == [
        [
            "dives",
            "hd_a, 1/deg<br>volmax - vbdbias, cm³",
            "0.000891<br>53029.5 (not there: assumed)",
            "0.001 (0.0009 to 0.0011)<br>not freed",
        ]
    ]
    assert sources.rows[0] == ["one, two; three", "a source", "nothing", "no other tool known"]
    assert currents.rows == [["one, 3", "0.100, 0.200", "0.000 ± 0.020, -0.200 ± 0.039", "0.100, 0.100"]]
    assert summary(RESULTS)[-1] == "| dives | vertical velocity, cm/s | 1.5 | 1.4 | 0.5 | 2 | tied, something left |"
    assert left_out(RESULTS)[0] == "- one, two: 50 % of the log is left out."


def test_the_picture_has_a_panel_for_each_unit():
    pytest.importorskip("matplotlib")
    panels = figure(RESULTS).axes
    assert [len(panel.get_yticklabels()) for panel in panels] == [1, 1, 1, 1]
    angles, depth, *_ = [panel.get_yticklabels()[0].get_text() for panel in panels]
    assert (angles, depth) == ("one, two: heading", "dives")


def test_a_failed_log_and_one_that_is_not_there_cost_no_other_and_results_are_not_made_again(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(real_logs, "LOGS", LOGS[:2] + (LOGS[0].__class__("bad", "slocum", (), "", ""),))

    def result_of(log, places):
        if log.name == "bad":
            raise ValueError("no rows")
        return SAID

    monkeypatch.setattr(real_logs, "result_of", result_of)
    page = tmp_path / "page.md"
    page.write_text("above\n<!-- tables of real logs: begin -->\n<!-- tables of real logs: end -->\nbelow\n")
    given = ["--out", str(tmp_path / "out"), "--page", str(page), "--data", str(tmp_path)]
    assert main(given) == 1
    err = capsys.readouterr().err
    assert "three is left out: three.bag is not in" in err
    assert "bad has no result: no rows" in err
    text = page.read_text()
    assert text.startswith("above\n")
    assert text.endswith("below\n")
    assert "| one, two |" in text
    kept = tmp_path / "out" / "one_two.json"
    kept.write_text(json.dumps(SAID | {"verdict": "none"}))
    assert main([*given, "--only", "one"]) == 0
    assert "| none, something left |" in page.read_text()
    assert main([*given, "--summary"]) == 0
    assert "| one, two | heading, deg |" in capsys.readouterr().out
