"""Tests of scores, free runs and residual tests, against numbers by hand or by theory."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from identification.experiments.heading_control import closed_loop
from identification.fit.shooting import Shooting
from identification.fit.validation import fitted_runs, free_runs, input_correlation, score, whiteness


def test_a_score_is_what_its_definition_says():
    measured = np.array([0.0, 1.0, 2.0, 3.0])
    s = score(measured, np.array([0.1, -0.1, 0.2, 0.0]))
    assert s.rmse == pytest.approx(np.sqrt(0.06 / 4))
    assert s.mean_absolute == pytest.approx(0.1)
    assert s.maximum == pytest.approx(0.2)
    assert s.r2 == pytest.approx(1 - 0.06 / 5)
    assert s.fit_percent == pytest.approx(100 * (1 - np.sqrt(0.06 / 5)))
    assert s.samples == 4


def test_a_score_of_nothing_is_refused():
    with pytest.raises(ValueError, match="at least one sample"):
        score(np.array([]), np.array([]))


def test_free_runs_of_the_true_vehicle_leave_the_noise():
    plant = load_vehicle("slocum")
    noise = np.deg2rad(0.5)
    record = closed_loop(plant, rng=np.random.default_rng(3), duration=1800.0, compass_noise=noise, track_noise=None)
    fitted = fitted_runs(plant, record, record.windows(120.0))
    # two states fitted in windows of 30 samples take 2/30 of the variance; 450 samples give it to 4 %
    assert np.std(fitted.residual) == pytest.approx(noise * np.sqrt(28 / 30), rel=0.12)
    runs = free_runs(plant, record, record.windows(120.0), settle=20.0)
    scores = runs.scores(record)["heading_rad"]
    assert scores.samples == 15 * 25
    assert noise * 0.9 < scores.rmse < 4 * noise
    assert whiteness(fitted.residual[:, 0], fitted.window).p_value > 1e-3


def test_windows_whose_first_readings_a_vehicle_runs_away_from_begin_with_what_suits_their_first_seconds(monkeypatch):
    plant = load_vehicle("slocum")
    record = closed_loop(plant, rng=np.random.default_rng(3), duration=600.0, track_noise=None)
    usual, solve = fitted_runs(plant, record, record.windows(120.0)), Shooting.solve

    def lost(problem, plant, paths, max_iterations=40, guess=None):
        found = solve(problem, plant, paths, max_iterations, guess)
        if guess is not None or max(w.stop - w.start for w in problem.windows) < 20:
            return found
        return replace(found, starts=np.full_like(found.starts, np.nan), cost=np.inf)

    monkeypatch.setattr(Shooting, "solve", lost)
    found = fitted_runs(plant, record, record.windows(120.0))
    assert np.std(found.residual) == pytest.approx(np.std(usual.residual), rel=0.02)


def test_a_heading_error_beyond_half_a_turn_is_not_flattered():
    plant = load_vehicle("slocum")
    record = closed_loop(plant, rng=np.random.default_rng(4), duration=600.0, compass_noise=0.0, track_noise=None)
    wrong = replace_at(plant, "effects.yaw.moment", 2.0)
    runs = free_runs(wrong, record, record.windows(300.0))
    assert np.max(np.abs(runs.residual)) > 2 * np.pi


def test_whiteness_accepts_white_noise_and_rejects_coloured():
    rng = np.random.default_rng(6)
    window = np.repeat(np.arange(20), 50)
    white = [whiteness(rng.standard_normal(1000), window).p_value for _ in range(60)]
    assert np.mean(np.array(white) < 0.05) < 0.2  # binomial: 60 draws at 5 %
    coloured = whiteness(lfilter([1.0], [1.0, -0.5], rng.standard_normal(1000)), window)
    assert coloured.p_value < 1e-6
    assert coloured.correlation[0] == pytest.approx(0.5, abs=0.1)  # three standard errors
    assert coloured.bound == pytest.approx(1.96 / np.sqrt(1000))


def test_what_was_fitted_in_short_windows_does_not_pass_for_colour():
    """With a level and a slope fitted in each of 80 windows of 11 readings, residuals of white noise are not white."""
    rng, window = np.random.default_rng(8), np.repeat(np.arange(80), 11)
    own = np.linalg.qr(np.stack([np.ones(11), np.arange(11.0)], axis=1))[0]
    basis = np.kron(np.eye(80), own)
    without, beside = [], []
    for _ in range(40):
        e = rng.standard_normal(window.size)
        left = e - basis @ (basis.T @ e)
        without.append(whiteness(left, window).p_value)
        found = whiteness(left, window, fitted=basis)
        beside.append(found.p_value)
        assert abs(found.correlation[0]) < 4.0 / np.sqrt(window.size)
    assert max(without) < 1e-4
    assert np.mean(np.array(beside) < 0.05) < 0.2  # binomial: 40 draws at 5 %, and three standard errors
    slow = lfilter([1.0], [1.0, -0.5], rng.standard_normal(window.size))
    assert whiteness(slow - basis @ (basis.T @ slow), window, fitted=basis).p_value < 1e-6


def test_input_correlation_peaks_at_the_lag_by_which_the_input_leads():
    rng = np.random.default_rng(7)
    window = np.zeros(2000, dtype=int)
    u = rng.standard_normal(2000)
    e = np.r_[np.zeros(3), 0.5 * u[:-3]] + 0.1 * rng.standard_normal(2000)
    lags, values, bound = input_correlation(e, u, window, lags=8)
    assert lags[np.argmax(np.abs(values))] == 3
    assert np.sum(np.abs(values) > bound) <= 4  # the peak, and a few of 16 at 5 %


def test_segments_do_not_mix_in_a_correlation():
    e = np.r_[np.ones(50), -np.ones(50)]
    split = np.repeat([0, 1], 50)
    assert whiteness(e, split, 5).correlation[0] == pytest.approx(98 / 100)
