"""Tests of closed-loop comparisons: better with the right model, and a clear statement if nothing can be run."""

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis.judge.closing import (
    closed_loop,
    commands_at_log_samples,
    controller_for_channels,
    steered,
    targets_of,
)
from identification.experiments.missions import run_mission

CASES = [
    ("slocum", {"effects.yaw.moment": 0.02}, {"duration": 300.0}, ("heading_rad",)),
    ("qiandao_float", {"effects.volume.compressibility": 4e-7}, {"duration": 400.0}, ("depth_m",)),
    ("remus100", {"effects.rudder.offset": 0.08}, {"duration": 40.0}, ("depth_m", "heading_rad", "u_mps")),
]


def told(record, given, after):
    """The parts of a diagnosis that the closed loop needs."""
    return record, {"given": given, "before": given, "after": after}


@pytest.mark.parametrize("vehicle, effects, settings, channels", CASES, ids=[case[0] for case in CASES])
def test_the_corrected_vehicle_repeats_the_logged_loop(vehicle, effects, settings, channels):
    given = load_vehicle(vehicle)
    truth = replace_at(given, effects)
    record = run_mission(truth, np.random.default_rng(0), **settings)
    found = closed_loop(*told(record, given, truth))
    assert tuple(loop.channel for loop in found) == channels
    loop = next(loop for loop in found if loop.channel in ("heading_rad", "depth_m") and loop.before > 1.2 * loop.after)
    assert loop.after < 0.1 * loop.logged
    assert loop.tracking["after"] == pytest.approx(loop.logged, rel=0.1)
    assert " as given and " in loop.words
    assert "before" not in loop.words


def test_samples_before_the_first_set_point_are_left_out_and_later_ones_keep_the_last():
    given = load_vehicle("slocum")
    record = run_mission(replace_at(given, "effects.yaw.moment", 0.02), np.random.default_rng(0), duration=400.0)
    wanted = record["heading_cmd_rad"].copy()
    new = np.flatnonzero(np.diff(wanted, prepend=np.nan) != 0.0)  # a log often holds a command only when it changes
    sparse = np.full(len(record), np.nan)
    sparse[new] = wanted[new]
    late = sparse.copy()
    late[: new[1]] = np.nan
    first, whole = record.time[new[1]], closed_loop(*told(record, given, given))
    assert closed_loop(*told(record.with_channels({"heading_cmd_rad": sparse}), given, given)) == whole
    cut = closed_loop(*told(record.between(first, np.inf), given, given))
    assert closed_loop(*told(record.with_channels({"heading_cmd_rad": late}), given, given)) == cut


def test_set_points_that_never_meet_give_a_reason():
    given = load_vehicle("remus100")
    record = run_mission(given, np.random.default_rng(0), duration=10.0)
    early, half = record.time < 5.0, np.repeat([0, 1], [50, len(record) - 50])
    goals = {"depth_cmd_m": np.where(early, record["depth_cmd_m"], np.nan)}
    goals["heading_cmd_rad"] = np.where(early, np.nan, record["heading_cmd_rad"])
    apart = Record.from_arrays(record.time, {n: record[n] for n in record.names} | goals, segment=half)
    (loop,) = closed_loop(*told(apart, given, given))
    assert "never has all of its set points" in loop.words


def test_a_log_without_set_points_gives_a_reason():
    given = load_vehicle("slocum")
    record = run_mission(given, np.random.default_rng(0), duration=60.0).without(["heading_cmd_rad"])
    (loop,) = closed_loop(*told(record, given, given))
    assert np.isnan(loop.after)
    assert loop.words == "The closed loop was not compared: the log has no set points (heading_cmd_rad)."


def test_the_commands_at_the_log_are_those_of_every_model():
    given = load_vehicle("remus100")
    record = run_mission(replace_at(given, "effects.rudder.offset", 0.05), np.random.default_rng(0), duration=20.0)
    targets = targets_of(given, record)
    controller = controller_for_channels(given, targets)
    at_log = commands_at_log_samples(given, controller, record, targets)
    assert at_log is not None
    assert len(at_log) == len(record)
    alone, told_so = (steered(given, controller, record, targets, known) for known in (None, at_log))
    for name in targets:
        assert np.array_equal(alone[name], told_so[name])
    missing = record.without([given.outputs[0]])
    assert commands_at_log_samples(given, controller, missing, targets) is None


@pytest.mark.parametrize("last", ["after", "refitted"])
def test_a_loop_is_told_by_what_the_vehicle_is_called(last):
    given = load_vehicle("slocum")
    record = run_mission(given, np.random.default_rng(0), duration=120.0)
    other = replace_at(given, "effects.rudder.offset", 0.05)
    (loop,) = closed_loop(record, {"given": given, "before": given, "after": other}, last=last)
    assert " as given and " in loop.words
    assert loop.words.endswith(f"{last}.")


def test_a_loop_in_which_nothing_was_found_has_no_before_and_after():
    given = load_vehicle("slocum")
    record = run_mission(given, np.random.default_rng(0), duration=120.0)
    other = replace_at(given, "effects.rudder.offset", 0.05)
    (same,) = closed_loop(record, {"given": given, "before": given, "after": given})
    (refitted,) = closed_loop(record, {"given": given, "before": other, "after": other})
    assert same.words.endswith("as given.")
    assert refitted.words.endswith("refitted.")
    assert "after" not in same.words + refitted.words.split("differs")[1]
