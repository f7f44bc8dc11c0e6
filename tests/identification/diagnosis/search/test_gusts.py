"""Tests of whether random accelerations are stronger at some times than at others."""

import numpy as np
import pytest

from auv_gym.param import replace_at
from identification.diagnosis.search import gusts as module
from identification.diagnosis.search.gusts import gusts
from identification.fit.prediction_errors import PredictionErrors
from tests.identification.fit.glider_logs import GLIDER, OFFSET, glider_log, whole

PLANT = replace_at(GLIDER, {OFFSET: 0.03})


def fitted(record):
    problem = PredictionErrors(PLANT, record, whole(record))
    return problem, problem.solve(PLANT, ())


def test_a_gust_shows_and_steady_pushes_do_not():
    assert gusts(*fitted(glider_log(0, push=0.003, gust=5.0))) == (("r_radps",), ())
    assert gusts(*fitted(glider_log(0, push=0.003))) == ((), ())


def test_where_nothing_pushes_there_are_no_gusts():
    assert gusts(*fitted(glider_log(0, push=0.0))) == ((), ())


def test_slopes_of_all_parts_are_those_of_the_whole():
    problem, point = fitted(glider_log(1))
    parts = problem.slopes_in_parts(point, 16)
    assert parts.shape == (16, point.logs.size)
    whole_slope = problem.noise_slopes(point, point.logs)[1] - problem._prior(point.logs)[1]
    np.testing.assert_allclose(parts.sum(axis=0), whole_slope, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_the_level_is_shared_by_parts_and_accelerations(monkeypatch):
    """At a level of 5 %, a test flags at most as many of 24 logs as chance allows."""
    monkeypatch.setattr(module, "LEFT", 0.05)
    false = sum(any(gusts(*fitted(glider_log(seed)))) for seed in range(20, 44))
    assert false <= 4  # 24 at 5 %: more in 0.6 %


@pytest.mark.slow
def test_steady_pushes_are_flagged_as_seldom_as_is_said(monkeypatch):
    for level, most in ((0.05, 22), (0.01, 7)):  # of 200: more have a chance of 0.02 % and 0.1 %
        monkeypatch.setattr(module, "LEFT", level)
        assert sum(any(gusts(*fitted(glider_log(seed)))) for seed in range(400, 600)) <= most
