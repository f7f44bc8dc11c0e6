"""Tests of the diagnosis on logs with an unknown truth, on a real log, and on bad input."""

import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from auv_gym.model import simulate
from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.reading import read_record
from auv_gym.records.record import Record
from auv_gym.vehicles.glider import yaw_inertia
from identification.diagnosis import as_json, diagnose, write_diagnosis
from identification.diagnosis.search import searching
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import COMMON_DELAY, candidates_of
from identification.diagnosis.search.remainder import Left
from identification.experiments.excitation import prbs
from identification.experiments.heading_control import closed_loop
from scripts import readme_figure
from tests.identification.blind_logs import CLEAN, effects_of, one, study
from tests.identification.gliders import QUICK

DEGREE = np.pi / 180.0
VEHICLES = ("slocum", "ganeshblue")


def log_of(vehicle="slocum", seed=0, duration=600.0, track=None, **effects) -> Record:
    """A closed-loop log of a vehicle with effects given as `yaw__moment=0.02`."""
    changes = {f"effects.{name.replace('__', '.')}": value for name, value in effects.items()}
    plant = replace_at(load_vehicle(vehicle), changes)
    return closed_loop(
        plant, rng=np.random.default_rng(seed), duration=duration, compass_noise=0.5 * DEGREE, track_noise=track
    )


@pytest.fixture(scope="module")
def ammonite():
    pytest.importorskip("dbdreader", reason="the extra `slocum` is not installed")
    record = read_record("slocum:ammonite")
    return diagnose(record.select(record["depth_m"] > 10.0), load_vehicle("slocum"), source="slocum:ammonite")


@pytest.mark.parametrize(
    "vehicle, effect",
    [
        # every other effect of a glider, daily
        pytest.param(v, e, marks=() if e == CLEAN or (v == VEHICLES[0] and k % 2) else pytest.mark.slow)
        for v in VEHICLES
        for k, e in enumerate((CLEAN, *effects_of(v)))
    ],
    ids=lambda x: x.removeprefix("effects."),
)
def test_an_undeclared_effect_is_named_or_in_the_named_tie(vehicle, effect):
    result = one((vehicle, effect, 1))
    assert result["right"], result


@pytest.mark.slow
@pytest.mark.parametrize("seed", [9, 18])
def test_a_compass_bias_does_not_pass_for_a_current(seed):
    """Two held-out windows refute the bias by chance (9), or a dozen blocks show a current by chance (18)."""
    result = one(("slocum", "effects.compass.bias", seed))
    assert result["right"], result
    assert not result["beside"], result


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_twenty_seeds_of_every_effect_and_of_clean_logs(vehicle):
    rows = study([vehicle], None, range(20), jobs=2)
    misses = {row["effect"]: row["misses"] for row in rows if row["right"] < (20 if row["effect"] == CLEAN else 19)}
    assert not misses


def test_a_real_glider_log_lacks_a_steady_turn(ammonite):
    assert ammonite.verdict == "tied"
    group = ammonite.tied[0]
    assert "effects.rudder.deadband" in {e.path for e in ammonite.effects}
    # at a nearly constant speed and roll, these three turn the glider alike
    assert {"effects.yaw.moment", "effects.rudder.offset", "effects.yaw.roll_moment"} <= set(group)
    before = ammonite.before.scores["heading_rad"].rmse / DEGREE
    after = ammonite.after.scores["heading_rad"].rmse / DEGREE
    assert before > 12.0
    assert after <= 7.0
    assert ammonite.explained > 0.75


def test_the_readme_says_what_its_program_prints(ammonite, tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")

    def diagnosed(record, plant, **settings):  # once is enough: half a minute
        assert record.dataset.equals(ammonite.record.dataset)
        assert (plant, settings) == (load_vehicle("slocum"), {"source": ammonite.source})
        return ammonite

    monkeypatch.setattr("scripts.readme_figure.diagnose", diagnosed)
    assert readme_figure.main(["--out", str(tmp_path)]) == 0
    before, after = re.findall(r"([\d.]+) deg before, ([\d.]+) deg after", capsys.readouterr().out)[0]
    readme = (Path(__file__).parents[2] / "README.md").read_text()
    assert f"{float(before):.1f} deg once the coefficients are refitted" in readme
    assert f"{float(after):.1f} deg with the two effects" in readme
    assert (tmp_path / "ammonite.png").stat().st_size > 10_000
    assert [p.name for p in tmp_path.iterdir()] == ["ammonite.png"]


def test_windows_are_those_of_the_parts_and_each_is_scored_once(ammonite):
    assert len(ammonite.windows) == 6
    rows = [k for part in ammonite.windows for w in part for k in range(w.start, w.stop)]
    assert len(rows) == len(set(rows))
    assert ammonite.after.unseen.rows.tolist() == sorted(rows)


@pytest.mark.slow
def test_no_name_depends_on_how_long_free_runs_are(ammonite):
    other = diagnose(ammonite.record, load_vehicle("slocum"), window=150.0)
    assert [(e.path, e.value, e.ci95, e.tied_with) for e in other.effects] == [
        (e.path, e.value, e.ci95, e.tied_with) for e in ammonite.effects
    ]
    assert other.verdict == ammonite.verdict
    assert other.after.scores["heading_rad"].rmse != ammonite.after.scores["heading_rad"].rmse


@pytest.mark.slow
def test_a_moment_and_a_rudder_offset_tie_unless_the_rudder_meets_its_stop():
    plant = replace_at(load_vehicle("slocum"), "effects.yaw.moment", 0.012)
    rng = np.random.default_rng(0)
    time = 4.0 * np.arange(180)
    rudder = prbs(180, 5, 0.2, rng)
    quiet = Record.from_arrays(time, {"rudder_rad": rudder, "heading_rad": np.zeros(180)})
    heading = simulate(plant, quiet)["heading_rad"] + 0.5 * DEGREE * rng.standard_normal(180)
    result = diagnose(quiet.with_channels({"heading_rad": heading}), load_vehicle("slocum"))
    assert result.verdict == "tied"
    assert {"effects.yaw.moment", "effects.rudder.offset"} <= set(result.tied[0])
    (effect,) = result.effects
    equal = {effect.path: effect.probability} | {m.path: m.probability for m in effect.members}
    assert sum(equal.values()) == pytest.approx(1.0, abs=1e-6)
    assert equal["effects.yaw.moment"] == pytest.approx(equal["effects.rudder.offset"], rel=0.2)
    (common,) = result.common
    assert common.spread["heading_rad"] < 0.1 * DEGREE
    assert "--next-experiment" in result.summary()
    assert "--next-experiment" not in replace(result, planned=True).summary()
    # a closed loop that drives the rudder into its stop, where an offset does nothing, tells them apart
    result = diagnose(log_of(yaw__moment=0.012), load_vehicle("slocum"))
    assert [e.path for e in result.effects] == ["effects.yaw.moment"]
    assert result.verdict == "named"
    assert result.effects[0].probability > 0.95
    assert "--next-experiment" not in result.summary()


@pytest.mark.slow
def test_a_current_needs_a_track_to_be_seen():
    result = diagnose(log_of(current__north=0.05), load_vehicle("slocum"))
    assert result.verdict == "none"
    unseen = {d.path: d.reason for d in result.detectable if not np.isfinite(d.size)}
    assert unseen["effects.current.north"] == "changes nothing that was measured"
    assert unseen["effects.compass.bias"] == "the initial states do the same"  # nobody knows the first heading
    named = diagnose(log_of(current__north=0.05, track=1.0), load_vehicle("slocum"))
    assert [e.path for e in named.effects] == ["effects.current.north"]
    low, high = named.effects[0].ci95
    assert low < 0.05 < high


def test_a_refit_that_leaves_what_the_given_vehicle_does_not_is_no_cause(monkeypatch):
    """The vehicle as given explains the log; what is left was left by the coefficients that were fitted to it."""

    def left(bench, state):
        return Left(("heading_rad",) if state.paths else ())

    plant, log = load_vehicle("slocum"), log_of(seed=3)
    monkeypatch.setattr(searching, "what_is_left", left)
    result = diagnose(log, plant)
    assert result.verdict == "none"
    assert result.after.plant.vector.tolist() == plant.vector.tolist()
    assert result.coefficients == ()
    assert not result.left
    monkeypatch.setattr(searching, "what_is_left", lambda *_: Left(("heading_rad",)))
    result = diagnose(log, plant)
    assert result.verdict == "unexplained"
    assert result.after.plant.vector.tolist() != plant.vector.tolist()
    assert result.left == Left(("heading_rad",))


@pytest.mark.parametrize("seed", [1, 2])
def test_windows_that_tell_little_do_not_make_coefficients_wrong(seed):
    plant, time = QUICK, 4.0 * np.arange(360)
    held_out = (time // 120.0) % 2 == 1  # where the rudder moves; the windows that are fitted tell little
    rudder = np.where(held_out, 0.4, 0.02) * np.where(time % 80.0 < 40.0, 1.0, -1.0)
    quiet = Record.from_arrays(time, {"rudder_rad": rudder, "u_mps": np.full(360, 0.35), "heading_rad": np.zeros(360)})
    noise = 0.02 * DEGREE * np.random.default_rng(seed).standard_normal(360)
    record = quiet.with_channels({"heading_rad": simulate(plant, quiet)["heading_rad"] + noise})
    result = diagnose(record, plant)
    assert result.verdict == "none"
    for c in result.coefficients:
        assert c.ci95[0] < c.given < c.ci95[1]


def test_a_clean_log_says_what_it_could_have_shown():
    result = diagnose(log_of(seed=3), load_vehicle("slocum"))
    assert result.verdict == "none"
    sizes = {d.path: d.size for d in result.detectable}
    smallest = sizes["effects.rudder.offset"]
    assert 0.0 < smallest < 0.05
    # an effect of that size, put in, is found (95 % power for the linear case; this seed is fixed)
    found = diagnose(log_of(seed=4, rudder__offset=1.2 * smallest), load_vehicle("slocum"))
    assert (
        any("effects.rudder.offset" in group for group in found.tied)
        or found.effects[0].path == "effects.rudder.offset"
    )


@pytest.mark.parametrize("shape", [pytest.param("square", marks=pytest.mark.slow), "wander"])
def test_a_push_outside_the_library_is_told_as_one_and_gets_no_name(shape):
    plant = load_vehicle("ganeshblue")
    rng = np.random.default_rng(11)
    record = closed_loop(plant, rng=rng, duration=1200.0, compass_noise=0.0, track_noise=None)
    time = record.time
    hidden = 0.05 * np.sign(np.sin(2 * np.pi * time / 47.0))
    if shape == "wander":  # first-order noise with a correlation time of 30 s
        hidden = lfilter([0.012], [1.0, -np.exp(-1 / 30.0)], rng.standard_normal(time.size))
    truth = simulate(plant, record.with_channels({"bow_thruster_N": hidden}))
    log = record.with_channels({"heading_rad": truth["heading_rad"] + 0.5 * DEGREE * rng.standard_normal(time.size)})
    result = diagnose(log, plant)
    assert result.effects == ()
    assert result.noise is not None
    assert result.noise.measurement["heading_rad"] == pytest.approx(0.5 * DEGREE, rel=0.1)
    size, correlated = result.noise.process["r_radps"]
    hull = plant.hull
    turning = np.std(hidden) * hull.bow_thruster_arm / yaw_inertia(plant.family.view(plant.vector).hull)
    if shape == "wander":  # 20 independent pushes: their size is sure to 16 %, how long they last to a third
        assert size == pytest.approx(turning, rel=0.48)
        assert 15.0 < correlated < 60.0
    else:
        assert size == pytest.approx(turning, rel=0.3)
        assert correlated < 0.5 * 47.0
    assert "Random accelerations push the vehicle" in result.summary()


@pytest.mark.slow
def test_two_effects_at_once_are_both_named():
    result = diagnose(log_of(duration=1200.0, rudder__deadband=0.06, yaw__roll_moment=0.4), load_vehicle("slocum"))
    assert {e.path for e in result.effects} == {"effects.rudder.deadband", "effects.yaw.roll_moment"}


def test_the_files_say_the_same_and_give_back_the_corrected_vehicle(tmp_path):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    result = diagnose(log_of(seed=5, rudder__deadband=0.06), load_vehicle("slocum"), seed=7, source="test log")
    paths = write_diagnosis(result, tmp_path / "new" / "folder")
    content = json.loads(paths["diagnosis.json"].read_text())
    assert content["verdict"] == result.verdict == "named"
    assert content["effects"][0]["path"] == "effects.rudder.deadband"
    assert content["effects"][0]["unit"] == "rad"
    low, high = content["effects"][0]["ci95"]
    assert low < content["effects"][0]["value"] < high
    error = content["error"]
    assert error["horizon_s"] == 100.0
    assert error["after"]["heading_rad"]["rmse"] < error["before"]["heading_rad"]["rmse"]
    assert content["process_noise"]["measurement"]["heading_rad"] == pytest.approx(0.5 * DEGREE, rel=0.2)
    assert content["process_noise"]["process"] == {}
    nothing = {name: [] for name in ("coloured", "bursts", "gusts", "misread", "slow")}
    assert content["left"] == nothing | {"depends": None, "changes": "", "passing": ""}
    assert content["process_noise"]["lasting"] == []
    assert content["seed"] == 7
    assert "numpy" in content["versions"]
    vehicle = load_vehicle(paths["vehicle.toml"])
    assert np.array_equal(vehicle.vector, result.after.plant.vector)
    assert value_at(vehicle, "effects.rudder.deadband") == content["effects"][0]["value"]
    assert not list(paths["report.html"].parent.glob(".*"))


def test_the_same_log_gives_the_same_verdict_to_the_last_digit():
    log = log_of(seed=6, yaw__moment=0.02)
    assert as_json(diagnose(log, load_vehicle("slocum"))) == as_json(diagnose(log, load_vehicle("slocum")))


def test_bad_logs_are_refused_with_what_was_needed_and_what_came(tmp_path):
    plant, log = load_vehicle("slocum"), log_of()
    with pytest.raises(ValueError, match=r"needs the channel heading_rad, got .*rudder_rad"):
        diagnose(log.without(["heading_rad"]), plant)
    with pytest.raises(ValueError, match="rudder_rad"):
        diagnose(log.without(["rudder_rad"]), plant)
    with pytest.raises(ValueError, match=r"rudder_rad is constant at 0\.1 .*in which it moves"):
        diagnose(log.with_channels({"rudder_rad": np.full(len(log), 0.1)}), plant)
    with pytest.raises(ValueError, match=r"at least 4 windows of 120 s, or of 60 s .* got 0 \(longest stretch"):
        diagnose(log.between(0.0, 100.0), plant)
    with pytest.raises(ValueError, match=r"Samples are .* apart, so that a window of .* holds only"):
        diagnose(log, plant, window=20.0, settle=4.0)
    with pytest.raises(ValueError, match="doubt needs a number of at least 0, got 'x'"):
        diagnose(log, plant, doubt="x")
    with pytest.raises(ValueError, match=r"diagnose needs a record, got 'mission.csv': read_record\('mission.csv'\)"):
        diagnose("mission.csv", plant)
    with pytest.raises(ValueError, match="less than half a window"):
        diagnose(log, plant, settle=90.0)
    if os.geteuid() != 0:
        tmp_path.chmod(0o500)
        with pytest.raises(ValueError, match="Cannot write into"):
            write_diagnosis(diagnose(log, plant), tmp_path / "out")
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ValueError, match="Cannot write into"):
        write_diagnosis(diagnose(log, plant), tmp_path / "file")


def test_the_bar_for_a_name_rises_with_the_number_of_candidates():
    assert threshold(1) == pytest.approx(10.83, abs=0.01)  # chi-square table, p = 0.001
    assert threshold(20) > threshold(10) > threshold(1)
    assert threshold(10, 2) > threshold(10)


def test_every_neutral_effect_is_a_candidate_once():
    plant = load_vehicle("slocum")
    paths = [p for c in candidates_of(plant) for p in c.paths]
    assert sorted(paths) == sorted([*effects_of("slocum"), COMMON_DELAY])  # with one command its dead time
    changed = replace_at(plant, "effects.rudder.deadband", 0.01)
    assert "effects.rudder.deadband" not in [p for c in candidates_of(changed) for p in c.paths]
