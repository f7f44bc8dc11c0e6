"""N4SID: known systems found again, their order too, and what it refuses."""

from collections import Counter

import numpy as np
import pytest

from auv_gym.models.files import load_model, save_model
from auv_gym.models.linear import StateSpace
from auv_gym.records.record import Record
from identification.linear.subspaces.n4sid import N4sid
from tests.identification.linear.known_systems import INPUTS, MOVED, OUTPUTS, TRUTH, record_of

OMEGA = np.array([0.02, 0.1, 0.3, 0.7])  # rad/s; Nyquist is at pi / 4 s


def responses_differ(model, truth=TRUTH):
    """Largest relative difference of the frequency responses."""
    wanted = truth.state_space.frequency_response(OMEGA)
    return float(np.abs(model.frequency_response(OMEGA) / wanted - 1.0).max())


@pytest.mark.parametrize("weight", ["cva", "n4sid", "moesp"])
def test_without_noise_the_system_comes_back_to_rounding(weight):
    record = record_of(TRUTH, 600, np.random.default_rng(0), segments=3, start=1.0)
    fit = N4sid(INPUTS, OUTPUTS, weight=weight).fit(record)
    assert fit.order == 5
    # 600 sums of rounding errors, and a pole at 1 that they move
    assert responses_differ(fit.model) < 1e-9
    np.testing.assert_allclose(
        np.sort(np.abs(fit.model.poles())), np.sort(np.abs(TRUTH.state_space.poles())), atol=1e-9
    )
    assert fit.model.dt == 4.0


def test_a_stiff_system_comes_back():
    truth = StateSpace(
        np.diag([0.9999, 0.05]), np.array([[1e-3], [1.0]]), np.array([[1.0, 0.1]]), INPUTS[:1], OUTPUTS[:1], dt=1.0
    )
    fit = N4sid(INPUTS[:1], OUTPUTS[:1], order=2).fit(driven(truth, 500, np.random.default_rng(0)))
    np.testing.assert_allclose(np.sort(fit.model.poles().real), [0.05, 0.9999], atol=1e-8)


def driven(model, n, rng, noise=0.0, level=0.0):
    """A record of a model in innovations form, from rest, with normal innovations of this standard deviation."""
    u = np.repeat(rng.choice([-1.0, 1.0], (n // 2 + 1, len(model.inputs))), 2, axis=0)[:n] + level
    x, y = np.zeros(len(model.a)), np.empty((n, len(model.outputs)))
    for t in range(n):
        e = noise * rng.standard_normal(len(model.outputs))
        y[t] = model.output(x) + e
        x = model.step(x, u[t]) + model.k @ e
    return Record.from_arrays(model.dt * np.arange(n), dict(zip((*model.inputs, *model.outputs), np.hstack([u, y]).T)))


def test_the_operating_point_is_found_beside_an_integrator():
    record = record_of(MOVED, 400, np.random.default_rng(2))
    model = N4sid(INPUTS, OUTPUTS, order=5).fit(record).model
    # an integrator leaves many operating points; all drift alike under the inputs of the true one
    x = model.initial(MOVED.output_offset)
    for _ in range(60):
        x = model.step(x, MOVED.input_offset)
    np.testing.assert_allclose(model.step(x, MOVED.input_offset), x, atol=1e-7)
    assert np.all(np.abs(model.input_offset) < 0.1)


def test_the_order_is_chosen_as_it_is():
    chosen = Counter()
    for seed in range(8):
        record = record_of(TRUTH, 400, np.random.default_rng(seed), noise=0.02)
        fit = N4sid(INPUTS, OUTPUTS).fit(record)
        chosen[fit.order] += 1
    assert chosen[5] >= 7
    assert fit.parameters == 5 * (2 + 2 * 2) - 2  # the pole at 1 of depth, and its drift
    assert fit.singular_values.size >= 5
    assert np.all(np.diff(fit.singular_values) <= 0.0)


def test_stable_moves_poles_into_the_unit_circle():
    truth = StateSpace(np.diag([1.05, 0.5]), np.ones((2, 1)), np.ones((1, 2)), INPUTS[:1], OUTPUTS[:1], dt=1.0)
    record = driven(truth, 80, np.random.default_rng(0), noise=0.02)
    free, kept = (N4sid(INPUTS[:1], OUTPUTS[:1], order=2, stable=stable).fit(record).model for stable in (False, True))
    np.testing.assert_allclose(np.sort(free.poles().real), [0.5, 1.05], atol=0.05)
    assert kept.is_stable()
    steady = record_of(TRUTH, 300, np.random.default_rng(0), noise=0.3)
    free, kept = (N4sid(INPUTS, OUTPUTS, order=5, stable=stable).fit(steady).model for stable in (False, True))
    assert free.is_stable()
    np.testing.assert_array_equal(free.a, kept.a)  # nothing to do


def test_a_fit_says_that_it_has_no_intervals_and_predicts():
    record = record_of(TRUTH, 800, np.random.default_rng(3), noise=0.05)
    fit = N4sid(INPUTS, OUTPUTS, order=5).fit(record)
    assert np.isnan(fit.covariance).all()
    assert all("refine=True" in estimate.problem for estimate in fit.estimates)
    assert fit["pole 1"].value == pytest.approx(1.0, abs=0.01)
    np.testing.assert_allclose(np.sqrt(fit.loss), 0.05, rtol=0.1)  # 2 / sqrt(2 * 800), and what 40 parameters take
    np.testing.assert_allclose(np.sqrt(np.diag(fit.noise)), 0.05, rtol=0.1)
    assert np.abs(np.linalg.eigvals(fit.model.a - fit.model.k @ fit.model.c)).max() < 1.0
    np.testing.assert_allclose(fit.at(fit.vector).a, fit.model.a)
    np.testing.assert_allclose(fit.at(fit.vector).output_offset, fit.model.output_offset, atol=1e-9)
    with pytest.raises(KeyError, match="pole 1"):
        fit["pole 9"]


def test_the_model_is_saved_and_read_back(tmp_path):
    model = N4sid(INPUTS, OUTPUTS, order=5).fit(record_of(TRUTH, 300, np.random.default_rng(0), noise=0.02)).model
    save_model(model, tmp_path / "model.npz")
    again = load_model(tmp_path / "model.npz")
    for name in ("a", "b", "c", "k", "input_offset", "output_offset"):
        np.testing.assert_array_equal(getattr(again, name), getattr(model, name))


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"order": 0}, "order >= 1"),
        ({"order": True}, "order >= 1"),
        ({"horizon": 1}, "horizon >= 2"),
        ({"integrators": -1}, "integrators >= 0"),
        ({"integrators": True}, "integrators >= 0"),
        ({"integrators": 2, "order": 1}, "no more integrators than its order 1"),
        ({"integrators": 3}, "no more integrators than outputs .depth_m, pitch_rad., got 3"),
        ({"integrators": 1, "stable": True}, "integrators and be stable"),
        ({"offset": "mean"}, "offset as true, false or 'auto'"),
        ({"weight": "none"}, "weight of cva"),
        ({"outputs": ()}, "outputs as a list"),
        ({"outputs": INPUTS}, "as input and as output"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        N4sid(**{"inputs": INPUTS, "outputs": OUTPUTS, **settings})


def changed(**channels):
    record = record_of(TRUTH, 300, np.random.default_rng(0), noise=0.02)
    return record.with_channels({name: make(record.time) for name, make in channels.items()})


@pytest.mark.parametrize(
    "record, settings, words",
    [
        (changed(), {"order": 30}, "horizon of 17.* record longer or lower order"),
        (changed(), {"order": 19, "horizon": 10}, "orders up to 18 .* got 19"),
        (changed(), {"horizon": 60}, "horizon of 60.* record longer or lower horizon"),
        (
            changed(bow_plane_rad=np.ones_like),
            {},
            "bow_plane_rad constant .* cannot be told from a drift",
        ),
        (changed(pitch_rad=np.zeros_like), {}, "pitch_rad constant"),
        (
            changed(bow_plane_rad=lambda t: np.sin(0.1 * t), stern_plane_rad=lambda t: np.cos(0.23 * t)),
            {},
            "excite 10 lags, got bow_plane_rad, stern_plane_rad exciting 4 of 2 x 10",
        ),
    ],
)
def test_records_that_cannot_tell_the_model_are_refused(record, settings, words):
    with pytest.raises(ValueError, match=words):
        N4sid(INPUTS, OUTPUTS, **settings).fit(record)


def test_short_records_are_refused():
    with pytest.raises(ValueError, match="record longer"):
        N4sid(INPUTS, OUTPUTS).fit(record_of(TRUTH, 30, np.random.default_rng(0), noise=0.02))
