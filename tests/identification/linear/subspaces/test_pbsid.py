"""PBSID: as N4SID in open loop, and unbiased where N4SID is not, in closed loop about an unstable plant."""

import numpy as np
import pytest

from auv_gym.models.linear import StateSpace
from auv_gym.records.record import Record
from identification.linear.subspaces.n4sid import N4sid
from identification.linear.subspaces.pbsid import Pbsid
from tests.identification.linear.known_systems import INPUTS, OUTPUTS, TRUTH, record_of

# a heading that runs away by itself, with coloured noise
UNSTABLE = StateSpace(
    a=np.array([[1.05, 0.1], [0.0, 0.8]]),
    b=np.array([[0.0], [0.5]]),
    c=np.array([[1.0, 0.0]]),
    k=np.array([[0.6], [0.2]]),
    inputs=("rudder_rad",),
    outputs=("heading_rad",),
    dt=1.0,
)
CHANNELS = (("rudder_rad",), ("heading_rad",))


def closed_loop(n, rng, noise=0.1):
    """A record of the unstable plant under a controller that keeps it upright, with steps added to its rudder."""
    x, y, u, last = np.zeros(2), np.empty(n), np.empty(n), 0.0
    added = np.repeat(rng.choice([-0.3, 0.3], n // 3 + 1), 3)[:n]
    for t in range(n):
        e = noise * rng.standard_normal(1)
        y[t] = (UNSTABLE.output(x) + e)[0]
        u[t] = -1.2 * y[t] + 0.9 * last + added[t]
        x, last = UNSTABLE.step(x, u[t : t + 1]) + UNSTABLE.k @ e, y[t]
    return Record.from_arrays(np.arange(n, dtype=float), {"rudder_rad": u, "heading_rad": y})


def test_without_noise_the_system_comes_back_to_rounding():
    record = record_of(TRUTH, 600, np.random.default_rng(0), segments=3, start=1.0)
    fit = Pbsid(INPUTS, OUTPUTS).fit(record)
    assert fit.order == 5
    omega = np.array([0.02, 0.1, 0.3, 0.7])
    wanted = TRUTH.state_space.frequency_response(omega)
    assert np.abs(fit.model.frequency_response(omega) / wanted - 1.0).max() < 1e-9


def test_an_unstable_plant_comes_back_from_its_loop():
    fit = Pbsid(*CHANNELS, order=2).fit(closed_loop(200, np.random.default_rng(0), noise=0.0))
    np.testing.assert_allclose(np.sort(fit.model.poles().real), [0.8, 1.05], atol=1e-8)
    assert np.abs(np.linalg.eigvals(fit.model.a - fit.model.k @ fit.model.c)).max() < 1.0


def test_in_closed_loop_it_has_no_bias_and_n4sid_has():
    at = np.array([0.5])
    true = UNSTABLE.frequency_response(at)[0, 0, 0]
    errors = {Pbsid: [], N4sid: []}
    for seed in range(12):
        record = closed_loop(1000, np.random.default_rng(seed))
        for method, found in errors.items():
            model = method(*CHANNELS, order=2).fit(record).model
            found.append(model.frequency_response(at)[0, 0, 0] / true - 1.0)
    biased, free = np.array(errors[N4sid]), np.array(errors[Pbsid])
    scatter = np.std(free) / np.sqrt(len(free))
    assert abs(free.mean()) < 4.0 * scatter + 0.03  # what a finite horizon leaves is a share of the scatter of one fit
    assert abs(biased.mean()) > 1.0
    assert abs(biased.mean()) > 10.0 * abs(free.mean())


def test_the_order_is_chosen_as_it_is():
    orders = [Pbsid(*CHANNELS).fit(closed_loop(600, np.random.default_rng(seed))).order for seed in range(8)]
    assert orders.count(2) >= 7
    orders = [
        Pbsid(INPUTS, OUTPUTS).fit(record_of(TRUTH, 400, np.random.default_rng(seed), noise=0.02)).order
        for seed in range(8)
    ]
    assert orders.count(5) >= 7


def test_stable_reflects_what_is_truly_unstable():
    fit = Pbsid(*CHANNELS, order=2, stable=True).fit(closed_loop(1000, np.random.default_rng(0)))
    assert fit.model.is_stable()


@pytest.mark.parametrize(
    "make, settings, words",
    [
        (lambda: closed_loop(30, np.random.default_rng(0)), {"horizon": 20}, "record longer or lower horizon"),
        (lambda: closed_loop(8, np.random.default_rng(0)), {}, "record longer"),
        (lambda: closed_loop(300, np.random.default_rng(0)), {"order": 40, "horizon": 10}, "orders up to 9 .* got 40"),
    ],
)
def test_records_that_cannot_tell_the_model_are_refused(make, settings, words):
    with pytest.raises(ValueError, match=words):
        Pbsid(*CHANNELS, **settings).fit(make())


def test_inputs_that_excite_too_few_lags_are_refused():
    record = closed_loop(300, np.random.default_rng(0))
    record = record.with_channels({"rudder_rad": np.sin(0.3 * record.time)})
    with pytest.raises(ValueError, match=r"excite 10 lags, got rudder_rad exciting 2 of 1 x 10"):
        Pbsid(*CHANNELS, horizon=10).fit(record)
