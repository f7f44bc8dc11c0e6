"""Tests of values that are no readings: repeats of slower or still sensors, and single spikes; coarse ones are."""

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.record_check import described
from auv_gym.records.record import Record
from auv_gym.records.unread import only_readings, only_repeated, single_spikes
from identification.diagnosis import diagnose
from identification.experiments.missions import run_mission
from tests.identification.gliders import QUICK

ROWS = 600
TIME = 0.1 * np.arange(ROWS)
WHOLE = [slice(0, ROWS)]


def swinging(noise: float = 0.01) -> np.ndarray:
    return 0.5 * np.sin(0.4 * TIME) + np.random.default_rng(0).normal(0.0, noise, ROWS)


def held(values: np.ndarray, every: float) -> np.ndarray:
    """The latest of readings that come every so many rows."""
    return values[(np.floor(np.arange(len(values)) / every) * every).astype(int)]


@pytest.mark.parametrize("every", [1.7, 2, 5, 10.3])
def test_of_a_slower_sensor_each_first_value_is_a_reading(every):
    values = held(swinging(), every)
    again, slower = only_repeated(values, WHOLE)
    assert slower
    assert np.array_equal(again, np.r_[False, np.diff(values) == 0.0])


def test_a_sensor_that_stands_still_was_not_read():
    values = swinging()
    values[200:260] = values[199]
    values[300:305] = values[299]  # too few rows to tell
    again, slower = only_repeated(values, WHOLE)
    assert not slower
    assert np.array_equal(np.flatnonzero(again), np.arange(200, 260))


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
@pytest.mark.parametrize("step", [0.02, 0.05, 0.2])
def test_coarse_readings_are_readings(noise, step):
    values = np.round(swinging(noise) / step) * step
    assert np.mean(np.diff(values) == 0.0) > 0.1
    assert not only_repeated(values, WHOLE)[0].any()


def test_between_readings_of_a_slower_sensor_nothing_repeats():
    """Two readings a second apart happen to be equal, so that the rows between them, on a straight line, are, too."""
    values, read = swinging(), np.arange(ROWS) % 10 == 0
    values[210] = values[200]
    record = Record.from_arrays(TIME, {"north_m": np.interp(TIME, TIME[read], values[read]), "rudder_rad": values})
    marked = record.with_readings({"north_m": read})
    assert only_readings(marked, ["north_m"]) == (marked, [])
    still = record.with_channels({"north_m": np.where(TIME < 20.0, record["north_m"], record["north_m"][200])})
    _, (line,) = only_readings(still.with_readings({"north_m": read}), ["north_m"])
    assert "one value for up to 39 s" in line


def test_so_are_those_of_a_vehicle_that_rests_and_constant_ones():
    resting = np.where(TIME < 30.0, 0.0, np.sin(TIME - 30.0))
    record = Record.from_arrays(TIME, {"heading_rad": resting, "depth_m": resting + 1.0, "rudder_rad": 0.0 * TIME})
    assert only_readings(record, ["heading_rad", "depth_m"]) == (record, [])
    steered = record.with_channels({"rudder_rad": np.sin(TIME)})
    assert len(only_readings(steered, ["heading_rad", "depth_m"])[1]) == 2
    assert not only_repeated(np.zeros(ROWS), WHOLE)[0].any()


def test_runs_of_equal_values_end_with_their_segment():
    values = np.tile(swinging()[:15], 40)
    values[9:25] = values[9]
    assert np.flatnonzero(only_repeated(values, WHOLE)[0]).size == 15
    assert not only_repeated(values, [slice(0, 18), slice(18, ROWS)])[0].any()


def test_repeats_become_lines_between_readings_and_are_told():
    heading, depth = held(swinging(), 4), swinging() + 10.0
    depth[100:160] = depth[99]
    record = Record.from_arrays(TIME, {"heading_rad": heading, "depth_m": depth})
    record = record.with_readings({"depth_m": np.arange(ROWS) != 50})
    found, lines = only_readings(record, ["heading_rad", "depth_m"])
    assert np.array_equal(np.flatnonzero(found.readings("heading_rad")), np.arange(0, ROWS, 4))
    assert found["heading_rad"][::4] == pytest.approx(heading[::4])
    assert found["heading_rad"][2] == pytest.approx(0.5 * (heading[0] + heading[4]))
    assert np.flatnonzero(~found.readings("depth_m")).tolist() == [50, *range(100, 160)]
    assert found["depth_m"][130] == pytest.approx(np.interp(13.0, [9.9, 16.0], [depth[99], depth[160]]))
    assert lines == [
        "depth_m repeats one value for up to 6 s, as a sensor that has failed: the repeated values are ignored.",
        "heading_rad repeats the last value in many rows, as slower sensors do: the repeated values are ignored.",
    ]
    assert only_readings(found, ["heading_rad", "depth_m"]) == (found, [])


def test_a_single_spike_is_no_reading_and_a_peak_or_a_step_is_one():
    values = swinging()
    spiked = values.copy()
    spiked[[50, 300]] += [0.8, -3.0]
    assert np.flatnonzero(single_spikes(spiked)).tolist() == [50, 300]
    assert not single_spikes(values).any()
    assert not single_spikes(np.abs(20.0 - TIME)).any()  # a dive and a climb
    assert not single_spikes(values + np.where(TIME > 30.0, 5.0, 0.0)).any()
    assert not single_spikes(np.round(values, 1)).any()
    assert not single_spikes(spiked[48:52]).any()  # too short to tell
    double = values.copy()
    double[50:52] += 3.0  # two rows may be a motion
    assert not single_spikes(double).any()


def test_spikes_are_told_and_replaced():
    north = swinging()
    north[200] = 5.0
    depth = north.copy()
    depth[[100, 300]] = -5.0
    record = Record.from_arrays(TIME, {"north_m": north, "depth_m": depth})
    found, lines = only_readings(record, ["north_m", "depth_m"])
    assert np.flatnonzero(~found.readings("north_m")).tolist() == [200]
    assert found["north_m"][200] == pytest.approx(0.5 * (north[199] + north[201]))
    assert lines == [
        "north_m has a single spike at 20 s, which is ignored.",
        "depth_m has 3 single spikes, the first at 10 s: they are ignored.",
    ]


def test_a_log_with_spikes_is_explained():
    log = run_mission(QUICK, np.random.default_rng(2), duration=1200.0)
    heading = log["heading_rad"].copy()
    heading[[40, 90, 170, 250]] += [1.0, -1.0, 1.0, 2.0]
    found = diagnose(log.with_channels({"heading_rad": heading}), QUICK, most=1)
    assert found.verdict == "none"
    assert found.noise.measurement["heading_rad"] < 0.02


def test_a_log_whose_rows_repeat_slower_sensors_is_explained():
    """Taken for readings, the repeated values of a clean log looked like a rudder with a dead time."""
    log = run_mission(QUICK, np.random.default_rng(2), duration=1200.0)
    slower = {"heading_rad": 2, "north_m": 3, "east_m": 3}
    record = log.with_channels({name: held(log[name], every) for name, every in slower.items()})
    found = diagnose(record, QUICK, most=1)
    assert found.verdict == "none"
    assert any(line.startswith("heading_rad, north_m and east_m repeat the last value") for line in found.record.notes)


def test_an_effect_is_found_in_such_a_log_and_a_record_is_described_once():
    plant = load_vehicle("slocum")
    log = run_mission(replace_at(plant, "effects.rudder.offset", 0.05), np.random.default_rng(3), duration=1200.0)
    record = log.with_channels({"heading_rad": held(log["heading_rad"], 2)})
    assert [e.path for e in diagnose(record, plant, most=1).effects] == ["effects.rudder.offset"]
    once = described(plant, record)
    assert described(plant, once).notes == once.notes
