"""Tests of the online filter against that of the fit, and of alarms after a change of the vehicle."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from auv_gym.model import inputs_of, outputs_of
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from identification.experiments.heading_control import closed_loop
from identification.fit.noises import Noise
from identification.fit.online import OnlineFilter
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.windows import stretches_of
from identification.monitor.monitor import CONSTANT, Alarm, Monitor
from identification.monitor.report import Watched, learned_words, watch, watched_page, watched_summary
from identification.monitor.wrapper import Monitored
from scripts.blind.changing import Changing
from scripts.blind.own_cruise import PERIOD, cruised

NOISE = Noise({"heading_rad": np.radians(0.5), "north_m": 1.0, "east_m": 1.0}, {})
PUSHED = replace(NOISE, process={"r_radps": (2e-4, 60.0)})
SWELL = replace(PUSHED, swell={40.0: {"r_radps": (2e-4, 200.0)}})
LASTING = replace(
    PUSHED, lasting={0.0: {"heading_rad": (0.02, 60.0)}, 50.0: {"north_m": (2.0, 300.0), "east_m": (1.0, 300.0)}}
)


@pytest.fixture(scope="module")
def slocum():
    return load_vehicle("slocum")


@pytest.fixture(scope="module")
def clean(slocum):
    return closed_loop(slocum, rng=np.random.default_rng(1), duration=4000.0)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [PUSHED, SWELL, LASTING], ids=["pushed", "swell", "lasting"])
def test_an_online_filter_predicts_as_that_of_a_fit_does(slocum, clean, noise):
    record = clean.select(clean.time <= 1200.0)
    problem = PredictionErrors(slocum, record, stretches_of(slocum, record)).with_noises_of(noise)
    point = problem.point(slocum.vector, problem.logs_of(noise))
    own, found = OnlineFilter(problem.online(point, 1e12)), np.zeros_like(point.errors)
    inputs, outputs, first = inputs_of(slocum, record), outputs_of(slocum, record), int(problem.rows[0])
    own.begin(inputs[first], outputs[first])
    for k in range(1, len(found)):
        own.step(inputs[first + k - 1], outputs[first + k], float(np.diff(record.time)[first + k - 1]))
        found[k] = own.innovations
    late = slice(len(found) // 2, None)  # where nothing is left of how it began
    assert np.abs(found[late] - point.errors[late]).max() < 0.05


@pytest.mark.slow
def test_a_monitor_takes_waves_of_the_clean_log_for_noise():
    """The torpedo of the driven study in a swell of 6 s."""
    torpedo = load_vehicle("vt690")
    monitor = Monitor.learn(cruised(torpedo, np.random.default_rng(9981), 300.0), torpedo)
    kicks = monitor.learned.plan.kicks
    periods = 2.0 * np.pi / kicks[kicks[:, 3] > 0.0, 3]
    assert periods.size > 1
    assert periods == pytest.approx(PERIOD, rel=0.05)


@pytest.mark.parametrize("steady", [False, True])
def test_an_alarm_comes_after_a_rudder_goes_off_and_none_before(slocum, clean, steady):
    monitor = Monitor.learn(clean, slocum, noise=NOISE, false_alarms_per_hour=0.01, steady=steady)
    bent = replace_at(slocum, "effects.rudder.offset", 0.03)
    moving = Changing.glider(slocum, lambda t: bent if t >= 2000.0 else slocum)
    record = closed_loop(moving, rng=np.random.default_rng(5), duration=3000.0)
    alarms = monitor.run(record)
    assert alarms[0].time > 2000.0
    assert alarms[0].time < 2200.0
    assert CONSTANT in monitor.learned.signals
    assert len(monitor.stretch()) <= 9.0 * slocum.window / monitor.learned.interval + 1.0


def test_a_clean_log_has_no_alarm_and_steps_are_those_of_a_replay(slocum, clean):
    monitor = Monitor.learn(clean, slocum, noise=NOISE, false_alarms_per_hour=0.01)
    other = closed_loop(slocum, rng=np.random.default_rng(6), duration=2000.0)
    found = watch(monitor, other)
    assert found.alarms == ()
    assert watched_summary(found) == [
        "The monitor assumes that the vehicle in the clean log (1.1 h) was healthy.",
        "No alarm was raised in 0.56 h, with the false-alarm rate set to 0.01 per hour.",
    ]
    again = Monitor(monitor.learned, 0.01)
    inputs, outputs = inputs_of(slocum, other), outputs_of(slocum, other)
    again.begin(inputs[0], outputs[0])
    for k in range(1, len(other)):
        again.step(dict(zip(slocum.inputs, inputs[k - 1], strict=True)), outputs[k])
        assert again.over == pytest.approx(found.over[k - 1], rel=1e-9)


@pytest.mark.slow
def test_what_stands_between_readings_is_none_to_a_monitor(slocum, clean):
    """With a compass of half the rate, the online filter has errors at its readings, and none between them."""
    held = np.arange(len(clean)) % 2 == 0
    coarse = clean.with_readings({"heading_rad": held})
    monitor = Monitor.learn(coarse, slocum, noise=NOISE)
    read = monitor.learned.present[:, slocum.outputs.index("heading_rad")]
    assert abs(read.mean() - 0.5) < 0.01
    inputs, outputs = inputs_of(slocum, coarse), outputs_of(slocum, coarse)
    streamed = Monitor(monitor.learned, 1.0)
    streamed.begin(inputs[0], outputs[0])
    replayed = Monitor(monitor.learned, 1.0)
    for k, _ in enumerate(replayed.replay(coarse.select(coarse.time <= 400.0)), 1):
        told = dict(zip(slocum.outputs, outputs[k], strict=True)) | ({} if held[k] else {"heading_rad": np.nan})
        streamed.step(inputs[k - 1], told)
        assert streamed.over == pytest.approx(replayed.over, rel=1e-9), k


def test_the_stretch_about_an_alarm_is_as_long_where_the_log_begins_just_before_it(slocum, clean, monkeypatch):
    monkeypatch.setattr("identification.monitor.monitor.find_onsets", lambda record, plant: np.ptp(record.time))
    monitor = Monitor.learn(clean, slocum, noise=NOISE)
    for time in (100.0, 2000.0):
        length = monitor.explain(clean, Alarm(time, "heading_rad", CONSTANT, 8.0, 1.5))
        assert length == pytest.approx(9.0 * slocum.window, abs=2.0 * monitor.learned.interval)


def test_the_page_lists_the_first_alarms_in_words_and_says_how_many_there_are(slocum, clean):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    monitor = Monitor.learn(clean, slocum, noise=NOISE)
    apart = float(monitor.learned.memories.max() * monitor.learned.interval)
    alarms = [Alarm(2.0 * apart * k, "heading_rad", CONSTANT, 8.0, 1.1) for k in range(1, 26)]
    alarms[1:1] = [Alarm(2.0 * apart + 8.0 * k, "heading_rad", CONSTANT, 8.0, 1.2) for k in (1, 2)]
    found = Watched(monitor, "the clean log", 1.0, tuple(alarms), np.arange(2.0), np.ones(2))
    text = watched_page(found)
    assert "slocum: 25 alarms" in text
    assert "These are the first 20 rows of 25." in text
    assert text.count("none (steady offset)") == 20
    assert f"{2.0 * apart:.0f} to {2.0 * apart + 16.0:.0f} s" in text  # a fault that stays has one row
    assert "2 times" in text
    assert "heading_rad" not in text
    told = watched_summary(found)
    assert told[1].endswith(f" It is repeated until {2.0 * apart + 16.0:.0f} s.")
    assert "22 more alarms follow" in told[4]


def test_a_clean_log_with_a_fault_is_said_to_have_one(slocum):
    """If the monitor has learned a fault as normal, neither alarms nor their absence mean anything."""
    bent = replace_at(slocum, "effects.rudder.offset", 0.05)
    monitor = Monitor.learn(closed_loop(bent, rng=np.random.default_rng(0), duration=1200.0), slocum)
    assert "effects.rudder.offset" in monitor.learned.missing
    told = learned_words(Watched(monitor, "last_week.csv", 1.0, (), np.arange(2.0), np.ones(2)))
    assumed = "The monitor assumes that the vehicle in last_week.csv (0.33 h) was healthy."
    assert told.startswith(f"{assumed} But that log itself")
    assert "rudder offset" in told
    straight = Monitor.learn(closed_loop(slocum, rng=np.random.default_rng(0), duration=1200.0), slocum)
    assert straight.learned.missing == ()


def test_an_environment_tells_of_an_alarm(slocum, clean):
    monitor = Monitor.learn(clean, slocum, noise=NOISE)
    env = Monitored(gymnasium.make("auv_gym/GliderHeading-v0", vehicle="slocum", dt=4.0).unwrapped, monitor)
    assert env.reset(seed=0)[1]["alarm"] is None
    told = [env.step([0.3])[-1]["alarm"] for _ in range(5)]
    assert told == [None] * 5
    assert monitor.time == pytest.approx(5 * monitor.learned.interval)


def test_a_monitor_in_an_environment_of_another_vehicle_or_step_is_refused(slocum, clean):
    monitor = Monitor.learn(clean, slocum, noise=NOISE)
    with pytest.raises(ValueError, match="has learned slocum, and the environment simulates"):
        Monitored(gymnasium.make("auv_gym/Heading-v0"), monitor)
    with pytest.raises(ValueError, match="4 s apart, and a step of the environment takes 2 s: make it with dt=4"):
        Monitored(gymnasium.make("auv_gym/GliderHeading-v0", vehicle="slocum", dt=2.0), monitor)


def test_a_monitor_says_what_it_needs(slocum, clean):
    for rate in (0, "x"):
        with pytest.raises(ValueError, match=f"false_alarms_per_hour needs a number above 0 in 1/h, got {rate!r}"):
            Monitor.learn(clean, slocum, noise=NOISE, false_alarms_per_hour=rate)
    with pytest.raises(ValueError, match="doubt needs a number of at least 0, got 'x'"):
        Monitor.learn(clean, slocum, noise=NOISE, doubt="x")
    with pytest.raises(ValueError, match=r"Monitor.learn needs a vehicle, got 'slocum': give load_vehicle\('slocum'\)"):
        Monitor.learn(clean, "slocum", false_alarms_per_hour=1)
    with pytest.raises(
        ValueError, match=r"Monitor.learn needs a record, got 'log.nc': read_record\('log.nc'\) reads it"
    ):
        Monitor.learn("log.nc", slocum)
    with pytest.raises(ValueError, match="at least 200 samples, got"):
        Monitor.learn(clean.select(clean.time < 400.0), slocum, noise=NOISE)
    monitor = Monitor.learn(clean, slocum, noise=NOISE)
    with pytest.raises(ValueError, match="got arrays of shape"):
        monitor.step(np.zeros(1), np.zeros(1))
    with pytest.raises(ValueError, match="at least two samples, got 0"):
        monitor.stretch()
    with pytest.raises(ValueError, match=r"A monitor needs a record, got 'log\.nc'"):
        monitor.run("log.nc")
    for duration in (0.0, -4.0, np.nan, 1e9):
        with pytest.raises(ValueError, match="seconds since the last sample"):
            monitor.step(np.zeros(len(slocum.inputs)), np.zeros(len(slocum.outputs)), duration)
    with pytest.raises(ValueError, match="got heading: rename them"):
        monitor.step({"rudder_rad": 0.0}, {"heading": 0.1})
