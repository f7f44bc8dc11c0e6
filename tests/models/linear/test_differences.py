"""Differences of an integrating output: exact where the pole is at 1, and refused where there is none to cancel."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.model import simulate
from auv_gym.models.linear import Polynomial
from auv_gym.models.linear.differences import differenced, rate_of, with_differences
from auv_gym.records.record import Record

INPUTS = ("bow_plane_rad", "stern_plane_rad")
DT = 4.0
RATE = np.array([1.0, -1.2, 0.45])  # A of the depth's rate


def model(pole: float = 1.0) -> Polynomial:
    """Depth with a pole at or near 1, and pitch."""
    depth = np.convolve([1.0, -pole], RATE).tolist()
    return Polynomial.from_coefficients(
        {"depth_m": depth[1:], "pitch_rad": [-0.8, 0.1]},
        {
            "depth_m": {"bow_plane_rad": [0.3, -0.1], "stern_plane_rad": [1.2, 0.4]},
            "pitch_rad": {"bow_plane_rad": [0.2], "stern_plane_rad": [-0.5, 0.1]},
        },
        DT,
        c={"depth_m": [0.4], "pitch_rad": [-0.2]},
        inputs=INPUTS,
    )


def record(segments: int = 1) -> Record:
    rng = np.random.default_rng(3)
    n = 60 * segments
    columns = {name: 0.1 * rng.standard_normal(n) for name in INPUTS}
    columns |= {"depth_m": np.full(n, 50.0), "pitch_rad": np.zeros(n)}
    return Record.from_arrays(DT * np.arange(n), columns, np.repeat(np.arange(segments), 60))


def test_the_rate_of_a_free_run_is_the_free_run_of_the_rate():
    """Two segments, inputs off their zero: from where all lags lie in the segment, the two agree to rounding."""
    moved = replace(model(), input_offset=np.array([0.02, -0.01]), output_offset=np.array([50.0, 0.03]))
    run = with_differences(simulate(moved, record(2)), "depth_m")
    rate = differenced(moved, "depth_m")
    assert rate.outputs == ("depth_rate_mps", "pitch_rad")
    for part in run.segments:
        y, u = run["depth_rate_mps"][part], run.matrix(INPUTS)[part] - moved.input_offset
        assert np.isnan(y[0])
        for t in range(3, y.size):
            past = sum(rate.b[k, 0] @ u[t - k] - rate.a[k, 0, 0] * y[t - k] for k in range(1, 3))
            assert y[t] == pytest.approx(past, abs=1e-10)
    free = simulate(rate, run)
    np.testing.assert_allclose(free["pitch_rad"], simulate(moved, record(2))["pitch_rad"], atol=1e-12)


def test_only_the_pole_at_one_is_cancelled():
    whole, rate = model(), differenced(model(), "depth_m")
    np.testing.assert_allclose(rate.a[:, 0, 0], [*RATE, 0.0], atol=1e-14)
    np.testing.assert_allclose(rate.a[:, 1, 1], whole.a[:, 1, 1], atol=0.0)
    np.testing.assert_allclose(DT * rate.b[:, 0], whole.b[:, 0], atol=1e-15)
    np.testing.assert_array_equal(rate.c, whole.c)
    omega = np.array([0.01, 0.1, 0.5])
    difference = (1.0 - np.exp(-1j * omega * DT)) / DT
    expected = difference[:, None] * whole.state_space.frequency_response(omega)[:, 0]
    np.testing.assert_allclose(rate.state_space.frequency_response(omega)[:, 0], expected, rtol=1e-10)


def test_the_published_depth_equation_has_its_pole_at_one():
    """Table 2 of Geng and Zhao 2012, to its three digits."""
    published = Polynomial.from_coefficients(
        {"depth_m": [-2.950, 2.903, -0.953]},
        {"depth_m": {"bow_plane_rad": [-0.00166, 0.00153], "stern_plane_rad": [-0.000438]}},
        DT,
    )
    np.testing.assert_allclose(differenced(published, "depth_m").a[:, 0, 0], [1.0, -1.950, 0.953, 0.0], atol=5e-4)


@pytest.mark.parametrize("pole", [0.985, 1.03])
def test_a_pole_near_one_is_taken_to_be_there(pole):
    np.testing.assert_allclose(differenced(model(pole), "depth_m").a[:, 0, 0], [*RATE, 0.0], atol=1e-12)


def test_two_equal_poles_leave_one():
    """numpy finds two equal poles as a pair with imaginary parts of 1e-8."""
    twice = Polynomial.from_coefficients({"depth_m": [-2.0, 1.0]}, {"depth_m": {"bow_plane_rad": [1.0]}}, DT)
    np.testing.assert_allclose(differenced(twice, "depth_m").a[:, 0, 0], [1.0, -1.0, 0.0], atol=1e-7)


def test_differences_are_per_second_and_stay_in_their_segment():
    time = np.array([0.0, 1.0, 3.0, 10.0, 12.0])
    given = Record.from_arrays(time, {"depth_m": [1.0, 2.0, 6.0, 0.0, -1.0]}, [0, 0, 0, 1, 1])
    np.testing.assert_allclose(with_differences(given, "depth_m")["depth_rate_mps"], [np.nan, 1.0, 2.0, np.nan, -0.5])
    assert rate_of("pitch_rad") == "pitch_rate_radps"
    with pytest.raises(ValueError, match="kgps"):
        rate_of("mass_kg")


def test_what_cannot_be_cancelled_is_refused():
    with pytest.raises(ValueError, match=r"within 0\.1 of 1 to cancel, got the nearest at 0\.85"):
        differenced(model(0.85), "depth_m")
    assert differenced(model(0.85), "depth_m", within=0.2).outputs[0] == "depth_rate_mps"
    still = Polynomial.from_coefficients({"depth_m": RATE[1:].tolist()}, {"depth_m": {"bow_plane_rad": [1.0]}}, DT)
    with pytest.raises(ValueError, match="got none that is real"):
        differenced(still, "depth_m")
    with pytest.raises(ValueError, match="an output of the model, depth_m, pitch_rad, got 'u_mps'"):
        differenced(model(), "u_mps")
    a = model().a.copy()
    a[1, 1, 0] = 0.1
    coupled = Polynomial(a, model().b, INPUTS, model().outputs, DT)
    with pytest.raises(ValueError, match="depth_m in an equation of its own"):
        differenced(coupled, "depth_m")
