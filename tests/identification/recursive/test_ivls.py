"""IVLS as printed: equations (31) to (34) to the digit, exact without noise, and failing with it."""

import numpy as np
import pytest
from dives_by_equation import THETA, dive_log

from auv_gym.records.record import Record
from identification.recursive.ivls import Ivls


def printed(record: Record, lag: int, share: float, spread: float) -> np.ndarray:
    """theta after each sample of an even record, by the formulas as they stand in the paper."""
    z, x, h = record["depth_m"], np.r_[record["piston_m"][:1], record["piston_m"][:-1]], record.time[1]
    theta, matrix = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), spread**2 * np.eye(6)
    found, followed, xi = np.tile(theta, (z.size, 1)), np.tile(theta, (z.size, 1)), z.copy()

    def at(j: int) -> int:
        return max(j, 1)

    for k in range(2, z.size):
        square = abs(x[k]) * x[k]
        i = np.array(
            [2 * z[k - 1] - z[k - 2], -h * (z[k - 1] - z[k - 2]), -(h**2), h * (x[k] - x[k - 1]), h**2 * square, 0.0]
        )
        i[5] = h**2 * x[k]
        late, first, second = x[at(k - lag)], x[at(k - lag - 1)], x[at(k - lag - 2)]
        star = np.array([2 * xi[k - 1] - xi[k - 2], -h * (xi[k - 1] - xi[k - 2]), -(h**2), 0.0, 0.0, h**2 * late])
        star[3], star[4] = h * (first - second), h**2 * abs(late) * late
        followed[k] = (1 - share) * followed[at(k - lag)] + share * found[at(k - lag)]
        xi[k] = star @ followed[k]
        gain = matrix @ star / (1.0 + i @ matrix @ star)
        theta = theta + gain * (z[k] - i @ theta)
        matrix = matrix - np.outer(gain, i @ matrix)
        found[k] = theta
    return found


@pytest.mark.parametrize("lag, share", [(4, 0.0005), (1, 0.05)])
def test_it_is_what_is_printed(lag, share):
    record = dive_log(300, 0.02, np.random.default_rng(0), near=0.7)
    fit = Ivls(lag=lag, share=share, spread=1.0).fit(record)
    assert np.ptp(np.diff(record.time)) < 1e-9
    assert fit.history is not None
    assert fit.history[2:] == pytest.approx(printed(record, lag, share, 1.0)[2:], rel=1e-6, abs=1e-9)


def test_data_without_noise_give_the_exact_parameters():
    fit = Ivls().fit(dive_log(3000, 0.0, np.random.default_rng(0)))
    assert fit.theta == pytest.approx(THETA, abs=1e-6)


def damping_of(seed: int) -> float:
    """D/M, 1/s, of a dive with 0.02 m of noise; NaN where the recursion leaves the finite numbers."""
    try:
        return Ivls().fit(dive_log(2000, 0.02, np.random.default_rng(seed)))["damping"].value
    except ValueError:
        return np.nan


def test_with_noise_the_damping_is_lost():
    found = np.array([damping_of(seed) for seed in range(10)])
    near = np.abs(found / THETA[1] - 1.0) < 0.5
    assert near.sum() <= 2


def test_a_recursion_that_leaves_the_finite_numbers_says_what_to_do():
    record = dive_log(600, 0.0, np.random.default_rng(0))
    with pytest.raises(ValueError, match="left the finite numbers after"):
        Ivls(initial=(3.0, 0.0, 0.0, 0.0, 0.0, 0.0), share=0.0).fit(record)


def test_sample_by_sample_is_the_fit():
    record = dive_log(200, 0.01, np.random.default_rng(3))
    estimator = Ivls(spread=1.0)
    memory = estimator.update(estimator.start(), record["depth_m"][0], record["piston_m"][0], 0.0)
    for k in range(1, len(record)):
        h = record.time[k] - record.time[k - 1]
        memory = estimator.update(memory, record["depth_m"][k], record["piston_m"][k - 1], h)
    assert np.array_equal(memory.theta, estimator.fit(record).theta)


@pytest.mark.parametrize("settings, words", [({"share": 2.0}, "share"), ({"lag": 0}, "lag"), ({"lag": 40}, "lag")])
def test_settings_that_cannot_be_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        Ivls(**settings)
