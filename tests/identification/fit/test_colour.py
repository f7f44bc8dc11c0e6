"""Tests of the colour of residuals, allowing for fitted starts, and of whitened residuals."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.signal import lfilter

from identification.fit.colour import colour, whitened
from identification.fit.shooting import Point


def stand_in(lengths, channels=1, starts=0):
    """Windows of rows as a problem whose channels are all measured."""
    rows = int(np.sum(lengths))
    return SimpleNamespace(
        windows=tuple(lengths),
        channels=tuple("abc"[:channels]),
        finite=np.ones((rows, channels), dtype=bool),
        counts=np.full(channels, rows),
        offsets=np.r_[0, np.cumsum(lengths)[:-1]],
        window_of_row=np.repeat(np.arange(len(lengths)), lengths),
        start_states=range(starts),
    )


def point(windows, residual):
    return Point(np.zeros(0), np.zeros((windows, 0)), residual, 0.0)


def test_the_colour_of_a_first_order_process_is_found_although_starts_took_some_of_it():
    lengths, rng, phi, found = (60,) * 40, np.random.default_rng(1), 0.6, {0: [], 2: []}
    time = np.linspace(-1.0, 1.0, 60)
    line = np.stack([np.ones(60), time])
    for _ in range(20):
        white = rng.standard_normal((40, 160))
        slow = lfilter([1.0], [1.0, -phi], white)[:, 100:]
        fitted = slow - np.linalg.lstsq(line.T, slow.T, rcond=None)[0].T @ line
        for starts, rows in ((0, slow), (2, fitted)):
            found[starts].append(colour(stand_in(lengths, 1, starts), point(40, rows.reshape(-1, 1)))[0])
    for estimates in found.values():  # 2400 samples: a standard error of 0.016 each; Marriott and Pope to first order
        assert np.mean(estimates) == pytest.approx(phi, abs=0.02)
    assert colour(stand_in(lengths), point(40, rng.standard_normal((2400, 1))))[0] == 0.0


@pytest.mark.parametrize("phi", [(0.0, 0.0), (0.7, 0.0), (0.95, 0.4)])
def test_squares_of_whitened_residuals_are_those_of_the_correlations_written_out(phi):
    """A first-order process of unit variance has correlations phi^|i - j| within windows, and none between them."""
    lengths, values = (30, 17, 45), np.random.default_rng(0).standard_normal((92, 2))
    found = whitened(stand_in(lengths, 2), values, np.array(phi))
    for c, p in enumerate(phi):
        matrix = block_diag(*[p ** np.abs(np.subtract.outer(np.arange(n), np.arange(n))) for n in lengths])
        expected = (1.0 - p**2) * values[:, c] @ np.linalg.solve(matrix, values[:, c])
        assert found[:, c] @ found[:, c] == pytest.approx(expected, rel=1e-9)
    assert np.array_equal(whitened(stand_in(lengths, 2), values, np.zeros(2)), values)
