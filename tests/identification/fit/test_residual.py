import numpy as np
import pytest

from identification.fit.residual import noise_floor, resolution


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
