"""The long predictor: poles at 1 are found where they are and nowhere else, and the horizon follows the memory."""

import numpy as np
import pytest

from auv_gym.models.linear import StateSpace
from auv_gym.records.record import Record
from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from identification.linear.subspaces.hankel import triangle
from identification.linear.subspaces.long_predictor import LONGEST, SHORTEST, LongPredictor, most_predictor_lags
from tests.identification.linear.known_systems import TRUTH

CHANNELS = (("rudder_rad",), ("heading_rad",))
TWO = (("rudder_rad", "stern_plane_rad"), ("heading_rad", "depth_m"))


def heading(pole, k=(0.0, 0.0)):
    """A heading that forgets with a pole, behind a lag of 0.7; k: how its errors enter the states."""
    a, b, c = np.array([[pole, 0.6], [0.0, 0.7]]), np.array([[0.2], [0.3]]), np.array([[1.0, 0.0]])
    return StateSpace(a, b, c, *CHANNELS, dt=1.0, k=np.array(k)[:, None])


def both(first, second):
    """Heading and depth, each the answer of a model to an input of its own."""
    zero = np.zeros((2, 2))
    a, c = np.block([[first.a, zero], [zero, second.a]]), np.zeros((2, 4))
    b, k = np.zeros((4, 2)), np.zeros((4, 2))
    for i, part in enumerate((first, second)):
        b[2 * i : 2 * i + 2, i], c[i, 2 * i : 2 * i + 2], k[2 * i : 2 * i + 2, i] = (
            part.b[:, 0],
            part.c[0],
            part.k[:, 0],
        )
    return StateSpace(a, b, c, *TWO, dt=1.0, k=k)


def driven(model, n, seed, noise, drift=0.0):
    """A record of a model driven by steps: errors of `noise` of the spread of the outputs' changes, and a drift."""
    rng = np.random.default_rng(seed)
    u = np.stack([np.repeat(rng.choice([-0.3, 0.3], n // hold + 1), hold)[:n] for hold in (4, 6)], axis=1)
    u = u[:, : len(model.inputs)]
    x, clean = np.zeros(len(model.a)), np.empty((n, len(model.outputs)))
    for t in range(n):
        clean[t], x = model.output(x), model.step(x, u[t])
    e = noise * np.diff(clean, axis=0).std(axis=0) * rng.standard_normal(clean.shape)
    x, y = np.zeros(len(model.a)), np.empty_like(clean)
    for t in range(n):
        y[t], x = model.output(x) + e[t], model.step(x, u[t]) + model.k @ e[t]
    y += drift * np.arange(n)[:, None]
    columns = dict(zip((*model.inputs, *model.outputs), np.hstack([u, y]).T))
    return Record.from_arrays(model.dt * np.arange(n), columns)


def predictor_of(record, model, lags=None, offset=True):
    scaled = Scaled.of(Series.of([record], model.inputs, model.outputs, "test"), offset, "test")
    if lags:
        return LongPredictor.of(scaled, lags)
    found = LongPredictor.of(scaled, LONGEST)
    return found.shortened(found.horizon(2))


SLOW = heading(0.98)
SUM = heading(1.0)
WALK = heading(1.0, k=(0.5, 0.2))  # currents add to it, which no later sample takes back
SYSTEMS = {
    "slow": (SLOW, 0),
    "slow, coloured noise": (heading(0.98, k=(0.5, 0.2)), 0),
    "integrating": (SUM, 1),
    "walking": (WALK, 1),
    "two slow": (both(SLOW, SLOW), 0),
    "one of two integrating": (both(SLOW, SUM), 1),
    "both integrating": (both(SUM, WALK), 2),
    "depth and pitch": (TRUTH.state_space, 1),
}


@pytest.mark.parametrize("noise", [0.05, 0.5])
@pytest.mark.parametrize("system", SYSTEMS)
def test_poles_at_1_are_counted(system, noise):
    model, there = SYSTEMS[system]
    found = [predictor_of(driven(model, 500, seed, noise), model).integrators for seed in range(6)]
    assert found.count(there) >= 5, found


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("n", [300, 1000])
@pytest.mark.parametrize("system", SYSTEMS)
def test_poles_at_1_are_counted_as_often_as_bic_allows(system, noise, n):
    """BIC lets a chi square of one degree pass log N, at most 1.7 % an output here.

    A pole of 0.98 that noise as large as the signal's changes keeps moving looks like a random walk over 300 samples.
    """
    model, there = SYSTEMS[system]
    found = [predictor_of(driven(model, n, seed, noise), model).integrators for seed in range(100)]
    if noise < 1.0:
        assert found.count(there) >= 90, np.bincount(found)
    if noise < 1.0 or there or n > 300:
        assert sum(count > there for count in found) <= 3, np.bincount(found)


@pytest.mark.parametrize("system", ["integrating", "walking"])
def test_a_drift_hides_no_integrator(system):
    model, there = SYSTEMS[system]
    drift = 0.1 * np.diff(driven(model, 500, 0, 0.0).matrix(model.outputs)[:, 0]).std()
    found = [predictor_of(driven(model, 500, seed, 0.1, drift), model).integrators for seed in range(3)]
    assert found.count(there) >= 2


@pytest.mark.parametrize("model", [SLOW, SUM], ids=["slow", "integrating"])
def test_without_noise_no_pole_is_fixed(model):
    assert predictor_of(driven(model, 300, 0, 0.0), model, lags=10).integrators == 0


def test_an_output_about_zero_has_no_intercept():
    model = SUM
    with_it, without = (predictor_of(driven(model, 300, 1, 0.3), model, 8, offset) for offset in (True, False))
    assert with_it.integrators == without.integrators == 1


def test_the_horizon_follows_the_memory_of_the_noise():
    fast, slow = (heading(0.98, k=k) for k in ((0.98, 0.0), (0.0, 0.0)))
    short, long = (predictor_of(driven(model, 1000, 0, 0.5), model).lags for model in (fast, slow))
    assert SHORTEST <= short < long <= LONGEST


def test_the_horizon_of_a_short_record_leaves_samples_to_fit():
    model = heading(0.98)
    record = driven(model, 60, 0, 0.5)
    found = predictor_of(record, model, lags=20)
    # 40 numbers of 40 rows: AIC as it is takes them all, as it then expects no error
    assert found.horizon(2) <= 14
    assert found.horizon(16) == 16
    assert found.horizon(25) == 20


def test_fewer_lags_are_the_same_regression():
    record, model = driven(WALK, 200, 0, 0.3), WALK
    long = predictor_of(record, model, lags=12)
    short = long.shortened(5)
    scaled = long.scaled
    rows = [part[7:] for part in scaled.joint]  # those that have all 12 lags, 5 of them looked at
    at = np.arange(12).reshape(6, 2)
    direct = triangle(rows, 6, np.concatenate([at[4::-1].ravel(), at[-1, -1:]]))
    np.testing.assert_allclose(short.factor.T @ short.factor, direct.T @ direct, rtol=1e-9, atol=1e-9 * 200)
    assert (short.lags, short.rows) == (5, long.rows)


def test_short_records_are_tried_with_few_lags():
    series = Series.of([driven(SLOW, 150, 0, 0.1)], SLOW.inputs, SLOW.outputs, "test")
    assert most_predictor_lags(series, 2) == (146 - LONGEST) // 12
    assert most_predictor_lags(Series.of([driven(SLOW, 40, 0, 0.1)], *CHANNELS, "test"), 2) == SHORTEST
