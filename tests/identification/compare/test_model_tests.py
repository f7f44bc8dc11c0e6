"""Tests of the measures of a fitted model: its poles, residual tests, and its error over time."""

import numpy as np
import pytest

from auv_gym.models.linear import StateSpace
from auv_gym.records.record import Record
from identification.compare.model_tests import over_time, poles_of, residual_tests


def test_poles_of_a_known_system():
    dt, rotation = 0.5, 0.3
    turn = np.exp(-0.2 * dt) * np.array([[np.cos(rotation), np.sin(rotation)], [-np.sin(rotation), np.cos(rotation)]])
    a = np.zeros((4, 4))
    a[:2, :2], a[2, 2] = turn, 1.0
    model = StateSpace(a, np.ones((4, 1)), np.ones((1, 4)), ("rudder_rad",), ("heading_rad",), dt)
    np.testing.assert_allclose(poles_of(model), [(0.0, 0.0), (-0.2, rotation / dt), (-0.2, -rotation / dt)], atol=1e-9)


def test_residual_tests_tell_a_lacking_response_from_noise():
    rng, n = np.random.default_rng(1), 600
    u, e = rng.standard_normal(n), 0.1 * rng.standard_normal(n)
    model = StateSpace(
        np.array([[0.5]]), np.array([[1.0]]), np.array([[1.0]]), ("stern_plane_rad",), ("depth_m",), 1.0,
        k=np.array([[0.5]]),
    )  # fmt: skip
    x = np.zeros(n + 1)
    for k in range(n):
        x[k + 1] = 0.5 * x[k] + u[k] + 0.5 * e[k]
    true = Record.from_arrays(np.arange(n), {"stern_plane_rad": u, "depth_m": x[:n] + e})
    test = residual_tests(model, [true])["depth_m"]
    assert test["ahead"]
    assert test["rms"] == pytest.approx(0.1, rel=0.1)
    assert test["p_value"] > 0.01
    lags, ties = (
        np.array(test["inputs"]["stern_plane_rad"]["lags_s"]),
        np.abs(test["inputs"]["stern_plane_rad"]["correlation"]),
    )
    assert ties.max() < 3.0 * test["inputs"]["stern_plane_rad"]["bound"]
    late = true.with_channels({"depth_m": true["depth_m"] + 0.2 * np.r_[0.0, 0.0, 0.0, u[:-3]]})
    ties = np.abs(residual_tests(model, [late])["depth_m"]["inputs"]["stern_plane_rad"]["correlation"])
    assert lags[np.argmax(ties)] == 3.0


def test_errors_over_time_are_root_mean_squares_of_equal_spans():
    elapsed = np.arange(0.0, 100.0)
    curve = over_time(elapsed, np.where(elapsed < 50.0, 3.0, 4.0), 2.0)
    assert len(curve["time_s"]) == 50
    assert np.all(np.diff(curve["time_s"]) > 0.0)
    np.testing.assert_allclose(curve["percent"], [150.0] * 25 + [200.0] * 25)
