"""The operators' rule of a glider in six degrees of freedom: yos, a PI on pitch, a PI on heading, and their gains."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.gliding import steady_glide
from controllers.autopilots import autopilot
from controllers.gains import Gains
from controllers.trials.trial import at_rest, run_trial
from controllers.yos import YoMemory
from tests.vehicles.body.test_seawing import steady

SEAWING = load_vehicle("seawing")
PILOT = autopilot(SEAWING)
READING = {"depth_m": 30.0, "pitch_rad": -0.4, "heading_rad": 0.0, "dt_s": 1.0}


def flown(plant=SEAWING, heading=1.0, duration=900.0, pilot=PILOT, rng=None):
    """A run of the plant on a heading, from a start at rest at 20 m."""
    start = at_rest(plant, {"depth_m": 20.0, "heading_rad": 0.0})
    start[0][:1] = 0.3  # m/s
    return run_trial(plant, pilot, {"heading_rad": [(0.0, heading)]}, duration, start=start, rng=rng)


def off(run, heading):
    """The heading error, rad, the short way round."""
    return np.remainder(run["heading_rad"] - heading + np.pi, 2.0 * np.pi) - np.pi


def climbing(run):
    """Samples of settled climbs and of settled dives, by the depth's rate."""
    rate = np.gradient(run["depth_m"], run["time_s"])
    return rate < -0.1, rate > 0.1


def test_its_gains_follow_from_the_published_equations():
    """The rate of turn per angle of the battery, and its place per pitch, by root finding apart."""
    for leg in (PILOT.dive, PILOT.climb):
        guess, near = (
            steady_glide(SEAWING, leg.volume, leg.pitch, 30.0, angle).state[[0, 1, 2, 3, 4, 5, 9, 10]]
            for angle in (0.0, 0.02)
        )
        turned = steady(leg.volume, leg.slide, 0.02, near)
        turn = np.sign(turned[5]) * np.linalg.norm(turned[3:6]) / 0.02
        assert 1.0 / (leg.per_turn * 30.0) == pytest.approx(turn, rel=0.05)  # a slope over 0.05 rad, one over 0.02
        pitch = (
            steady(leg.volume, leg.slide + 1e-3, 0.0, guess)[7] - steady(leg.volume, leg.slide - 1e-3, 0.0, guess)[7]
        )
        assert leg.per_pitch == pytest.approx(0.5 * 2e-3 / pitch, rel=0.1)
    assert PILOT.dive.per_turn > 0.0 > PILOT.climb.per_turn  # it turns to the other side in a climb


def test_the_battery_turns_to_the_other_side_in_a_climb_and_not_at_all_while_it_turns_round():
    for memory, sign in ((YoMemory(False, PILOT.dive.volume), 1.0), (YoMemory(True, PILOT.climb.volume), -1.0)):
        command, _ = PILOT.act(memory, READING, {"heading_rad": 0.1})
        assert np.sign(command["battery_rad"]) == sign
    command, after = PILOT.act(YoMemory(True, 0.0, heading_sum=5.0), READING, {"heading_rad": 0.1})
    assert command["battery_rad"] == 0.0
    assert after.heading_sum == 0.0


def test_the_engine_changes_over_at_the_two_depths_and_the_pitch_follows_it():
    memory, seen = PILOT.start(), []
    for depth in (30.0, 47.9, 48.0, 30.0, 12.1, 12.0, 30.0):
        command, memory = PILOT.act(memory, {**READING, "depth_m": depth}, {})
        seen.append(command["ballast_m3"])
    down, up = PILOT.dive.volume, PILOT.climb.volume
    assert seen == [down, down, up, up, up, down, down]
    level = {**READING, "pitch_rad": 0.0}
    command, memory = PILOT.act(YoMemory(True, 0.0 - PILOT.rate), level, {})
    assert memory.engine == pytest.approx(0.0, abs=1e-12)
    # neutral on its way up: midway between where the battery is in dives and in climbs
    assert command["battery_m"] == pytest.approx(0.5 * (PILOT.dive.slide + PILOT.climb.slide), abs=1e-9)


def test_both_integrals_rest_where_a_command_is_at_its_end():
    memory = YoMemory(False, PILOT.dive.volume)
    for _ in range(100):
        command, memory = PILOT.act(memory, {**READING, "pitch_rad": 1.5}, {"heading_rad": 2.0})
    assert command["battery_m"] == PILOT.high
    assert command["battery_rad"] == PILOT.dive.angle
    assert memory.pitch_sum > -15.0  # of errors of 1.9 rad, over 100 s
    assert memory.heading_sum == 0.0


@pytest.mark.parametrize("heading", [1.0, -1.0, 3.0])
def test_it_settles_on_a_heading_with_noise(heading):
    run = flown(heading=heading, rng=np.random.default_rng(0))
    error = off(run, heading)
    assert np.abs(error[600:]).max() < np.radians(6.0)
    assert np.sqrt(np.mean(error[600:] ** 2)) < np.radians(2.0)
    assert 4.0 < run["depth_m"][200:].min() < run["depth_m"].max() < 56.0
    assert np.abs(run["roll_rad"][60:]).max() < 0.5  # before, it gathers speed
    for name, (low, high) in {"battery_m": (-0.05, 0.05), "battery_rad": (-np.pi / 2, np.pi / 2)}.items():
        assert low <= run[name].min() <= run[name].max() <= high


def test_a_large_turn_in_a_climb_does_not_roll_it_over():
    steps = {"heading_rad": [(0.0, 0.0), (280.0, 2.0)]}  # s, rad: it climbs by then
    start = at_rest(SEAWING, {"depth_m": 20.0, "heading_rad": 0.0})
    run = run_trial(SEAWING, PILOT, steps, 360.0, start=start)
    rows = run["time_s"] >= 280.0
    assert (np.diff(run["depth_m"][rows]) < -0.1).all()
    assert 0.2 < np.abs(run["roll_rad"][rows]).max() < 0.5
    assert off(run, 0.0)[-1] > 0.2  # and it turns to the right side


@pytest.mark.parametrize(
    "effects",
    [
        {"effects.battery.slide.offset": 5e-3},
        {"effects.load.payload": 0.1, "effects.load.x_g": 5e-4},
        {"effects.ballast.gain": 0.8},
        {"effects.wings.lost": 0.2},
    ],
)
def test_the_integral_holds_the_pitch_of_a_vehicle_that_is_not_the_modelled_one(effects):
    plant = replace_at(SEAWING, effects)
    run = flown(plant, duration=1800.0)
    for rows, pitch in zip(climbing(run), (0.4, -0.4), strict=True):
        rows &= run["time_s"] > 900.0
        assert rows.sum() > 100
        assert np.median(run["pitch_rad"][rows]) == pytest.approx(pitch, abs=0.04)
    without = replace(PILOT, pitch_time=np.inf)
    if "effects.battery.slide.offset" in effects:
        run = flown(plant, duration=900.0, pilot=without)
        assert abs(np.median(run["pitch_rad"][climbing(run)[1]]) + 0.4) > 0.08


def test_the_integral_takes_out_what_a_crooked_battery_does_to_the_heading():
    plant = replace_at(SEAWING, "effects.battery.turn.offset", 0.1)
    errors = []
    for pilot in (PILOT, replace(PILOT, heading_time=np.inf)):
        run = flown(plant, pilot=pilot, duration=1500.0)
        errors.append(np.sqrt(np.mean(off(run, 1.0)[600:] ** 2)))
    assert errors[0] < 0.7 * errors[1]


def test_a_place_is_flown_to_and_a_heading_counts_before_it():
    reading = {**READING, "north_m": 0.0, "east_m": 0.0}
    east = {"north_m": 0.0, "east_m": 100.0, "depth_m": 0.0}
    memory = YoMemory(False, PILOT.dive.volume)
    towards, _ = PILOT.act(memory, reading, east)
    assert towards["battery_rad"] == PILOT.dive.angle
    other, _ = PILOT.act(memory, reading, {**east, "heading_rad": -0.1})
    assert other["battery_rad"] < 0.0


@pytest.mark.parametrize(
    "options, words",
    [
        ({"targets": ["heading_rad", "depth_m"]}, "on heading_rad, or to north_m, east_m and depth_m together"),
        ({"gains": Gains("seawing", 1.0)}, "leave out gains="),
        ({"top": 50.0}, "need 0 < top < apogee in m"),
        ({"lift": 0.0}, "lift from 0 to 1"),
        ({"pitch": 0.01}, "pitch from 0.1 to 1.2 rad"),
    ],
)
def test_bad_settings_are_refused(options, words):
    with pytest.raises(ValueError, match=words):
        autopilot(SEAWING, **options)


def test_a_mass_that_turns_about_its_own_centre_does_not_steer():
    with pytest.raises(ValueError, match="does not turn with battery_rad"):
        autopilot(replace_at(SEAWING, {"parts.battery.eccentricity": 0.0, "parts.battery.i_yy": 0.17}))
