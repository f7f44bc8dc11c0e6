"""The published control case: each controller reaches its targets, in numbers and in a picture."""

import pytest

from scripts import reproduce_s_plane


def test_each_step_is_settled_and_told(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(reproduce_s_plane, "CASES", reproduce_s_plane.CASES[1:2])
    assert reproduce_s_plane.main(["--seeds", "1", "--jobs", "1", "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in ("S-plane", "PID", "GPC", "heading 0 to 50 deg", "heading 50 to 0 deg"))
    assert "never" not in text
    assert (tmp_path / "control_case.png").stat().st_size > 20_000
    assert (tmp_path / "control_case.json").is_file()


def test_table_4_holds_on_the_vehicle_without_noise():
    for case in reproduce_s_plane.CASES:
        run = reproduce_s_plane.fly(case, "s_plane", None)
        assert run.reason == ""
        for (begin, end, _), step in zip(case.legs, reproduce_s_plane.responses(case, run), strict=True):
            assert step.settling_time < end - begin, case.title


def test_too_few_seeds_are_refused(capsys):
    with pytest.raises(SystemExit):
        reproduce_s_plane.main(["--seeds", "0"])
    assert "--seeds needs at least 1" in capsys.readouterr().err
