from dataclasses import fields, replace

import numpy as np
import pytest

from auv_gym.model import Diverged, predict, simulate
from auv_gym.models.linear import StateSpace
from auv_gym.records.record import Record

INPUTS, OUTPUTS = ("stern_plane_rad", "bow_plane_rad"), ("depth_m", "pitch_rad")


def random_model(seed, singular=False, noisy=True, n=4) -> StateSpace:
    rng = np.random.default_rng(seed)
    a = rng.standard_normal((n, n))
    a *= 0.9 / np.abs(np.linalg.eigvals(a)).max()
    if singular:
        a[-1] = 0.0
    k = 0.2 * rng.standard_normal((n, 2)) if noisy else np.zeros((n, 2))
    b, c = rng.standard_normal((n, 2)), rng.standard_normal((2, n))
    return StateSpace(a, b, c, INPUTS, OUTPUTS, 0.5, k, rng.standard_normal(2), rng.standard_normal(2))


def random_record(seed, samples=30, start=0.0, dt=0.5) -> Record:
    rng = np.random.default_rng(seed)
    columns = dict(zip((*INPUTS, *OUTPUTS), rng.standard_normal((4, samples))))
    return Record.from_arrays(start + dt * np.arange(samples), columns)


@pytest.mark.parametrize("seed", range(5))
def test_a_start_has_the_outputs_measured(seed):
    model, y0 = random_model(seed), np.array([3.0, -0.2])
    assert model.output(model.initial(y0)) == pytest.approx(y0, abs=1e-10)
    assert model.output(model.initial(np.array([np.nan, -0.2])))[1] == pytest.approx(-0.2, abs=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_a_start_is_nearest_to_rest(seed):
    model, y0 = random_model(seed), np.array([3.0, -0.2])
    x = model.initial(y0)
    change = np.linalg.norm(model.a @ x - x)
    _, _, rows = np.linalg.svd(model.c)
    for direction in rows[2:]:  # those that no output shows
        for size in (-1e-3, 1e-3):
            moved = x + size * direction
            assert np.linalg.norm(model.a @ moved - moved) > change


def test_an_integrator_starts_where_it_is_measured_and_at_rest():
    model = StateSpace(
        np.array([[1.0, 0.5], [0.0, 0.8]]), np.array([[0.0], [0.1]]), np.array([[1.0, 0.0]]), ("rudder_rad",),
        ("heading_rad",), 1.0,
    )  # fmt: skip
    assert model.initial(np.array([7.3])) == pytest.approx([7.3, 0.0], abs=1e-12)
    assert model.initial(np.array([np.nan])) == pytest.approx([0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("singular", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_predictions_are_those_of_the_innovations_form(seed, singular):
    model, record = random_model(seed, singular), random_record(seed)
    a, b, c, k = model.a, model.b, model.c, model.k
    predicted = predict(model, record)
    x = model.initial(np.array([record[name][0] for name in OUTPUTS]))
    x = model.correct(model.step(x, np.array([record[name][0] for name in INPUTS])), np.full(2, np.nan))
    for t in range(1, record.time.size):
        y = c @ x + model.output_offset
        assert [predicted[name][t] for name in OUTPUTS] == pytest.approx(y, abs=1e-9)
        e = np.array([record[name][t] for name in OUTPUTS]) - y
        u = np.array([record[name][t] for name in INPUTS])
        x = a @ x + b @ (u - model.input_offset) + k @ e


def test_innovations_join_the_states_only_where_no_correction_does():
    assert random_model(0).states == ("x1", "x2", "x3", "x4")
    assert random_model(0, singular=True).states[4:] == ("depth_m innovation", "pitch_rad innovation")
    assert random_model(0, singular=True, noisy=False).states == ("x1", "x2", "x3", "x4")


@pytest.mark.parametrize("singular", [False, True])
def test_made_again_of_its_fields_it_is_the_same(singular):
    model = random_model(1, singular)
    again = StateSpace(**{field.name: getattr(model, field.name) for field in fields(model)})
    assert again.states == model.states
    for name in ("a", "b", "c", "k", "gain"):
        assert np.array_equal(getattr(again, name), getattr(model, name))


def test_what_was_not_measured_corrects_nothing():
    model = random_model(2)
    x = np.arange(4.0)
    assert np.array_equal(model.correct(x, np.full(2, np.nan)), x)
    y = model.output(x)
    one = model.correct(x, np.array([y[0] + 0.1, np.nan]))
    assert one == pytest.approx(x + 0.1 * model.gain[:, 0], abs=1e-12)


def test_free_runs_are_steps_in_a_row():
    model, record = random_model(3), random_record(3)
    windows, starts = [slice(0, 12), slice(20, 30)], np.random.default_rng(0).standard_normal((2, 4))
    inputs = np.stack([record[name] for name in INPUTS], axis=1)
    expected = []
    for window, x in zip(windows, starts):
        for t in range(window.start, window.stop):
            expected.append(model.output(x))
            x = model.step(x, inputs[t])
    assert model.run(record, windows, starts) == pytest.approx(np.array(expected), abs=1e-12)


def test_a_run_refuses_other_samples_and_reports_divergence():
    model = random_model(4)
    with pytest.raises(ValueError, match=r"steps 0\.5 s at a time"):
        simulate(model, random_record(0, dt=1.0))
    with pytest.raises(ValueError, match="starts of shape"):
        model.run(random_record(0), [slice(0, 5)], np.zeros((1, 3)))
    with pytest.raises(Diverged):
        simulate(replace(model, a=1e100 * np.eye(4), k=np.zeros((4, 2))), random_record(0))


def test_poles_gains_and_responses_of_a_first_order_lag():
    lag = StateSpace(
        np.array([[0.8]]), np.array([[0.1]]), np.array([[2.0]]), ("rudder_rad",), ("r_radps",), 0.5
    )  # fmt: skip
    assert lag.poles() == pytest.approx([0.8])
    assert lag.is_stable()
    assert lag.dc_gain() == pytest.approx(np.array([[1.0]]))
    omega = np.array([0.1, 1.0])
    expected = 0.2 / (np.exp(0.5j * omega) - 0.8)
    assert lag.frequency_response(omega)[:, 0, 0] == pytest.approx(expected)
    integrator = replace(lag, a=np.array([[1.0]]))
    assert not integrator.is_stable()
    with pytest.raises(ValueError, match="pole at 1"):
        integrator.dc_gain()


def test_python_control_knows_the_same_system():
    control = pytest.importorskip("control")
    model = random_model(5)
    system = model.to_control()
    omega = np.array([0.2, 2.0])
    response = control.frequency_response(system, omega).complex.transpose(2, 0, 1)
    assert model.frequency_response(omega) == pytest.approx(response, abs=1e-10)
    back = StateSpace.from_control(system)
    assert (back.inputs, back.outputs, back.states, back.dt) == (model.inputs, model.outputs, model.states, model.dt)
    assert np.array_equal(back.a, model.a)
    with pytest.raises(ValueError, match="discrete time"):
        StateSpace.from_control(control.tf([1.0], [1.0, 1.0]), ("rudder_rad",), ("r_radps",))
    with pytest.raises(ValueError, match="does not see the present input"):
        StateSpace.from_control(control.tf([1.0, 0.0], [1.0, -0.5], 0.5), ("rudder_rad",), ("r_radps",))


@pytest.mark.parametrize(
    "change, message",
    [
        ({"b": np.zeros((4, 3))}, "needs finite b of shape"),
        ({"c": np.full((2, 4), np.nan)}, "needs finite c"),
        ({"k": np.zeros((3, 2))}, "needs finite k"),
        ({"dt": 0.0}, "dt > 0"),
        ({"outputs": ("depth_m", "pitch")}, "pitch"),
        ({"outputs": ("depth_m", "depth_m")}, "each channel once"),
        ({"states": ("x1", "x1", "x3", "x4")}, "4 different names"),
    ],
)
def test_what_is_no_model_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(random_model(0), **change)
