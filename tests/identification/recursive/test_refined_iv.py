"""Refined instrumental variables: exact without noise, honest intervals in closed loop, and refusals."""

from dataclasses import replace

import numpy as np
import pytest
from dives_by_equation import THETA, TRUTH, dive_log

from auv_gym.model import simulate
from identification.recursive.refined_iv import RefinedIv

EXACT = replace(TRUTH, scheme="exact")


def test_data_without_noise_give_the_exact_parameters():
    record = dive_log(3000, 0.0, np.random.default_rng(0), EXACT)
    fit = RefinedIv().fit(record)
    assert fit.theta == pytest.approx(THETA, abs=1e-6)
    assert simulate(fit.model, record)["depth_m"] == pytest.approx(record["depth_m"], abs=1e-4)


def test_segments_that_begin_in_mid_dive_have_starts_of_their_own():
    whole = dive_log(3000, 0.0, np.random.default_rng(1), EXACT)
    index = np.arange(len(whole))
    log = whole.select((index > 60) & (np.abs(index - 1500) > 20))
    assert len(log.segments) == 2
    # the piston's step just before a segment is not known
    assert RefinedIv().fit(log).theta == pytest.approx(THETA, rel=1e-3, abs=1e-3)


def test_parameters_may_be_known():
    record = dive_log(2000, 0.01, np.random.default_rng(2), EXACT)
    fit = RefinedIv(known=("piston_rate",), initial=(1.0, 0.0, 0.0, 0.3, 0.0, 0.0)).fit(record)
    assert fit.theta[3] == 0.3
    assert fit["damping"].value == pytest.approx(0.1, rel=0.02)
    held = RefinedIv(known=("damping",), initial=(1.0, 0.1, 0.0, 0.0, 0.0, 0.0)).fit(record)
    assert held.theta[1] == 0.1
    assert held["piston"].value == pytest.approx(THETA[5], rel=0.05)


def coverage(seeds: int, samples: int) -> np.ndarray:
    held = np.zeros(5)
    for seed in range(seeds):
        fit = RefinedIv().fit(dive_log(samples, 0.02, np.random.default_rng(seed), EXACT))
        held += [e.ci95[0] <= t <= e.ci95[1] for e, t in zip(fit.estimates[1:], THETA[1:])]
    return held / seeds


def test_intervals_hold_the_truth_in_closed_loop():
    assert np.all(coverage(20, 1500) >= 0.8)  # binomial: 95 % of 20, less three standard deviations


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say():
    shares = coverage(200, 2000)
    assert np.all((shares >= 0.90) & (shares <= 0.99)), shares


def test_a_float_at_the_surface_is_noticed():
    record = dive_log(1500, 0.0, np.random.default_rng(3), EXACT)
    # held up by the surface with its piston out, which the equation takes for a neutral float
    depth = np.where(record.time > 400.0, 0.0, record["depth_m"])
    piston = np.where(record.time > 400.0, 0.56, record["piston_m"])
    with pytest.raises(ValueError, match=r"surface|did not settle"):
        RefinedIv(slowest=20.0).fit(record.with_channels({"depth_m": depth, "piston_m": piston}))


@pytest.mark.parametrize(
    "settings, words", [({"slowest": 0.5}, "fastest < slowest"), ({"max_iterations": 0}, "at least 1 iteration")]
)
def test_settings_that_cannot_be_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        RefinedIv(**settings)
