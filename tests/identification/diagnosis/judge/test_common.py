"""Tests of what the members of a tie have in common."""

import numpy as np
import pytest

from identification.diagnosis.judge.common import common_prediction
from identification.fit.validation import FreeRuns
from tests.identification.diagnosis.stand_ins import PLANT

A, C, D = "effects.rudder.offset", "effects.yaw.moment", "effects.yaw.roll_moment"
DEGREE = np.pi / 180.0


def runs_of(model):
    """Free runs of a heading whose measured value is zero; the first sample is not scored."""
    model = np.asarray(model, dtype=float)[:, None]
    rows = np.arange(len(model))
    return FreeRuns(("heading_rad",), rows, 0 * rows, model, -model, rows > 0)


def test_runs_are_averaged_by_probability_and_the_spread_is_between_the_two_that_differ_most():
    flights = iter([runs_of([9.0, 0.1, 0.1]), runs_of([0.0, -0.1, -0.1]), runs_of([0.0, 0.0, 0.0])])
    found = common_prediction([(A, 0.6, PLANT), (C, 0.2, PLANT), (D, 0.0, PLANT)], lambda plant: next(flights))
    assert found.members == pytest.approx({A: 0.75, C: 0.25, D: 0.0})
    assert found.error["heading_rad"] == pytest.approx(0.05)
    assert found.spread["heading_rad"] == pytest.approx(0.2)


def test_the_sentence_has_the_spread_in_units_for_people():
    flights = iter([runs_of([0.0, DEGREE, DEGREE]), runs_of([0.0, 0.0, 0.0])])
    found = common_prediction([(A, 0.5, PLANT), (C, 0.5, PLANT)], lambda plant: next(flights))
    assert found.words({A: "rudder offset", C: "yaw moment"}, "over 100 s") == (
        "Free runs over 100 s with rudder offset or yaw moment differ by at most 1 deg in heading (RMS)."
    )


def test_a_member_whose_runs_diverge_is_said():
    flights = iter([runs_of([0.0, 0.1, 0.1]), None])
    found = common_prediction([(A, 0.5, PLANT), (C, 0.5, PLANT)], lambda plant: next(flights))
    assert np.isinf(found.spread["heading_rad"])
    assert found.error["heading_rad"] == pytest.approx(0.1)
    assert (
        found.words({}, "over 100 s")
        == f"It matters whether the cause is {A} or {C}: free runs over 100 s diverge with one of them."
    )
