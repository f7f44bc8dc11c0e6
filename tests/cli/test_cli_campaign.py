import re
import sys
from pathlib import Path

import pytest

from auv_gym.cli import main
from auv_gym.records.record import Record
from identification.campaign.index import read_index
from tests.identification.campaign.texts import DEEP, HOPELESS

ROOT = Path(__file__).parents[2]
GUIDE = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "campaigns.md").read_text(encoding="utf-8"), re.DOTALL)
SHORT = """
name = "short"
[vehicle]
preset = "slocum"
[experiment]
kind = "env"
id = "GliderHeading"
duration_s = 80.0
[controller]
kind = "pid"
"""
SLOW = {"depth", "gains"}  # of vehicles that take long to compile
pytestmark = pytest.mark.usefixtures("wide")


def guide(text: str):
    name = re.findall('name = "(.*?)"', text)[0]
    return pytest.param(text, id=name, marks=[pytest.mark.slow] if name in SLOW else [])


def run(path, out, *options):
    return main(["campaign", str(path), "--out", str(out), "--jobs", "1", "--only", "runs", *options])


@pytest.mark.slow
@pytest.mark.parametrize("text", [guide(text) for text in GUIDE])
def test_the_guides_campaigns_run(text, tmp_path, capsys):
    (tmp_path / "guide.toml").write_text(text)
    assert run(tmp_path / "guide.toml", tmp_path / "out") == 0, capsys.readouterr().err
    rows = read_index(tmp_path / "out")
    assert rows
    assert all(row.usable for row in rows)
    assert f"{len(rows)} of {len(rows)} runs done" in capsys.readouterr().out
    assert all(len(Record.load(row.path(tmp_path / "out"))) == row.samples for row in rows)


def test_the_example_goes_on_and_takes_other_seeds(tmp_path, capsys):
    text = (ROOT / "scripts" / "campaigns" / "small.toml").read_text(encoding="utf-8")
    short = tmp_path / "small.toml"
    short.write_text(text.replace("400.0", "80.0"))
    assert run(short, tmp_path / "out") == 0
    assert run(short, tmp_path / "out") == 0
    assert "6 of them earlier" in capsys.readouterr().out
    assert run(short, tmp_path / "out", "--seed", "1") == 0
    said = capsys.readouterr().out
    assert "4 of them earlier" in said
    assert "2 records" in said
    assert "belong to no run" in said
    assert {row.seed for row in read_index(tmp_path / "out")} == {1, 2, 3}


@pytest.mark.slow
def test_failures_are_told_by_exit_code_and_table(tmp_path, capsys):
    grid = "[grid]\nexperiment.start.depth_m = [39.0, 20.0]\nexperiment.duration_s = [30.0]\n"
    (tmp_path / "deep.toml").write_text(DEEP + grid)
    assert run(tmp_path / "deep.toml", tmp_path / "out") == 3
    said = capsys.readouterr().out
    assert "1 of 2 runs done" in said
    assert "ended" in said
    assert "too deep" in said
    assert "experiment.start.depth_m = 39.0" in said


def test_a_failed_fit_is_told_with_its_reason(tmp_path, capsys):
    (tmp_path / "short.toml").write_text(SHORT + HOPELESS)
    given = ["campaign", str(tmp_path / "short.toml"), "--out", str(tmp_path / "out"), "--jobs", "1"]
    assert main(given) == 3
    said = " ".join(capsys.readouterr().out.split())
    assert "1 of 1 fits failed" in said
    assert "hopeless" in said


def test_a_part_that_the_file_does_not_have_is_refused(tmp_path, capsys):
    (tmp_path / "short.toml").write_text(SHORT)
    assert run(tmp_path / "short.toml", tmp_path / "out", "--only", "fits") == 1
    assert "--only fits needs [[fit]] in" in " ".join(capsys.readouterr().err.split())


def test_an_error_in_the_file_ends_before_anything_is_made(tmp_path, capsys):
    (tmp_path / "wrong.toml").write_text('name = "wrong"\nsedes = 2\n')
    assert run(tmp_path / "wrong.toml", tmp_path / "out") == 1
    assert "Did you mean 'seeds'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert run(tmp_path / "none.toml", tmp_path / "out") == 1
    assert "There is no campaign file" in capsys.readouterr().err


def test_a_scheduler_that_is_not_there_is_said(tmp_path, capsys, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("identification.campaign.running.pool._ANSWER", 0.5)
    (tmp_path / "guide.toml").write_text(GUIDE[0])
    assert run(tmp_path / "guide.toml", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9") == 1
    assert "No Dask scheduler answers at tcp://127.0.0.1:9" in capsys.readouterr().err


def test_without_dask_the_extra_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    (tmp_path / "guide.toml").write_text(GUIDE[0])
    assert run(tmp_path / "guide.toml", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:9") == 1
    assert "in the clone of auv-gym: pip install '.[distributed]'" in capsys.readouterr().err
