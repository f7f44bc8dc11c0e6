"""What holds for every model that an environment may step: each preset, bare and with effects on."""

import numpy as np
import pytest

from auv_gym.channels import CHANNELS
from auv_gym.model import Model, predict, simulate
from auv_gym.param import replace_at
from auv_gym.plant import list_vehicles, load_vehicle
from auv_gym.record import Record

EFFECTS = {
    "effects.rudder.lag": 1.0,
    "effects.rudder.dead_time": 1.5,
    "effects.rudder.backlash": 0.02,
    "effects.compass.lag": 2.0,
    "effects.compass.deviation_sin": 0.05,
    "effects.yaw.quadratic_damping": 20.0,
}
MODELS = {
    **{name: load_vehicle(name) for name in sorted(list_vehicles())},
    **{f"{name} with effects": replace_at(load_vehicle(name), EFFECTS) for name in sorted(list_vehicles())},
}


@pytest.fixture(params=MODELS.values(), ids=MODELS)
def model(request) -> Model:
    return request.param


def excited(model: Model, samples: int = 40) -> Record:
    rudder = np.where(np.arange(samples) < 2, 0.0, 0.3 * np.sin(0.8 * np.arange(samples)))
    return Record.from_arrays(model.dt * np.arange(samples), {"rudder_rad": rudder})


def commands(model: Model, rudder: float) -> np.ndarray:
    return np.array([rudder if name == "rudder_rad" else model.constants.get(name, 0.0) for name in model.inputs])


def test_it_keeps_the_protocol(model):
    assert isinstance(model, Model)
    assert model.dt > 0.0
    assert set(model.inputs) <= set(CHANNELS)
    assert set(model.outputs) <= set(CHANNELS)
    assert len(set(model.states)) == len(model.states)


def test_shapes_and_types(model):
    x = model.initial(np.zeros(len(model.outputs)))
    x1 = model.step(x, commands(model, 0.1))
    for state in (x, x1, model.correct(x1, np.zeros(len(model.outputs)))):
        assert (state.shape, state.dtype) == ((len(model.states),), np.float64)
    assert (model.output(x1).shape, model.output(x1).dtype) == ((len(model.outputs),), np.float64)


def test_a_step_is_pure(model):
    x, u = model.initial(np.full(len(model.outputs), 0.1)), commands(model, 0.2)
    x_before, u_before = x.copy(), u.copy()
    first, second = model.step(x, u), model.step(x, u)
    assert np.array_equal(first, second)
    assert np.array_equal(x, x_before)
    assert np.array_equal(u, u_before)


def test_an_output_does_not_see_the_present_input(model):
    x = model.step(model.initial(np.zeros(len(model.outputs))), commands(model, 0.3))
    before = model.output(x)
    model.step(x, commands(model, -0.3))
    assert np.array_equal(model.output(x), before)


def test_initial_and_correct_meet_what_was_measured(model):
    y = np.linspace(0.1, 0.4, len(model.outputs))
    assert model.output(model.initial(y)) == pytest.approx(y, abs=1e-12)
    x = model.step(model.initial(y), commands(model, 0.2))
    assert model.output(model.correct(x, y)) == pytest.approx(y, abs=1e-12)
    unmeasured = model.correct(x, np.full(y.size, np.nan))
    assert np.array_equal(unmeasured, x)


def test_simulation_predicts_itself_at_every_horizon(model):
    made = simulate(model, excited(model))
    assert np.ptp(made["heading_rad"]) > 1e-9
    for horizon in (1, 5, 100):
        again = predict(model, made, horizon)
        for name in model.outputs:
            # the integrator's steps are cut at other times where a dead time reaches back before the record
            assert again[name] == pytest.approx(made[name], abs=1e-6), (name, horizon)


def test_the_same_run_twice_is_the_same(model):
    record = excited(model)
    one, two = simulate(model, record), simulate(model, record)
    for name in model.outputs:
        assert np.array_equal(one[name], two[name])
