"""Tests of responses to parameters over one row, of slopes from these by the linearised filter, and of such fits."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from identification.fit import sensitivities
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.responses import Responses
from tests.identification.fit.test_averaging import COEFFICIENTS, GLIDER, dense_log, whole

WRONG = replace_at(GLIDER, {path: 1.4 * value_at(GLIDER, path) for path in COEFFICIENTS})


@pytest.fixture(autouse=True)
def few_are_many(monkeypatch):
    monkeypatch.setattr(sensitivities, "_MANY", 2)


@pytest.fixture(scope="module")
def pushed():
    return dense_log(1, rows=1500, push=2e-4)


@pytest.mark.parametrize("period", [0.0, 12.0], ids=["fading", "swell"])
@pytest.mark.parametrize("stride", [1, 3])
def test_slopes_of_the_linearised_filter_are_those_of_the_vehicle(pushed, stride, period):
    """They agree to two thousandths, the error of finite steps, with accelerations and with averaged readings."""
    problem = PredictionErrors(GLIDER, pushed, whole(pushed), stride=stride)
    point = problem.solve(GLIDER, ())
    if period:
        problem = problem.with_noises(problem.velocities, range(len(problem.channels)), period)
        point = problem.begun_with(point)
    assert problem._there(point.logs).all()
    point = problem.prepared(point, COEFFICIENTS)
    found = problem.soon_slopes(point, COEFFICIENTS)
    exact = problem.flat_slopes(point, COEFFICIENTS)
    for one, other in zip(found, exact, strict=True):
        assert np.linalg.norm(one - other) < 2e-3 * np.linalg.norm(other)


def test_a_fit_ends_by_responses_of_its_end(pushed, monkeypatch):
    """The result does not depend on the first responses, which here grow with time by mistake."""
    problem = PredictionErrors(WRONG, pushed, whole(pushed))
    near = problem.solve(WRONG, ())
    taken, calls = PredictionErrors._responses, []

    def growing(self: PredictionErrors, *arguments) -> Responses:
        own = taken(self, *arguments)
        calls.append(own)
        if len(calls) > 1:
            return own
        return replace(own, onward=np.linspace(0.0, 2.0, len(own.onward))[:, None, None] * own.onward)

    monkeypatch.setattr(PredictionErrors, "_responses", growing)
    soon = problem.solve(WRONG, COEFFICIENTS, near)
    assert soon.system is not None
    assert soon.system.responses is not None
    monkeypatch.setattr(sensitivities, "_MANY", 3)
    exact = problem.solve(WRONG, COEFFICIENTS, near)
    assert exact.system is not None
    assert exact.system.responses is None
    assert problem.objective(soon, COEFFICIENTS) == pytest.approx(problem.objective(exact, COEFFICIENTS), abs=0.01)


def test_responses_are_kept_while_noises_and_parameters_move(pushed, monkeypatch):
    problem = PredictionErrors(WRONG, pushed, whole(pushed))
    near, calls = problem.solve(WRONG, ()), []
    taken = PredictionErrors._responses
    monkeypatch.setattr(PredictionErrors, "_responses", lambda *a: calls.append(a[3]) or taken(*a))
    problem.solve(WRONG, COEFFICIENTS, near)
    assert calls == [list(COEFFICIENTS)] * 2  # and once more at the end of the fit


def test_slopes_by_responses_of_a_vehicle_that_diverges_are_zero_from_there_on(pushed, monkeypatch):
    """Their squares would not be finite, and no information could be computed."""
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    point = problem.prepared(problem.solve(GLIDER, ()), COEFFICIENTS)
    taken = sensitivities.driven_slopes

    def diverging(*arguments) -> np.ndarray:
        slopes = taken(*arguments)
        slopes[:, 1000:], slopes[:, 1400:] = 1e170, np.nan
        return slopes

    before = problem.slopes_by(point, point.system.responses)
    monkeypatch.setattr(sensitivities, "driven_slopes", diverging)
    found = problem.slopes_by(point, point.system.responses)
    assert np.array_equal(found[:, :1000], before[:, :1000])
    assert not found[:, 1000:].any()
