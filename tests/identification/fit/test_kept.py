"""Tests of kept slopes: the same numbers, without further runs of the vehicle."""

import numpy as np
import pytest

from identification.fit import sensitivities
from identification.fit.kept import KeptSlopes
from identification.fit.parameters import moves_of
from identification.fit.prediction_errors import PredictionErrors
from tests.identification.fit.test_averaging import COEFFICIENTS, GLIDER, OFFSET, dense_log, whole


class Point:
    """Any object that can be referenced weakly."""


def columns(which):
    return np.array([np.full((2, 3), float(k)) for k in which])


def test_what_is_kept_is_not_made_again_and_the_rest_is():
    kept, point, made = KeptSlopes(), Point(), []

    def make(which):
        made.append(list(which))
        return columns(which)

    assert np.array_equal(kept.of(point, ["a", "b"], make), columns([0, 1]))
    assert np.array_equal(kept.of(point, ["b", "c", "a"], make), columns([1, 1, 0]))  # c is the second made
    assert made == [[0, 1], [1]]


def test_another_point_has_its_own():
    kept, one, other = KeptSlopes(), Point(), Point()
    kept.keep(one, {"a": np.zeros((2, 3))})
    assert np.array_equal(kept.of(other, ["a"], lambda which: np.ones((1, 2, 3))), np.ones((1, 2, 3)))


def test_there_is_room_for_so_many_and_the_oldest_go():
    kept, points, made = KeptSlopes(most=12), [Point() for _ in range(3)], []
    for point in points:
        kept.keep(point, {"a": np.zeros((2, 3))})

    def make(which):
        made.append(which)
        return np.ones((1, 2, 3))

    assert np.array_equal(kept.of(points[2], ["a"], make), np.zeros((1, 2, 3)))
    assert np.array_equal(kept.of(points[0], ["a"], make), np.ones((1, 2, 3)))
    assert len(made) == 1


@pytest.fixture(scope="module")
def fitted():
    record = dense_log(1, rows=1200, push=2e-4)
    problem = PredictionErrors(GLIDER, record, whole(record))
    return problem, problem.solve(GLIDER, COEFFICIENTS)


def test_slopes_of_a_point_are_taken_once(fitted):
    problem, point = fitted
    paths = (*COEFFICIENTS, OFFSET)
    first = problem.columns_of(point, moves_of(paths))
    done = problem.work.done
    again = problem.columns_of(point, moves_of(paths[::-1]))
    assert problem.work.done == done
    assert np.array_equal(again, first[::-1])
    other = problem.with_gains(point, point.vector * 1.001)
    done = problem.work.done
    assert not np.array_equal(problem.columns_of(other, moves_of(paths)), first)
    assert problem.work.done > done


def test_slopes_in_other_scales_are_others(fitted):
    problem, point = fitted
    whole, half = problem.scaled({OFFSET: 0.02}), problem.scaled({OFFSET: 0.01})
    moves = moves_of([OFFSET])
    assert whole.columns_of(point, moves) == pytest.approx(2.0 * half.columns_of(point, moves), rel=1e-2, abs=1e-6)


def test_slopes_by_coefficients_that_change_are_zero_before_and_those_of_the_vehicle_after(fitted, monkeypatch):
    problem, point = fitted
    assert (
        problem.changing_slopes(point, COEFFICIENTS, np.ones(1200)) is None
    )  # two coefficients are too few for responses
    monkeypatch.setattr(sensitivities, "_MANY", 2)
    answered = problem.prepared(point, COEFFICIENTS)
    whole, later = (
        problem.changing_slopes(answered, COEFFICIENTS, (np.arange(1200) >= row).astype(float)) for row in (0, 600)
    )
    exact = problem.columns_of(point, moves_of(COEFFICIENTS))
    assert np.linalg.norm(whole - exact) < 2e-3 * np.linalg.norm(exact)
    assert not later[:, :600].any()
    assert later[:, 600:].any()
