"""What holds for every model that an environment may step: each preset, bare and with effects on, and linear models."""

from functools import partial

import numpy as np
import pytest

from auv_gym.channels import channel
from auv_gym.model import Model, predict, simulate
from auv_gym.models.linear import Polynomial, linearise
from auv_gym.models.narx import Narx
from auv_gym.param import replace_at
from auv_gym.plant import Plant, list_vehicles, load_vehicle
from auv_gym.plant.cruise import command_ranges, find_helm
from auv_gym.records.record import Record

STEERED = {
    "effects.rudder.lag": 1.0,
    "effects.rudder.dead_time": 1.5,
    "effects.rudder.backlash": 0.02,
    "effects.compass.lag": 2.0,
    "effects.compass.deviation_sin": 0.05,
}
EFFECTS = {
    "glider": {**STEERED, "effects.yaw.quadratic_damping": 20.0},
    "body": {
        **STEERED,
        "effects.stern_plane.offset": 0.02,
        "effects.propeller.lag": 1.0,
        "effects.current.north": 0.2,
        "effects.current.shear_east": 0.01,
        "effects.waves.amplitude_sin": 0.2,
        "effects.load.payload": 0.3,
        "effects.load.tether_drag": 0.5,
        "effects.depth.scale": 0.01,
        "effects.gyros.misalignment": 0.1,
        "effects.gyros.lag": 0.3,
        "effects.dvl_water.lag": 0.5,
        "effects.dvl_water.scale": 0.02,
        "effects.dvl_ground.lag": 0.5,
    },
    "hover": {
        "effects.t1.lag": 0.2,
        "effects.t2.dead_time": 0.1,
        "effects.t3.lost": 0.3,
        "effects.t4.deadband": 0.05,
        "effects.compass.lag": 2.0,
        "effects.compass.deviation_sin": 0.05,
        "effects.current.north": 0.2,
        "effects.load.tether_drag": 0.5,
        "effects.gyros.lag": 0.3,
        "effects.dvl_ground.lag": 0.5,
    },
    "float": {
        "effects.piston.gain": 0.9,
        "effects.piston.lag": 1.0,
        "effects.piston.dead_time": 1.5,
        "effects.piston.backlash": 2e-3,
        "effects.volume.compressibility": 1e-7,
        "effects.volume.air": 2e-5,
        "effects.volume.expansion": 1e-6,
        "effects.volume.expansion_lag": 20.0,
        "effects.volume.leak": 1e-8,
        "effects.water.gradient": 5e-3,
        "effects.water.current": 0.01,
        "effects.water.current_with_depth": 5e-5,
        "effects.water.heave_sin": 0.01,
        "effects.tether.drag": 0.2,
        "effects.depth.scale": 0.01,
        "effects.depth.lag": 1.0,
    },
    "glide_body": {
        "effects.ballast.gain": 0.9,
        "effects.ballast.dead_time": 1.5,
        "effects.battery.slide.gain": 0.9,
        "effects.battery.turn.lag": 2.0,
        "effects.current.north": 0.1,
        "effects.load.payload": 0.05,
        "effects.compass.deviation_sin": 0.05,
        "effects.gyros.lag": 0.3,
        "effects.depth.scale": 0.01,
    },
    "glide": {
        "effects.engine.gain": 0.9,
        "effects.engine.lag": 10.0,
        "effects.engine.dead_time": 7.0,
        "effects.volume.compressibility": 1e-10,
        "effects.volume.expansion": 1e-5,
        "effects.volume.expansion_lag": 100.0,
        "effects.volume.air": 2e-5,
        "effects.volume.leak": 1e-8,
        "effects.polar.growth": 0.2,
        "effects.polar.lift": -0.1,
        "effects.inclinometer.pitch_bias": 0.02,
        "effects.compass.deviation_sin": 0.05,
        "effects.current.north": 0.1,
        "effects.water.current": 0.01,
        "effects.water.current_with_depth": 5e-5,
        "effects.water.heave_sin": 0.01,
        "effects.depth.scale": 0.01,
    },
}
# what other steps change: a float's are of seconds, within which a lagging depth sensor takes its motion as even
CUT_STEPS = {"glider": 1e-6, "body": 1e-6, "hover": 1e-6, "float": 1e-4, "glide": 1e-4, "glide_body": 1e-6}
MOVED = {
    **dict.fromkeys(("glider", "body", "hover", "glide_body"), "heading_rad"),
    **dict.fromkeys(("float", "glide"), "depth_m"),
}


def with_effects(plant: Plant) -> Plant:
    return replace_at(plant, EFFECTS[plant.family.kind])


PRESETS = {name: load_vehicle(name) for name in sorted(list_vehicles())}
MODELS = {**PRESETS, **{f"{name} with effects": with_effects(plant) for name, plant in PRESETS.items()}}


@pytest.fixture(params=MODELS.values(), ids=MODELS)
def model(request) -> Model:
    return request.param


def excited(model: Model, samples: int = 40) -> Record:
    """From rest; all commands rest at first, as they count as having been before a model's initial state."""
    rows = [commands(model, 0.0, 0.0)] * 2 + [commands(model, 0.3 * np.sin(0.8 * k)) for k in range(2, samples)]
    given = dict(zip(model.inputs, np.transpose(rows), strict=True))
    deep = {"float": 8.0, "glide": 150.0, "glide_body": 30.0}
    at_depth = {"depth_m": np.full(samples, deep[model.family.kind])} if model.family.kind in deep else {}
    named = {name: given[name] for name in model.family.required or model.family.actuators}
    return Record.from_arrays(model.dt * np.arange(samples), {**named, **at_depth})


def commands(model: Model, moved: float, running: float = 1.0) -> np.ndarray:
    """A rudder angle, a piston moved down from neutral by a tenth of that, or oil by a ten thousandth, m^3.

    running: share of the propeller's command at the design speed.
    """
    constants = {**model.constants, "rudder_rad": moved, "oil_volume_m3": -1e-4 * moved}
    if model.family.kind == "body":
        constants[model.inputs[find_helm(model).drive]] = running * model.parts.propeller.design
    if model.family.kind in ("hover", "glide_body"):
        low, rest, high = command_ranges(model).T
        pushed = rest + 0.5 * (high - low) * moved * np.cos(np.arange(rest.size))
        constants |= dict(zip(model.inputs, pushed.tolist(), strict=False))
    if model.family.kind == "float":
        constants["piston_m"] = model.hull.piston_neutral - 0.1 * moved
    if model.family.kind == "glide":
        constants |= {"buoyancy_volume_m3": model.hull.engine_neutral - 5e-4 * moved, "pitch_rad": -0.3}
    return np.array([constants.get(name, 0.0) for name in model.inputs])


def under_way(model: Model) -> np.ndarray:
    """Outputs of a vehicle at depth, under way and turning a little."""
    known = {"u_mps": 1.2, "v_mps": 0.05, "r_radps": 0.02, "heading_rad": 0.3, "roll_rad": 0.05, "depth_m": 8.0}
    known["depth_rate_mps"] = 0.02
    return np.array([known.get(name, 0.0) for name in model.outputs])


def states_among(model: Model) -> np.ndarray:
    """Where the outputs are that measure a state, and not what follows from states, as velocity over ground does."""
    return np.array([index for index, name in enumerate(model.outputs) if name in model.states])


def test_it_keeps_the_protocol(model):
    assert isinstance(model, Model)
    assert model.dt > 0.0
    assert all(channel(name).name == name for name in (*model.inputs, *model.outputs))
    assert len(set(model.states)) == len(model.states)


def test_shapes_and_types(model):
    x = model.initial(under_way(model))
    x1 = model.step(x, commands(model, 0.1))
    for state in (x, x1, model.correct(x1, under_way(model))):
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
    x = model.step(model.initial(under_way(model)), commands(model, 0.3))
    before = model.output(x)
    model.step(x, commands(model, -0.3))
    assert np.array_equal(model.output(x), before)


def test_initial_and_correct_meet_what_was_measured(model):
    y, measured = np.linspace(0.1, 0.4, len(model.outputs)), states_among(model)
    assert model.output(model.initial(y))[measured] == pytest.approx(y[measured], abs=1e-12)
    x = model.step(model.initial(y), commands(model, 0.2))
    assert model.output(model.correct(x, y))[measured] == pytest.approx(y[measured], abs=1e-12)
    unmeasured = model.correct(x, np.full(y.size, np.nan))
    assert np.array_equal(unmeasured, x)


def test_simulation_predicts_itself_at_every_horizon(model):
    made = simulate(model, excited(model))
    assert np.ptp(made[MOVED[model.family.kind]]) > 1e-9
    for horizon in (1, 5, 100):
        again = predict(model, made, horizon)
        for name in model.outputs:
            # the integrator's steps are cut at other times where a dead time reaches back before the record
            assert again[name] == pytest.approx(made[name], abs=CUT_STEPS[model.family.kind]), (name, horizon)


def test_the_same_run_twice_is_the_same(model):
    record = excited(model)
    one, two = simulate(model, record), simulate(model, record)
    for name in model.outputs:
        assert np.array_equal(one[name], two[name])


NOISY = Polynomial.from_coefficients(
    {"depth_m": [-1.6, 0.6], "pitch_rad": [-1.2, 0.5]},
    {"depth_m": {"stern_plane_rad": [0.1]}, "pitch_rad": {"stern_plane_rad": [-0.2, 0.1], "bow_plane_rad": [0.1]}},
    2.0,
    c={"depth_m": [0.4], "pitch_rad": [-0.3, 0.1, 0.2, 0.1]},
)
BELLS = Narx(
    ("stern_plane_rad",), ("depth_m", "pitch_rad"), 2.0, 2, 2, 1, ("depth_m",),
    support=np.linspace(-0.5, 0.5, 20).reshape(4, 5), middle=np.zeros(5), spread=np.ones(5), sigma=np.array([0.7]),
    coefficients=np.array([[[0.1, 0.2], [-0.3, 0.1], [0.2, -0.1], [0.1, 0.1]]]), reach=1.0,
    slopes=0.2 * np.ones((5, 2)), bias=np.array([0.01, 0.0]), rest=np.array([5.0, 0.0, 0.0]),
    sway=np.ones(3),
)  # fmt: skip
LINEAR = {
    **{f"{name} linearised": partial(linearise, plant) for name, plant in PRESETS.items()},
    "polynomial": lambda: NOISY,
    "state space": NOISY.to_state_space,
    "bells": lambda: BELLS,  # not linear, but it shares what is tested of these
}


@pytest.fixture(scope="module", params=LINEAR)
def linear(request) -> Model:
    return LINEAR[request.param]()


def moving(model: Model, samples: int = 40) -> Record:
    """Small sines about the model's own operating point."""
    waves = 0.01 * np.sin(np.outer(np.arange(1, len(model.inputs) + 1), 0.4 * np.arange(samples)))
    offset = getattr(model, "input_offset", np.zeros(len(model.inputs)))
    given = dict(zip(model.inputs, offset[:, None] + waves, strict=True))
    start = model.output(np.zeros(len(model.states)))
    held = {name: np.full(samples, value) for name, value in zip(model.outputs, start, strict=True)}
    return Record.from_arrays(model.dt * np.arange(samples), {**given, **held})


def test_a_linear_model_keeps_the_protocol(linear):
    test_it_keeps_the_protocol(linear)
    x, u = linear.initial(np.full(len(linear.outputs), 0.1)), np.full(len(linear.inputs), 0.2)
    x_before, y = x.copy(), linear.output(x)
    x1 = linear.step(x, u)
    for state in (x, x1, linear.correct(x1, y)):
        assert (state.shape, state.dtype) == ((len(linear.states),), np.float64)
    assert (y.shape, y.dtype) == ((len(linear.outputs),), np.float64)
    assert np.array_equal(linear.step(x, u), x1)
    assert np.array_equal(x, x_before)
    assert np.array_equal(linear.correct(x1, np.full(y.size, np.nan)), x1)
    assert linear.output(linear.initial(y)) == pytest.approx(y, abs=1e-9)


def test_a_linear_simulation_predicts_itself_at_every_horizon(linear):
    made = simulate(linear, moving(linear))
    for horizon in (1, 5, 100):
        again = predict(linear, made, horizon)
        for name in linear.outputs:
            assert again[name] == pytest.approx(made[name], abs=1e-9 * (1.0 + np.abs(made[name]).max())), (
                name,
                horizon,
            )
