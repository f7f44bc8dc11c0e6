"""What held-out rows say where parameters are uncertain; intervals where errors are coloured or noise is unknown."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from auv_gym.param import replace_at
from identification.fit import intervals
from identification.fit.intervals import Information, _by_noise, information_of, interval_of, predictive_scores
from identification.fit.prediction_errors import PredictionErrors
from tests.identification.diagnosis.stand_ins import point_of
from tests.identification.fit.test_prediction_errors import GLIDER, OFFSET, glider_log

COUNT = 4000


@dataclass(frozen=True, eq=False)
class Regression:
    """A problem of one channel whose slopes are given.

    slopes: (P, rows).  basis: (rows, m), orthonormal, what starts can do.  rates: (P,), 1 over what was known before.
    """

    slopes: np.ndarray
    stretch_of_row: np.ndarray
    basis: np.ndarray = field(default_factory=lambda: np.zeros((COUNT, 0)))
    rates: float = 0.0
    count: int = COUNT

    def pushing(self, point) -> list[int]:
        return []

    def counted_slopes(self, point, paths) -> np.ndarray:
        return self.slopes

    def without_starts(self, point, slopes) -> np.ndarray:
        return slopes - (slopes @ self.basis) @ self.basis.T

    def counted_errors(self, point) -> np.ndarray:
        return point.errors

    def pulls(self, vector, paths) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros(len(self.slopes)), np.full(len(self.slopes), self.rates)


def coloured(phi: float, seed: int = 0) -> np.ndarray:
    """Errors of unit variance, each with a share of the one before."""
    innovations = np.sqrt(1.0 - phi**2) * np.random.default_rng(seed).standard_normal(COUNT + 200)
    return np.asarray(lfilter([1.0], [1.0, -phi], innovations))[200:]


def variances(errors: np.ndarray, stretch: np.ndarray | None = None, **settings) -> np.ndarray:
    """What is said of a mean and of a slope that alternates from row to row, over what white errors would give."""
    slopes = np.stack([np.ones(COUNT), np.where(np.arange(COUNT) % 2, 1.0, -1.0)])
    problem = Regression(slopes, np.zeros(COUNT, dtype=int) if stretch is None else stretch, **settings)
    point = point_of([0.0] * COUNT, errors=errors[:, None])
    return COUNT * np.diag(information_of(problem, point, ("mean", "other")).covariance)  # type: ignore[arg-type]


def test_errors_that_follow_each_other_widen_the_interval_of_what_they_look_like():
    """By the sum of the correlations with Bartlett's weights over 10 lags; the alternating slope is no less sure."""
    lags = np.arange(1, 11)
    widened = 1.0 + 2.0 * float(((1.0 - lags / 11.0) * 0.8**lags).sum())
    mean, alternating = variances(coloured(0.8))
    assert mean == pytest.approx(widened, rel=0.15)
    assert alternating == pytest.approx(1.0)
    mean, alternating = variances(coloured(-0.8))
    assert mean == pytest.approx(1.0)
    assert alternating == pytest.approx(widened, rel=0.15)


def test_intervals_of_white_errors_are_those_of_the_information():
    assert variances(coloured(0.0)) == pytest.approx([1.0, 1.0], abs=0.15)  # 10 lags of 4000 scores
    # errors half as large as they should be narrow no interval
    assert variances(0.5 * coloured(0.0)) == pytest.approx([1.0, 1.0])


def test_errors_at_either_side_of_a_gap_have_nothing_to_do_with_each_other():
    whole, cut = (variances(coloured(0.8), stretch)[0] for stretch in (None, np.arange(COUNT) // 2))
    assert cut == pytest.approx(1.0 + 10.0 / 11.0 * 0.8, rel=0.1)  # a half of the pairs of neighbours
    assert cut < 0.5 * whole


def test_what_starts_can_imitate_is_no_information_and_what_was_known_is():
    start = np.zeros((COUNT, 1))
    start[: COUNT // 2] = np.sqrt(2.0 / COUNT)  # a start that shifts the first half
    mean, alternating = variances(0.1 * coloured(0.0), basis=start)
    assert (mean, alternating) == pytest.approx((2.0, 1.0), rel=1e-3)
    assert variances(0.1 * coloured(0.0), rates=np.sqrt(3.0 * COUNT)) == pytest.approx([0.25, 0.25])


@pytest.fixture(scope="module")
def fitted():
    """A glider's offset, fitted to the first 200 rows of 500, and the windows that were not counted."""
    log = glider_log(3)
    held = [slice(200, 320), slice(320, 500)]
    problem = PredictionErrors(GLIDER, log, [slice(0, 200), *held], counted=[slice(0, 200)])
    return problem, problem.solve(replace_at(GLIDER, OFFSET, 0.02), [OFFSET]), held


def test_they_are_the_likelihood_averaged_over_what_the_fit_leaves_open(fitted):
    problem, point, held = fitted
    error = np.sqrt(1.0 / information_of(problem, point, [OFFSET]).alone[0, 0]) * problem.scale(OFFSET)
    far = np.linspace(-5.0, 5.0, 41)
    weights = np.exp(-0.5 * far**2) / np.exp(-0.5 * far**2).sum()
    inside = [problem.within([w]) > 0.0 for w in held]
    scores = []
    for steps in far:
        vector = point.vector.copy()
        vector[problem.index[OFFSET]] += steps * error
        there = problem.with_gains(point, vector)
        scores.append([there.scores[rows].sum() for rows in inside])
    first, both = np.array(scores)[:, 0], np.array(scores).sum(axis=1)
    expected = np.log(weights @ np.exp(both - both.max())) + both.max()
    found = predictive_scores(problem, point, [OFFSET], held)
    assert found.sum() == pytest.approx(expected, abs=0.1)
    assert found[0] == pytest.approx(np.log(weights @ np.exp(first - first.max())) + first.max(), abs=0.1)
    assert abs(found.sum() - point.scores[np.logical_or(*inside)].sum()) > 0.3  # what it is without


class Line(Regression):
    """One parameter that 4 of 10 rows have told a little of; the others are to be foretold."""

    counted = np.repeat([1.0, 0.0], [4, 6])

    def columns_of(self, point, moves) -> np.ndarray:
        return self.slopes[:, :, None]

    def counted_flat(self, columns) -> np.ndarray:
        return (columns * self.counted[:, None]).reshape(len(columns), -1)

    def within(self, windows) -> np.ndarray:
        inside = np.zeros(10)
        for window in windows:
            inside[window] = 1.0
        return inside


def test_a_window_is_foretold_by_those_before_it():
    """Both together are as likely as rows whose errors share an unknown parameter, and the second follows the first."""
    rng = np.random.default_rng(0)
    slopes, errors = rng.uniform(0.5, 1.5, (1, 10)), rng.standard_normal(10) + 2.0
    problem = Line(slopes, np.zeros(10, dtype=int), np.zeros((10, 0)))
    point = point_of(stats.norm.logpdf(errors).tolist(), errors=errors[:, None])
    first, second = predictive_scores(problem, point, ("slope",), [slice(4, 7), slice(7, 10)])  # type: ignore[arg-type]
    own = np.outer(slopes[0], slopes[0]) / (slopes[0, :4] @ slopes[0, :4]) + np.eye(10)
    assert first == pytest.approx(stats.multivariate_normal(np.zeros(3), own[4:7, 4:7]).logpdf(errors[4:7]))  # type: ignore[arg-type]
    assert first + second == pytest.approx(stats.multivariate_normal(np.zeros(6), own[4:, 4:]).logpdf(errors[4:]))  # type: ignore[arg-type]


def test_what_is_known_exactly_costs_nothing(fitted):
    """Without a free parameter, and with one of which a spread of nothing is known, they are the rows' likelihoods."""
    problem, point, held = fitted
    own = np.array([point.scores[problem.within([w]) > 0.0].sum() for w in held])
    assert predictive_scores(problem, point, [], held) == pytest.approx(own)
    sure = PredictionErrors(GLIDER, problem.record, [slice(0, 200), *held], doubt=1e-6, counted=[slice(0, 200)])
    assert predictive_scores(sure, replace(point), ["hull.n_r"], held) == pytest.approx(own, abs=1e-3)


class Mean:
    """A stand-in: the mean of random pushes of known strength and correlation time, whose information is their inverse.

    curvature: of the log-likelihood by the logarithms of both.
    """

    def __init__(self, curvature, pushing=(1, 2)):
        self.curvature, self._pushing = np.array(curvature), list(pushing)

    def pushing(self, point):
        return self._pushing

    def noise_slopes(self, point, logs):
        return 0.0, np.r_[0.0, -self.curvature @ logs[1:]]

    def with_noise(self, point, logs):
        return replace(point, logs=logs)

    def counted_slopes(self, point, paths):
        return np.exp(-0.5 * (2.0 * point.logs[1] + point.logs[2]))[None, None]

    def without_starts(self, point, slopes):
        return slopes


@dataclass(frozen=True)
class Logs:
    logs: np.ndarray


def test_a_noise_of_which_little_is_known_widens_intervals_as_student_did():
    """The variance goes with the square of the strength and with the time: slopes of 2 and 1, of which all follows."""
    told, slopes = np.array([[20.0, -4.0], [-4.0, 6.0]]), np.array([2.0, 1.0])
    variance = slopes @ np.linalg.solve(told, slopes)
    growth, freedom = _by_noise(Mean(told), Logs(np.zeros(3)), ["mean"], np.eye(1), np.zeros((1, 1)))  # type: ignore[arg-type]
    assert freedom == pytest.approx([2.0 / variance], rel=1e-6)
    assert growth == pytest.approx([0.5 * variance], rel=1e-6)


def test_what_is_not_known_of_a_noise_at_all_has_a_limit_and_without_any_nothing_is_wider():
    growth, freedom = _by_noise(Mean(1e-3 * np.eye(2)), Logs(np.zeros(3)), ["mean"], np.eye(1), np.zeros((1, 1)))  # type: ignore[arg-type]
    assert growth == [1.0]
    assert freedom == [2.0]
    growth, freedom = _by_noise(Mean(np.eye(2), ()), Logs(np.zeros(3)), ["mean"], np.eye(1), np.zeros((1, 1)))  # type: ignore[arg-type]
    assert growth == [0.0]
    assert freedom == [np.inf]


def test_slow_pushes_leave_less_freedom_than_fast_ones():
    freedom, wider = [], []
    for tau in (5.0, 60.0):
        log = glider_log(7, tau=tau, rows=400)
        problem = PredictionErrors(GLIDER, log, [slice(0, 400)])
        point = problem.solve(replace_at(GLIDER, OFFSET, 0.02), [OFFSET])
        told = information_of(problem, point, [OFFSET])
        freedom.append(told.freedom[0])
        wider.append(told.covariance[0, 0] * told.alone[0, 0])
    assert freedom[1] < 0.7 * freedom[0] < 30.0  # of 400 readings, which hold 80 or 7 correlation times
    assert 1.0 <= wider[0] < wider[1]


def test_an_effect_with_a_corner_or_near_a_bound_has_the_interval_of_its_profile(fitted, monkeypatch):
    problem, point, _ = fitted
    lag, asked = "effects.rudder.lag", []

    def profile(problem, point, paths, path, error, reach):
        asked.append((path, error, reach))
        return -5.0, 5.0

    monkeypatch.setattr(intervals, "profile_interval", profile)
    variances = np.diag([0.25, 0.04])
    told = Information(variances, variances, np.array([np.inf, 5.0]), np.array([1.96, 2.5]))
    paths, value = [OFFSET, lag], point.vector[problem.index[OFFSET]]
    half = 1.96 * 0.5 * problem.scale(OFFSET)
    assert interval_of(problem, point, paths, OFFSET, told) == pytest.approx((value - half, value + half), rel=1e-4)
    assert asked == []
    within = point.vector.copy()
    within[problem.index[lag]] = 0.5 * sum(problem.bounds(lag))
    assert problem.bounds(lag)[1] > 2.0 * problem.scale(lag)  # its interval is far within
    assert interval_of(problem, replace(point, vector=within), paths, lag, told)[0] == -5.0
    assert asked == [(lag, pytest.approx(0.2 * problem.scale(lag)), 2.5)]
    near = point.vector.copy()
    near[problem.index[OFFSET]] = problem.bounds(OFFSET)[1] - 0.5 * half
    assert interval_of(problem, replace(point, vector=near), paths, OFFSET, told) == (-5.0, 5.0)
    assert len(asked) == 2
