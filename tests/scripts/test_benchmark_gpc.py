import pytest

from scripts import benchmark_gpc


def test_it_times_both_solvers_and_they_agree(capsys):
    timing = benchmark_gpc.measure(2)
    assert timing.step.size == 2
    assert (timing.program > 0.0).all()
    assert timing.difference < 1e-4  # of a plane's range; SLSQP stops earlier
    assert benchmark_gpc.main(["--steps", "1"]) == 0
    assert "of SLSQP's time" in " ".join(capsys.readouterr().out.split())


def test_no_steps_are_refused():
    with pytest.raises(SystemExit):
        benchmark_gpc.main(["--steps", "0"])
