"""Where free runs of floats lie, and which dives are held out."""

import numpy as np

from auv_gym.plant import load_vehicle
from auv_gym.record import Record
from identification.float_experiment import depth_control, oil_mission
from identification.windows import AFLOAT, LEAST_SAMPLES, free_run_windows, held_out


def test_a_float_with_a_piston_is_judged_below_the_surface_only():
    plant = load_vehicle("qiandao_float")
    record = depth_control(plant, [12.0, 0.0, 10.0], rng=np.random.default_rng(0), hold=300.0)
    windows = free_run_windows(plant, record, 100.0)
    assert len(windows) >= 5
    for window in windows:
        assert record["depth_m"][window].min() > AFLOAT
        assert 49.0 < np.ptp(record.time[window]) <= 100.0
    afloat = np.ones(len(record), dtype=bool)
    for window in windows:
        afloat[window] = False
    assert (record["depth_m"][afloat] < AFLOAT).any()


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


def test_other_vehicles_have_consecutive_windows():
    record = Record.from_arrays(np.arange(100.0), {"heading_rad": np.zeros(100), "rudder_rad": np.zeros(100)})
    assert free_run_windows(load_vehicle("slocum"), record, 30.0) == record.windows(30.0)
