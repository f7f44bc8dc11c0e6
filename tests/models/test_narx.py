"""The nonlinear black box as a model: its equation, its lags, its free runs, what lies outside."""

from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest

from auv_gym.model import Diverged, predict, simulate
from auv_gym.models.files import load_model, save_model
from auv_gym.models.lags import Lags
from auv_gym.models.linear import Polynomial
from auv_gym.models.narx import Narx
from auv_gym.records.record import Record

INPUTS, OUTPUTS, DT = ("rudder_rad", "stern_plane_rad"), ("heading_rad", "pitch_rad"), 0.5


def model(n_a=3, n_b=2, delay=2, integrating: tuple[str, ...] = ("heading_rad",), **changed) -> Narx:
    rng, centres = np.random.default_rng(0), 150
    lags = Lags(INPUTS, OUTPUTS, n_a, n_b, delay, integrating)
    d = len(lags.matrix)
    given = {
        "support": rng.normal(size=(centres, d)),
        "middle": 0.3 * rng.normal(size=d),
        "spread": 0.5 + rng.random(d),
        "sigma": np.array([1.0, 2.5]),
        "coefficients": 0.02 * rng.normal(size=(2, centres, 2)),
        "slopes": 0.1 * rng.normal(size=(d, 2)),
        "bias": np.array([0.01, 0.2]),
        "rest": np.array([0.5, 0.1, 0.0, -0.2]),
        "sway": np.ones(4),
        "reach": 1.5,
        **changed,
    }
    return Narx(INPUTS, OUTPUTS, DT, n_a, n_b, delay, integrating, **given)


def record(samples=60, seed=1) -> Record:
    rng = np.random.default_rng(seed)
    signals = 0.4 * rng.standard_normal((4, samples)).cumsum(axis=1) / np.sqrt(np.arange(1, samples + 1))
    return Record.from_arrays(DT * np.arange(samples), dict(zip((*INPUTS, *OUTPUTS), signals)))


def ahead(model: Narx, record: Record) -> np.ndarray:
    """The outputs one sample after each row that has its lags, straight from the equation."""
    u, y = record.matrix(INPUTS), record.matrix(OUTPUTS)
    rows = []
    for t in range(4, len(y)):
        z: list[float] = []
        for i, name in enumerate(OUTPUTS):
            past = [y[t - k, i] for k in range(model.n_a)]
            z += [a - b for a, b in pairwise(past)] if name in model.integrating else past
        for j in range(2):
            z += [u[t + 1 - model.delay - k, j] for k in range(model.n_b)]
        at = np.array(z)
        f = model.bias + model.slopes.T @ (at - model.middle)
        for sigma, coefficients in zip(model.sigma, model.coefficients):
            f += np.exp(-np.sum(((at - model.support) / model.spread / sigma) ** 2, axis=1)) @ coefficients
        rows.append(f + np.array([name in model.integrating for name in OUTPUTS]) * y[t])
    return np.array(rows)


@pytest.mark.parametrize("n_a, n_b, delay", [(3, 2, 2), (1, 1, 1), (2, 3, 1), (4, 1, 2)])
@pytest.mark.parametrize("integrating", [(), ("heading_rad",), ("heading_rad", "pitch_rad")])
def test_free_runs_and_predictions_are_the_equation(n_a, n_b, delay, integrating):
    made = model(n_a, n_b, delay, integrating)
    free = simulate(made, record())
    np.testing.assert_allclose(free.matrix(OUTPUTS)[5:], ahead(made, free)[:-1], rtol=1e-10, atol=1e-12)
    measured = record(seed=2)
    predicted = predict(made, measured).matrix(OUTPUTS)
    np.testing.assert_allclose(predicted[5:], ahead(made, measured)[:-1], rtol=1e-10, atol=1e-12)


def test_without_bells_it_is_the_linear_model_of_its_slopes():
    linear = Polynomial.from_coefficients(
        {"pitch_rad": [-1.5, 0.6]}, {"pitch_rad": {"stern_plane_rad": [0.1, -0.03]}}, DT, delay=2
    )
    narx = Narx(
        ("stern_plane_rad",), ("pitch_rad",), DT, 2, 2, 2, (), support=np.zeros((1, 4)), middle=np.zeros(4),
        spread=np.ones(4), sigma=np.zeros(0), coefficients=np.zeros((0, 1, 1)),
        slopes=np.array([[1.5], [-0.6], [0.1], [-0.03]]), bias=np.zeros(1), rest=np.zeros(2),
        sway=np.ones(2), reach=1.0,
    )  # fmt: skip
    run, same = (simulate(m, record(200))["pitch_rad"] for m in (linear, narx))
    # their starts differ in what they take for the inputs before the record, and forget it
    np.testing.assert_allclose(same[50:], run[50:], atol=1e-4)
    assert np.ptp(run[50:]) > 1e-2


def test_a_start_holds_what_was_measured_and_rests_otherwise():
    made = model()
    x = made.initial(np.array([2.0, np.nan]))
    named = dict(zip(made.states, x, strict=True))
    assert [named[n] for n in ("heading_rad", "heading_rad lag 1", "heading_rad lag 2")] == [2.0] * 3
    assert [named[n] for n in ("pitch_rad", "pitch_rad lag 2", "stern_plane_rad lag 1")] == [0.1, 0.1, -0.2]


def test_the_level_of_an_integrating_output_changes_nothing_else():
    made, given = model(), record()
    low, high = (
        simulate(made, given.with_channels({"heading_rad": given["heading_rad"] + turn})) for turn in (0.0, 40.0)
    )
    np.testing.assert_allclose(high["heading_rad"] - low["heading_rad"], 40.0, atol=1e-10)
    np.testing.assert_allclose(high["pitch_rad"], low["pitch_rad"], atol=1e-10)


def test_bells_far_from_zero_keep_their_digits():
    near, shift = model(integrating=()), 1000.0
    d = len(near.lags.matrix)
    levels = np.r_[np.full(6, shift), np.zeros(d - 6)]
    far = replace(near, support=near.support + levels, middle=near.middle + levels, bias=near.bias + shift)
    given = record()
    raised = given.with_channels({name: given[name] + shift for name in OUTPUTS})
    apart = simulate(far, raised).matrix(OUTPUTS) - shift
    np.testing.assert_allclose(apart, simulate(near, given).matrix(OUTPUTS), atol=1e-10)


def test_what_is_far_from_the_training_data_is_outside():
    made, given = model(integrating=(), reach=0.8), record()
    z = np.concatenate([made.lags.regressors(given.matrix(INPUTS), given.matrix(OUTPUTS))])
    apart = np.linalg.norm((z[:, None] - made.support) / made.spread, axis=2).min(axis=1) / 0.8
    np.testing.assert_allclose(made.distance(given), apart, atol=1e-7)
    assert made.outside(given) == np.mean(apart > 1.0)
    there = replace(made, support=z, sigma=np.zeros(0), coefficients=np.zeros((0, len(z), 2)))
    assert there.outside(given) == 0.0
    assert there.outside(given.with_channels({"rudder_rad": given["rudder_rad"] + 20.0})) == 1.0


def test_a_run_that_grows_diverges_with_the_time_and_the_channel():
    grows = model(n_a=1, integrating=(), slopes=np.array([[40.0, 0.0]] + [[0.0, 0.0]] * 5))
    with pytest.raises(Diverged, match=r"heading_rad is not finite at \d+\.\d+ s"):
        simulate(grows, record(400))


def test_it_is_written_and_read_back_bit_for_bit(tmp_path):
    made = model()
    save_model(made, tmp_path / "model.npz")
    again = load_model(tmp_path / "model.npz")
    assert type(again) is Narx
    for field in fields(made):
        given, found = getattr(made, field.name), getattr(again, field.name)
        assert np.array_equal(found, given) if isinstance(given, np.ndarray) else found == given, field.name
    run, same = (simulate(m, record()).matrix(OUTPUTS) for m in (made, again))
    np.testing.assert_array_equal(same, run)


@pytest.mark.parametrize(
    "changed, words",
    [
        ({"n_a": 2.0}, "n_a needs a whole number of at least 0, got 2.0"),
        ({"delay": 0}, "delay needs a whole number of at least 1, got 0"),
        ({"integrating": ("depth_m",)}, r"integrating needs outputs \(heading_rad, pitch_rad\), got 'depth_m'"),
        ({"inputs": ("rudder_rad", "pitch_rad")}, "given once"),
        ({"dt": 0.0}, "finite dt > 0, got 0.0"),
        (
            {"slopes": np.zeros((3, 2))},
            r"slopes of shape \(9, 2\), got \(3, 2\)",
        ),
        ({"bias": np.array([np.nan, 0.0])}, "finite bias"),
        ({"sigma": np.array([1.0, 0.0])}, "sigma > 0"),
    ],
)
def test_what_cannot_be_is_refused_in_words(changed, words):
    with pytest.raises(ValueError, match=words):
        replace(model(), **changed)
    assert len(model().lags.matrix) == 9


def test_a_step_and_a_run_need_states_and_samples_of_their_own():
    made = model()
    with pytest.raises(ValueError, match=r"state of this model has shape \(\d+,\), got \(2,\)"):
        made.step(np.zeros(2), np.zeros(2))
    with pytest.raises(ValueError, match=r"steps 0\.5 s at a time"):
        simulate(made, Record.from_arrays(np.arange(9.0), {name: np.zeros(9) for name in (*INPUTS, *OUTPUTS)}))
    with pytest.raises(ValueError, match="one state a window"):
        made.run(record(), [slice(0, 9)], np.zeros((2, 3)))
