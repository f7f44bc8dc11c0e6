"""Where free runs of floats lie, and which dives are held out."""

import numpy as np

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.record import Record
from identification.float_experiment import depth_control, oil_mission
from identification.windows import LEAST_SAMPLES, free_run_windows, held_out


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
    """A record of nothing, a row a second, beginning anew in each segment."""
    time = np.arange(float(rows)) % (rows if segment is None else rows // 2)
    zeros = np.zeros(rows)
    return Record.from_arrays(time, {"heading_rad": zeros, "rudder_rad": zeros}, segment=segment)


def test_other_vehicles_have_consecutive_windows():
    record = straight(100)
    assert free_run_windows(load_vehicle("slocum"), record, 30.0) == record.windows(30.0)


def test_the_first_seconds_of_a_segment_are_left_out_where_enough_windows_stay():
    plant, record = load_vehicle("slocum"), straight(200)  # the vehicle settles in 20 s
    assert free_run_windows(plant, record, 40.0) == [slice(20, 40), *record.windows(40.0)[1:]]
    assert free_run_windows(plant, record, 30.0) == record.windows(30.0)[1:]  # a third of the first would be left
    assert free_run_windows(plant, record, 10.0) == record.windows(10.0)[2:]
    assert free_run_windows(plant, record, 55.0) == record.windows(55.0)


def test_each_segment_has_a_beginning_of_its_own():
    plant, record = load_vehicle("slocum"), straight(400, segment=np.repeat([0, 1], 200))
    every = record.windows(30.0)
    assert free_run_windows(plant, record, 30.0) == every[1:6] + every[7:]


def steps(oil, interval=100.0, segment=None) -> Record:
    """A record at depth of oil volumes in millilitres, one a sample."""
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
