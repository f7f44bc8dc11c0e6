"""Tests of the filter against statsmodels, of its gradient, and of its stretches against separate filters."""

from dataclasses import replace

import numpy as np
import pytest
from statsmodels.tsa.statespace.mlemodel import MLEModel

from identification.fit.adjoint import slopes_of
from identification.fit.kalman import System, run_filter, start_slopes

SOLID, PUSHED, CHANNELS, ROWS = 3, 2, 3, 40
SIZE = SOLID + PUSHED
LOGS = np.log([0.3, 0.5, 0.7, 0.4, 0.2, 3.0, 8.0])  # of channels, accelerations, correlation times
SWELL, PAIR = np.array([1.3, 0.0]), np.log([0.3, 0.5, 0.7, 0.4, 0.4, 3.0, 3.0])  # rad/s, and noises of a pair


def system(
    seed: int = 0, begins: tuple[int, ...] = (0,), carried: tuple[int, ...] = (), dt: float | None = None
) -> System:
    """A system that varies from row to row, with missing readings and averaged ones."""
    rng = np.random.default_rng(seed)
    a = np.concatenate([0.8 * np.eye(SOLID), rng.normal(size=(SOLID, PUSHED))], axis=1)
    a = a + 0.1 * rng.normal(size=(ROWS, SOLID, SIZE))
    constant = np.zeros(SIZE, dtype=bool)
    if carried:
        constant[1] = True
        a[:, 1], a[:, 1, 1] = 0.0, 1.0
    c = rng.normal(size=(ROWS, CHANNELS, SIZE))
    c[:, :, SOLID:] = 0.0
    begin = np.zeros(ROWS, dtype=np.int64)
    begin[list(begins)] = 1
    begin[list(carried)] = 2
    finite = rng.random((ROWS, CHANNELS)) < 0.8
    durations = rng.uniform(0.5, 1.5, ROWS) if dt is None else np.full(ROWS, dt)
    count = len(begins) + len(carried)
    start = np.tril(rng.uniform(0.2, 1.0, (count, SOLID, SOLID))).transpose(0, 2, 1)
    for w, row in enumerate(sorted((*begins, *carried))):
        if row in carried:
            start[w, 1], start[w, :, 1] = 0.0, 0.0
    error = np.where(finite, rng.normal(size=(ROWS, CHANNELS)), 0.0)
    forcing, origin = rng.normal(size=(ROWS, SOLID)), 0.3 * rng.normal(size=(count, SIZE))
    counts = rng.integers(1, 4, finite.shape).astype(float)
    return System(a, c, forcing, error, finite, counts, begin, constant, durations, start, origin)


def numbers(logs: np.ndarray):
    return np.exp(2.0 * logs[:CHANNELS]), np.exp(logs[CHANNELS : CHANNELS + PUSHED]), np.exp(logs[-PUSHED:])


class Reference(MLEModel):
    """The same system for statsmodels."""

    def __init__(self, s: System, logs: np.ndarray):
        readings = np.where(s.finite, s.error, np.nan)
        super().__init__(readings, k_states=SIZE, k_posdef=PUSHED, initialization="known",
                         initial_state=s.origin[0], initial_state_cov=self.start(s, logs))  # fmt: skip
        variances, deviations, times = numbers(logs)
        decay = np.exp(-s.durations[:, None] / times)
        turn = np.zeros((SIZE, SIZE, ROWS))
        turn[:SOLID] = s.a.transpose(1, 2, 0)
        push = np.zeros((PUSHED, PUSHED, ROWS))
        for d in range(PUSHED):
            turn[SOLID + d, SOLID + d] = decay[:, d]
            push[d, d] = deviations[d] ** 2 * (1.0 - decay[:, d] ** 2)
            if s.turning[d] != 0.0:
                angles = s.turning[d] * s.durations
                pair = np.array([[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]])
                turn[SOLID + d : SOLID + d + 2, SOLID + d : SOLID + d + 2] = pair * decay[:, d]
                push[d + 1, d + 1] = push[d, d]
                break
        self["transition"], self["state_cov"] = turn, push
        self["selection"] = np.eye(SIZE)[:, SOLID:]
        self["design"] = s.c.transpose(1, 2, 0)
        self["obs_cov"] = np.einsum("rc,cd->cdr", variances / s.counts, np.eye(CHANNELS))
        self["state_intercept"] = np.concatenate([-s.forcing.T, np.zeros((PUSHED, ROWS))])

    @staticmethod
    def start(s: System, logs: np.ndarray) -> np.ndarray:
        covariance = np.diag(np.r_[np.zeros(SOLID), numbers(logs)[1] ** 2])
        covariance[:SOLID, :SOLID] = s.start[0].T @ s.start[0]
        return covariance


def test_the_likelihood_is_that_of_statsmodels():
    for seed in range(5):
        s = system(seed)
        ours = run_filter(s, *numbers(LOGS))
        theirs = Reference(s, LOGS).ssm.filter()
        # rounding of two filters that order their sums differently
        assert ours.scores.sum() == pytest.approx(theirs.llf, rel=1e-8)
        assert ours.scores == pytest.approx(theirs.llf_obs, rel=1e-8, abs=1e-8)
        assert ours.means == pytest.approx(theirs.filtered_state.T, abs=1e-8)


def test_the_likelihood_of_a_swell_is_that_of_statsmodels():
    for seed in range(5):
        s = replace(system(seed), turns=SWELL)
        ours, theirs = run_filter(s, *numbers(PAIR)), Reference(s, PAIR).ssm.filter()
        assert ours.scores == pytest.approx(theirs.llf_obs, rel=1e-8, abs=1e-8)
        assert ours.means == pytest.approx(theirs.filtered_state.T, abs=1e-8)
        assert abs(ours.scores.sum() - run_filter(replace(s, turns=None), *numbers(PAIR)).scores.sum()) > 0.1


@pytest.mark.parametrize("begins, carried", [((0, 15), ()), ((0,), (12, 25))])
def test_the_gradient_by_a_swell_is_that_of_central_differences(begins, carried):
    """The gradient is that of both members of a pair, which share their noises."""
    s, weights = replace(system(2, begins, carried), turns=SWELL), np.random.default_rng(3).random(ROWS)

    def value(logs: np.ndarray) -> float:
        return float(weights @ run_filter(s, *numbers(logs)).scores)

    exact = slopes_of(s, run_filter(s, *numbers(PAIR)), weights, *numbers(PAIR)).noises
    both = np.r_[exact[:CHANNELS], exact[CHANNELS : CHANNELS + 2].sum(), exact[-2:].sum()]
    step, one = 1e-5, np.eye(LOGS.size)
    moves = [*one[:CHANNELS], one[CHANNELS] + one[CHANNELS + 1], one[-2] + one[-1]]
    numeric = [(value(PAIR + step * m) - value(PAIR - step * m)) / (2.0 * step) for m in moves]
    assert both == pytest.approx(numeric, rel=1e-6, abs=1e-6)  # rounding of differences over 1e-5


def test_gains_and_whitened_errors_belong_to_the_rows_covariance():
    s = system(1)
    made, theirs = run_filter(s, *numbers(LOGS)), Reference(s, LOGS).ssm.filter()
    k = 17
    seen = s.finite[k]
    covariance = theirs.forecasts_error_cov[:, :, k][np.ix_(seen, seen)]
    whiten = made.whiten[k][np.ix_(seen, seen)]
    assert whiten @ covariance @ whiten.T == pytest.approx(np.eye(seen.sum()), abs=1e-8)
    root = made.roots[k]
    assert root.T @ root == pytest.approx(theirs.predicted_state_cov[:, :, k], abs=1e-8)
    assert np.all(made.gains[k][:, ~seen] == 0.0)


def test_the_gradient_is_exact_along_an_unstable_vehicle_that_hardly_anything_pushes():
    # a position and two growing oscillatory rates, as of a body that turns away from its course; a filter follows it
    rows, dt, scale = 400, 0.3, np.array([3e-3, 2e-3, 1e-3])
    a = np.repeat(np.array([[1.0, dt, 0.0, 0.0], [0.0, 1.1, 0.1, 0.0], [0.0, -0.1, 1.1, dt]])[None], rows, axis=0)
    c = np.repeat(np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.2, 0.0], [0.0, 0.3, 1.0, 0.0]])[None], rows, axis=0)
    begin = np.zeros(rows, dtype=np.int64)
    begin[0] = 1
    error = np.random.default_rng(5).normal(size=(rows, 3)) * scale
    s = System(
        a, c, np.zeros((rows, 3)), error, np.ones((rows, 3), dtype=bool), np.ones((rows, 3)), begin,
        np.zeros(4, dtype=bool), np.full(rows, dt), 100.0 * np.eye(3)[None], np.zeros((1, 4)),
    )  # fmt: skip
    logs = np.log([*1.5 * scale, 1e-5, 25.0])

    def split(values: np.ndarray):
        return np.exp(2.0 * values[:3]), np.exp(values[3:4]), np.exp(values[4:])

    def value(values: np.ndarray) -> float:
        return float(run_filter(s, *split(values)).scores.sum())

    exact = slopes_of(s, run_filter(s, *split(logs)), np.ones(rows), *split(logs)).noises
    step = 1e-4
    numeric = [(value(logs + step * e) - value(logs - step * e)) / (2.0 * step) for e in np.eye(5)]
    assert numeric[0] < -100.0  # the readings are more precise than these noises say
    assert exact == pytest.approx(numeric, abs=1e-4)  # rounding and curvature of differences over 1e-4


@pytest.mark.parametrize("begins, carried", [((0,), ()), ((0, 15), ()), ((0,), (12, 25))])
def test_the_gradient_is_that_of_central_differences(begins, carried):
    s, weights = system(2, begins, carried), np.random.default_rng(3).random(ROWS)

    def value(logs: np.ndarray) -> float:
        return float(weights @ run_filter(s, *numbers(logs)).scores)

    exact = slopes_of(s, run_filter(s, *numbers(LOGS)), weights, *numbers(LOGS)).noises
    step = 1e-5
    numeric = [(value(LOGS + step * e) - value(LOGS - step * e)) / (2.0 * step) for e in np.eye(LOGS.size)]
    assert exact == pytest.approx(numeric, rel=1e-6, abs=1e-6)  # rounding of differences over 1e-5


def test_a_stretch_begins_anew():
    whole, cut = system(4, (0, 20)), slice(20, None)
    names = ("a", "c", "forcing", "error", "finite", "counts", "begin", "durations")
    own = {name: getattr(whole, name)[cut] for name in names}
    rest = replace(whole, **own, start=whole.start[1:], origin=whole.origin[1:])
    assert run_filter(whole, *numbers(LOGS)).scores[cut] == pytest.approx(run_filter(rest, *numbers(LOGS)).scores)


def test_what_goes_on_from_one_stretch_to_the_next_is_known_there():
    s = system(5, (0,), (20,))
    roots = run_filter(s, *numbers(LOGS)).roots
    first, last, after = (np.diag(roots[k].T @ roots[k]) for k in (0, 19, 20))
    assert after[1] <= last[1] < 0.5 * first[1]
    assert after[[0, 2]] == pytest.approx(np.diag(s.start[1].T @ s.start[1])[[0, 2]])


def test_slopes_by_the_starts_are_those_of_central_differences():
    s, weights = system(7, (0, 15)), np.random.default_rng(8).random(ROWS)
    found = slopes_of(s, run_filter(s, *numbers(LOGS)), weights, *numbers(LOGS))

    def value(origin: np.ndarray, start: np.ndarray) -> float:
        return float(weights @ run_filter(replace(s, origin=origin, start=start), *numbers(LOGS)).scores)

    step = 1e-5
    for w in range(2):
        for i in range(SOLID):
            moved = np.zeros_like(s.origin)
            moved[w, i] = step
            numeric = (value(s.origin + moved, s.start) - value(s.origin - moved, s.start)) / (2.0 * step)
            assert found.means[w, i] == pytest.approx(numeric, rel=1e-6, abs=1e-6)
        covariance, turned = s.start[w].T @ s.start[w], np.zeros((SOLID, SOLID))
        turned[0, 1] = turned[1, 0] = step
        values = []
        for side in (1.0, -1.0):
            start = s.start.copy()
            start[w] = np.linalg.cholesky(covariance + side * turned).T
            values.append(value(s.origin, start))
        numeric = (values[0] - values[1]) / (2.0 * step)
        both = found.covariances[w, 0, 1] + found.covariances[w, 1, 0]
        assert both == pytest.approx(numeric, rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("turns", [None, SWELL], ids=["fading", "swell"])
@pytest.mark.parametrize("begins, carried", [((0, 15), ()), ((0,), (12, 25))])
def test_predictions_move_with_the_starts_as_those_of_the_filter_do(begins, carried, turns):
    s = replace(system(9, begins, carried), turns=turns)
    made = run_filter(s, *numbers(LOGS))
    slopes = start_slopes(s, made.gains, made.whiten, numbers(LOGS)[2])
    for i in range(SOLID):
        moved = run_filter(replace(s, origin=s.origin + np.eye(SIZE)[i]), *numbers(LOGS))
        assert slopes[i] == pytest.approx(made.innovations - moved.innovations, abs=1e-10)


def test_without_noise_of_motion_what_is_forgotten_stays_a_number():
    s = system(6)
    s.a[:, :, :SOLID] *= 1e-5  # within 40 rows its variance would underflow
    quiet = np.r_[LOGS[:CHANNELS], -40.0, -40.0, LOGS[-PUSHED:]]
    made = run_filter(s, *numbers(quiet))
    assert np.isfinite(made.scores).all()
    assert np.isfinite(slopes_of(s, made, np.ones(ROWS), *numbers(quiet)).noises).all()


@pytest.mark.parametrize("left_out", [(0,), (1,), (0, 1)])
def test_an_acceleration_without_deviation_is_left_out_at_no_loss(left_out):
    """The result equals that for a deviation of a billionth."""
    s, (variances, deviations, times) = system(7, begins=(0, 15), carried=(28,)), numbers(LOGS)
    s.origin[:, SOLID:] = 0.0  # the initial mean of an acceleration is zero
    deviations[list(left_out)] = 0.0
    tiny = np.where(deviations > 0.0, deviations, 1e-9)
    found, other = run_filter(s, variances, deviations, times), run_filter(s, variances, tiny, times)
    assert found.scores == pytest.approx(other.scores, rel=1e-12)
    assert found.gains == pytest.approx(other.gains, abs=1e-12)
    own = slopes_of(s, found, np.ones(ROWS), variances, deviations, times)
    theirs = slopes_of(s, other, np.ones(ROWS), variances, tiny, times)
    assert own.noises == pytest.approx(theirs.noises, abs=1e-10)
    assert own.means[:, :SOLID] == pytest.approx(theirs.means[:, :SOLID], abs=1e-10)
    assert own.covariances[:, :SOLID, :SOLID] == pytest.approx(
        theirs.covariances[:, :SOLID, :SOLID], rel=1e-12, abs=1e-10
    )
