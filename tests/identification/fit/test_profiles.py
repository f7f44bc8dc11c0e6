"""Tests of intervals by a profile of the likelihood."""

import numpy as np
import pytest

from auv_gym.param import replace_at
from identification.experiments.missions import run_mission
from identification.fit.intervals import information_of, profile_interval
from identification.fit.prediction_errors import PredictionErrors
from tests.identification.fit.glider_logs import COEFFICIENTS, GLIDER, OFFSET, PATHS, glider_log, whole


def test_a_profile_of_a_smooth_parameter_is_its_interval_and_ends_at_a_bound(pushed):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    point = problem.solve(GLIDER, PATHS)
    told = information_of(problem, point, PATHS)
    k = PATHS.index(OFFSET)
    error = float(np.sqrt(told.covariance[k, k])) * problem.scale(OFFSET)
    value = point.vector[problem.index[OFFSET]]
    low, high = profile_interval(problem, point, PATHS, OFFSET, error, 1.96, None)
    assert low == pytest.approx(value - 1.96 * error, abs=0.4 * error)  # noises are held; scores may correlate
    assert high == pytest.approx(value + 1.96 * error, abs=0.4 * error)
    lag = "effects.rudder.lag"
    beside = problem.solve(replace_at(GLIDER, lag, 0.05), (*PATHS, lag))
    low, high = profile_interval(problem, beside, (*PATHS, lag), lag, 0.05, 1.96, None)
    assert low == 0.0  # a lag is not negative
    assert 0.0 < high < 2.0


def test_a_profile_leaves_a_range_in_which_nothing_changes():
    """Without any travel left, a further loss changes nothing: there is no slope, and yet a smallest size."""
    lost = "effects.rudder.lost_travel"
    stop = GLIDER.hull.rudder_limit
    log = run_mission(replace_at(GLIDER, lost, 1.0), np.random.default_rng(1), duration=600.0)
    problem = PredictionErrors(GLIDER, log, whole(log))
    point = problem.solve(replace_at(GLIDER, lost, 0.9), (lost,))
    low, high = profile_interval(problem, point, (lost,), lost, 0.0, 1.96, None)
    assert low == pytest.approx(stop, rel=0.1)
    assert high == 1.0


def test_a_profile_follows_what_makes_up_for_its_parameter(pushed, monkeypatch):
    """If a fit from far away finds nothing better, the first-order way gives the right width, else far too small."""
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    point = problem.solve(GLIDER, PATHS)
    told = information_of(problem, point, PATHS)
    covariance = np.linalg.inv(told.alone)
    k = PATHS.index("hull.n_r")  # compensated by the rudder effectiveness
    error, alone = (float(v**0.5) * problem.scale(PATHS[k]) for v in (covariance[k, k], 1.0 / told.alone[k, k]))
    assert error > 1.5 * alone
    monkeypatch.setattr(problem, "descended", lambda here, *rest: here)
    way = covariance[:, k] / covariance[k, k]
    for given, half in ((way, 1.96 * error), (None, 1.96 * alone)):
        low, high = profile_interval(problem, point, PATHS, PATHS[k], error, 1.96, given)
        assert high - low == pytest.approx(2.0 * half, rel=0.2)


def test_a_profile_does_not_count_what_the_colour_of_errors_tells_of_coefficients():
    """Neither do estimates nor covariances: it adds no certainty to a dead time that coefficients almost imitate."""
    time = "effects.rudder.dead_time"
    log = glider_log(3, **{time: 0.3})
    problem, paths = PredictionErrors(GLIDER, log, whole(log)), (*COEFFICIENTS, time)
    point = problem.solve(replace_at(GLIDER, time, 0.3), paths)
    told = information_of(problem, point, paths)
    error = float(np.linalg.inv(told.alone)[2, 2] ** 0.5) * problem.scale(time)
    low, high = profile_interval(problem, point, paths, time, error, 1.96, None)
    assert high - low == pytest.approx(2.0 * 1.96 * error, rel=0.15)  # a dead time is not quite linear
