"""The known systems are what they say; models are scored alike; whoever is missing or fails is told."""

import json
import os
import signal
from functools import partial
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.model import simulate
from scripts import benchmark
from scripts.benchmarks import identification, systems
from scripts.benchmarks.peers import environments, run_ours, runner


def test_the_systems_have_the_poles_that_they_are_made_of():
    wanted = [0.95 * np.exp(0.3j), 0.95 * np.exp(-0.3j), 0.80 * np.exp(1.0j), 0.80 * np.exp(-1.0j)]
    poles = systems.truth("armax").state_space.poles()
    assert [np.abs(poles - pole).min() for pole in wanted] == pytest.approx([0.0] * 4, abs=1e-9)
    # the third state is driven by no other, so that its pole stands on the diagonal
    poles = systems.truth("state_space").poles()
    assert [np.abs(poles - pole).min() for pole in (0.9 + 0.2j, 0.9 - 0.2j, 0.7)] == pytest.approx([0.0] * 3, abs=1e-9)


@pytest.mark.parametrize("system", systems.SYSTEMS)
def test_records_are_the_system_and_its_noise(system):
    noisy = systems.measured(system, 4000, 3)
    quiet = systems.measured(system, 4000, 3, noise=0.0, state_noise=0.0)
    np.testing.assert_array_equal(noisy.u, quiet.u)
    outputs_alone = systems.measured(system, 4000, 3, state_noise=0.0)
    share = np.std(outputs_alone.y - quiet.y, axis=0) / np.std(quiet.y, axis=0)
    assert share == pytest.approx(0.1, rel=0.1)  # the standard error of a coloured share of 4000 samples
    again = systems.measured(system, 4000, 3)
    np.testing.assert_array_equal(noisy.y, again.y)
    assert not np.array_equal(noisy.u, systems.measured(system, 4000, 4).u)


@pytest.mark.parametrize("system", systems.SYSTEMS)
def test_fresh_data_are_free_runs_of_the_truth(system):
    fresh = systems.clean(system, 300, 1)
    model = systems.truth(system)
    run = simulate(model, fresh.record).matrix(model.outputs)
    assert run == pytest.approx(fresh.y, abs=1e-12)
    assert not np.array_equal(fresh.u, systems.measured(system, 300, 1).u)
    assert systems.fit_percent(fresh.y, run) == pytest.approx(100.0)
    assert systems.fit_percent(fresh.y, np.broadcast_to(fresh.y.mean(axis=0), fresh.y.shape)) == pytest.approx(0.0)
    assert systems.fit_percent(fresh.y, np.full_like(fresh.y, np.nan)) == -np.inf


def test_an_unknown_system_is_refused():
    with pytest.raises(ValueError, match="armax and state_space, got 'arx'"):
        systems.truth("arx")


def test_errors_of_coefficients_are_relative_to_all_of_them():
    a, b, c = systems.A[1:], systems.B[1:], systems.C[1:]
    size = np.linalg.norm(np.concatenate([a, b, c]))
    assert systems.coefficient_error(a, b, c) == 0.0
    assert systems.coefficient_error(a, b, [c[0], c[1] + 0.1]) == pytest.approx(0.1 / size)
    assert systems.coefficient_error(a, b, [c[0]]) == pytest.approx(0.3 / size)
    assert systems.coefficient_error([*a, 0.1], b, c) == pytest.approx(0.1 / size)
    assert systems.coefficient_error(a, b) == 0.0


def test_poles_are_paired_before_their_errors_are_taken():
    moved = np.diag([0.71, 0.0, 0.0]) + 0.0
    moved[1:, 1:] = [[0.9, 0.2], [-0.2, 0.9]]
    assert systems.largest_pole_error(moved) == pytest.approx(0.01)
    assert systems.largest_pole_error(np.eye(2)) == np.inf


@pytest.mark.parametrize("offset", [0.0, 0.4])
def test_the_truth_scores_full_wherever_its_signals_are_taken_from(offset):
    """A model about another operating point of a linear system is the same model."""
    scored = identification.score
    armax, states = systems.ARMAX, systems.STATE_SPACE
    gain = armax.state_space.dc_gain()
    of_armax = {"a": systems.A, "b": systems.B, "c": systems.C, "offset_u": [offset], "offset_y": gain[0] * offset}
    assert scored("armax", of_armax, 0) == pytest.approx({"fit_percent": 100.0, "error_ab": 0.0, "error_abc": 0.0})
    shift = np.array([offset, -offset])
    model = {"a": states.a, "b": states.b, "c": states.c, "offset_u": shift, "offset_y": states.dc_gain() @ shift}
    assert scored("state_space", model, 0) == pytest.approx({"fit_percent": 100.0, "pole_error": 0.0})


def test_a_model_without_c_has_no_error_of_c():
    assert "error_abc" not in identification.score("armax", {"a": systems.A, "b": systems.B}, 0)


def test_a_model_that_runs_away_scores_last():
    unstable = {"a": 3.0 * np.eye(3), "b": systems.STATE_SPACE.b, "c": systems.STATE_SPACE.c}
    assert identification.score("state_space", unstable, 0)["fit_percent"] == -np.inf


def _row(ours, kind, method, **by_quantity):
    return {"peer": "x", "ours": ours, "method": method, "kind": kind, "by_samples": {"100": by_quantity}}


def test_who_is_ahead_of_ours_is_found():
    rows = [
        _row(True, "subspace", "mine", ms=[2.0] * 3, fit_percent=[99.0, 99.2, 90.0], pole_error=[0.1] * 3),
        _row(True, "prediction error", "my best", ms=[9.0] * 3, fit_percent=[99.9] * 3, pole_error=[0.01] * 3),
        # over fewer records, which then count for ours too; a difference of the third digit is a tie
        _row(False, "subspace", "theirs", ms=[1.0] * 2, fit_percent=[99.5, 99.1], pole_error=[0.0999] * 2),
        _row(False, "subspace", "slower", ms=[1.5] * 3, fit_percent=[0.0] * 3, pole_error=[9.0] * 3),
    ]
    found = identification.leads("state_space", rows)
    assert [(lead["kind"], lead["quantity"], lead["peer"]) for lead in found] == [
        ("subspace", "ms", "x theirs"),
        ("subspace", "fit_percent", "x theirs"),
    ]
    fit = {"theirs": 99.3, "ours": 99.1, "records": 2, "ahead_on": 1, "samples": 100}
    assert {key: found[1][key] for key in fit} == pytest.approx(fit)
    assert identification.leads("state_space", rows[:2]) == []


def test_the_best_of_a_kind_over_all_records_is_marked(capsys):
    rows = [
        _row(True, "subspace", "mine", ms=[2.0] * 3, fit_percent=[99.0] * 3, pole_error=[0.1] * 3),
        _row(False, "subspace", "theirs", ms=[4.0] * 3, fit_percent=[99.5] * 3, pole_error=[0.2] * 3),
        _row(False, "subspace", "slow", ms=[1.0], fit_percent=[99.9], pole_error=[0.05]),
    ]
    numbers = {"systems": {"state_space": rows}, "seeds": 3, "threads": 1, "measured": ["x 1"], "not_installed": []}
    leads = identification.leads("state_space", rows)
    identification.show({**numbers, "failed": [], "compared": True, "ahead_of_ours": leads})
    shown = capsys.readouterr().out
    mine, theirs, slow = (
        next(line for line in shown.splitlines() if f"x {name}" in line) for name in ("mine", "theirs", "slow")
    )
    assert "*2.0" in mine
    assert "*99.50" in theirs
    assert "1.0 (1)" in slow
    assert "*" not in slow
    assert "Not first: state space, subspace, fit, %, N 100: x slow 99.9, ours 99; ahead on 1 of 1 records." in shown
    identification.show({**numbers, "failed": [], "compared": True, "ahead_of_ours": []})
    assert "Ours is first wherever another package is measured." in capsys.readouterr().out


@pytest.fixture
def broken_peer(tmp_path):
    """A folder of environments that holds one, whose interpreter fails."""
    if os.name == "nt":
        pytest.skip("the interpreter is a shell script")
    program = environments.PEERS[1].python(tmp_path)
    program.parent.mkdir(parents=True)
    program.write_text('#!/bin/sh\necho \'{"fits": 4}\'\necho "no module named llsi" >&2\nexit 3\n')
    program.chmod(0o755)
    return tmp_path


@pytest.mark.slow
def test_our_rows_are_measured_and_the_others_are_told(broken_peer, capsys):
    command = ["identification", "--peers", str(broken_peer), "--samples", "300", "--seeds", "1", "--json"]
    assert benchmark.main(command) == 0
    numbers = json.loads(capsys.readouterr().out)
    rows = [row for found in numbers["systems"].values() for row in found]
    assert [row["method"] for row in rows] == [method.name for method in run_ours.METHODS]
    assert all(row["ours"] and row["by_samples"]["300"]["ms"][0] > 0.0 for row in rows)
    assert min(row["by_samples"]["300"]["fit_percent"][0] for row in rows) > 80.0
    assert numbers["not_installed"] == ["sippy_unipi 1.0.1", "nfoursid 1.0.2", "sysidentpy 0.9.0", "control 0.10.2"]
    told = {"peer": "llsi 0.5.0", "method": "all", "error": "its runner ended with code 3: no module named llsi"}
    assert numbers["failed"] == [told]
    assert numbers["ahead_of_ours"] == []

    identification.show(numbers)
    shown = capsys.readouterr().out
    assert "auv-gym Armax" in shown
    assert "Not installed: sippy_unipi 1.0.1, nfoursid" in shown
    assert "Failed: llsi 0.5.0, all: its runner ended with code 3: no module named llsi" in shown
    assert "Ours is first" not in shown  # nobody was there to be compared with


def _jobs(folder, budget_s=60.0):
    identification.write_jobs(folder, [60], 5, budget_s)
    return folder


def _failing_at(data, seed, calls):
    calls.append(data)
    print("a package that talks")
    if len(calls) == seed + 2:  # the first call warms up
        raise RuntimeError("singular")


def _lines(methods, folder, capfd):
    assert runner.main(methods, [str(folder)]) == 0
    return [json.loads(line) for line in capfd.readouterr().out.splitlines()]


def test_a_method_that_fails_says_so_and_the_next_goes_on(tmp_path, capfd):
    methods = [
        runner.Method("fails", "k", "armax", partial(_failing_at, seed=2, calls=[]), lambda fitted: {"a": [1.0]}),
        runner.Method("works", "k", "armax", lambda data: data[1].sum(), lambda fitted: {"a": np.array([fitted])}),
    ]
    head, *lines = _lines(methods, _jobs(tmp_path), capfd)
    assert head == {"fits": 10}
    failing = [line for line in lines if line["method"] == "fails"]
    assert [("seconds" in line, line.get("error"), line.get("left")) for line in failing] == [
        (True, None, None),
        (True, None, None),
        (False, "RuntimeError: singular", 2),
    ]
    working = [line for line in lines if line["method"] == "works"]
    assert [line["seed"] for line in working] == [0, 1, 2, 3, 4]
    assert working[1]["model"]["a"] == [pytest.approx(systems.measured("armax", 60, 1).y.sum())]


def test_a_method_over_its_budget_gets_no_more_seeds(tmp_path, capfd, monkeypatch):
    clock = SimpleNamespace(perf_counter=count(0.0, 61.0).__next__, process_time=lambda: 0.0)
    monkeypatch.setattr(runner, "time", clock)
    method = runner.Method("slow", "k", "armax", lambda data: None, lambda fitted: {})
    _, *lines = _lines([method], _jobs(tmp_path, budget_s=60.0), capfd)
    assert [line.get("left") for line in lines] == [None] * runner.LEAST_SEEDS + [2]


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="needs the alarm of POSIX")
def test_a_fit_that_does_not_end_is_stopped(tmp_path, capfd):
    def endless(data):
        while True:
            pass

    method = runner.Method("endless", "k", "armax", endless, lambda fitted: {})
    _, line = _lines([method], _jobs(tmp_path, budget_s=0.05), capfd)
    assert line["error"] == "TimeoutError: a fit took longer than 0.15 s"
    assert line["left"] == 4


@pytest.mark.slow
def test_an_environment_that_cannot_be_made_is_told(broken_peer, monkeypatch):
    monkeypatch.setattr(environments, "PEERS", environments.PEERS[1:2])
    with pytest.raises(ValueError, match=r"pip could not install llsi==0\.5\.0 in .*llsi: no module named llsi"):
        environments.make(broken_peer)


@pytest.mark.parametrize("option", [["--seeds", "0"], ["--samples", "0"], ["--budget", "0"], ["--threads", "0"]])
def test_what_cannot_be_measured_is_refused(option, capsys):
    with pytest.raises(SystemExit):
        benchmark.main(["identification", *option])
    assert "need more than 0" in capsys.readouterr().err
