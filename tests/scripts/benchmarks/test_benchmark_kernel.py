"""The kernel benchmark measures every section on the same data and tells what is missing; speeds are not asserted."""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from scripts import benchmark
from scripts.benchmarks import kernel
from scripts.benchmarks.peers import environments, kernel_runner, run_kernel


def test_forces_are_the_polynomials_of_the_hull():
    hull = load_vehicle(kernel.VEHICLE).hull
    velocities = np.array([[1.2, 0.1, -0.2, 0.3, 0.05, -0.1], [1.5, 0.0, 0.0, 0.0, 0.0, 0.0]])
    found = kernel.forces(velocities)
    u, v, w, p, q, r = velocities[0]
    surge, yaw = hull.surge, hull.yaw
    assert found[0, 0] == pytest.approx(
        surge.u_u * u * abs(u) + surge.vr * v * r + surge.wq * w * q + surge.qq * q * q + surge.rr * r * r
    )
    assert found[0, 5] == pytest.approx(
        yaw.r_r * r * abs(r) + yaw.uv * u * v + yaw.ur * u * r + yaw.wp * w * p + yaw.pq * p * q
    )
    assert found[1, 0] < 0.0  # drag
    np.testing.assert_array_equal(found[1, 1:], 0.0)


def test_samples_are_the_forces_and_their_noise():
    data = kernel.samples(4000, 1)
    noise = (data["y"] - kernel.forces(data["x"])) / kernel.forces(data["x"]).std(axis=0)
    np.testing.assert_allclose(noise.std(axis=0), kernel.NOISE, rtol=0.05)  # four standard errors
    np.testing.assert_array_equal(data["fresh_y"], kernel.forces(data["fresh_x"]))
    np.testing.assert_array_equal(data["x"], kernel.samples(4000, 1)["x"])
    assert not np.array_equal(data["x"][:2000], data["fresh_x"])


@pytest.mark.slow  # starts a process for each section
def test_all_sections_are_measured_in_processes_of_their_own(tmp_path, capsys):
    options = ["--samples", "60", "--long", "200", "--size", "12", "--peers", str(tmp_path)]
    assert benchmark.main(["kernel", "--json", *options]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert list(numbers["sections"]) == ["machines", "tuning", "sizes", "long", "hybrid"]
    assert numbers["not_installed"] == ["scikit-learn 1.9.1"]
    for name in ("machines", "tuning", "long"):
        rows = numbers["sections"][name]
        of_section = [f"auv-gym {method.name}" for method in run_kernel.METHODS if method.section == name]
        assert [row["method"] for row in rows] == of_section
        assert min(row[key] for row in rows for key in ("learn_s", "row_us", "rows_ms", "error_percent")) > 0.0
    tuned = {row["method"]: row for row in numbers["sections"]["tuning"]}
    least = tuned["auv-gym descend, all outputs together"]
    assert tuned["auv-gym descend_each, every output"]["loss"] < least["loss"] + 1e-6
    assert least["error_percent"] < numbers["sections"]["machines"][0]["error_percent"]
    assert [row["size"] for row in numbers["sections"]["sizes"]] == [50]


@pytest.mark.slow
def test_methods_learn_and_are_judged_on_fresh_data(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(kernel_runner, "ONE_ROW_S", 0.0)
    monkeypatch.setattr(kernel_runner, "ROWS", 20)
    np.savez(tmp_path / "data.npz", **kernel.samples(50, 0))
    for section in ("machines", "tuning", "long"):
        jobs = {"section": section, "penalty": 1e3, "sigma": 6.0, "size": 10}
        (tmp_path / "jobs.json").write_text(json.dumps(jobs), encoding="utf-8")
        assert kernel_runner.main(run_kernel.METHODS, [str(tmp_path)]) == 0
        rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
        assert [row["method"] for row in rows] == [one.name for one in run_kernel.METHODS if one.section == section]
        assert all(0.0 < row["error_percent"] < 60.0 for row in rows)
        if section == "tuning":
            together, each, annealed = rows
            assert each["loss"] < together["loss"] + 1e-6
            assert together["loss"] < annealed["loss"] + 1e-3
            assert annealed["solved"] >= 1


def test_sizes_come_nearer_to_the_full_machine(monkeypatch):
    monkeypatch.setattr(kernel, "SIZES", (20, 80, 500))
    numbers = kernel.measure(
        argparse.Namespace(
            samples=150, long=100, size=5, threads=1, make_peers=False, peers=Path("none"), only=["sizes"]
        )
    )
    few, many = numbers["sections"]["sizes"]
    assert (few["size"], many["size"]) == (20, 80)
    assert few["farthest"] > many["farthest"]
    assert few["entropy"] > many["entropy"]


def test_tables_name_what_failed_and_what_is_missing(capsys):
    failed = {"method": "scikit-learn 1.9.1", "ours": False, "failed": "its runner ended with code 1: [no] module"}
    row = {"method": "auv-gym FixedSize", "learn_s": 0.1234, "row_us": 5.0, "rows_ms": 10.0, "error_percent": 1.0}
    kernel.show({"threads": 1, "sections": {"machines": [row, failed]}, "not_installed": ["scikit-learn 1.9.1"]})
    printed = capsys.readouterr().out
    assert "0.12" in printed
    assert "Failed: scikit-learn 1.9.1: its runner ended with code 1: [no] module" in printed
    assert "Not installed: scikit-learn 1.9.1" in printed
    assert "A long record" not in printed


def test_peer_that_fails_is_told_and_the_others_go_on(tmp_path, monkeypatch):
    broken = environments.Peer("scikit-learn", "1.9.1", "scripts.benchmarks.peers.run_nothing")
    broken.python(tmp_path).parent.mkdir(parents=True)
    broken.python(tmp_path).symlink_to(sys.executable)
    monkeypatch.setattr(kernel, "KERNEL_PEERS", (broken,))
    monkeypatch.setattr(kernel, "KERNEL_OURS", broken)
    arguments = ["kernel", "--only", "machines", "--samples", "30", "--peers", str(tmp_path), "--json"]
    parsed = []
    monkeypatch.setattr(kernel, "show", parsed.append)
    assert benchmark.main(arguments[:-1]) == 0
    rows = parsed[0]["sections"]["machines"]
    assert len(rows) == 2
    assert all("No module named" in row["failed"] for row in rows)


@pytest.mark.parametrize(
    "option, value", [("--samples", "5"), ("--long", "5"), ("--size", "1"), ("--threads", "0"), ("--only", "speed")]
)
def test_what_cannot_be_measured_is_refused(option, value, capsys):
    with pytest.raises(SystemExit):
        benchmark.main(["kernel", option, value])
    assert option in capsys.readouterr().err


def test_environments_are_made_of_the_peers_asked_for(tmp_path, monkeypatch):
    commands = []

    def installed(command, **options):
        commands.append(command)
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(environments.subprocess, "run", installed)
    monkeypatch.setattr(environments.venv, "create", lambda *arguments, **options: None)
    environments.make(tmp_path, environments.KERNEL_PEERS)
    assert [command[-1] for command in commands] == ["scikit-learn==1.9.1"]


def test_peak_of_memory_is_that_of_this_process():
    before = kernel_runner._peak_mb()
    if before is None:
        pytest.skip("this system does not tell")
    held = np.ones(30_000_000)
    assert kernel_runner._peak_mb() > before + 200.0 or kernel_runner._peak_mb() > held.nbytes / 1e6 + 100.0
