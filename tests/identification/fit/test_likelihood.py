"""Points that are likeliest where residuals are slow: what white fits leave, and what can then be compared."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from auv_gym.plant import load_vehicle
from identification.estimate import half_width
from identification.experiments.missions import run_mission
from identification.fit.likelihood import colour, covariance, evidence, polished, window_costs
from identification.fit.shooting import Linearisation, Point, Shooting

MOMENT = "effects.yaw.moment"


@pytest.fixture(scope="module")
def disturbed():
    """A glider's mission with slow noise in its heading, and nothing else that its model lacks."""
    plant, rng = load_vehicle("slocum"), np.random.default_rng(3)
    record = run_mission(plant, rng, duration=2400.0)
    slow = lfilter([1.0], [1.0, -0.95], 0.01 * rng.standard_normal(len(record.time)))
    return plant, Shooting(
        plant, record.with_channels({"heading_rad": record["heading_rad"] + slow}), record.windows(120.0)
    )


def test_a_white_residual_is_left_as_it_is(disturbed):
    plant, problem = disturbed
    point = problem.solve(plant, (MOMENT,))
    assert polished(problem, point, (MOMENT,), np.zeros(len(problem.channels))) is point


def test_no_start_and_no_path_near_by_is_likelier(disturbed):
    plant, problem = disturbed
    point = problem.solve(plant, (MOMENT,))
    slow = colour(problem, point)
    assert slow[problem.channels.index("heading_rad")] > 0.6
    found = polished(problem, point, (MOMENT,), slow)

    def cost(vector, starts):
        near = problem.point(vector, starts)
        return float(problem.counts @ np.log(window_costs(problem, near, slow).sum(axis=0)))

    least, rng = cost(found.vector, found.starts), np.random.default_rng(0)
    assert least < cost(point.vector, point.starts) - 5.0
    for _ in range(20):
        vector, starts = found.vector.copy(), found.starts.copy()
        vector[problem.index[MOMENT]] += 0.1 * problem.scale(MOMENT) * rng.standard_normal()
        starts[:, problem.start_states] += 3e-3 * rng.standard_normal((len(starts), len(problem.start_states)))
        assert cost(vector, starts) > least


def test_what_is_not_there_gains_what_chance_gives_and_never_loses(disturbed):
    plant, problem = disturbed
    without, beside = problem.solve(plant, ()), problem.solve(plant, (MOMENT,))
    slow = colour(problem, beside)
    gain = evidence(problem, polished(problem, without, (), slow), polished(problem, beside, (MOMENT,), slow), slow)
    assert -1e-6 <= gain < 11.0  # a chi-squared of one degree of freedom, with probability .999


def stand_in(lengths, channels=1, starts=0, **others):
    """Windows of rows as a problem of so many channels, all measured."""
    rows = int(np.sum(lengths))
    problem = SimpleNamespace(
        windows=tuple(lengths),
        channels=tuple("abc"[:channels]),
        finite=np.ones((rows, channels), dtype=bool),
        counts=np.full(channels, rows),
        offsets=np.r_[0, np.cumsum(lengths)[:-1]],
        window_of_row=np.repeat(np.arange(len(lengths)), lengths),
        start_states=range(starts),
        nuisances=starts * len(lengths),
        pulls=lambda vector, paths: (np.zeros(len(paths)), np.zeros(len(paths))),
    )
    vars(problem).update(others)
    return problem


def correlations(lengths, phi):
    """What a first-order process of a unit's variance correlates within the windows, by its definition."""
    return block_diag(*[phi ** np.abs(np.subtract.outer(np.arange(n), np.arange(n))) for n in lengths])


def likeliest(residual, matrix) -> float:
    """The log-likelihood of Gaussian residuals of these correlations at their likeliest variance; by its definition."""
    variance = residual @ np.linalg.solve(matrix, residual) / len(residual)
    return float(multivariate_normal.logpdf(residual, cov=variance * matrix))


@pytest.mark.parametrize("phi", [(0.0, 0.0), (0.7, 0.0), (0.95, 0.4)])
def test_evidence_is_twice_the_gain_in_the_log_likelihood_of_first_order_processes(phi):
    lengths, rng = (30, 17, 45), np.random.default_rng(0)
    before, after = rng.standard_normal((2, 92, 2)) * np.array([[[1.5]], [[1.0]]])
    matrices = [correlations(lengths, p) for p in phi]
    expected = sum(2.0 * (likeliest(after[:, c], m) - likeliest(before[:, c], m)) for c, m in enumerate(matrices))
    points = [Point(np.zeros(0), np.zeros((3, 0)), residual, 0.0) for residual in (before, after)]
    assert evidence(stand_in(lengths, 2), *points, np.array(phi)) == pytest.approx(expected, rel=1e-6)
    assert expected > 10.0


def test_the_colour_of_a_first_order_process_is_found_although_starts_took_some_of_it():
    lengths, rng, phi, found = (60,) * 40, np.random.default_rng(1), 0.6, {0: [], 2: []}
    time = np.linspace(-1.0, 1.0, 60)
    line = np.stack([np.ones(60), time])
    for _ in range(20):
        white = rng.standard_normal((40, 160))
        slow = lfilter([1.0], [1.0, -phi], white)[:, 100:]
        fitted = slow - np.linalg.lstsq(line.T, slow.T, rcond=None)[0].T @ line
        for starts, rows in ((0, slow), (2, fitted)):
            point = Point(np.zeros(0), np.zeros((40, 0)), rows.reshape(-1, 1), 0.0)
            found[starts].append(colour(stand_in(lengths, 1, starts), point)[0])
    for estimates in found.values():  # 2400 samples: a standard error of 0.016 each; Marriott and Pope to first order
        assert np.mean(estimates) == pytest.approx(phi, abs=0.02)
    white = Point(np.zeros(0), np.zeros((40, 0)), rng.standard_normal((2400, 1)), 0.0)
    assert colour(stand_in(lengths), white)[0] == 0.0


@pytest.mark.parametrize("phi", [0.0, 0.8])
def test_the_covariance_is_that_of_least_squares_on_slow_residuals(phi):
    """Of parameters beside a level and a slope of each window: the exact covariance, from the matrices written out."""
    lengths, rng, variance = (30, 24, 40), np.random.default_rng(2), 0.09
    rows = sum(lengths)
    problem = stand_in(lengths, 1, 2)
    columns = np.cumsum(rng.standard_normal((2, rows)), axis=1)
    local = [np.stack([np.ones(n), np.linspace(-1.0, 1.0, n)]) for n in lengths]
    starts = np.concatenate(local, axis=1)
    every = block_diag(*local)
    rest = columns - np.linalg.lstsq(every.T, columns.T, rcond=None)[0].T @ every
    design, matrix = np.concatenate([columns, every]), correlations(lengths, phi)
    estimator = np.linalg.inv(design @ design.T) @ design
    exact = variance * (estimator @ matrix @ estimator.T)[:2, :2]
    hat = design.T @ estimator
    left = variance * (rows - np.trace(hat @ matrix))  # expected sum of squares of what such a fit leaves
    sigma = np.sqrt(left / rows)
    problem.sigma = lambda point: np.array([sigma])
    linear = Linearisation(rest[:, :, None] / sigma, starts[:, :, None] / sigma, np.zeros(2), np.array([1.0 / sigma]))
    point = Point(np.zeros(0), np.zeros((3, 0)), np.zeros((rows, 1)), 0.0)
    found, freedom = covariance(problem, point, ("a", "b"), linear, np.array([phi]))
    assert np.trace(hat @ matrix) > (8.0 if phi == 0.0 else 30.0) - 1e-9  # what makes the residuals look small
    assert found == pytest.approx(exact, rel=1e-9)
    assert freedom == pytest.approx(rows * (1.0 - phi) - 8.0)


def test_an_interval_of_few_degrees_of_freedom_is_students():
    assert [half_width(n) for n in (3, 10)] == pytest.approx([3.1824, 2.2281], abs=1e-4)  # from tables
