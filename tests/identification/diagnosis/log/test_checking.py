"""Tests of which channels of a log are compared: unmeasured speeds, and the depth that depends on them."""

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis.log.checking import Asked, _adrift, check_log
from identification.diagnosis.log.plausibility import log_doubts
from identification.experiments.hovering import hover
from identification.experiments.manoeuvres import NOISE
from identification.experiments.missions import run_mission
from identification.fit.shooting import Shooting
from identification.fit.stretches import Stretches
from identification.fit.windows import free_run_windows

TIME = np.arange(0.0, 20.0, 0.05)
SPEEDS = ("u_mps", "v_mps", "w_mps")


def log_of(steep: float, *more: str) -> Record:
    """A log of a vehicle that pitches by up to `steep`, rad, with idle thrusters."""
    rng = np.random.default_rng(0)
    names = ("roll_rad", "heading_rad", "p_radps", "q_radps", "r_radps", "depth_m", *more)
    channels = {name: 0.01 * rng.standard_normal(TIME.size) for name in names}
    channels |= {f"t{k}_us": np.full(TIME.size, 1500.0) for k in range(1, 7)}
    return Record.from_arrays(TIME, channels | {"pitch_rad": steep * np.sin(TIME)})


@pytest.mark.parametrize(
    "steep, more, left_out",
    [
        (1.4, (), ("depth_m",)),
        (0.3, (), ()),
        (1.4, ("u_dvl_mps", "v_dvl_mps", "w_dvl_mps"), ()),
        (1.4, ("north_m", "east_m"), ()),
    ],
)
def test_the_depth_of_a_vehicle_that_loops_needs_its_speeds(steep, more, left_out):
    load_vehicle("bluerov")
    assert _adrift(log_of(steep, *more), load_vehicle("bluerov")) == left_out
    assert _adrift(log_of(steep), load_vehicle("vt690")) == ()  # a torpedo's speed follows from its propeller


@pytest.mark.parametrize(
    "dropped, more, resting",
    [
        (("depth_m",), (), set(SPEEDS)),
        ((), (), {"u_mps", "v_mps"}),
        ((), ("u_dvl_mps", "v_dvl_mps", "w_dvl_mps"), set()),
    ],
)
def test_speeds_that_nothing_tells_are_followed_and_nothing_pushes_them(dropped, more, resting):
    """The hull's speeds also turn it; those of the first BlueROV affect no other measurement."""
    plant, record = load_vehicle("bluerov2_heavy"), log_of(0.3, *more).without(dropped)
    record = record.with_channels({f"t{k}_share": np.zeros(TIME.size) for k in range(1, 9)})
    problem = Stretches(plant, record, record.segments)
    states = [(*plant.family.states, *plant.family.sensors)[i] for i in problem.live]
    assert set(SPEEDS) <= set(states)
    assert set(SPEEDS) - set(problem.pushed) == resting


def test_attitude_that_nothing_tells_follows_the_commands_and_is_not_pushed():
    """Otherwise the process noise of an unmeasured axis would absorb model errors elsewhere."""
    plant, tilt = load_vehicle("bluerov2_heavy"), ("roll_rad", "pitch_rad", "p_radps", "q_radps")
    record = log_of(0.3, "u_dvl_mps", "v_dvl_mps", "w_dvl_mps")
    record = record.with_channels({f"t{k}_share": 0.1 * np.sin(k * TIME) for k in range(1, 9)})
    assert set(tilt[2:]) <= set(Stretches(plant, record, record.segments).pushed)
    untold = Stretches(plant, record.without(tilt), record.segments)
    assert not set(tilt) & set(untold.pushed)
    assert set(tilt) <= set(untold.driven)
    assert all(np.ptp(untold.driven[name]) > 0.0 for name in tilt)


@pytest.fixture(scope="module")
def moving() -> Record:
    """Twenty seconds of a vehicle that is moved by its thrusters."""
    return hover(
        load_vehicle("bluerov2_heavy"),
        rng=np.random.default_rng(3),
        duration=20.0,
        loop="open",
        amplitude=0.3,
        noise=0.1,
    )


@pytest.mark.parametrize("left, rates", [((), True), ((), False), (("depth_m",), True)])
def test_speeds_that_nothing_tells_are_those_that_the_commands_make(moving, left, rates):
    """First guesses at the starts of runs are within a twentieth of the spread; they depend on noisy readings."""
    kept = ("roll_rad", "pitch_rad", "heading_rad", *left, *(("p_radps", "q_radps", "r_radps") if rates else ()))
    plant = load_vehicle("bluerov2_heavy")
    record = moving.without([name for name in plant.outputs if name not in kept])
    problem = Shooting(plant, record, record.windows(4.0))
    untold = sorted(plant.family.resting(problem.channels))
    assert set(untold) == set(SPEEDS) - ({"w_mps"} if left else set())
    states = [plant.family.states.index(name) for name in untold]
    truth = moving.matrix(untold)
    missed = problem.first_guess[:, states] - truth[[w.start for w in problem.windows]]
    assert np.all(np.sqrt((missed[1:] ** 2).mean(axis=0)) < 0.05 * truth.std(axis=0) + NOISE["dvl_water"])
    assert not problem.first_guess[0, states].any()
    assert not set(states) & set(problem.start_states.tolist())


@pytest.mark.parametrize("duration, window", [(600.0, 120.0), (400.0, 96.0), (300.0, 60.0)])
def test_a_short_log_has_shorter_windows(duration, window):
    """Windows have at least half the vehicle's length; a requested length that gives too few windows is refused."""
    plant = load_vehicle("slocum")
    record = run_mission(plant, np.random.default_rng(1), duration=duration)
    log = check_log(record, plant, Asked())
    assert log.window == pytest.approx(window)
    assert len(log.every_window) >= 4
    assert log.settle < 0.5 * log.window
    if duration < 600.0:
        with pytest.raises(ValueError, match="at least 4 windows of 120 s"):
            check_log(record, plant, Asked(window=120.0))


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"window": "x"}, "window needs a number above 0 in s, got 'x'"),
        ({"window": 0}, "window needs a number above 0 in s, got 0"),
        ({"settle": -1.0}, "settle needs a number of at least 0 in s, got -1.0"),
        ({"seed": "x"}, "seed needs a whole number of at least 0, got 'x'"),
        ({"most": 0}, "most needs a whole number of at least 1, got 0"),
        ({"doubt": "x"}, "doubt needs a number of at least 0, got 'x'"),
    ],
)
def test_settings_that_are_no_such_numbers_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        Asked(**settings)


def test_a_log_too_short_for_windows_of_half_the_length_is_refused():
    plant = load_vehicle("slocum")
    record = run_mission(plant, np.random.default_rng(1), duration=200.0)
    with pytest.raises(ValueError, match="at least 4 windows of 120 s"):
        check_log(record, plant, Asked())


def test_a_measurement_that_was_not_read_for_longer_than_a_free_run_is_left_out():
    """A position at the surface, before and after a dive, and one with short outages."""
    glider = load_vehicle("slocum")
    log = run_mission(glider, np.random.default_rng(0), duration=1200.0)
    surfaced, there = (log.time < 60.0) | (log.time > 1140.0), log.time % 100.0 < 60.0
    checked = check_log(log.with_readings({"north_m": there, "east_m": surfaced}), glider, Asked())
    assert checked.record.has("north_m")
    assert not checked.record.has("east_m")
    assert checked.record.notes[-1] == "east_m is left out: it was not read for 1,088 s, longer than a free run."


def test_a_check_of_a_log_needs_no_readings_where_the_commands_move_most():
    glider = load_vehicle("slocum")
    log = run_mission(glider, np.random.default_rng(0), duration=1200.0)
    rare = log.with_readings({"north_m": np.arange(len(log)) % 24 == 0})
    windows = free_run_windows(glider, rare, 100.0)
    assert log_doubts(rare, glider, windows, 20.0) == ()
    none = log.with_readings({"north_m": np.zeros(len(log), dtype=bool)})
    assert log_doubts(none, glider, windows, 20.0) == ()
