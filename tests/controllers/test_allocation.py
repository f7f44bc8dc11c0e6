"""A wrench shared among thrusters: exact where it can be, optimal at limits, around dead zones, without lost ones."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from controllers.allocation import AXES, Allocation


def frame(seed: int = 0, count: int = 8) -> np.ndarray:
    """The matrix of thrusters at drawn places and in drawn directions, (6, count)."""
    rng = np.random.default_rng(seed)
    direction = rng.standard_normal((3, count))
    direction /= np.linalg.norm(direction, axis=0)
    return np.vstack([direction, np.cross(rng.uniform(-0.3, 0.3, (3, count)), direction, axis=0)])


def thrusters(matrix: np.ndarray, **settings) -> Allocation:
    n = matrix.shape[1]
    return Allocation(matrix, np.full(n, -40.0), np.full(n, 50.0), **settings)


def test_where_nothing_saturates_the_wrench_is_reached_to_rounding():
    for seed in range(20):
        allocation = thrusters(frame(seed))
        wanted = np.random.default_rng(seed).uniform(-1.0, 1.0, 6) * [20, 20, 20, 1, 1, 1]
        shared = allocation.share(wanted)
        if np.abs(allocation.inverse(wanted)).max() <= 40.0:
            assert np.abs(shared.reached - wanted).max() < 1e-12 * np.abs(wanted).max()
            assert shared.exact
            # of all thrusts with this wrench the smallest: they have no part that does nothing
            null = np.linalg.svd(allocation.matrix)[2][6:]
            assert np.abs(null @ shared.thrusts).max() < 1e-12 * np.abs(shared.thrusts).max()


def test_at_its_limits_it_is_as_good_as_the_bounded_least_squares_of_scipy():
    limited = 0
    for seed in range(20):
        matrix = frame(seed)
        allocation = thrusters(matrix)
        wanted = np.random.default_rng(100 + seed).uniform(-1.0, 1.0, 6) * [150, 150, 150, 20, 20, 20]
        shared = allocation.share(wanted)
        limited += not shared.exact
        weights = allocation.weights
        rows = np.vstack([weights[:, None] * matrix, 1e-3 * np.eye(8) / 45.0])
        sides = np.concatenate([weights * wanted, 1e-3 * allocation.inverse(wanted) / 45.0])
        best = lsq_linear(rows, sides, (-40.0, 50.0), method="bvls", tol=1e-14).x
        ours, least = (float(np.sum((rows @ t - sides) ** 2)) for t in (shared.thrusts, best))
        assert ours == pytest.approx(least, rel=1e-9, abs=1e-15)
        assert np.abs(shared.thrusts - best).max() < 1e-4
        assert (shared.thrusts >= -40.0).all()
        assert (shared.thrusts <= 50.0).all()
        assert np.allclose(shared.reached, matrix @ shared.thrusts, atol=0.0)
    assert limited > 10  # else the wrenches were too small to show anything


def test_a_lost_thruster_is_not_used_and_the_others_do_its_work():
    matrix, wanted = frame(3), np.array([10.0, -5.0, 8.0, 0.3, -0.2, 0.4])
    left = np.ones(8)
    left[2] = 0.0
    shared = thrusters(matrix, left=left).share(wanted)
    assert shared.thrusts[2] == 0.0
    assert np.abs(shared.reached - wanted).max() < 1e-11
    unaware = thrusters(matrix).share(wanted).thrusts.copy()
    unaware[2] = 0.0
    assert np.abs(matrix @ unaware - wanted).max() > 0.1


def test_a_partly_lost_thruster_keeps_to_what_it_has_left():
    matrix, left = frame(3), np.ones(8)
    left[2] = 0.25
    allocation = thrusters(matrix, left=left)
    shared = allocation.share(1e3 * matrix[:, 2])  # asks for more of it than it has
    assert shared.thrusts[2] == pytest.approx(12.5)
    assert allocation.commandable(shared.thrusts)[2] == pytest.approx(50.0)  # which takes a full command
    small = allocation.share(np.array([10.0, -5.0, 8.0, 0.3, -0.2, 0.4]))
    assert small.exact
    assert abs(small.thrusts[2]) < abs(thrusters(matrix).share(small.reached).thrusts[2])


def test_thrusts_in_a_dead_zone_become_none_or_those_at_its_edge_as_the_error_has_it():
    rng = np.random.default_rng(5)
    matrix, dead = np.array([[1.0, 0, 0, 0, 0, 0], [0, 1.0, 0, 0, 0, 0]]).T, np.full(2, 2.0)
    allocation = thrusters(matrix, dead_low=-dead, dead_high=dead, counts=("surge_N", "sway_N"))
    assert allocation.share(np.array([0.9, 1.1, 0, 0, 0, 0])).thrusts.tolist() == [0.0, 2.0]
    assert allocation.share(np.array([-1.1, -0.9, 0, 0, 0, 0])).thrusts.tolist() == [-2.0, 0.0]
    assert allocation.share(np.array([3.0, 0.0, 0, 0, 0, 0])).thrusts.tolist() == [3.0, 0.0]
    matrix = frame(7)
    dead = np.full(8, 1.5)
    allocation = thrusters(matrix, dead_low=-dead, dead_high=dead)
    worse = []
    for _ in range(10):
        wanted = rng.uniform(-1.0, 1.0, 6) * [4, 4, 4, 0.5, 0.5, 0.5]
        shared = allocation.share(wanted)
        inside = (np.abs(shared.thrusts) < 1.5 - 1e-6) & (shared.thrusts != 0.0)
        assert not inside.any()
        simple = allocation.inverse(wanted)  # each by itself, without the others making up for it
        nearest = np.where(np.abs(simple) < 0.75, 0.0, np.sign(simple) * 1.5)
        simple = np.where(np.abs(simple) < 1.5, nearest, simple)
        errors = [np.linalg.norm(allocation.weights * (matrix @ t - wanted)) for t in (shared.thrusts, simple)]
        worse.append(errors[0] / max(errors[1], 1e-12))
    assert np.median(worse) < 0.5
    with pytest.raises(ValueError, match=r"finite wrench of shape \(6,\)"):
        allocation.share(np.array([np.nan, 0, 0, 0, 0, 0]))


def test_an_axis_that_does_not_count_does_not_hold_the_others_back():
    matrix = np.array([[1.0, 0.0], [0.0, 1.0], [0, 0], [0, 0], [0.1, 0.0], [0, 0]])  # surge comes with a pitch moment
    wanted = np.array([10.0, 5.0, 0, 0, 0, 0])
    assert np.allclose(thrusters(matrix, counts=("surge_N", "sway_N")).share(wanted).thrusts, [10.0, 5.0])
    assert thrusters(matrix).share(wanted).thrusts[0] < 6.0


@pytest.mark.parametrize(
    "change, words",
    [
        ({"matrix": np.ones((5, 8))}, "matrix of shape"),
        ({"lowest": np.full(8, 1.0)}, "lowest thrusts of at most 0 N"),
        ({"dead_high": np.full(8, 60.0)}, "dead zones around 0 N and within the limits"),
        ({"left": np.full(8, 1.5)}, "shares left between 0"),
        ({"left": np.ones(3)}, "8 numbers as left"),
        ({"counts": ("surge",)}, f"knows the axes {', '.join(AXES)}"),
        ({"axis_weights": -np.ones(6)}, "6 axis_weights of at least 0"),
    ],
)
def test_what_cannot_be_is_refused_with_what_is_needed(change, words):
    settings = {"matrix": frame(), "lowest": np.full(8, -40.0), "highest": np.full(8, 50.0), **change}
    with pytest.raises(ValueError, match=words):
        Allocation(**settings)
