"""The published experiment in its limits, and its figures."""

import pytest

from scripts.reproduce.vertical_plane import main


def test_the_published_experiment_stays_in_its_limits(tmp_path, capsys):
    assert main(["--out", str(tmp_path), "--jobs", "1", "--runs-only"]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if "depth within" in line]
    assert len(lines) == 4
    assert all(float(line.split("pitch within ")[1].split(" deg")[0]) > 2.0 for line in lines)  # it is excited
    assert (tmp_path / "figures_5_to_10.png").stat().st_size > 20_000


@pytest.mark.slow
@pytest.mark.parametrize("seed", [10, 20, 30])
def test_other_seeds_stay_in_the_limits_too(tmp_path, seed):
    assert main(["--out", str(tmp_path), "--jobs", "1", "--runs-only", "--seed", str(seed)]) == 0
