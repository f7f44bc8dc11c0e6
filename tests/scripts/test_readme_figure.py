"""The README's picture and numbers come from a program."""

import re
from pathlib import Path

import pytest

from scripts.readme_figure import main


def test_the_readme_says_what_the_program_prints(tmp_path, capsys):
    pytest.importorskip("dbdreader", reason="the extra `slocum` is not installed")
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    assert main(["--out", str(tmp_path)]) == 0
    before, after = re.findall(r"([\d.]+) deg before, ([\d.]+) deg after", capsys.readouterr().out)[0]
    readme = (Path(__file__).parents[2] / "README.md").read_text()
    assert f"miss by {float(before):.1f} deg" in readme
    assert f"miss by {float(after):.1f} deg" in readme
    assert (tmp_path / "ammonite.png").stat().st_size > 10_000
    assert [p.name for p in tmp_path.iterdir()] == ["ammonite.png"]
