"""Tests of where residuals are large: found for residuals that depend on something, and nothing said for others."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from auv_gym.records.record import Record
from identification.diagnosis.judge.habitat import Share, residual_habitat
from identification.diagnosis.judge.spectrum import residual_period
from identification.fit.validation import FreeRuns

WINDOWS, LENGTH = 12, 250


def lived(seed: int, where: str = "") -> tuple[FreeRuns, Record]:
    """Free runs with slow heading errors that are largest as specified, and white depth errors; and their record."""
    rng = np.random.default_rng(seed)
    size = WINDOWS * LENGTH
    t = np.arange(float(size))
    depth = 40.0 + 35.0 * np.sin(2.0 * np.pi * t / 1370.0) + rng.normal(0.0, 0.1, size)
    heading = 3.0 * np.pi * np.sin(2.0 * np.pi * t / 911.0)
    speed = 1.0 + 0.2 * np.repeat(rng.normal(size=size // 50), 50)
    e = np.concatenate([lfilter([1.0], [1.0, -0.97], rng.normal(0.0, 0.01, LENGTH)) for _ in range(WINDOWS)])
    if where == "depth":
        e *= 1.0 + 4.0 * ((depth > 30.0) & (depth < 50.0))
    elif where == "heading":
        e *= 1.0 + 4.0 * (np.cos(heading) > 0.5)
    elif where == "period":
        e += 0.06 * np.sin(2.0 * np.pi * t / 57.0 + 1.0)
    elif where == "growth":
        e *= 0.3 + 2.0 * np.tile(np.arange(LENGTH) / LENGTH, WINDOWS)
    residual = np.stack([e, rng.normal(0.0, 0.02, size)], axis=1)
    channels = {"depth_m": depth, "heading_rad": heading, "u_mps": speed, "rudder_rad": 0.1 * np.sin(t / 11.0)}
    window = np.repeat(np.arange(WINDOWS), LENGTH)
    runs = FreeRuns(("heading_rad", "depth_m"), np.arange(size), window, residual, residual, np.ones(size, dtype=bool))
    return runs, Record.from_arrays(t, channels)


def home(seed: int, where: str = ""):
    return residual_habitat(*lived(seed, where), np.random.default_rng(seed))


def test_errors_at_some_depths_are_found_there():
    found = home(0, "depth")
    assert found.channel == "heading_rad"
    assert found.channels["heading_rad"] > 0.95
    assert found.found[0].name == "depth_m"
    low, high = found.found[0].stretch
    assert low < 30.0 < 50.0 < high + 10.0
    assert found.found[0].error_share > 0.6 > 0.5 > found.found[0].sample_share
    assert re.match(
        r"With starts fitted to whole windows, free runs still err by [\d.]+ deg RMS in heading, which is "
        r"most of the remaining error: ",
        found.summary(),
    )
    assert re.search(r"of samples with depth between [\d.]+ and [\d.]+ m[;.]", found.summary())
    assert found.found[0].error.sum() == pytest.approx(1.0)
    assert found.found[0].samples.sum() == pytest.approx(1.0)


def test_a_narrow_range_has_as_many_digits_as_its_ends_need_to_differ():
    share = Share("density_kgpm3", np.zeros(2), np.ones(1), np.ones(1), (1027.04, 1027.31), 0.73, 0.33, 0.0)
    assert share.words.endswith("with water density between 1027.0 and 1027.3 kg/m3")
    assert replace(share, stretch=(1027.041, 1027.042)).words.endswith("between 1027.041 and 1027.042 kg/m3")


def test_errors_on_some_headings_are_found_across_north():
    found = home(2, "heading")
    assert found.found[0].name == "heading_rad"
    low, high = found.found[0].stretch
    assert low > high  # through north
    assert re.search(r"of samples with heading between [\d.]+ and [\d.]+ deg", found.summary())


def test_a_period_is_found_within_its_band():
    found = home(1, "period")
    assert found.rhythm is not None
    assert found.rhythm.p_value < 1e-6
    assert found.rhythm.period_s == pytest.approx(57.0, rel=0.05)
    assert found.rhythm.band[0] < 57.0 < found.rhythm.band[1]
    assert "it has a period of about 5" in found.summary()


def test_growth_within_runs_is_said():
    found = home(0, "growth")
    assert found.growth is not None
    assert found.growth.last > 2.0 * found.growth.first
    assert "it grows within a run, from" in found.summary()


def test_a_residual_that_lives_nowhere_is_said_so_nearly_always():
    said = []
    for seed in range(12):
        found = home(100 + seed)
        said.append(bool(found.found) or "period of" in found.summary() or "grows" in found.summary())
    assert sum(said) <= 2  # 5 % of 12, and two standard deviations


def test_slow_noise_has_no_period():
    p = []
    for seed in range(25):
        runs, record = lived(200 + seed)
        found = residual_period(runs.residual[:, 0], runs.window, record.time)
        assert found is not None
        p.append(found.p_value)
    assert np.mean(np.array(p) < 0.01) <= 0.08


def test_few_windows_give_no_p_value():
    runs, record = lived(0, "depth")
    few = runs.window < 3
    cut = FreeRuns(runs.channels, runs.rows[few], runs.window[few], runs.model[few], runs.residual[few], few[few])
    found = residual_habitat(cut, record, np.random.default_rng(0))
    assert found.found == ()
    assert found.growth is None
