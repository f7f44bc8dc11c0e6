"""The published control case: each controller reaches its targets, in numbers and in a picture."""

from math import degrees

from scripts.reproduce.s_plane import CASES, CONTROLLERS, STUDY, controlled_run, responses


def test_each_step_is_settled_and_told(tmp_path):
    found = STUDY.find(range(1), ["heading, *"])
    assert list(found.runs) == [f"heading, {name}" for name in CONTROLLERS]
    (sheet,) = STUDY.sheets(found)
    rows = [row for row in sheet.rows if row]
    assert [row[:2] for row in rows] == [
        [step, name] for step in ("heading 0 to 50 deg", "heading 50 to 0 deg") for name in CONTROLLERS
    ]
    first = found.of("heading, S-plane")[0]["steps"][0]
    assert rows[0][2] == f"{first['settling_time']:.1f} ({first['settling_time']:.1f})"
    assert rows[0][4].startswith(f"{degrees(first['rms']):.3g} (")
    assert all(row[5] == "0 of 1" for row in rows)
    assert first["settling_time"] < 40.0


def test_table_4_holds_on_the_vehicle_without_noise():
    for case in CASES:
        run = controlled_run(case, "s_plane", None)
        assert run.reason == ""
        for (begin, end, _), step in zip(case.legs, responses(case, run), strict=True):
            assert step.settling_time < end - begin, case.title
