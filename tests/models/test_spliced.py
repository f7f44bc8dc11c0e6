"""A plant that a model drives in part: twins, closed forms, orders, and what is refused."""

import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, exp, pi, sin
from typing import Any

import gymnasium
import numpy as np
import pytest

from auv_gym.model import Diverged, Model, predict, simulate
from auv_gym.models.spliced import Spliced, splice
from auv_gym.param import replace_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from tests.plain_python import run_plain

RATES = ("p_radps", "q_radps", "r_radps")
BODY = ("u_mps", "v_mps", "w_mps", *RATES)
WATER = {
    "effects.current.north": 0.3,
    "effects.current.down": 0.05,
    "effects.current.shear_east": 0.02,
    "effects.waves.amplitude_cos": 0.3,
    "effects.waves.direction": 0.5,
}


@dataclass(frozen=True)
class Twin:
    """A plant as a model of some of its outputs; the others are zero at the start."""

    plant: Plant
    outputs: tuple[str, ...]

    @property
    def inputs(self):
        return self.plant.inputs

    @property
    def states(self):
        return self.plant.states

    @property
    def dt(self):
        return self.plant.dt

    def initial(self, y0):
        return self.plant.initial(np.nan_to_num(self._whole(y0)))

    def step(self, x, u):
        return self.plant.step(x, u)

    def output(self, x):
        return self.plant.output(x)[self._at]

    def correct(self, x, y):
        return self.plant.correct(x, self._whole(y))

    @cached_property
    def _at(self):
        return [self.plant.outputs.index(name) for name in self.outputs]

    def _whole(self, y):
        whole = np.full(len(self.plant.outputs), np.nan)
        whole[self._at] = y
        return whole


@dataclass(frozen=True, eq=False)
class Linear:
    """x1 = a x + b u + c, of which all of x is measured."""

    outputs: tuple[str, ...]
    a: Any = 1.0
    b: Any = 0.0
    c: Any = 0.0
    inputs: tuple[str, ...] = ()
    dt: float = 1.0

    @property
    def states(self):
        return self.outputs

    def initial(self, y0):
        return np.nan_to_num(np.asarray(y0, dtype=float))

    def step(self, x, u):
        return self.a * x + self.b * np.sum(u) + self.c

    def output(self, x):
        return x.copy()

    def correct(self, x, y):
        return np.where(np.isfinite(y), y, x)


def lag(output: str, dt: float) -> Linear:
    """Twice the rudder angle behind a lag of 1.5 s, exact for a command that is held."""
    decay = exp(-dt / 1.5)
    return Linear((output,), decay, 2.0 * (1.0 - decay), inputs=("rudder_rad",), dt=dt)


def commands(model: Any, k: int) -> np.ndarray:
    moving = {"rudder_rad": 0.1 * sin(0.7 * k), "stern_plane_rad": 0.05 * cos(0.3 * k), "propeller_rpm": 1500.0}
    moving["bow_plane_rad"] = 0.04 * sin(0.5 * k)
    values = {**model.constants, **moving}
    return np.array([values.get(name, 0.0) for name in model.inputs])


def start(model: Any, **known: float) -> np.ndarray:
    return np.array([known.get(name, 0.0) for name in model.outputs])


def run(model: Any, y0: np.ndarray, plant: Plant, coarse: float, count: int = 10) -> np.ndarray:
    """Outputs every `coarse` seconds, over which the commands are held, whatever the model's own sample."""
    x, found = model.initial(y0), []
    for k in range(count):
        found.append(model.output(x))
        for _ in range(round(coarse / model.dt)):
            x = model.step(x, commands(plant, k))
    return np.array([*found, model.output(x)])


def orders(
    plant: Plant, make: Callable[[Plant], Any], y0: np.ndarray, coarse: float, divisions: tuple, exact: np.ndarray
) -> np.ndarray:
    """The order in dt of each output that differs from the exact one, from two sample times."""
    errors = []
    for division in divisions:
        fine = replace(plant, dt=coarse / division)
        errors.append(np.abs(run(make(fine), y0, fine, coarse) - exact).max(axis=0))
    moving = errors[-1] > 1e-12
    return np.log2(errors[-2][moving] / errors[-1][moving])


def glider(**effects: float) -> Plant:
    return replace_at(load_vehicle("slocum"), {f"effects.{name}": value for name, value in effects.items()})


def torpedo(effects: dict[str, float] | None = None) -> Plant:
    # RK4 in steps so short that only the splice's own error shows
    return replace(replace_at(load_vehicle("remus100"), effects or {}), longest_step=0.0125)


# The model is the plant itself.


@pytest.mark.slow
@pytest.mark.parametrize("outputs", [("r_radps",), ("heading_rad",), ("heading_rad", "r_radps")])
def test_a_glider_spliced_with_its_twin_is_the_glider_to_second_order(outputs):
    plant = replace(glider(**{"current.north": 0.1}), longest_step=0.1)
    alone = run(plant, start(plant), plant, plant.dt)
    together = run(splice(plant, Twin(plant, outputs)), start(plant), plant, plant.dt)
    for index, name in enumerate(plant.outputs):
        # a sample is 4 s, in which the rudder turns the glider by up to 0.07 rad at 0.3 m/s
        assert together[:, index] == pytest.approx(alone[:, index], abs=1e-12 if name in outputs else 0.01), name
    found = orders(plant, lambda fine: splice(fine, Twin(fine, outputs)), start(plant), plant.dt, (8, 16), alone)
    assert found.size >= 2
    assert found == pytest.approx(2.0, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("effects", [{}, WATER], ids=["still water", "current, shear and waves"])
def test_body_velocities_of_a_twin_move_the_whole_pose(effects):
    plant = torpedo(effects)
    alone = run(replace(plant, dt=0.0125), start(plant, u_mps=1.5), plant, 0.8)
    assert np.ptp(alone[:, plant.outputs.index("heading_rad")]) > 0.1

    def spliced(fine: Plant) -> Spliced:
        return splice(fine, Twin(fine, BODY))

    fine = replace(plant, dt=0.05)
    together = run(spliced(fine), start(plant, u_mps=1.5), plant, 0.8)
    for index, name in enumerate(plant.outputs):
        assert together[:, index] == pytest.approx(alone[:, index], abs=1e-12 if name in BODY else 0.01), name
    found = orders(plant, spliced, start(plant, u_mps=1.5), 0.8, (16, 32), alone)
    assert found.size >= 6
    assert found == pytest.approx(2.0, abs=0.1)


@pytest.mark.slow
def test_a_turn_at_constant_velocities_is_exact_at_any_sample():
    plant = replace(torpedo(), dt=1.0)
    u, v, w, p, q, r = still = np.array([1.5, 0.1, -0.2, 0.0, 0.0, 0.3])
    model = splice(plant, Linear(BODY))
    x = model.initial(start(plant, **dict(zip(BODY, still))))
    for _ in range(50):
        x = model.step(x, np.zeros(3))
    found = dict(zip(plant.outputs, model.output(x)))
    t = 50.0
    assert found["heading_rad"] == pytest.approx(r * t)  # past two turns, without a jump
    assert found["north_m"] == pytest.approx((u * sin(r * t) + v * (cos(r * t) - 1.0)) / r)
    assert found["east_m"] == pytest.approx((u * (1.0 - cos(r * t)) + v * sin(r * t)) / r)
    assert found["depth_m"] == pytest.approx(w * t)


def test_a_loop_goes_through_the_vertical():
    plant = replace(torpedo(), dt=0.5)
    still = {"u_mps": 1.5, "q_radps": 2.0 * pi / 12.0}
    model = splice(plant, Linear(BODY, dt=0.5))
    x = model.initial(start(plant, heading_rad=0.3, **still))
    depths, radius = [], 1.5 / still["q_radps"]
    for _ in range(24):
        x = model.step(x, np.zeros(3))
        depths.append(x[plant.states.index("depth_m")])
    assert depths == pytest.approx(-radius * (1.0 - np.cos(2.0 * pi * np.arange(1, 25) / 24.0)), abs=1e-9)
    pose = dict(zip(plant.outputs, model.output(x)))
    assert [pose["north_m"], pose["east_m"], pose["pitch_rad"]] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    for name in ("roll_rad", "heading_rad"):  # back where it was, whatever happened at the vertical
        assert cos(pose[name] - (0.3 if name == "heading_rad" else 0.0)) == pytest.approx(1.0, abs=1e-12)


# The model is another one.


@pytest.mark.parametrize("output", ["heading_rad", "u_mps", "depth_m"])
def test_all_channels_are_of_second_order_when_another_model_drives_one(output):
    plant = replace(torpedo(WATER), longest_step=0.8 / 256)  # the same RK4 step at all sample times

    def spliced(fine: Plant) -> Spliced:
        return splice(fine, lag(output, fine.dt))

    y0 = start(plant, u_mps=1.5, depth_m=20.0)  # well below the surface, where the motion of waves has a corner
    exact = run(spliced(replace(plant, dt=0.8 / 256)), y0, plant, 0.8)
    found = orders(plant, spliced, y0, 0.8, (16, 32), exact)
    assert found.size >= 12
    assert found == pytest.approx(2.0, abs=0.1)


def test_a_linear_model_of_heading_drives_a_glider():
    plant = glider(**{"current.east": 0.05, "compass.bias": 0.1})
    model = splice(plant, Linear(("heading_rad",), c=0.06, dt=plant.dt))
    assert isinstance(model, Model)
    assert model.driven == ("heading_rad",)
    assert model.states == (*plant.states, "model: heading_rad")
    x = model.initial(start(plant, heading_rad=0.3))
    for k in range(30):
        x = model.step(x, commands(plant, k))
    found = dict(zip(model.outputs, model.output(x)))
    speed, rate, t = plant.hull.speed, 0.06 / plant.dt, 30 * plant.dt
    first, last = 0.2, 0.2 + 30 * 0.06  # the compass shows 0.1 more
    assert found["heading_rad"] == pytest.approx(last + 0.1, abs=1e-12)
    assert found["north_m"] == pytest.approx(speed * (sin(last) - sin(first)) / rate)
    assert found["east_m"] == pytest.approx(speed * (cos(first) - cos(last)) / rate + 0.05 * t)
    alone = plant.initial(start(plant, heading_rad=0.3))
    for k in range(30):
        alone = plant.step(alone, commands(plant, k))
    # what is not driven is still the plant's
    assert found["r_radps"] == pytest.approx(plant.output(alone)[plant.outputs.index("r_radps")], abs=1e-12)


def test_the_compass_lags_behind_the_driven_heading():
    plant = glider(**{"compass.lag": 5.0})
    model = splice(plant, Linear(("heading_rad",), c=0.2, dt=plant.dt))
    x = model.initial(start(plant))
    for _ in range(40):
        x = model.step(x, commands(plant, 0))
    true = x[model.states.index("model: heading_rad")]
    assert true == pytest.approx(8.0)
    # a first-order lag follows a ramp by its time constant; the start has died away as exp(-32)
    assert model.output(x)[0] == pytest.approx(true - 5.0 * 0.2 / plant.dt, abs=1e-12)


@pytest.mark.parametrize("driven", [("u_mps",), ("u_mps", "north_m")])
def test_the_vehicle_meets_the_waves_where_it_is(driven):
    plant = replace(torpedo(WATER), dt=0.5)
    model = splice(plant, Linear(driven, c=np.array([0.02, 0.3])[: len(driven)], dt=0.5))
    x = model.initial(start(plant, u_mps=1.0, heading_rad=0.3, depth_m=10.0))
    for k in range(20):
        x = model.step(x, commands(plant, k))
    at = dict(zip(model.states, x))
    waves = plant.effects.waves
    omega = 2.0 * pi / waves.period
    along = at["north_m"] * cos(waves.direction) + at["east_m"] * sin(waves.direction)
    expected = omega * 10.0 - omega**2 / plant.hull.gravity * along
    assert at["wave_phase_rad"] == pytest.approx(expected, abs=1e-12)


def test_a_heading_that_the_model_wraps_is_the_same_heading():
    class Wrapping(Linear):
        def output(self, x):
            return (x + pi) % (2.0 * pi) - pi

    plant = replace(torpedo(WATER), dt=0.1)
    ends = []
    for kind in (Linear, Wrapping):
        model = splice(plant, kind(("heading_rad",), c=0.05, dt=0.1))
        x = model.initial(start(plant, u_mps=1.5, heading_rad=3.0, depth_m=10.0))
        for k in range(80):
            x = model.step(x, commands(plant, k))
        ends.append(dict(zip(model.outputs, model.output(x))))
    assert ends[0]["heading_rad"] == pytest.approx(7.0)
    assert ends[1] == pytest.approx({**ends[0], "heading_rad": 7.0 - 2.0 * pi})


@pytest.mark.parametrize("other", ["slocum", "npsauv"])
def test_the_actuators_of_any_parts_are_the_plants(other):
    """Of vehicles with other parts, one after the other: each has compiled code of its own."""
    for name in ("remus100", other, "remus100"):
        plant = load_vehicle(name)
        model = splice(plant, Linear(("q_radps" if "q_radps" in plant.states else "r_radps",), 0.9, 0.01, dt=plant.dt))
        x, alone = model.initial(start(plant, u_mps=1.2)), plant.initial(start(plant, u_mps=1.2))
        for k in range(5):
            x, alone = model.step(x, commands(plant, k)), plant.step(alone, commands(plant, k))
        moved = [index for index, state in enumerate(plant.states) if state.endswith((" position", " play"))]
        assert len(moved) == 2 * len(plant.family.actuators)
        for index in moved:
            assert x[model.states.index(plant.states[index])] == alone[index] != 0.0, name


def test_a_model_sees_what_the_plant_computes():
    plant = replace(replace_at(torpedo(), "effects.gyros.bias_q", 0.5), dt=0.1)
    names = ("q_radps", "u_dvl_mps", "stern_plane_rad")
    model = splice(plant, Linear(("depth_m",), a=0.0, b=1.0, inputs=names, dt=0.1))
    x = model.step(model.initial(start(plant, u_mps=1.2, q_radps=0.7)), np.array([0.0, 0.03, 0.0]))
    # the rate itself, not the gyro's biased reading
    assert x[model.states.index("model: depth_m")] == pytest.approx(0.2 + 1.2 + 0.03)
    assert model.output(x)[plant.outputs.index("depth_m")] == pytest.approx(1.43)


# What holds for every model.

GLIDER_EFFECTS = {
    "effects.rudder.lag": 1.0,
    "effects.rudder.dead_time": 1.5,
    "effects.compass.lag": 2.0,
    "effects.compass.deviation_sin": 0.05,
    "effects.current.east": 0.1,
}


def models() -> dict[str, Spliced]:
    slocum = load_vehicle("slocum")
    affected = replace_at(slocum, GLIDER_EFFECTS)
    remus, nps = (
        replace_at(load_vehicle(name), {**WATER, "effects.gyros.lag": 0.3, "effects.dvl_ground.lag": 0.5})
        for name in ("remus100", "npsauv")
    )
    return {
        "glider, heading": splice(slocum, lag("heading_rad", slocum.dt)),
        "glider, rate, with effects": splice(affected, lag("r_radps", slocum.dt)),
        "torpedo, rates": splice(remus, Linear(RATES, 0.9, 0.05, inputs=("rudder_rad",), dt=remus.dt)),
        "torpedo, pitch and speed": splice(
            remus, Linear(("pitch_rad", "u_mps"), 0.9, 1e-4, inputs=("propeller_rpm",), dt=remus.dt)
        ),
        "torpedo of other parts": splice(nps, Linear(RATES, 0.9, 0.05, inputs=("bow_plane_rad",), dt=nps.dt)),
    }


# compiled for these tests only
SELDOM = "torpedo of other parts"


@pytest.fixture(params=[pytest.param(n, marks=[pytest.mark.slow] if n == SELDOM else []) for n in models()])
def spliced(request) -> Spliced:
    return models()[request.param]


def test_it_keeps_the_protocol(spliced):
    assert isinstance(spliced, Model)
    assert (spliced.inputs, spliced.outputs) == (spliced.plant.inputs, spliced.plant.outputs)
    assert len(set(spliced.states)) == len(spliced.states)
    x = spliced.initial(start(spliced, u_mps=1.0))
    u = commands(spliced, 3)
    x_before, u_before, y_before = x.copy(), u.copy(), spliced.output(x)
    first, second = spliced.step(x, u), spliced.step(x, u)
    assert np.array_equal(first, second)
    assert np.array_equal(x, x_before)
    assert np.array_equal(u, u_before)
    assert np.array_equal(spliced.output(x), y_before)
    for state in (x, first, spliced.correct(first, y_before)):
        assert (state.shape, state.dtype) == ((len(spliced.states),), np.float64)
    assert spliced.output(first).shape == (len(spliced.outputs),)


def test_initial_and_correct_meet_what_was_measured(spliced):
    y = start(spliced, u_mps=0.9, v_mps=0.05, heading_rad=0.4, pitch_rad=0.1, r_radps=0.02, depth_m=5.0, east_m=2.0)
    free = [not name.endswith("dvl_mps") for name in spliced.outputs]  # those follow from the others
    assert spliced.output(spliced.initial(y))[free] == pytest.approx(y[free], abs=1e-12)
    x = spliced.step(spliced.initial(y), commands(spliced, 3))
    assert spliced.output(spliced.correct(x, y))[free] == pytest.approx(y[free], abs=1e-12)
    assert np.array_equal(spliced.correct(x, np.full(y.size, np.nan)), x)


def test_simulation_predicts_itself(spliced):
    time = spliced.dt * np.arange(30)
    table = np.array([commands(spliced, k) for k in range(30)])
    given = {name: table[:, i] for i, name in enumerate(spliced.inputs)}
    begin = {"u_mps": np.full(30, 1.0)} if "u_mps" in spliced.outputs else {}
    made = simulate(spliced, Record.from_arrays(time, {**given, **begin}))
    assert np.ptp(made[spliced.driven[0]]) > 1e-3
    again = predict(spliced, made, 5)
    for name in spliced.outputs:
        # sensors that lag are corrected within the tolerance of a fixed point
        assert again[name] == pytest.approx(made[name], abs=1e-9), name


def test_correcting_leaves_to_the_model_what_it_makes_of_a_measurement():
    class Stubborn(Linear):
        def correct(self, x, y):
            return x + 0.25 * np.nan_to_num(y - x)

    plant = glider()
    model = splice(plant, Stubborn(("heading_rad",), dt=plant.dt))
    x = model.correct(model.initial(start(plant)), start(plant, heading_rad=0.8, north_m=3.0))
    assert dict(zip(model.outputs, model.output(x))) == pytest.approx(
        {"heading_rad": 0.2, "r_radps": 0.0, "north_m": 3.0, "east_m": 0.0}
    )


def test_a_model_that_grows_without_bound_is_told_by_name():
    plant = glider()
    model = splice(plant, Linear(("r_radps",), 1e200, c=1.0, dt=plant.dt))
    record = Record.from_arrays(plant.dt * np.arange(20), {"rudder_rad": np.zeros(20)})
    with pytest.raises(Diverged, match="is not finite at"), np.errstate(all="ignore"):
        simulate(model, record)


def test_it_drives_an_environment():
    plant = load_vehicle("slocum")
    model = splice(plant, lag("heading_rad", plant.dt))
    env = gymnasium.make("auv_gym.envs:auv_gym/GliderHeading-v0", vehicle="slocum", model=model)
    env.reset(seed=1, options={"start": {"heading_rad": 0.0}, "target": 0.5})
    for _ in range(10):
        observation, _, terminated, _, info = env.step(np.array([1.0], dtype=np.float32))
    assert not terminated
    assert env.observation_space.contains(observation)
    gone = 2.0 * plant.hull.rudder_limit * (1.0 - exp(-10.0 * plant.dt / 1.5))
    assert info["state"]["heading_rad"] == pytest.approx(gone)
    assert info["state"]["north_m"] > 1.0


# What does not fit.

REFUSED = {
    "no plant": (lambda: splice(3, lag("heading_rad", 4.0)), "needs a plant first, got int"),
    "no model": (lambda: splice(glider(), "model.npz"), "needs a model second, got str"),
    "another sample": (
        lambda: splice(glider(), lag("heading_rad", 1.0)),
        "steps 1 s at a time and slocum 4 s: fit the model to record.resample(4), or splice it into "
        "dataclasses.replace(plant, dt=1)",
    ),
    "unknown input": (
        lambda: splice(glider(), Linear(("heading_rad",), inputs=("rudder_cmd_rad",), dt=4.0)),
        "needs the input rudder_cmd_rad, which slocum neither takes nor computes. Did you mean 'rudder_rad'",
    ),
    "no outputs": (lambda: splice(glider(), Linear((), dt=4.0)), "The model has no outputs"),
    "an input as output": (lambda: splice(glider(), lag("u_mps", 4.0)), "gives u_mps, which it cannot drive in slocum"),
    "a reading": (
        lambda: splice(torpedo(), lag("u_dvl_mps", torpedo().dt)),
        "gives u_dvl_mps, which it cannot drive in remus100. Did you mean ",
    ),
    "a rate that is not the whole turn": (
        lambda: splice(load_vehicle("ganeshblue_corrected", dt=4.0), lag("r_radps", 4.0)),
        "'hull.rudder_heading_rate', 0.0)",
    ),
}


@pytest.mark.parametrize("make, words", REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_refused_by_name(make, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        make()


def test_the_offered_ways_out_lead_out():
    plant = glider()
    assert splice(replace(plant, dt=1.0), lag("heading_rad", 1.0)).dt == 1.0
    corrected = replace_at(load_vehicle("ganeshblue_corrected", dt=4.0), "hull.rudder_heading_rate", 0.0)
    assert splice(corrected, lag("r_radps", 4.0)).driven == ("r_radps",)


def test_a_state_of_another_size_is_refused():
    model = splice(glider(), lag("heading_rad", 4.0))
    with pytest.raises(ValueError, match=r"has shape \(\d+,\), got \(3,\): see `initial`"):
        model.step(np.zeros(3), commands(model, 0))


# Plain Python.


def trajectories() -> dict[str, np.ndarray]:
    daily = {name: model for name, model in models().items() if name != SELDOM}
    return {name: run(model, start(model, u_mps=1.0), model.plant, model.dt, 8) for name, model in daily.items()}


def test_plain_python_agrees_with_compiled_code(tmp_path):
    out = tmp_path / "plain.npz"
    run_plain(__file__, out)
    with np.load(out) as plain:
        for name, compiled in trajectories().items():
            assert plain[name] == pytest.approx(compiled, rel=1e-10, abs=1e-11), name  # rounded a thousand times


if __name__ == "__main__":
    np.savez(sys.argv[1], **trajectories())
