"""Tests of the windows of free runs, and of the dives that are held out."""

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle, vehicle_of_text
from auv_gym.plant.record_check import check_excitation
from auv_gym.records.record import Record
from identification.experiments.float_dives import depth_control, oil_mission
from identification.fit.windows import LEAST_SAMPLES, free_run_windows, held_out


def test_a_float_with_a_piston_is_judged_below_the_surface_only():
    plant = load_vehicle("qiandao_float")
    record = depth_control(plant, [12.0, 0.0, 10.0], rng=np.random.default_rng(0), hold=300.0)
    windows = free_run_windows(plant, record, 100.0)
    assert len(windows) >= 5
    for window in windows:
        assert record["depth_m"][window].min() > plant.family.afloat
        assert 49.0 < np.ptp(record.time[window]) <= 100.0
    afloat = np.ones(len(record), dtype=bool)
    for window in windows:
        afloat[window] = False
    assert (record["depth_m"][afloat] < plant.family.afloat).any()


def test_a_float_with_oil_runs_free_between_its_actions_and_dives_are_held_out_whole():
    plant = load_vehicle("mermaid")
    record = oil_mission(plant, [150.0, 200.0, 250.0], rng=np.random.default_rng(0))
    windows = free_run_windows(plant, record, plant.window)
    for window in windows:
        assert np.ptp(record["oil_volume_m3"][window]) == 0.0
        assert window.stop - window.start >= LEAST_SAMPLES
    fitted, held = held_out(plant, record, windows)
    middle = record.segments[1]
    assert all(middle.start <= w.start < middle.stop for w in held)
    assert not any(middle.start <= w.start < middle.stop for w in fitted)
    assert len(fitted) + len(held) == len(windows)


def straight(rows: int, segment=None) -> Record:
    """A record without signals, one row a second, whose time begins anew in each segment."""
    time = np.arange(float(rows)) % (rows if segment is None else rows // 2)
    zeros = np.zeros(rows)
    return Record.from_arrays(time, {"heading_rad": zeros, "rudder_rad": zeros}, segment=segment)


def test_other_vehicles_have_consecutive_windows():
    record = straight(100)
    assert free_run_windows(load_vehicle("slocum"), record, 30.0) == record.windows(30.0)


def test_the_first_seconds_of_a_segment_are_left_out_where_enough_windows_stay():
    plant, record = load_vehicle("slocum"), straight(200)  # the vehicle settles in 20 s
    assert free_run_windows(plant, record, 40.0) == [slice(20, 40), *record.windows(40.0)[1:]]
    assert free_run_windows(plant, record, 30.0) == record.windows(30.0)[1:]  # only a third of it would be left
    assert free_run_windows(plant, record, 10.0) == record.windows(10.0)[2:]
    assert free_run_windows(plant, record, 55.0) == record.windows(55.0)


def test_each_segment_has_a_beginning_of_its_own():
    plant, record = load_vehicle("slocum"), straight(400, segment=np.repeat([0, 1], 200))
    every = record.windows(30.0)
    assert free_run_windows(plant, record, 30.0) == every[1:6] + every[7:]


def steps(oil, interval=100.0, segment=None) -> Record:
    """A record at depth of oil volumes, mL, one for each sample."""
    oil = 1e-6 * np.asarray(oil, dtype=float)
    time = interval * np.arange(oil.size)
    if segment is not None:
        time = np.concatenate([interval * np.arange(np.sum(segment == s)) for s in np.unique(segment)])
    return Record.from_arrays(time, {"oil_volume_m3": oil, "depth_m": np.full(oil.size, 50.0)}, segment=segment)


def test_the_sample_at_which_oil_has_moved_belongs_to_no_free_run():
    windows = free_run_windows(load_vehicle("mermaid"), steps([0.0] * 20 + [-20.0] * 15 + [10.0] * 12), 1e5)
    assert windows == [slice(1, 20), slice(21, 35), slice(36, 47)]


def test_short_stretches_between_actions_are_dropped():
    kept, dropped = LEAST_SAMPLES + 1, LEAST_SAMPLES
    windows = free_run_windows(load_vehicle("mermaid"), steps([0.0] * kept + [-20.0] * dropped + [10.0] * kept), 1e5)
    assert windows == [slice(1, kept), slice(kept + dropped + 1, 2 * kept + dropped)]


def test_long_stretches_are_cut_into_equal_parts():
    windows = free_run_windows(load_vehicle("mermaid"), steps([0.0] * 101), 4000.0)
    assert [w.start for w in windows[1:]] == [w.stop for w in windows[:-1]]
    assert (windows[0].start, windows[-1].stop) == (1, 101)
    assert {w.stop - w.start for w in windows} <= {33, 34}


def test_the_end_of_a_dive_ends_its_windows():
    segment = np.repeat(["a", "b"], [15, 20])
    windows = free_run_windows(load_vehicle("mermaid"), steps([0.0] * 35, segment=segment), 1e5)
    assert windows == [slice(1, 15), slice(16, 35)]


def test_a_single_dive_is_held_out_by_every_other_window():
    plant = load_vehicle("mermaid")
    record = steps([0.0] * 20 + [-20.0] * 20 + [10.0] * 20)
    windows = free_run_windows(plant, record, 1e5)
    assert held_out(plant, record, windows) == (windows[0::2], windows[1::2])


def test_with_a_known_trim_windows_are_held_out_and_not_dives():
    plant = replace_at(load_vehicle("mermaid"), "hull.trim_known", 1.0)
    segment = np.repeat(["a", "b"], [40, 40])
    record = steps(([0.0] * 20 + [-20.0] * 20) * 2, segment=segment)
    windows = free_run_windows(plant, record, 1e5)
    assert held_out(plant, record, windows) == (windows[0::2], windows[1::2])
    fitted, held = held_out(load_vehicle("mermaid"), record, windows)
    assert (fitted, held) == (windows[:2], windows[2:])


def commanded(plant, seconds=400.0) -> Record:
    """A record of evenly sampled commands with frequent small changes, within a tenth of the actuator's travel."""
    time = np.arange(0.0, seconds, 0.5)
    name = plant.family.actuators[0]
    low, high = plant.family.ranges.get(name, (-0.3, 0.3))
    low, high = (value_at(plant, end) if isinstance(end, str) else end for end in (low, high))
    command = 0.5 * (low + high) + 0.05 * (high - low) * np.sign(np.sin(time))
    other = {n: np.full(time.size, plant.constants.get(n, 0.0)) for n in plant.family.required if n != name}
    return Record.from_arrays(time, {"depth_m": np.full(time.size, 20.0), name: command} | other)


SLUGGISH = [
    # vehicle, what makes its actuator slow, s until it stands within a hundredth of its travel of where it is told to
    ("qiandao_float", {}, 0.055 * 250.0),  # from the far end of 0.1 m to 5 mm beyond its middle, at 250 s/m
    ("slocum", {"effects.rudder.lag": 5.0}, 5.0 * np.log(100.0)),
    ("slocum", {"effects.rudder.lag": 5.0, "effects.rudder.dead_time": 7.0}, 7.0 + 5.0 * np.log(100.0)),
    ("npsauv", {"effects.rudder.lag": 5.9}, 6.0 * np.log(100.0)),  # its own 0.1 s joins
]


@pytest.mark.parametrize("name, slow, seconds", SLUGGISH)
def test_windows_begin_where_it_no_longer_matters_how_the_actuators_stood_before(name, slow, seconds):
    plant = replace_at(load_vehicle(name), slow)
    first = free_run_windows(plant, commanded(plant), 180.0)[0].start
    # two samples of 0.5 s; the piston's command moves by 10 mm, which takes it 2.5 s, meanwhile
    assert 0.5 * first == pytest.approx(seconds, abs=2.5 if name == "qiandao_float" else 1.0)


@pytest.mark.parametrize("name, slow, seconds", SLUGGISH)
def test_what_an_actuator_did_before_a_record_does_not_show_in_its_windows(name, slow, seconds):
    plant = replace_at(load_vehicle(name), slow)
    record = commanded(plant)
    path = plant.family.actuators[0]
    before = value_at(plant, "hull.piston_high") if path == "piston_m" else 0.3
    runs = []
    for told in (before, record[path][0]):
        x = plant.initial(np.full(len(plant.outputs), np.nan))
        u = np.array([plant.constants.get(n, 0.0) for n in plant.inputs])
        u[0] = told
        for _ in range(600):
            x = plant.step(x, u)
        at = len(plant.family.states)
        positions = []
        for command in record[path]:
            u[0] = command
            x = plant.step_over(x, u, 0.5)
            positions.append(x[at])
        runs.append(np.array(positions))
    first = free_run_windows(plant, record, 180.0)[0].start
    apart = np.abs(runs[0] - runs[1])
    assert apart[0] > 0.05 * abs(before - record[path][0])
    assert apart[first:].max() <= 0.01 * 2.0 * abs(before - record[path][0])


def test_a_play_is_taken_up_before_windows_begin():
    plant = replace_at(load_vehicle("slocum"), "effects.rudder.backlash", 0.2)
    time = np.arange(0.0, 400.0, 4.0)
    rudder = np.where(time < 100.0, 0.05, np.where(time < 160.0, -0.1, 0.12))  # moves by the play's width at 160 s
    record = Record.from_arrays(time, {"heading_rad": 0.0 * time, "rudder_rad": rudder})
    assert free_run_windows(plant, record, 40.0)[0].start == 40
    still = Record.from_arrays(time, {"heading_rad": 0.0 * time, "rudder_rad": 0.1 * rudder})  # play not taken up
    assert free_run_windows(plant, still, 40.0)[0].start == 5  # only the settling time


def test_a_vehicle_without_a_command_has_windows_and_is_refused_in_words():
    text = 'family = "body"\nname = "bare"\n[hull]\nmass = { value = 52, unit = "kg" }\n'
    plant = vehicle_of_text(text, "bare.toml")
    time = np.arange(0.0, 100.0, 0.5)
    record = Record.from_arrays(time, {"u_mps": np.sin(time), "depth_m": np.cos(time)})
    assert free_run_windows(plant, record, 20.0)
    with pytest.raises(ValueError, match="bare has no part with a command, such as a fin or a thruster"):
        check_excitation(plant, record)
