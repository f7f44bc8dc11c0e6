"""The benchmarks print what they measured; how much that is depends on the machine and is not asserted."""

import json

import pytest

from scripts import benchmark
from scripts.benchmarks import env, rl


def test_a_rollout_is_timed(capsys):
    assert benchmark.main(["rollout", "--alone", "--json", "--repeats", "1"]) == 0
    assert json.loads(capsys.readouterr().out)["rollout_ns_per_rk4_step"] > 0.0


def test_recursions_are_timed(capsys):
    assert benchmark.main(["recursion", "--alone", "--json", "--repeats", "1", "--samples", "1000"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert len(numbers) == 6
    assert min(numbers.values()) > 0.0


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["recursion", "--samples", "10"], "--samples needs 100 or more"),
        (["env", "--envs", "0"], "--envs and --rounds need 1 or more"),
        (["rl", "--steps", "10"], "--steps needs 2048 or more"),
        (["env", "--vehicle", "slocum"], "six degrees of freedom, got 'slocum'"),
        (["env", "--vehicle", "remus10"], "Did you mean 'remus100'"),
    ],
)
def test_what_cannot_be_measured_is_refused(arguments, message, capsys):
    with pytest.raises(SystemExit):
        benchmark.main(arguments)
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_learning_is_timed(capsys, monkeypatch):
    pytest.importorskip("stable_baselines3")
    monkeypatch.setattr(rl, "COUNTS", (8,))
    monkeypatch.setattr(rl, "STEPS_AN_UPDATE", 512)
    assert benchmark.main(["rl", "--json", "--rounds", "1", "--steps", "512"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert min(numbers.values()) > 0.0
    assert numbers["depth_8_over_pendulum_8"] == pytest.approx(
        numbers["depth_8_steps_per_s"] / numbers["pendulum_8_steps_per_s"]
    )
    assert max(value for name, value in numbers.items() if "share" in name) < 1.0


@pytest.mark.slow  # compiles the batch that only this needs, and starts processes that compile all anew
def test_environments_are_timed(capsys, monkeypatch):
    monkeypatch.setattr(env, "SINGLE_STEPS", 200)
    assert benchmark.main(["env", "--json", "--rounds", "1", "--envs", "16"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert min(numbers.values()) > 0.0
    assert numbers["vector_rk4_substeps_per_s"] == pytest.approx(5.0 * numbers["vector_steps_per_s"])
    assert numbers["first_step_warm_s"] < numbers["first_step_cold_s"]
