from dataclasses import replace

import numpy as np
import pytest

from auv_gym.model import predict, simulate
from auv_gym.models.linear import Polynomial
from auv_gym.records.record import Record

INPUTS, OUTPUTS = ("bow_plane_rad", "stern_plane_rad"), ("depth_m", "pitch_rad")


def full_model(seed, powers=(2, 3, 2)) -> Polynomial:
    """Both outputs act on each other; C's zeros are well inside the unit circle."""
    rng = np.random.default_rng(seed)
    a, b, c = (0.2 * rng.standard_normal((n + 1, 2, 2)) for n in powers)
    a[0] = c[0] = np.eye(2)
    b[0] = 0.0
    return Polynomial(a, b, INPUTS, OUTPUTS, 4.0, c, np.array([0.1, 0.2]), np.array([5.0, -0.1]))


def table_2() -> Polynomial:
    """Coefficients of a diving vehicle at 8 kn as published, as far as they are printed, angles in degrees."""
    return Polynomial.from_coefficients(
        a={"depth_m": [-2.950, 2.903, -0.953], "pitch_rad": [-3.520, 4.638, -2.712, 0.594]},
        b={
            "depth_m": {"bow_plane_rad": [-0.00166, 0.00153], "stern_plane_rad": [-0.000438]},
            "pitch_rad": {"bow_plane_rad": [0.000894, -0.000890], "stern_plane_rad": [-0.00149]},
        },
        dt=4.0,
    )


def run_by_hand(model, u, e):
    """y by the difference equation, from rest."""
    y = np.zeros((len(u), 2))
    v = u - model.input_offset
    for t in range(len(u)):
        y[t] = e[t]
        for terms, signal, sign in ((model.a, y, -1.0), (model.b, v, 1.0), (model.c, e, 1.0)):
            for j in range(1, min(len(terms) - 1, t) + 1):
                y[t] += sign * terms[j] @ signal[t - j]
    return y + model.output_offset


@pytest.mark.parametrize("seed", range(4))
def test_the_observer_form_is_the_difference_equation(seed):
    model, rng = full_model(seed), np.random.default_rng(seed)
    u, e = rng.standard_normal((50, 2)), np.zeros((50, 2))
    space, x, y = model.to_state_space(), np.zeros(len(model.states)), []
    for row in u:
        y.append(space.output(x))
        x = space.step(x, row)
    assert np.array(y) == pytest.approx(run_by_hand(model, u, e), abs=1e-10)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("powers", [(2, 3, 0), (2, 2, 1), (1, 2, 3)])
def test_predictions_leave_the_white_noise(seed, powers):
    model, rng = full_model(seed, powers), np.random.default_rng(seed)
    u, e = 0.01 * rng.standard_normal((2, 120, 2))  # angles that jump by less than half a turn
    y = run_by_hand(model, u, e)
    columns = dict(zip((*INPUTS, *OUTPUTS), (*u.T, *y.T)))
    predicted = predict(model, Record.from_arrays(4.0 * np.arange(120), columns))
    for i, name in enumerate(OUTPUTS):  # what the start does not know has faded with C's zeros
        assert y[80:, i] - predicted[name][80:] == pytest.approx(e[80:, i], abs=1e-8)


def test_a_diagonal_model_takes_as_many_states_as_its_highest_powers():
    model = table_2()
    assert model.states == tuple(f"depth_m {i}" for i in (1, 2, 3)) + tuple(f"pitch_rad {i}" for i in (1, 2, 3, 4))
    space = model.state_space
    reach = np.hstack([np.linalg.matrix_power(space.a, j) @ space.b for j in range(7)])
    scaled = reach / np.linalg.norm(reach, axis=1, keepdims=True)
    assert np.linalg.matrix_rank(scaled, tol=1e-9) == 7
    assert sorted(np.abs(model.state_space.poles())) == pytest.approx(
        sorted(np.abs([*np.roots([1, -2.950, 2.903, -0.953]), *np.roots([1, -3.520, 4.638, -2.712, 0.594])])), abs=1e-6
    )


def test_the_depth_of_the_published_model_integrates():
    assert np.abs(table_2().state_space.poles() - 1.0).min() < 1e-9


def test_arx_is_corrected_to_what_was_measured():
    model = table_2()
    x = model.step(model.initial(np.array([10.0, 0.5])), np.array([1.0, -1.0]))
    assert model.output(model.correct(x, np.array([11.0, 0.4]))) == pytest.approx([11.0, 0.4], abs=1e-10)


def test_a_free_run_starts_at_rest_from_what_was_measured():
    model, held = full_model(0), np.ones(20)
    record = Record.from_arrays(
        4.0 * np.arange(20),
        {INPUTS[0]: 0.1 * held, INPUTS[1]: 0.2 * held, OUTPUTS[0]: 5.0 * held, OUTPUTS[1]: -0.1 * held},
    )
    made = simulate(model, record)
    assert made["depth_m"] == pytest.approx(5.0 * held, abs=1e-12)
    assert made["pitch_rad"] == pytest.approx(-0.1 * held, abs=1e-12)


def test_coefficients_go_where_they_are_named():
    model = Polynomial.from_coefficients(
        {"heading_rad": [-0.9]}, {"heading_rad": {"rudder_rad": [0.2, 0.3]}}, 1.0, c={"heading_rad": [0.5]}, delay=2,
        inputs=("bow_thruster_N", "rudder_rad"),
    )  # fmt: skip
    assert model.b[:, 0].tolist() == [[0.0, 0.0], [0.0, 0.0], [0.0, 0.2], [0.0, 0.3]]
    assert model.a[:, 0, 0].tolist() == [1.0, -0.9]
    assert model.c[:, 0, 0].tolist() == [1.0, 0.5]


@pytest.mark.parametrize(
    "change, message",
    [
        ({"b": np.ones((2, 2, 2))}, "does not see the present input"),
        ({"a": np.zeros((2, 2, 2))}, "unit matrix"),
        ({"c": np.zeros((2, 2))}, "one matrix a power"),
        ({"output_offset": np.zeros(3)}, "output_offset"),
        ({"dt": -1.0}, "dt > 0"),
    ],
)
def test_what_is_no_model_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(full_model(0), **change)


def test_coefficients_of_nothing_are_refused():
    with pytest.raises(ValueError, match="a for every output"):
        Polynomial.from_coefficients({"depth_m": [1.0]}, {"pitch_rad": {"rudder_rad": [1.0]}}, 1.0)
    with pytest.raises(ValueError, match="at least 1 sample"):
        Polynomial.from_coefficients({"depth_m": [1.0]}, {"depth_m": {"rudder_rad": [1.0]}}, 1.0, delay=0)
    with pytest.raises(ValueError, match="got b for inputs"):
        Polynomial.from_coefficients({"depth_m": [1.0]}, {"depth_m": {"rudder_rad": [1.0]}}, 1.0, inputs=("piston_m",))


def test_python_control_knows_the_same_system():
    control = pytest.importorskip("control")
    model = Polynomial.from_coefficients(
        a={"depth_m": [-1.5, 0.7], "pitch_rad": [-0.9]},
        b={"depth_m": {"stern_plane_rad": [0.3, 0.1]}, "pitch_rad": {"stern_plane_rad": [0.2]}},
        dt=0.5,
    )
    system, omega = model.to_control(), np.array([0.1, 0.7, 3.0])
    back = Polynomial.from_control(system)
    assert (back.inputs, back.outputs, back.dt) == (model.inputs, model.outputs, 0.5)
    np.testing.assert_allclose(
        back.to_state_space().frequency_response(omega), model.to_state_space().frequency_response(omega), rtol=1e-9
    )
    one = Polynomial.from_control(control.tf([0.5], [1.0, -0.8], 0.5), ("rudder_rad",), ("r_radps",))
    np.testing.assert_allclose(one.a[:, 0, 0], [1.0, -0.8], atol=1e-12)
    np.testing.assert_allclose(one.b[:, 0, 0], [0.0, 0.5], atol=1e-12)
