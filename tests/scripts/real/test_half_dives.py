"""Depth over half-dives and intervals by resampling: stretches, free runs, and coverage for correlated errors."""

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.record_check import described
from auv_gym.records.record import Record
from identification.experiments.glider_dives import yo_mission
from scripts.real.dives import depth_rate, errors_of_dives
from scripts.real.half_dives import depth_error, depth_error_of, half_dives, interval_of, rms, rms_draws

GLIDER = load_vehicle("seaglider")


@pytest.fixture(scope="module")
def dives() -> Record:
    """Two dives of the preset, without noise."""
    return described(GLIDER, yo_mission(GLIDER, (150.0, 250.0), rng=np.random.default_rng(0), noise=0.0))


def test_a_half_dive_goes_one_way(dives):
    stretches = half_dives(dives)
    assert len(stretches) == 4
    for number, stretch in enumerate(stretches):
        assert np.ptp(dives.time[stretch]) >= 300.0
        assert np.all(np.sign(np.diff(dives["depth_m"][stretch])) == (1.0 if number % 2 == 0 else -1.0))
    brief = dives.select(dives["depth_m"] < 25.0)
    assert half_dives(brief) == []


def test_the_depth_of_the_true_vehicle_is_right_and_that_of_a_heavier_one_drifts(dives):
    heavier = replace_at(GLIDER, "effects.volume.offset", -2e-5)
    assert depth_error(GLIDER, dives) < 0.05
    assert 2.0 < depth_error(heavier, dives) < 20.0  # about 1 cm/s for half an hour
    found = errors_of_dives([GLIDER, heavier, GLIDER], dives)
    assert [(e.signal, e.unit, e.others) for e in found] == [
        ("vertical velocity", "cm/s", None),
        ("depth over half-dives", "m", None),
    ]
    assert found[1].stages == [depth_error(p, dives) for p in (GLIDER, heavier, GLIDER)]
    for size, (low, high) in zip(found[0].stages, found[0].intervals, strict=True):
        assert low <= size <= high


def test_the_depth_of_a_vertical_velocity_is_its_integral(dives):
    rate = depth_rate(dives)
    assert depth_error_of(rate, dives, 60.0) < 0.2  # trapezoids of differences over 5 s
    apart = [dives.time[s] - dives.time[s.start] for s in half_dives(dives)]
    fast = rms(np.concatenate([0.01 * (a[a >= 60.0] - a[a < 60.0].mean()) for a in apart]))
    assert depth_error_of(rate + 0.01, dives, 60.0) == pytest.approx(fast, abs=0.2)
    down = np.where(np.arange(len(dives)) % 50 == 0, np.nan, -rate)
    operated = dives.with_channels({"vert_speed_mps": down})
    velocity, depth = errors_of_dives([GLIDER], operated)
    assert velocity.others == pytest.approx(0.0, abs=1e-9)
    assert len(velocity.intervals) == 2
    assert np.isnan(depth.others)  # a sum cannot be taken over what is missing


def test_intervals_cover_the_rms_of_errors_that_correlate_over_minutes():
    """Three hours, with a correlation time of 100 s: 95 % of the intervals, with 18 pieces a few percent less."""
    rng, step, inside = np.random.default_rng(1), 10.0, 0
    record = Record.from_arrays(step * np.arange(1080), {"depth_m": np.arange(1080.0)})
    keep = np.exp(-step / 100.0)
    for _ in range(200):
        errors = np.empty(1080)
        errors[0] = rng.standard_normal()
        for k, push in enumerate(np.sqrt(1.0 - keep**2) * rng.standard_normal(1079), start=1):
            errors[k] = keep * errors[k - 1] + push
        low, high = interval_of(rms_draws([errors], record)[0])
        inside += low < 1.0 < high
    assert 0.84 < inside / 200 < 0.98


def test_errors_are_resampled_together():
    record = Record.from_arrays(10.0 * np.arange(400), {"depth_m": np.arange(400.0)})
    errors = np.random.default_rng(2).standard_normal(400)
    one, twice = rms_draws([errors, 2.0 * errors], record)
    np.testing.assert_allclose(twice, 2.0 * one)
