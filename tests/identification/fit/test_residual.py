"""Tests of noise floors, steps of readings, and statements about a residual."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.records.record import Record
from identification.fit.residual import noise_floor, noise_floors, residual_summary, resolution
from identification.fit.validation import FreeRuns


def test_the_step_of_readings_is_found_on_a_grid_with_an_offset():
    rng = np.random.default_rng(1)
    depth = 20.0 + 15.0 * np.sin(np.arange(2000) / 150.0) + 0.02 * rng.standard_normal(2000)
    assert resolution(0.25 * np.round(depth / 0.25) + 0.1) == pytest.approx(0.25)
    assert resolution(depth) == 0.0
    assert resolution(np.round(depth, 4)) == 0.0
    assert resolution(np.full(100, 3.0)) == 0.0


def test_missing_readings_do_not_hide_the_step():
    values = 0.5 * np.round(np.sin(np.arange(600) / 40.0) * 8.0)
    values[::7] = np.nan
    assert resolution(values) == pytest.approx(0.5)


def test_a_smooth_misfit_is_not_noise():
    time = np.arange(3000) / 3000.0
    noise = 0.1 * np.random.default_rng(2).standard_normal(3000)
    assert noise_floor(noise + 5.0 * np.sin(6.0 * time), np.zeros(3000, dtype=int)) == pytest.approx(0.1, rel=0.05)


def test_a_sensor_that_is_slower_than_its_windows_has_a_noise_all_the_same():
    values = 0.1 * np.random.default_rng(3).standard_normal(2000)
    assert noise_floor(values, np.arange(2000) // 2) == pytest.approx(0.1, rel=0.05)


def test_lost_readings_are_no_noise():
    """A tenth of the readings of a steep dive is missing, so that some neighbours differ more."""
    rng, time = np.random.default_rng(5), np.arange(4000.0)
    held = rng.random(4000) > 0.1
    depth = 0.2 * time + 0.04 * rng.standard_normal(4000)
    window = np.zeros(held.sum(), dtype=int)
    assert noise_floor(depth[held], window, time[held]) == pytest.approx(0.04, rel=0.05)
    assert noise_floor(depth[held], window) > 0.055
    (floor,) = noise_floors(depth[:, None], np.zeros(4000, dtype=int), held[:, None], time)
    assert floor == pytest.approx(0.04, rel=0.05)


def test_values_between_readings_are_no_readings():
    """The speed is read every other row: its noise is white at the readings, and has half the variance between them."""
    rows, rng = np.arange(2000), np.random.default_rng(4)
    read, white = rows % 2 == 0, np.round(0.1 * rng.standard_normal(2000) / 0.05) * 0.05
    error = np.interp(rows, rows[read], white[read])
    record = Record.from_arrays(0.1 * rows, {"u_mps": error, "depth_m": np.sin(rows / 50.0)})
    record = record.with_readings({"u_mps": read})
    table = error[:, None]
    runs = FreeRuns(("u_mps",), rows, rows // 500, table, table, rows >= 0, read[:, None])
    (found,) = residual_summary(runs, record).values()
    assert found["rms"] == pytest.approx(found["noise_floor"], rel=0.05)
    assert found["whiteness_p"] > 0.01
    assert found["resolution"] == pytest.approx(0.05)
    assert runs.scores(record)["u_mps"].rmse == pytest.approx(found["rms"])
    every = residual_summary(replace(runs, readings=None), record)["u_mps"]
    assert every["lag_1_correlation"] > 0.4
