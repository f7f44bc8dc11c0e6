import pytest

from scripts.benchmark import main
from scripts.benchmarks.gpc import timings


def test_it_times_both_solvers_and_they_agree(capsys):
    timing = timings(2)
    assert timing.step.size == 2
    assert (timing.program > 0.0).all()
    assert timing.difference < 1e-4  # of a plane's range; SLSQP stops earlier
    assert main(["gpc", "--steps", "1"]) == 0
    assert "of SLSQP's time" in " ".join(capsys.readouterr().out.split())


def test_no_steps_are_refused(capsys):
    with pytest.raises(SystemExit):
        main(["gpc", "--steps", "0"])
    assert "--steps needs 1 or more, got 0" in capsys.readouterr().err
