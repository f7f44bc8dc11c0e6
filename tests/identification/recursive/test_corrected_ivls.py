"""Corrected IVLS: exact without noise, without bias with it, intervals that hold, on line too, better free runs."""

import numpy as np
import pytest
from dives_by_equation import THETA, TRUTH, dive_log

from auv_gym.model import simulate
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.experiments.float_dives import depth_control
from identification.kernel_machines.ls_svm import LsSvm
from identification.recursive.corrected_ivls import CorrectedIvls
from identification.recursive.rwls import Rwls


@pytest.mark.slow
def test_data_without_noise_give_the_exact_parameters():
    fit = CorrectedIvls().fit(dive_log(3000, 0.0, np.random.default_rng(0)))
    assert fit.theta == pytest.approx(THETA, abs=1e-6)
    assert fit.skipped == 0


def mean_error(samples: int, seeds: int, closed: bool) -> np.ndarray:
    """Mean error of [D/M, d/M, N3/M, N2/M, N1/M] over seeds, of their true values."""
    fits = [CorrectedIvls().fit(dive_log(samples, 0.02, np.random.default_rng(s), closed=closed)) for s in range(seeds)]
    return np.mean([fit.theta[1:] / THETA[1:] - 1.0 for fit in fits], axis=0)


@pytest.mark.slow
@pytest.mark.parametrize("closed", [False, True])
def test_the_bias_of_least_squares_is_gone(closed):
    few, many = mean_error(1500, 6, closed), mean_error(12000, 6, closed)
    assert abs(many[0]) < 0.02
    assert abs(many[0]) <= max(abs(few[0]), 0.01)
    least_squares = Rwls().fit(dive_log(12000, 0.02, np.random.default_rng(0), closed=closed))
    assert least_squares.theta[1] > 10.0 * TRUTH.damping


@pytest.mark.slow
@pytest.mark.parametrize("closed", [False, True])
def test_the_bias_against_the_number_of_samples(closed):
    errors = {n: mean_error(n, 8, closed) for n in (1000, 10000, 100000)}
    assert abs(errors[100000][0]) < 0.01  # in closed loop 0.5 % stays
    if not closed:
        # the scatter of the mean falls with the root of n; four of its standard deviations at the stated scatter
        assert np.all(np.abs(errors[100000]) < 4.0 * np.array([0.0016, 0.0027, 0.014, 0.034, 0.005]) / np.sqrt(8.0))
    for n in errors:
        biased = Rwls().fit(dive_log(n, 0.02, np.random.default_rng(n), closed=closed))
        assert biased.theta[1] > 10.0 * TRUTH.damping


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say():
    held = np.zeros(5)
    for seed in range(100):
        fit = CorrectedIvls().fit(dive_log(4000, 0.01, np.random.default_rng(seed), closed=False))
        held += [e.ci95[0] <= t <= e.ci95[1] for e, t in zip(fit.estimates[1:], THETA[1:])]
    # the binomial spread of 100 seeds is 2.2 %
    assert np.all(held >= 88), held


@pytest.mark.slow
def test_intervals_are_of_the_size_of_the_errors():
    ratio = []
    for seed in range(12):
        fit = CorrectedIvls().fit(dive_log(3000, 0.01, np.random.default_rng(seed), closed=False))
        ratio.append((fit.theta[1:] - THETA[1:]) / [e.error for e in fit.estimates[1:]])
        assert fit.noise == pytest.approx(0.01, rel=0.05)
    size = np.sqrt(np.mean(np.square(ratio), axis=0))
    assert np.all((size > 0.4) & (size < 1.8)), size


def test_on_line_it_finds_the_truth_too_and_another_start_needs_no_warm_up():
    record = dive_log(12000, 0.02, np.random.default_rng(5))
    depth, piston, h = record["depth_m"], record["piston_m"], np.diff(record.time, prepend=record.time[0])
    for auxiliary in (None, THETA):
        estimator = CorrectedIvls()
        memory = estimator.start(auxiliary)
        for k in range(len(record)):
            memory = estimator.update(memory, depth[k], piston[max(k - 1, 0)], h[k])
        # what the warm-up by least squares leaves fades with the share that it has in the record
        assert memory.theta[1] == pytest.approx(TRUTH.damping, rel=0.25 if auxiliary is None else 0.05)


def test_the_instrument_stays_bounded_whatever_the_auxiliary_model():
    record = dive_log(2000, 0.02, np.random.default_rng(6))
    for damping in (-5.0, 0.0, 1e6):
        estimator = CorrectedIvls(share=0.0)
        memory = estimator.start((1.0, damping, *THETA[2:]))
        for k in range(500):
            h = record.time[k] - record.time[k - 1] if k else 0.0
            memory = estimator.update(memory, record["depth_m"][k], record["piston_m"][max(k - 1, 0)], h)
        assert np.isfinite(memory.vector).all()


def test_segments_are_fitted_together():
    logs = [dive_log(1500, 0.01, np.random.default_rng(seed)) for seed in (7, 8)]
    fit = CorrectedIvls().fit(*logs)
    assert fit["damping"].value == pytest.approx(TRUTH.damping, rel=0.05)
    assert fit.history is not None
    assert fit.history.shape == (3000, 6)


def lake_dive(depth: float, rng: np.random.Generator, back: bool = False) -> Record:
    """A dive of the lake float at 0.02 m of noise; with the way back, up to where it comes near the surface."""
    plant = load_vehicle("qiandao_float")
    record = depth_control(plant, [depth, 0.0] if back else [depth], rng=rng, hold=650.0, noise=0.02)
    if not back:
        return record
    surfaced = np.flatnonzero((record.time > 650.0) & (record["depth_m"] < 0.5))
    return record.between(0.0, record.time[surfaced[0]])


def test_its_free_runs_of_the_lake_float_are_the_best():
    rng = np.random.default_rng(0)
    train = lake_dive(40.0, rng, back=True)
    tests = [train, *(lake_dive(depth, rng) for depth in (30.0, 50.0, 60.0))]
    models = {type(e).__name__: e.fit(train).model for e in (CorrectedIvls(), Rwls(), LsSvm())}
    for record in tests:
        depth = record["depth_m"]
        error = {n: float(np.sqrt(np.mean((simulate(m, record)["depth_m"] - depth) ** 2))) for n, m in models.items()}
        assert 3.0 * error["CorrectedIvls"] < min(error["Rwls"], error["LsSvm"])
        assert error["CorrectedIvls"] ** 2 < 0.05 * np.var(depth)


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"lag": -1}, "lag needs a whole number of at least 0"),
        ({"lag": 2.5}, "lag needs a whole number"),
        ({"known": "unity"}, r"needs a list of names, got the text 'unity'"),
        ({"initial": (0.9, 0.0, 0.0, 0.0, 0.0, 0.0)}, "unity at 1"),
        ({"memory": 0.0}, "memory > 0"),
        ({"slowest": 0.5}, "fastest < slowest"),
        ({"passes": 0}, "passes needs a whole number of at least 1"),
        ({"known": ("mass",)}, "no parameter 'mass'"),
        ({"known": ("damping", "offset", "piston_rate", "piston_square", "piston")}, "leave at least one"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        CorrectedIvls(**settings)
