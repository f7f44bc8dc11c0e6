"""Tests of smoothing: the banded solution, the likelihood, and series with and without noise."""

import numpy as np
import pytest

from identification.kernel_machines.hull.smoothing import ORDER, Smoothness, smoothed, smoothness_of


def walk(n: int, rng: np.random.Generator, step: float = 0.01) -> np.ndarray:
    return np.cumsum(np.cumsum(step * rng.standard_normal(n)))


def test_the_estimate_is_that_of_the_whole_matrix():
    y, differences = np.random.default_rng(0).standard_normal(40), np.diff(np.eye(40), ORDER, axis=0)
    expected = np.linalg.solve(np.eye(40) + 7.0 * differences.T @ differences, y)
    assert smoothed(y, Smoothness(7.0, 1.0)) == pytest.approx(expected, abs=1e-12)


def test_the_smoothness_is_of_largest_likelihood():
    rng = np.random.default_rng(1)
    parts = [walk(n, rng) + 0.2 * rng.standard_normal(n) for n in (60, 45)]

    def misfit(ratio: float) -> float:
        """Minus twice the logarithm of the likelihood of the differences, with the variance that suits them best."""
        total, determinant, count = 0.0, 0.0, 0
        for part in parts:
            rows = np.diff(np.eye(part.size), ORDER, axis=0)
            covariance = np.eye(len(rows)) / ratio + rows @ rows.T  # over the variance of the noise
            total += float(rows @ part @ np.linalg.solve(covariance, rows @ part))
            determinant += np.linalg.slogdet(covariance)[1]
            count += len(rows)
        return count * np.log(total / count) + determinant

    found = smoothness_of(parts).ratio
    near = found * np.array([0.5, 0.8, 1.25, 2.0])
    assert all(misfit(found) < misfit(ratio) for ratio in near)


def test_noise_and_smoothness_are_recovered():
    rng = np.random.default_rng(2)
    parts = [walk(400, rng) + 0.3 * rng.standard_normal(400) for _ in range(4)]
    found = smoothness_of(parts)
    assert found.noise == pytest.approx(0.3, rel=0.08)  # 1 600 samples: 2 % each way, and the walk takes some
    assert found.ratio == pytest.approx((0.3 / 0.01) ** 2, rel=0.6)
    assert 3.0 < found.width < 10.0


def test_a_series_without_noise_stays_what_it_is():
    clean = np.sin(0.1 * np.arange(200.0))
    assert smoothed(clean, smoothness_of([clean])) == pytest.approx(clean, abs=1e-6)


@pytest.mark.parametrize("line", [np.zeros(30), np.full(30, 2.5), 0.3 * np.arange(30.0) - 1.0])
def test_a_straight_line_has_no_noise(line):
    found = smoothness_of([line])
    assert found == Smoothness(0.0, 0.0)
    assert np.array_equal(smoothed(line, found), line)
