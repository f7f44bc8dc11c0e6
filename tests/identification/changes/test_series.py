"""Tests of trends over missions: a line with its own scatter, and a series that is stopped and resumed."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.changes.page import write_series
from identification.changes.series import FOLLOWED, MISSIONS, _trend, follow_series, line, mission_step
from identification.experiments.heading_control import closed_loop
from scripts.studies.series_resilience import STUDY, dives, hashes

OFFSET = "effects.rudder.offset"


def test_a_line_holds_its_slope_where_missions_scatter_and_is_weighted_where_they_do_not():
    rng, at = np.random.default_rng(0), np.arange(12.0)
    errors, held = rng.uniform(0.1, 0.3, at.size), []
    for scatter in (0.0, 1.0):
        found = [
            line(at, 0.2 * at + errors * rng.standard_normal(12) + scatter * rng.standard_normal(12), errors)
            for _ in range(400)
        ]
        slopes, stated, scatters, levels = np.array(found).T
        assert np.mean(slopes) == pytest.approx(0.2, abs=4.0 * np.std(slopes) / 20.0)
        assert np.mean(levels) == pytest.approx(0.2 * at.mean(), abs=4.0 * np.std(levels) / 20.0)
        assert np.median(scatters) == pytest.approx(scatter, abs=0.1)
        held.append(float(np.mean(np.abs(slopes - 0.2) < 2.228 * stated)))  # Student's t of ten degrees of freedom
    assert min(held) > 0.92  # 95 % of 400, less 3 standard errors


@pytest.mark.parametrize("scatter", [0.0, 1.0])
def test_a_step_is_named_with_its_mission_and_seldom_where_there_is_none(scatter):
    rng, at, names = np.random.default_rng(0), np.arange(12.0), [f"m{k}" for k in range(12)]
    errors = rng.uniform(0.1, 0.3, at.size)
    usual = np.sqrt(np.mean(errors**2) + scatter**2)

    def steps_of(shape):
        drawn = (errors * rng.standard_normal(12) + scatter * rng.standard_normal(12) for _ in range(200))
        return [mission_step(names, at, usual * shape + noise, errors) for noise in drawn]

    # 5 % of 200, and 3 standard errors: a step is tested at the level of a 95 % interval
    assert sum(step is not None for step in steps_of(np.zeros(12))) <= 19
    assert sum(step is not None for step in steps_of(0.7 * at)) <= 19
    found = [step for step in steps_of(5.0 * (at >= 7)) if step is not None]
    assert len(found) >= 160
    assert np.mean([step.mission == "m7" for step in found]) > 0.9
    assert np.mean([names.index(step.ci95[0]) <= 7 <= names.index(step.ci95[1]) for step in found]) > 0.92
    held = [step.change.ci95[0] < 5.0 * usual < step.change.ci95[1] for step in found]
    assert np.mean(held) > 0.88  # of those that are named, which tend to be large
    assert all(step.at == 0.5 * (int(step.mission[1:]) - 1 + int(step.mission[1:])) for step in found)


def test_a_single_deviating_mission_at_an_end_is_no_step():
    names, errors = list("abcdef"), np.full(6, 0.1)
    assert mission_step(names, np.arange(6.0), np.array([0.0, 0.1, -0.1, 0.0, 0.1, 5.0]), errors) is None


def test_a_trend_has_the_step_of_the_missions_that_can_be_used():
    sizes = {f"m{k}": (0.03 * (k >= 3), 0.001 if k != 1 else 0.0) for k in range(8)}  # nothing is known of the second
    usable = [(name, float(k), {OFFSET: one}) for k, (name, one) in enumerate(sizes.items())]
    found = _trend(load_vehicle("slocum"), OFFSET, usable, "mission", ())
    assert (found.step.mission, found.step.ci95, found.step.at) == ("m3", ("m3", "m3"), 2.5)
    assert found.step.before.value == pytest.approx(0.0)
    assert found.step.after.value == pytest.approx(0.03)


def test_a_trend_needs_four_missions(tmp_path):
    with pytest.raises(ValueError, match="at least 4 missions"):
        follow_series({}, load_vehicle("slocum"), tmp_path)


@pytest.mark.slow
def test_a_series_finds_what_grows_and_goes_on_where_it_was_stopped(tmp_path):
    plant, missions = load_vehicle("slocum"), {}
    for k in range(6):
        flown = replace_at(plant, OFFSET, 0.01 * k)
        missions[f"m{k}"] = closed_loop(flown, rng=np.random.default_rng(40 + k), duration=520.0)
    found = follow_series(missions, plant, tmp_path)
    trend = next(t for t in found.trends if t.path == OFFSET)
    assert trend.sure
    assert trend.rate.ci95[0] < 0.01 < trend.rate.ci95[1]
    written = {name: path.read_bytes() for name, path in write_series(found, tmp_path).items()}
    files = sorted((tmp_path / MISSIONS).iterdir())
    assert len(files) == 6
    files[2].unlink()
    files[4].write_text("half of a fi")  # what no such file can be, since each is written whole
    before = files[0].stat().st_mtime_ns
    again = follow_series(missions, plant, tmp_path, jobs=2)
    assert {name: path.read_bytes() for name, path in write_series(again, tmp_path).items()} == written
    assert files[0].stat().st_mtime_ns == before


SLOWLY = """
import sys, time
import auv_gym.cli
import identification.changes.series as series
real = series.sizes_of
def sizes_of(*given):
    time.sleep(0.3)
    return real(*given)
series.sizes_of = sizes_of
sys.exit(auv_gym.cli.main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_a_killed_series_goes_on_and_leaves_the_same_bytes(tmp_path):
    logs = dives(tmp_path, 3, 5, 520.0)

    def begin(out, *code):
        given = ["compare-missions", *logs, "--series", "--vehicle", "slocum", "--most", "1", "--out", str(out)]
        return subprocess.Popen([sys.executable, *code, *given], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)

    whole, out = tmp_path / "whole", tmp_path / "out"
    undisturbed = begin(whole, "-m", "auv_gym.cli")
    assert undisturbed.wait(300) == 0, undisturbed.stderr.read()
    process, deadline = begin(out, "-c", SLOWLY), time.monotonic() + 300.0
    while len(list((out / MISSIONS).glob("*.json"))) < 2 and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    assert process.wait(60) == -signal.SIGKILL, process.stderr.read()
    (out / MISSIONS / ".half.json.12ab.part").write_text("{")  # what it might have been writing
    kept = {p: p.stat().st_mtime_ns for p in (out / FOLLOWED, *(out / MISSIONS).glob("*.json"))}
    assert 2 <= len(kept) - 1 < 5
    resumed = begin(out, "-m", "auv_gym.cli")
    assert resumed.wait(300) == 0, resumed.stderr.read()
    assert hashes(out) == hashes(whole)
    assert len(hashes(out)) == 5 + 3  # missions, followed.json, series.json, series.html
    assert all(p.stat().st_mtime_ns == then for p, then in kept.items())


@pytest.mark.slow
def test_forty_dives_survive_a_kill_and_a_cluster_that_loses_a_worker():
    pytest.importorskip("distributed")
    found = STUDY.find([0])
    assert STUDY.good(found)
    killed, clustered = found.of("kill")[0], found.of("dask")[0]
    assert killed["exit_code"] == -signal.SIGKILL
    assert 20 <= killed["kept"] == killed["after"] < 40
    assert clustered["killed_after"] < 40
    assert clustered["exit_code"] == 0


@pytest.mark.slow
def test_missions_taken_by_a_cluster_have_the_same_sizes(tmp_path):
    distributed = pytest.importorskip("distributed")
    plant, missions = load_vehicle("slocum"), {}
    for k in range(4):
        flown = replace_at(plant, OFFSET, 0.01 * k)
        missions[f"m{k}"] = closed_loop(flown, rng=np.random.default_rng(40 + k), duration=520.0)
    missions["short"] = missions["m0"].between(0.0, 100.0)
    folders = tmp_path / "cluster", tmp_path / "here"
    with distributed.LocalCluster(1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        found = follow_series(missions, plant, folders[0], most=1, scheduler=cluster.scheduler_address)
    here = follow_series(missions, plant, folders[1], most=1)
    assert found.trends == here.trends
    assert set(found.failed) == {"short"}
    files = [{p.name: p.read_bytes() for p in (folder / MISSIONS).iterdir()} for folder in folders]
    assert files[0] == files[1]
    assert len(files[0]) == 5


def test_a_scheduler_is_asked_before_anything_is_fitted(tmp_path, monkeypatch):
    record = Record.from_arrays(4.0 * np.arange(5), {"heading_rad": np.zeros(5)})  # too short for any fit
    missions = dict.fromkeys(("a", "b", "c", "d"), record)
    given = (missions, load_vehicle("slocum"), tmp_path)
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "distributed", None)
        with pytest.raises(ImportError, match=r"pip install '\.\[distributed\]'"):
            follow_series(*given, scheduler="tcp://127.0.0.1:9")
    pytest.importorskip("distributed")
    monkeypatch.setattr("identification.campaign.running.pool._ANSWER", 0.5)
    with pytest.raises(ValueError, match=r"No Dask scheduler answers at tcp://127.0.0.1:9"):
        follow_series(*given, scheduler="tcp://127.0.0.1:9")
