"""Tests of predictions of parts from each other, and of intervals for coloured errors or unknown noise."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from auv_gym.param import replace_at
from identification.fit import intervals
from identification.fit.intervals import Information, _by_noise, information_of, interval_of, told_by_part
from identification.fit.noises import Noises
from identification.fit.prediction_errors import PredictionErrors
from tests.identification.diagnosis.stand_ins import point_of
from tests.identification.fit.glider_logs import GLIDER, OFFSET, glider_log

COUNT = 4000


@dataclass(frozen=True, eq=False)
class Regression:
    """A problem of one channel with given slopes.

    slopes: (P, rows).  basis: (rows, m), orthonormal, of changes by starts.  rates: (P,), 1 over prior deviations.
    """

    slopes: np.ndarray
    stretch_of_row: np.ndarray
    basis: np.ndarray = field(default_factory=lambda: np.zeros((COUNT, 0)))
    rates: float | np.ndarray = 0.0
    count: int = COUNT

    def pushing(self, point) -> list[int]:
        return []

    def own_slopes(self, point, paths) -> tuple[np.ndarray, np.ndarray]:
        return self.slopes, self.slopes - (self.slopes @ self.basis) @ self.basis.T

    def pulls(self, vector, paths) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros(len(self.slopes)), np.broadcast_to(self.rates, len(self.slopes))


def coloured(phi: float, seed: int = 0) -> np.ndarray:
    """First-order autoregressive errors of unit variance; phi: their correlation from row to row."""
    innovations = np.sqrt(1.0 - phi**2) * np.random.default_rng(seed).standard_normal(COUNT + 200)
    return np.asarray(lfilter([1.0], [1.0, -phi], innovations))[200:]


def variances(errors: np.ndarray, stretch: np.ndarray | None = None, **settings) -> np.ndarray:
    """Stated variances of a mean and of a slope of alternating sign, over those for white errors."""
    slopes = np.stack([np.ones(COUNT), np.where(np.arange(COUNT) % 2, 1.0, -1.0)])
    problem = Regression(slopes, np.zeros(COUNT, dtype=int) if stretch is None else stretch, **settings)
    point = point_of([0.0] * COUNT, errors=errors[:, None])
    return COUNT * np.diag(information_of(problem, point, ("mean", "other")).covariance)  # type: ignore[arg-type]


def test_errors_that_follow_each_other_widen_the_interval_of_what_they_look_like():
    """The factor is the sum of correlations with Bartlett's weights over 10 lags; the alternating slope keeps 1."""
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
    # errors half as large as expected do not narrow an interval
    assert variances(0.5 * coloured(0.0)) == pytest.approx([1.0, 1.0])


def test_errors_at_either_side_of_a_gap_have_nothing_to_do_with_each_other():
    whole, cut = (variances(coloured(0.8), stretch)[0] for stretch in (None, np.arange(COUNT) // 2))
    assert cut == pytest.approx(1.0 + 10.0 / 11.0 * 0.8, rel=0.1)  # half of the pairs of neighbours
    assert cut < 0.5 * whole


def test_what_starts_can_imitate_is_no_information_and_what_was_known_is():
    start = np.zeros((COUNT, 1))
    start[: COUNT // 2] = np.sqrt(2.0 / COUNT)  # a start that shifts the first half
    mean, alternating = variances(0.1 * coloured(0.0), basis=start)
    assert (mean, alternating) == pytest.approx((2.0, 1.0), rel=1e-3)
    assert variances(0.1 * coloured(0.0), rates=np.sqrt(3.0 * COUNT)) == pytest.approx([0.25, 0.25])


def test_what_starts_all_but_imitate_neither_narrows_nor_widens_an_interval():
    """A millionth of a slope of 1e9 is left: rounding error, which must not count as information."""
    start = np.full((COUNT, 1), COUNT**-0.5)
    rounding = np.random.default_rng(1).standard_normal((1, COUNT)) * COUNT**-0.5
    problem = Regression(1e9 * start.T + 1e3 * rounding, np.zeros(COUNT, dtype=int), start, rates=1.0)
    point = point_of([0.0] * COUNT, errors=coloured(0.0)[:, None])
    told = information_of(problem, point, ("imitated",))  # type: ignore[arg-type]
    assert told.covariance == pytest.approx(np.ones((1, 1)))  # the prior


def test_a_path_of_which_much_was_known_leaves_another_as_it_is():
    """The path has no effect on the readings, so that its prior is huge in units of its slopes."""
    slopes = np.stack([np.ones(COUNT), np.zeros(COUNT)])
    problem = Regression(slopes, np.zeros(COUNT, dtype=int), rates=np.array([0.0, 1e4]))
    point = point_of([0.0] * COUNT, errors=np.zeros((COUNT, 1)))
    told = information_of(problem, point, ("mean", "idle"))  # type: ignore[arg-type]
    assert np.diag(told.covariance) == pytest.approx([1.0 / COUNT, 1e-8])


PARTS = [[slice(0, 200)], [slice(200, 320)], [slice(320, 500)]]


@pytest.fixture(scope="module")
def fitted():
    """A glider's rudder offset, fitted to a log of three parts."""
    log = glider_log(3)
    problem = PredictionErrors(GLIDER, log, [slice(0, 500)])
    return problem, problem.solve(replace_at(GLIDER, OFFSET, 0.02), [OFFSET])


def test_a_part_is_as_likely_as_on_average_over_what_the_others_leave_open(fitted):
    problem, point = fitted
    error = np.sqrt(1.0 / information_of(problem, point, [OFFSET]).alone[0, 0]) * problem.scale(OFFSET)
    inside = [problem.within(part) > 0.0 for part in PARTS]
    scores = []
    for steps in np.linspace(-12.0, 12.0, 121):
        vector = point.vector.copy()
        vector[problem.index[OFFSET]] += steps * error
        there = problem.with_gains(point, vector)
        scores.append([there.scores[rows].sum() for rows in inside])
    own, found = np.array(scores), told_by_part(problem, point, [OFFSET], PARTS).foretold
    for k in range(3):
        others = own.sum(axis=1) - own[:, k]
        weights = np.exp(others - others.max()) / np.exp(others - others.max()).sum()
        expected = np.log(weights @ np.exp(own[:, k] - own[:, k].max())) + own[:, k].max()
        assert found[k] == pytest.approx(expected, abs=0.1)
    assert abs(found.sum() - point.scores.sum()) > 0.3  # the sum of scores at the fitted parameter


class Line(Regression):
    """One parameter with information in ten rows."""

    def total(self, point) -> float:
        return float(point.scores.sum())

    def objective(self, point, paths) -> float:
        return self.total(point)

    def within(self, windows) -> np.ndarray:
        inside = np.zeros(10)
        for window in windows:
            inside[window] = 1.0
        return inside


@pytest.fixture(scope="module")
def line():
    """Slopes and errors, and the information in parts of four, three and three rows."""
    rng = np.random.default_rng(0)
    slopes, errors = rng.uniform(0.5, 1.5, (1, 10)), rng.standard_normal(10) + 2.0
    problem = Line(slopes, np.zeros(10, dtype=int), np.zeros((10, 0)))
    point = point_of(stats.norm.logpdf(errors).tolist(), errors=errors[:, None])
    parts = [[slice(0, 4)], [slice(4, 7)], [slice(7, 10)]]
    return slopes[0], errors, told_by_part(problem, point, ("slope",), parts)  # type: ignore[arg-type]


def test_a_part_is_foretold_by_the_others(line):
    """The likelihood is that of an exact regression whose parameter is determined by the other rows."""
    slopes, errors, told = line
    for k, own in enumerate((slice(0, 4), slice(4, 7), slice(7, 10))):
        others = np.delete(np.arange(10), own)
        power = float(slopes[others] @ slopes[others])
        mean = slopes[own] * float(slopes[others] @ errors[others]) / power
        spread = np.outer(slopes[own], slopes[own]) / power + np.eye(own.stop - own.start)
        assert told.foretold[k] == pytest.approx(stats.multivariate_normal(mean, spread).logpdf(errors[own]))  # type: ignore[arg-type]


def test_parameters_without_a_part_are_those_of_the_other_rows(line):
    slopes, errors, told = line
    step, reached = told.refitted(np.array([True, False, True]))
    rows = np.r_[0:4, 7:10]
    best = float(slopes[rows] @ errors[rows]) / float(slopes[rows] @ slopes[rows])
    assert step == pytest.approx([best])
    assert reached == pytest.approx(stats.norm.logpdf(errors[rows] - best * slopes[rows]).sum())


def test_what_is_known_exactly_costs_nothing(fitted):
    """Without a free parameter, or with one of zero prior deviation, the result is the likelihood of the rows."""
    problem, point = fitted
    own = [point.scores[problem.within(part) > 0.0].sum() for part in PARTS]
    assert told_by_part(problem, point, [], PARTS).foretold == pytest.approx(own)
    sure = PredictionErrors(GLIDER, problem.record, [slice(0, 500)], doubt=1e-6)
    assert told_by_part(sure, replace(point), ["hull.n_r"], PARTS).foretold == pytest.approx(own, abs=1e-3)


def test_parameters_without_a_part_of_a_log_are_those_of_a_fit_without_it(fitted):
    problem, point = fitted
    told = told_by_part(problem, point, [OFFSET], PARTS)
    step, _ = told.refitted(np.array([True, True, False]))
    fewer = PredictionErrors(GLIDER, problem.record, [slice(0, 320)])
    near = fewer.point(point.vector, point.logs)
    there = fewer.solve(problem.plant_at(point, [OFFSET]), [OFFSET], near, noise=False)
    moved = (there.vector - point.vector)[problem.index[OFFSET]] / problem.scale(OFFSET)
    error = np.sqrt(1.0 / information_of(problem, point, [OFFSET]).alone[0, 0])
    assert abs(moved) > 0.2 * error
    assert step[0] == pytest.approx(moved, abs=0.1 * error)


class Mean:
    """A stand-in: the mean of random pushes, whose variance is proportional to their strength squared and their time.

    curvature: of the log-likelihood by the logarithms of both.  error: of the one reading, over its deviation.
    """

    def __init__(self, curvature, pushing=(1, 2), error=0.0):
        self.curvature, self._pushing, self.error = np.array(curvature), list(pushing), error

    noise_information = Noises.noise_information

    def pushing(self, point):
        return self._pushing

    def noise_slopes(self, point, logs):
        return 0.0, np.r_[0.0, -self.curvature @ logs[1:]]

    def with_noise(self, point, logs):
        return replace(point, logs=logs)

    def prepared(self, point, paths):
        return point

    def soon_slopes(self, point, paths):
        return np.exp(-0.5 * (2.0 * point.logs[1] + point.logs[2]))[None, None]

    def without_starts(self, point, slopes, soon):
        assert soon
        return slopes

    def pulls(self, vector, paths):
        return np.zeros(1), np.zeros(1)


@dataclass(frozen=True)
class Logs:
    logs: np.ndarray
    vector: np.ndarray = field(default_factory=lambda: np.zeros(1))
    scores: np.ndarray = field(default_factory=lambda: np.zeros(1))
    system: str | None = "linearised"
    errors: np.ndarray = field(default_factory=lambda: np.zeros((1, 1)))


def by_noise(problem) -> tuple[np.ndarray, np.ndarray]:
    """The growth and the degrees of freedom of a mean with unit information."""
    point = Logs(np.zeros(3), errors=np.array([[problem.error]]))
    return _by_noise(problem, point, ["mean"], np.zeros((1, 1)))  # type: ignore[arg-type]


def test_a_noise_of_which_little_is_known_widens_intervals_as_student_did():
    """The variance is proportional to strength squared and to time, so that its logarithm has slopes of 2 and 1."""
    told, slopes = np.array([[20.0, -4.0], [-4.0, 6.0]]), np.array([2.0, 1.0])
    variance = slopes @ np.linalg.solve(told, slopes)
    growth, freedom = by_noise(Mean(told))
    assert freedom == pytest.approx([2.0 / variance], rel=1e-6)
    assert growth == pytest.approx([0.5 * variance], rel=1e-6)


def test_a_vehicle_that_runs_away_has_intervals_all_the_same():
    lost = Logs(np.zeros(3), system=None)
    growth, freedom = _by_noise(Mean(np.eye(2)), lost, ["mean"], np.zeros((1, 1)))  # type: ignore[arg-type]
    assert growth == [0.0]
    assert freedom == [np.inf]


def test_a_noise_with_which_the_vehicle_runs_away_tells_nothing_of_intervals():
    class Lost(Mean):
        def with_noise(self, point, logs):
            return replace(point, logs=np.full(3, np.nan), scores=np.array([np.nan]))

    growth, freedom = by_noise(Lost(np.eye(2)))
    assert growth == [0.0]
    assert freedom[0] > 1e6


def test_what_is_not_known_of_a_noise_at_all_has_a_limit_and_without_any_nothing_is_wider():
    growth, freedom = by_noise(Mean(1e-3 * np.eye(2)))
    assert growth == [1.0]
    assert freedom == [2.0]
    growth, freedom = by_noise(Mean(np.eye(2), ()))
    assert growth == [0.0]
    assert freedom == [np.inf]


def test_an_estimate_that_moves_with_the_noise_is_less_sure_by_what_it_moves_by():
    """The error is 0.5 deviations, and the deviation grows with the strength and the root of the time; steps of 0.2."""
    told, slopes = np.array([[20.0, -4.0], [-4.0, 6.0]]), np.array([2.0, 1.0])
    moves = 0.5 * np.expm1([0.2, 0.1]) / 0.2
    expected = np.exp(0.5 * slopes @ np.linalg.solve(told, slopes)) + moves @ np.linalg.solve(told, moves)
    growth, _ = by_noise(Mean(told, error=0.5))
    assert growth == pytest.approx([np.log(expected)], rel=1e-6)


def test_slow_pushes_leave_less_freedom_than_fast_ones():
    freedom, wider = [], []
    for tau in (5.0, 60.0):
        log = glider_log(7, tau=tau, rows=400)
        problem = PredictionErrors(GLIDER, log, [slice(0, 400)])
        point = problem.solve(replace_at(GLIDER, OFFSET, 0.02), [OFFSET])
        told = information_of(problem, point, [OFFSET])
        freedom.append(told.freedom[0])
        wider.append(told.covariance[0, 0] * told.alone[0, 0])
    assert freedom[1] < 0.7 * freedom[0] < 30.0  # 400 readings hold some 80 or 7 correlation times
    assert 1.0 <= wider[0] < wider[1]


def weakly_pushed(seed, push):
    """Problem, point and information on the rudder offset, for pushes so weak that the fit leaves them out."""
    log = glider_log(seed, push=push, tau=30.0, rows=400)
    problem = PredictionErrors(GLIDER, log, [slice(0, 400)])
    point = problem.solve(replace_at(GLIDER, OFFSET, 0.03), [OFFSET])
    assert not problem.is_pushed(point)
    return problem, point, information_of(problem, point, [OFFSET])


@pytest.mark.parametrize("seed", [116, 119, 122])
def test_pushes_that_a_fit_leaves_out_widen_intervals(seed):
    """The offset absorbs the mean of slow pushes; with their neglect it is off by up to 14 standard errors."""
    problem, point, told = weakly_pushed(seed, 0.0006)
    off = (point.vector[problem.index[OFFSET]] - 0.03) / problem.scale(OFFSET)
    assert abs(off) * np.sqrt(told.alone[0, 0]) > 2.5
    assert abs(off) / np.sqrt(told.covariance[0, 0]) < 1.96


@pytest.mark.parametrize("seed", [101, 107])
def test_where_nothing_pushes_intervals_stay_as_they_are(seed):
    _, _, told = weakly_pushed(seed, 0.0)
    assert told.covariance[0, 0] * told.alone[0, 0] == pytest.approx(1.0, rel=0.02)


def test_pushes_that_are_tried_are_not_far_less_likely():
    problem, point, _ = weakly_pushed(101, 0.0)
    (left_out,) = problem.left_out(point)
    tried = problem.with_acceleration(point, point.logs, left_out)
    first = len(problem.channels) + left_out
    strengths = np.exp([logs[first] for logs in tried]) / problem.unit[left_out]
    assert strengths.min() == pytest.approx(1e-3)
    assert strengths.max() < 1.0  # the strongest would leave the record far less likely
    lost = [problem.total(point) - problem.total(problem.with_noise(point, logs)) for logs in tried]
    assert max(lost) < 5.0


def test_an_effect_with_a_corner_or_near_a_bound_has_the_interval_of_its_profile(fitted, monkeypatch):
    problem, point = fitted
    lag, asked = "effects.rudder.lag", []

    def profile(problem, point, paths, path, error, reach, way):
        asked.append((path, error, reach))
        assert way == pytest.approx([0.0, 1.0] if path == lag else [1.0, 0.0])  # the two are independent
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
    assert problem.bounds(lag)[1] > 2.0 * problem.scale(lag)  # the interval is far within the bounds
    assert interval_of(problem, replace(point, vector=within), paths, lag, told)[0] == -5.0
    assert asked == [(lag, pytest.approx(0.2 * problem.scale(lag)), 2.5)]
    near = point.vector.copy()
    near[problem.index[OFFSET]] = problem.bounds(OFFSET)[1] - 0.5 * half
    assert interval_of(problem, replace(point, vector=near), paths, OFFSET, told) == (-5.0, 5.0)
    assert len(asked) == 2
