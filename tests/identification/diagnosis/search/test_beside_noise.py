"""Tests of evidence for linear terms with noises fitted for each of them."""

import numpy as np
import pytest
from scipy import stats

from auv_gym import load_vehicle
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search import beside_noise
from identification.diagnosis.search.beside_noise import Weight, weigh
from identification.diagnosis.search.dependence import dependence
from identification.diagnosis.search.workbench import Workbench
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.responses import Responses
from scripts.blind.logs import Conditions, heaved, yo_log

PLANT = load_vehicle("seaglider")
DIVES = Conditions(1.0, 1.0, 4.0 * 3600.0)
LAYER = 60.0  # m, the depth of its upper edge


def fitted(record):
    bench = Workbench(PLANT, record, parts_of(PLANT, record), 0.1)
    return bench, bench.fit(PLANT, PLANT.family.coefficients)


@pytest.fixture(scope="module")
def still():
    record = yo_log(PLANT, DIVES, np.random.default_rng(3))
    return record.select(np.arange(len(record)) >= record.segments[1].start)


@pytest.fixture(scope="module")
def layered(still):
    return fitted(heaved(still, np.where(still["depth_m"] > LAYER, -0.004, 0.0)))


def below(bench, state) -> Responses:
    depth = bench.record["depth_m"][bench.problem.rows]
    return bench.problem.pushed_by(state.point, 0, (depth > LAYER).astype(float)[None])


@pytest.mark.parametrize("freedom", [12.0, 28.0, 400.0])
def test_the_chance_of_a_likelihood_ratio_is_that_of_student_where_a_variance_is_estimated(freedom):
    """For one term in a regression it is exact; with a known variance it is that of chi-square."""
    for t in (0.5, 2.0, 6.0):
        ratio = freedom * np.log1p(t * t / (freedom - 1.0))
        assert Weight(ratio, freedom).chance == pytest.approx(2.0 * stats.t.sf(t, freedom - 1.0), rel=1e-6)
    assert Weight(9.0, np.inf).chance == pytest.approx(stats.chi2.sf(9.0, 1))
    assert Weight(9.0, 1e7).chance == pytest.approx(stats.chi2.sf(9.0, 1), rel=1e-4)
    assert Weight(1e9, 1.0).chance == 1.0  # nothing is left to estimate a noise from
    assert Weight(1e9, 40.0).chance == 0.0


def test_what_random_accelerations_have_taken_over_weighs_more_with_noises_of_its_own(layered):
    """Water rises below some depth: accelerations have grown to absorb it, and are weaker beside the term."""
    bench, state = layered
    assert bench.problem.is_pushed(state.point)
    (weight,) = weigh(bench.problem, state.point, state.paths, below(bench, state))
    assert weight.chance < 1e-5
    assert np.isfinite(weight.freedom)
    found = dependence(bench, state)
    assert found is not None
    assert found.pushed == "depth_m"


def test_the_search_of_dependences_needs_the_weights(layered, monkeypatch):
    monkeypatch.setattr("identification.diagnosis.search.dependence.WEIGHED", 0)
    assert dependence(*layered) is None


def test_what_is_not_there_weighs_next_to_nothing(still):
    bench, state = fitted(still)
    (weight,) = weigh(bench.problem, state.point, state.paths, below(bench, state))
    assert weight.chance > 1e-3


def test_degrees_of_freedom_are_asked_for_only_where_they_may_matter(layered, monkeypatch):
    bench, state = layered
    monkeypatch.setattr(beside_noise, "freedom_of", lambda *args: pytest.fail("asked for"))
    (weight,) = weigh(bench.problem, state.point, state.paths, below(bench, state), 0.0)
    assert weight.freedom == np.inf


def test_a_term_that_starts_and_coefficients_imitate_weighs_nothing(layered):
    bench, state = layered
    (path,) = state.paths[:1]
    own = bench.problem.partly(state.point, path, np.ones((1, len(bench.problem.rows))))
    (weight,) = weigh(bench.problem, state.point, state.paths, own)
    assert weight.evidence == pytest.approx(0.0, abs=0.5)


def test_one_wild_row_is_not_taken_for_a_term_that_acts_there(still):
    """If the size of the errors did not include the wild row, a term in this row alone would seem certain."""
    row = len(still) // 2
    depth = still["depth_m"].copy()
    depth[row:] += 1.0  # m, a single jump
    bench, state = fitted(still.with_channels({"depth_m": depth}))
    there = (bench.problem.rows == row - 1).astype(float)[None]
    (weight,) = weigh(bench.problem, state.point, state.paths, bench.problem.pushed_by(state.point, 0, there))
    assert weight.evidence < 3.0


@pytest.mark.slow
def test_weights_of_what_is_not_there_have_the_distribution_that_is_said():
    """For a step in the yaw acceleration, over 60 logs of a randomly pushed glider, p-values are uniform."""
    from tests.identification.fit.glider_logs import GLIDER, OFFSET, glider_log, replace_at, whole

    plant, chances = replace_at(GLIDER, {OFFSET: 0.03}), []
    for seed in range(100, 160):
        log = glider_log(seed)
        problem = PredictionErrors(plant, log, whole(log))
        point = problem.solve(plant, ())
        later = (np.arange(len(problem.rows)) > 250).astype(float)[None]
        chances += [weight.chance for weight in weigh(problem, point, (), problem.pushed_by(point, 0, later))]
    assert stats.kstest(chances, "uniform").pvalue > 0.01
    assert min(chances) > 1e-4
