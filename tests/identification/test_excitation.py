import numpy as np
import pytest

from identification.excitation import prbs, set_point_steps, slow_variation


def test_prbs_has_two_levels_and_holds_them():
    signal = prbs(1000, 4, 0.3, np.random.default_rng(0))
    edges = np.flatnonzero(np.diff(signal))
    assert signal.shape == (1000,)
    assert set(signal) == {-0.3, 0.3}
    assert (np.diff(edges) % 4 == 0).all()
    assert np.diff(edges).min() == 4


def test_prbs_of_a_whole_period_is_white():
    """The circular correlation of a maximum-length sequence is -1 at every lag but zero."""
    signal = prbs(63, 1, 1.0, np.random.default_rng(3))
    correlation = [float(signal @ np.roll(signal, lag)) for lag in range(63)]
    assert correlation == [63.0] + [-1.0] * 62


@pytest.mark.parametrize("n", [1, 2, 3, 7, 8, 100])
@pytest.mark.parametrize("hold", [1, 3, 50])
def test_prbs_has_the_length_asked_for_from_any_phase(n, hold):
    signals = [prbs(n, hold, 1.0, np.random.default_rng(seed)) for seed in range(30)]
    assert all(signal.shape == (n,) and set(signal) <= {-1.0, 1.0} for signal in signals)
    assert len({signal.tobytes() for signal in signals}) > 1


def test_prbs_depends_on_the_generator_only():
    one, two = (prbs(50, 2, 1.0, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("n, hold", [(0, 1), (5, 0)])
def test_prbs_refuses_what_it_cannot_make(n, hold):
    with pytest.raises(ValueError, match="n >= 1 and hold >= 1"):
        prbs(n, hold, 1.0, np.random.default_rng(0))


def test_set_points_step_by_the_stated_sizes_at_the_stated_times():
    time = np.arange(0.0, 50_000.0, 1.0)
    values = set_point_steps(time, np.random.default_rng(1), start=0.5, hold=(40.0, 90.0), step=(0.3, 1.2))
    changes = np.flatnonzero(np.diff(values))
    sizes, holds = np.abs(np.diff(values)[changes]), np.diff(time[changes])
    assert values[0] == 0.5
    assert 0.3 - 1e-9 <= sizes.min() < 0.32
    assert 1.18 < sizes.max() <= 1.2 + 1e-9
    assert holds.min() >= 39.0
    assert holds.max() <= 91.0
    assert 0.4 < np.mean(np.diff(values)[changes] > 0.0) < 0.6
    with pytest.raises(ValueError, match="hold"):
        set_point_steps(time, np.random.default_rng(1), hold=(0.0, 10.0))


def test_slow_variation_keeps_its_bound_and_its_pace():
    time = np.arange(0.0, 2000.0, 1.0)
    signal = slow_variation(time, np.random.default_rng(2), amplitude=0.09, periods=(60.0, 200.0))
    assert np.abs(signal).max() == pytest.approx(0.09)
    assert abs(signal.mean()) < 0.02
    assert np.abs(np.diff(signal)).max() < 3.0 * 0.09 * 2.0 * np.pi / 60.0  # peaks are scaled up by less than three
