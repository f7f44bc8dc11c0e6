"""Effects of a profiling float act as documented: volumes, water, tether, oil, piston, depth sensor; and which way."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st

from auv_gym.param import list_paths, replace_at, spec_at
from auv_gym.physics.buoyancy import ATMOSPHERE
from auv_gym.plant import Plant, load_vehicle
from auv_gym.vehicles.profiling_float import FLOAT_PISTON, FloatParameters
from tests.vehicles.float_runs import run

GRAVITY = 9.81
DENSITY, MASS, VIRTUAL_MASS = 1000.0, 60.0, 75.0  # of the float below


def diver(effects: dict[str, float] | None = None, hull: dict[str, float] | None = None, **times: float) -> Plant:
    """A float with a piston of 2 L/m between -0.05 and 0.05 m, neutral at 0, with these effects."""
    values = {f"effects.{path}": value for path, value in (effects or {}).items()}
    values |= {f"hull.{path}": value for path, value in (hull or {}).items()}
    parameters = replace_at(FloatParameters(), values)
    return Plant("diver", FLOAT_PISTON, parameters, **{"dt": 1.0, "longest_step": 0.25, **times})


def rates(plant: Plant, depth=100.0, rate=0.0, volume=0.0, actuators=(0.0, 15.0), **inputs: float) -> np.ndarray:
    """The derivative of depth, depth rate, unknown volume and clock."""
    u = np.array([{**plant.constants, **inputs}.get(name, 0.0) for name in plant.inputs])
    dz, z = np.empty(4), np.array([depth, rate, volume, 0.0])
    plant.family.hooks.derivative(z, np.array(actuators), u, plant.family.view(plant.derived), dz, np.empty(1))
    return dz


# What lifts

WEIGHT_OF_WATER = DENSITY * GRAVITY
DENSER = MASS / DENSITY**2  # m^3 of lift per kg/m^3
LIFTS = {
    "unknown volume": ({}, {"volume": 3e-5}, 3e-5),
    "oil": ({}, {"oil_volume_m3": -2e-5}, -2e-5),
    "piston": ({}, {"actuators": (0.02, 15.0)}, 4e-5),
    "denser water": ({}, {"density_kgpm3": 1001.5}, 1.5 * DENSER),
    "denser water, read above": (
        {},
        {"density_kgpm3": 1001.5, "density_gradient_kgpm4": 0.02, "density_depth_m": 90.0},
        1.7 * DENSER,
    ),
    "stratification": ({"water.gradient": 0.02}, {}, 2.0 * DENSER),
    "initial volume": ({"volume.offset": -2e-5}, {}, -2e-5),
    "compressibility": ({"volume.compressibility": 1.1e-7}, {}, 1.1e-5),
    "trapped air": ({"volume.air": 4e-5}, {}, 4e-5 / (1.0 + WEIGHT_OF_WATER * 100.0 / ATMOSPHERE)),
    "warm hull": ({"volume.expansion": 2e-6}, {"actuators": (0.0, 19.0)}, 8e-6),
    "leak": ({"volume.leak": 3e-9}, {"elapsed_s": 4000.0}, -1.2e-5),
    "pump": ({"oil.pump_gain": 0.1}, {"pumped_volume_m3": 2e-4}, 2e-5),
    "valve": ({"oil.valve_gain": 0.1}, {"valved_volume_m3": 2e-4}, -2e-5),
    "valve under pressure": ({"oil.valve_with_depth": 1e-4}, {"valved_depth_m4": 0.1}, -1e-5),
}


@pytest.mark.parametrize("effects, at, volume", LIFTS.values(), ids=LIFTS)
def test_a_volume_lifts_by_the_weight_of_its_water(effects, at, volume):
    found = rates(diver(effects), **at)
    assert found[1] == pytest.approx(-WEIGHT_OF_WATER * volume / VIRTUAL_MASS, rel=1e-10)
    assert np.array_equal(found[2:], [0.0, 1.0])


def test_volumes_add_up():
    effects = {path: value for more, _, _ in LIFTS.values() for path, value in more.items()}
    at = {name: value for _, there, _ in LIFTS.values() for name, value in there.items()} | {"actuators": (0.02, 19.0)}
    total = sum(volume for name, (_, _, volume) in LIFTS.items() if name != "denser water")  # there read higher up
    assert rates(diver(effects), **at)[1] == pytest.approx(-WEIGHT_OF_WATER * total / VIRTUAL_MASS, rel=1e-10)


def test_a_tether_pulls_up_and_drags_as_far_as_it_is_paid_out():
    assert rates(diver({"tether.pull": 0.3}))[1] == pytest.approx(-0.3 / VIRTUAL_MASS, rel=1e-13)
    paid_out = diver({"tether.drag": 0.2}), diver(hull={"drag_quadratic": 14.0 + 0.2 * 40.0})
    assert rates(paid_out[0], 40.0, 0.3)[1] == pytest.approx(rates(paid_out[1], 40.0, 0.3)[1], rel=1e-13)
    assert rates(paid_out[0], -0.2, 0.3)[1] == rates(diver(), -0.2, 0.3)[1]


def test_errors_of_drag_are_another_hull():
    wrong = diver({"drag.quadratic": 0.25, "drag.linear": -0.5})
    right = diver(hull={"drag_quadratic": 17.5, "drag_linear": 3.0})
    for rate in (-0.4, 0.1):
        assert rates(wrong, rate=rate)[1] == pytest.approx(rates(right, rate=rate)[1], rel=1e-14)


# Water that moves


@given(current=st.floats(-0.3, 0.3), rate=st.floats(-0.3, 0.3), lift=st.floats(-1e-4, 1e-4))
def test_a_current_carries_the_float(current, rate, lift):
    t = np.array([0.0, 3.0, 10.0, 40.0])
    still = run(diver(), t, rate=rate, volume=lift)
    carried = run(diver({"water.current": current}), t, rate=rate + current, volume=lift)
    # steps are cut by the speed over ground, so the two do not round, nor err, alike
    assert carried - still == pytest.approx(np.stack([current * t, np.full(4, current)], axis=1), abs=1e-7)


@pytest.mark.parametrize("drag", [0.0, 6.0])
def test_a_neutral_float_goes_with_an_internal_wave(drag):
    """Exactly, with drag or without, whatever its added mass: the water's acceleration acts on all of it."""
    wave = {"water.heave_sin": 0.03, "water.heave_cos": -0.02, "water.heave_period": 120.0, "water.current": 0.01}
    plant = diver(wave, {"added_mass": 33.0, "drag_linear": drag})
    t = np.array([0.0, 7.0, 20.0, 60.0, 61.0, 120.0, 300.0])
    found = run(plant, t, rate=-0.01)
    phase = 2.0 * math.pi * t / 120.0
    size = 120.0 / (2.0 * math.pi)
    moved = 0.01 * t + size * (0.03 * (1.0 - np.cos(phase)) - 0.02 * np.sin(phase))
    assert found[:, 0] == pytest.approx(100.0 + moved, abs=1e-6)
    assert found[:, 1] == pytest.approx(0.01 + 0.03 * np.sin(phase) - 0.02 * np.cos(phase), abs=1e-8)


@pytest.mark.parametrize("drag", [0.0, 6.0])
def test_a_neutral_float_goes_with_water_that_moves_faster_with_depth(drag):
    """Its depth grows as the water's does, exponentially; the surface stays where it is."""
    plant = diver({"water.current_with_depth": 2e-3}, {"added_mass": 33.0, "drag_linear": drag})
    t = np.array([0.0, 7.0, 60.0, 61.0, 300.0])
    depth = 100.0 * np.exp(2e-3 * t)
    found = run(plant, t, rate=0.2)
    assert found == pytest.approx(np.stack([depth, 2e-3 * depth], axis=1), rel=1e-7)
    assert rates(plant, depth=-0.1)[1] == rates(diver(hull={"added_mass": 33.0, "drag_linear": drag}), depth=-0.1)[1]


def test_the_phase_of_a_wave_is_that_of_the_dive():
    wave = {"water.heave_sin": 0.05, "water.heave_period": 200.0}
    at_crest = rates(diver(wave), rate=0.05, elapsed_s=50.0)
    assert at_crest[:2] == pytest.approx([0.05, 0.0], abs=1e-16)
    rising = rates(diver(wave), elapsed_s=200.0)
    assert rising[1] == pytest.approx(0.05 * 2.0 * math.pi / 200.0, rel=1e-12)


def test_without_inertia_current_and_wave_add_to_the_terminal_speed():
    plant = replace_at(load_vehicle("mermaid"), {"effects.water.current": 0.02, "effects.water.heave_cos": 0.03})
    still = rates(load_vehicle("mermaid"), volume=1e-4)[0]
    assert rates(plant, volume=1e-4)[0] == pytest.approx(still + 0.05, rel=1e-14)
    plant = replace_at(load_vehicle("mermaid"), "effects.water.current_with_depth", 1e-4)
    assert rates(plant, 300.0, volume=1e-4)[0] == pytest.approx(still + 0.03, rel=1e-14)


# The hull's temperature and the piston


def positions(plant: Plant, name: str, commands, seconds: float = 1.0) -> np.ndarray:
    """Where an actuator stands after each sample, under commands held for a sample each; from rest at depth."""
    plant, x, found = replace(plant, dt=seconds), replace(plant, dt=seconds).initial(np.array([50.0, 0.0])), []
    for command in commands:
        u = np.array([{**plant.constants, name: command}.get(i, 0.0) for i in plant.inputs])
        x = plant.step(x, u)
        found.append(x[plant.states.index(f"{name} position")])
    return np.array(found)


def test_the_hull_follows_the_waters_temperature_with_a_lag():
    plant = diver({"volume.expansion": 2e-6, "volume.expansion_lag": 300.0})
    found = positions(plant, "temperature_C", np.full(20, 5.0), 60.0)
    assert found == pytest.approx(15.0 - 10.0 * -np.expm1(-60.0 * np.arange(1, 21) / 300.0), abs=1e-10)
    assert np.array_equal(positions(diver(), "temperature_C", [5.0, 8.0]), [5.0, 8.0])


def test_a_hull_that_cools_late_sinks_late():
    """Closed form: V = e (T - T0) (1 - exp(-t/lag)), in still water with linear drag alone."""
    e, lag, a = 2e-6, 200.0, 30.0
    plant = diver(
        {"volume.expansion": e, "volume.expansion_lag": lag}, {"drag_linear": a, "drag_quadratic": 1e-3, "mass": 20.0}
    )
    t = np.arange(0.0, 1500.0, 25.0)
    temperature = np.where(t < 25.0, 15.0, 5.0)
    found = run(plant, t, temperature_C=temperature)
    since = np.maximum(t - 25.0, 0.0)
    top, tau = WEIGHT_OF_WATER * e * 10.0 / a, 35.0 / a
    expected = top * (1.0 - (lag * np.exp(-since / lag) - tau * np.exp(-since / tau)) / (lag - tau))
    # the least quadratic drag: 1e-3 of 30 kg/s at a millimetre a second
    assert found[:, 1] == pytest.approx(expected, abs=2e-6)


@pytest.mark.parametrize(
    "effects, commands, expected",
    [
        ({}, [0.53], 0.53),
        ({}, [0.8], 0.6),
        ({}, [0.3], 0.5),
        ({"gain": 0.8}, [0.53], 0.55 - 0.8 * 0.02),
        ({"gain": 2.0}, [0.54], 0.55 - 2.0 * 0.01),
        ({"gain": 2.0}, [0.51], 0.5),
        ({"offset": 5e-3}, [0.53], 0.535),
        ({"offset": 5e-3}, [0.6], 0.6),
        ({"backlash": 0.01}, [0.552], 0.55),
        ({"backlash": 0.01}, [0.53], 0.535),
        ({"backlash": 0.01}, [0.53, 0.538], 0.535),
        ({"backlash": 0.01}, [0.53, 0.58], 0.575),
        ({"stiction": 0.01}, [0.545], 0.55),
        ({"stiction": 0.01}, [0.545, 0.535, 0.53], 0.535),
        ({"dead_time": 2.0}, [0.53, 0.57], 0.55),
        ({"dead_time": 2.0}, [0.53, 0.57, 0.57], 0.53),
    ],
)
def test_where_a_piston_ends_up(effects, commands, expected):
    """From the middle of its range, 0.55 m: gain is about there, backlash starts in the middle of its play."""
    plant = replace_at(load_vehicle("qiandao_float"), "hull.piston_slowness", 0.0)
    plant = replace_at(plant, {f"effects.piston.{name}": value for name, value in effects.items()})
    assert positions(plant, "piston_m", commands)[-1] == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("slower", [0.0, 150.0])
def test_a_slower_piston_and_one_with_lag(slower):
    plant = replace_at(load_vehicle("qiandao_float"), {"effects.piston.slowness": slower, "effects.piston.lag": 2.0})
    rate, t = 1.0 / (250.0 + slower), np.arange(1.0, 31.0)
    found = positions(plant, "piston_m", np.full(30, 0.59)) - 0.55
    run_in = 0.04 / rate - 2.0  # at full rate until lag times rate are left
    expected = np.where(t < run_in, rate * t, 0.04 - 2.0 * rate * np.exp(-np.maximum(t - run_in, 0.0) / 2.0))
    assert found == pytest.approx(expected, abs=1e-12)


# The depth sensor


def test_a_depth_sensor_with_bias_and_scale():
    plant = diver({"depth.bias": 0.5, "depth.scale": 0.02})
    found = run(plant, [0.0, 1.0], depth=30.0)
    # runs start from true states
    assert found[0] == pytest.approx([30.0 * 1.02 + 0.5, 0.0], abs=1e-12)
    x = plant.initial(np.array([30.0, 0.1]))
    assert plant.output(x) == pytest.approx([30.0, 0.1], rel=1e-12)
    assert x[0] == pytest.approx((30.0 - 0.5) / 1.02, rel=1e-12)


def test_a_lagging_depth_sensor_is_behind_by_lag_times_rate():
    """From the first sample on: it has been at this speed for long. The rate is the true one."""
    plant = diver({"depth.lag": 3.0, "depth.scale": 0.1})
    speed = (-6.0 + math.sqrt(36.0 + 56.0 * WEIGHT_OF_WATER * 5e-5)) / 28.0
    t = np.arange(0.0, 50.0, 5.0)
    found = run(plant, t, rate=speed, volume=-5e-5)
    assert found[:, 0] == pytest.approx(1.1 * (100.0 + speed * (t - 3.0)), abs=1e-9)
    assert found[:, 1] == pytest.approx(np.full(10, speed), abs=1e-12)


def test_a_lagging_depth_sensor_is_a_first_order_filter():
    lag, step = 4.0, 0.05
    t = np.arange(0.0, 60.0, step)
    piston = 0.05 * np.sign(np.sin(0.3 * t))
    true, found = (
        run(diver({"depth.lag": value}, longest_step=step), t, piston_m=piston)[:, 0] for value in (0.0, lag)
    )
    filtered = [true[0]]
    for before, after in pairwise(true):
        slope = (after - before) / step
        filtered.append(after - slope * lag + (filtered[-1] - before + slope * lag) * math.exp(-step / lag))
    assert np.abs(found - true).max() > 0.1
    assert found == pytest.approx(np.array(filtered), abs=1e-10)


# Which way each of them goes

DEEPER, SHALLOWER = 1.0, -1.0
# of a float that begins to rise in water that gets warmer, whose pump and valve have run
DIRECTIONS = {
    "piston.offset": SHALLOWER,
    "piston.gain": SHALLOWER,
    "piston.backlash": DEEPER,
    "piston.stiction": DEEPER,
    "piston.dead_time": DEEPER,
    "piston.lag": DEEPER,
    "piston.slowness": DEEPER,
    "volume.offset": SHALLOWER,
    "volume.compressibility": SHALLOWER,
    "volume.air": SHALLOWER,
    "volume.expansion": SHALLOWER,
    "volume.expansion_lag": DEEPER,
    "volume.leak": DEEPER,
    "water.gradient": SHALLOWER,
    "water.current": DEEPER,
    "water.current_with_depth": DEEPER,
    "water.heave_sin": DEEPER,
    "water.heave_cos": DEEPER,
    "water.heave_period": SHALLOWER,
    "tether.pull": SHALLOWER,
    "tether.drag": DEEPER,
    "drag.quadratic": DEEPER,
    "drag.linear": DEEPER,
    "oil.pump_gain": SHALLOWER,
    "oil.valve_gain": DEEPER,
    "oil.valve_with_depth": DEEPER,
    "depth.bias": DEEPER,
    "depth.scale": DEEPER,
    "depth.lag": DEEPER,
    "clock.rate": DEEPER,
    "clock.delay": DEEPER,
}
# what a companion needs to be seen
NEEDED = {"volume.expansion_lag": {"volume.expansion": 1e-6}, "water.heave_period": {"water.heave_sin": 0.02}}


def test_every_effect_that_may_be_probed_has_a_direction():
    plant = load_vehicle("qiandao_float")
    probed = [p for p in list_paths(plant) if p.startswith("effects.") and spec_at(plant, p).probe > 0.0]
    assert sorted(probed) == sorted(f"effects.{path}" for path in DIRECTIONS)


@pytest.mark.parametrize("path, direction", DIRECTIONS.items())
def test_one_probe_of_an_effect_moves_the_float_the_way_it_should(path, direction):
    plant = replace_at(load_vehicle("qiandao_float"), {f"effects.{p}": v for p, v in NEEDED.get(path, {}).items()})
    spec, t = spec_at(plant, f"effects.{path}"), np.arange(0.0, 100.0, 0.7)
    begun = t > 0.5
    inputs = {
        "piston_m": 0.55 + np.minimum(2.8e-3 * t, 0.0176),  # in steps below what a stiction of one probe lets pass
        "temperature_C": 20.0 + 4.0 * begun,
        "pumped_volume_m3": 3e-4,
        "valved_volume_m3": 2e-4,
        "valved_depth_m4": 0.05,
    }
    probed = replace_at(plant, f"effects.{path}", spec.neutral + spec.probe)
    change = (run(probed, t, depth=60.0, **inputs) - run(plant, t, depth=60.0, **inputs))[:, 0]
    assert direction * change[-1] > 2e-3
    assert np.min(direction * change) > -1e-9
