"""Vertical motion of a float: terminal speed, decay, energy, heave at the surface and in stratified water, presets."""

import math
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from auv_gym.param import list_paths, replace_at, spec_at
from auv_gym.plant import Plant, load_vehicle, save_vehicle
from auv_gym.records.record import Record, concat
from auv_gym.vehicles.profiling_float import FLOAT_PISTON, FloatParameters, steady_speed
from tests.vehicles.float_runs import run

FOLDER = Path(__file__).parents[2] / "auv_gym" / "vehicles" / "presets"
PRESETS = ("qiandao_float", "mermaid")
GUIDE = Path(__file__).parents[2] / "docs" / "vehicles.md"
GRAVITY = 9.81
MASS = 75.0  # kg, with added mass, of the float below
speeds = st.floats(-0.5, 0.5)


def diver(longest_step: float = 0.25, **hull: float) -> Plant:
    """A float of 60 kg and 15 kg of added mass in fresh water, its piston 2 L/m, but for these values of its hull."""
    values = {f"hull.{name}": value for name, value in hull.items()}
    return Plant("diver", FLOAT_PISTON, replace_at(FloatParameters(), values), dt=1.0, longest_step=longest_step)


def rates(plant: Plant, depth=100.0, rate=0.0, volume=0.0, piston=0.0, **inputs: float) -> np.ndarray:
    """The derivative of depth, depth rate, unknown volume and clock."""
    u = np.array([{**plant.constants, **inputs}.get(name, 0.0) for name in plant.inputs])
    actuators, dz = np.array([piston, plant.hull.temperature]), np.empty(4)
    z = np.array([depth, rate, volume, 0.0])
    plant.family.hooks.derivative(z, actuators, u, plant.family.view(plant.derived), dz, np.empty(1))
    return dz


# Drag


@pytest.mark.parametrize("lift", [2e-5, -2e-5, 1e-4, -3e-4])
@pytest.mark.parametrize("linear, quadratic", [(6.0, 14.0), (0.0, 14.0), (6.0, 1e-3), (1.0, 350.0)])
def test_a_lift_ends_in_its_terminal_speed(linear, quadratic, lift):
    plant = diver(drag_linear=linear, drag_quadratic=quadratic)
    force = 1000.0 * GRAVITY * abs(lift)
    expected = (-linear + math.sqrt(linear**2 + 4.0 * quadratic * force)) / (2.0 * quadratic)
    # started 5 % too slow, it is there after 15 times M/D'
    wait = 15.0 * MASS / (linear + 2.0 * quadratic * 0.9 * expected)
    found = run(plant, [0.0, wait], depth=2000.0, rate=-0.95 * math.copysign(expected, lift), volume=lift)
    assert found[-1, 1] == pytest.approx(-math.copysign(expected, lift), rel=1e-6)


@given(force=st.floats(-10.0, 10.0), linear=st.floats(0.0, 50.0), quadratic=st.floats(0.0, 500.0))
def test_drag_at_the_steady_speed_balances_the_force(force, linear, quadratic):
    if linear > 1e-6 or quadratic > 1e-6:
        speed = float(steady_speed(force, linear, quadratic))
        assert (linear + quadratic * abs(speed)) * speed == pytest.approx(force, rel=1e-12, abs=1e-300)
    else:
        assert steady_speed(0.0, 0.0, 0.0) == 0.0


def test_a_float_without_lift_slows_down_as_linear_and_quadratic_drag_make_it():
    """M w' = -(a + b |w|) w from w0: w = a w0 e / (a + b w0 (1 - e)) with e = exp(-a t / M)."""
    a, b, w0 = 6.0, 14.0, 0.4
    t = np.arange(0.0, 60.0, 2.0)
    found = run(diver(), t, rate=w0)
    gone = -np.expm1(-a * t / MASS)
    # the integrator: (0.25 s times 0.23 1/s)^4 / 120
    assert found[:, 1] == pytest.approx(a * w0 * (1.0 - gone) / (a + b * w0 * gone), abs=1e-8)
    assert found[:, 0] == pytest.approx(100.0 + MASS / b * np.log1p(b * w0 / a * gone), abs=1e-7)


def test_a_float_falls_against_quadratic_drag_as_a_hyperbolic_tangent():
    b, lack = 14.0, 5e-5
    top = math.sqrt(1000.0 * GRAVITY * lack / b)
    t = np.arange(0.0, 120.0, 3.0)
    found = run(diver(drag_linear=0.0), t, volume=-lack)
    assert found[:, 1] == pytest.approx(top * np.tanh(b * top * t / MASS), abs=1e-8)
    assert found[:, 0] == pytest.approx(100.0 + MASS / b * np.log(np.cosh(b * top * t / MASS)), abs=1e-7)


@given(rate=speeds, current=speeds, depth=st.floats(-0.5, 500.0), linear=st.floats(0.0, 50.0), tether=st.floats(0, 1.0))
def test_drag_never_adds_energy(rate, current, depth, linear, tether):
    plant = diver(drag_linear=linear)
    plant = replace_at(plant, {"effects.water.current": current, "effects.tether.drag": tether})
    drag = MASS * (rates(plant, depth, rate, 1e-5)[1] - rates(plant, depth, current, 1e-5)[1])
    assert drag * (rate - current) <= 0.0


@given(rate=speeds, volume=st.floats(-2e-4, 2e-4), piston=st.floats(-0.05, 0.05))
def test_up_is_the_mirror_image_of_down(rate, volume, piston):
    plant = diver(piston_square=2.0)
    one, other = rates(plant, 100.0, rate, volume, piston), rates(plant, 100.0, -rate, -volume, -piston)
    assert np.array_equal(other[:2], -one[:2])


def test_forces_are_those_of_equation_5_with_its_symbols():
    plant = load_vehicle("qiandao_float")
    hull, piston, w = plant.hull, 0.58, 0.12
    m_z, d_z = 60.0 + 15.0, 6.0 + 14.0 * 0.12
    n_1, n_2 = -998.0 * GRAVITY * 2e-3, -0.27
    neutral = n_1 * hull.piston_neutral + n_2 * hull.piston_neutral**2
    expected = (n_1 * piston + n_2 * piston * abs(piston) - neutral - d_z * w) / m_z
    assert rates(plant, 20.0, w, piston=piston)[:2] == pytest.approx([w, expected], rel=1e-13)


# Energy and waves


def stratified(gradient: float, **hull: float) -> Plant:
    return replace_at(diver(**hull), "effects.water.gradient", gradient)


@pytest.mark.parametrize("added_mass", [0.0, 15.0, 60.0])
def test_in_stratified_water_a_neutral_float_swings_at_the_buoyancy_frequency(added_mass):
    """N^2 = g/rho drho/dz, of a float whose added mass swings with it times m / (m + m_a).  Source: Gill 1982, 3.7."""
    gradient = 0.05
    plant = stratified(gradient, added_mass=added_mass, drag_linear=0.0, drag_quadratic=1e-3)
    omega = math.sqrt(GRAVITY / 1000.0 * gradient * 60.0 / (60.0 + added_mass))
    t = np.arange(0.0, 3.0 * 2.0 * math.pi / omega, 5.0)
    # neutral at 100 m, where the water is 5 kg/m^3 denser than at its trim
    found = run(plant, t, depth=101.0, volume=-0.060 * gradient * 100.0 / 1000.0)
    # what drag is left takes 4/(3 pi) b omega A^2 t / M = 1e-4 of a metre over three periods
    assert found[:, 0] == pytest.approx(100.0 + np.cos(omega * t), abs=2e-4)


def test_mechanical_energy_stays_without_drag_and_goes_as_drag_takes_it():
    gradient, lift = 0.05, -0.060 * 0.05 * 90.0 / 1000.0
    t = np.arange(0.0, 300.0, 0.25)

    def energies(plant):
        found = run(plant, t, depth=101.0, volume=lift)
        spring = GRAVITY * 60.0 / 1000.0 * gradient
        return 0.5 * MASS * found[:, 1] ** 2 + 0.5 * spring * (found[:, 0] - 90.0) ** 2, found[:, 1]

    free, _ = energies(stratified(gradient, drag_linear=0.0, drag_quadratic=1e-3))
    assert np.ptp(free) < 2e-3 * free[0]  # least quadratic drag
    slowed, w = energies(stratified(gradient))
    taken = np.concatenate([[0.0], np.cumsum(0.125 * np.add(*(((6 + 14 * abs(v)) * v**2) for v in (w[1:], w[:-1]))))])
    assert np.all(np.diff(slowed) <= 1e-12)
    assert slowed[-1] < 0.1 * slowed[0]
    assert slowed + taken == pytest.approx(np.full(t.size, slowed[0]), rel=1e-4)  # trapezoids of 0.25 s


def test_a_buoyant_float_rests_where_what_stands_out_weighs_its_lift():
    found = run(diver(), np.arange(0.0, 600.0, 5.0), depth=3.0, volume=9e-4)
    assert found[-1] == pytest.approx([-9e-4 / 0.03, 0.0], abs=1e-5)


def test_afloat_it_heaves_at_the_frequency_of_its_waterplane():
    plant = diver(0.02, drag_linear=0.0, drag_quadratic=1e-3)
    omega = math.sqrt(1000.0 * GRAVITY * 0.03 / MASS)
    t = np.arange(0.0, 20.0, 0.2)
    found = run(plant, t, depth=-0.05 + 0.02, volume=1.5e-3)
    assert found[:, 0] == pytest.approx(-0.05 + 0.02 * np.cos(omega * t), abs=1e-6)


@pytest.mark.parametrize("piston", [0.05, -0.05])
def test_long_steps_stay_stable_under_drag_and_at_the_surface(piston):
    """A sample of 20 s and steps as long: shortened where drag or the surface would make them unstable."""
    t = np.arange(0.0, 400.0, 20.0)
    coarse, fine = (run(diver(h), t, depth=15.0, rate=0.5, piston_m=piston) for h in (20.0, 0.05))
    assert coarse[:, 0] == pytest.approx(fine[:, 0], abs=0.05)
    assert coarse[:, 1] == pytest.approx(fine[:, 1], abs=0.03)  # bobbing at the surface, two steps a radian


# Integration


def test_fourth_order_at_uneven_samples_behind_a_piston_with_rate_limit_and_lag():
    lag = {"effects.piston.lag": 2.0, "effects.piston.slowness": 250.0}
    times = np.array([0.0, 1.0, 4.0, 5.0, 7.0, 12.0, 13.0, 20.0])
    # at full rate from 1 s to 11 s, where the lag takes over: between two steps
    piston = np.where(times < 1.0, 0.0, 0.048)

    def path(step):
        return run(replace_at(diver(step), lag), times, rate=-0.05, piston_m=piston)[1:]

    exact = path(1.0 / 16.0)

    def error(step):
        return np.sqrt(np.mean((path(step) - exact) ** 2, axis=0))

    assert np.log2(error(1.0) / error(0.5)) == pytest.approx([4.0, 4.0], abs=0.1)


def test_a_float_samples_as_it_likes():
    """The same times are reached whether the samples between them are even or not."""
    some = np.array([0.0, 10.0, 30.0, 60.0])
    many = np.unique(np.r_[some, np.random.default_rng(0).uniform(0.0, 60.0, 40)])
    few, all_of_them = (run(diver(0.1), t, rate=0.1, piston_m=0.02) for t in (some, many))
    assert all_of_them[np.isin(many, some)] == pytest.approx(few, abs=1e-9)


def test_time_in_a_dive_is_that_since_its_log_began():
    plant = replace_at(diver(), "effects.volume.leak", 1e-7)
    t = np.arange(0.0, 100.0, 5.0)
    one = Record.from_arrays(t, {"piston_m": np.zeros(t.size)})
    both = concat([one, one])
    start = np.array([[50.0, 0.0, 0.0]])
    first, second = np.split(plant.run(both, both.segments, np.repeat(start, 2, axis=0)), 2)
    assert np.array_equal(first, second)
    assert first[-1, 0] > 50.1
    # a window that starts within a dive has leaked before, and a record may say how long
    late = plant.run(both, [slice(10, 20)], start)
    said = Record.from_arrays(t[:10], {"piston_m": np.zeros(10), "elapsed_s": t[10:]})
    assert np.array_equal(late, plant.run(said, said.segments, start))
    assert late[-1, 0] > first[9, 0]


# Without inertia


def test_without_inertia_the_speed_is_terminal_at_once():
    plant = replace(load_vehicle("mermaid"), dt=1.0)
    found = run(plant, np.arange(0.0, 600.0, 10.0), depth=500.0, rate=0.0, volume=1e-4)
    expected = -float(steady_speed(1028.0 * GRAVITY * 1e-4, 1.0, 350.0))
    assert np.diff(found[:, 0]) == pytest.approx(np.full(59, 10.0 * expected), rel=1e-12)
    # the rate that is kept follows in half a minute
    t = np.arange(0.0, 600.0, 10.0)
    assert found[:, 1] == pytest.approx(-expected * np.expm1(-t / 30.0), abs=1e-4)


def test_a_float_without_inertia_is_the_limit_of_one_with_little():
    """To first order in the mass: what is left is halved with it."""
    t, oil = np.arange(0.0, 1200.0, 30.0), 1e-4 * np.sin(np.arange(40) / 4.0)
    still = run(replace(load_vehicle("mermaid"), longest_step=1.0), t, depth=300.0, oil_volume_m3=oil)[:, 0]

    def error(mass):
        moving = {"hull.quasi_steady": 0.0, "hull.mass": mass, "hull.added_mass": 0.0}
        plant = replace(replace_at(load_vehicle("mermaid"), moving), longest_step=0.05)
        return np.abs(run(plant, t, depth=300.0, oil_volume_m3=oil)[:, 0] - still).max()

    assert error(2.0) < 0.02
    assert error(4.0) / error(2.0) == pytest.approx(2.0, rel=0.15)


@pytest.mark.parametrize("depth", [5.0, 16.0, 31.0, 100.0])
@pytest.mark.parametrize("lift", [2e-5, 3e-4])
@pytest.mark.parametrize("interval", [30.0, 325.0])
def test_a_float_without_inertia_surfaces_without_bouncing(depth, lift, interval):
    """It arrives and stays; its steps of two seconds let it sway by a tenth of a metre."""
    found = run(load_vehicle("mermaid"), np.arange(0.0, 10_000.0, interval), depth=depth, volume=lift)[:, 0]
    there = int(np.argmax(found < 0.2))
    assert np.all(np.diff(found[:there]) < 0.0)
    assert found[there:].min() > -0.3
    assert found[there:].max() < 0.2


def test_a_float_without_inertia_leaves_the_surface_when_it_is_heavy():
    found = run(load_vehicle("mermaid"), np.arange(0.0, 3000.0, 30.0), depth=0.0, volume=-3e-5)[:, 0]
    speed = float(steady_speed(1028.0 * GRAVITY * 3e-5, 1.0, 350.0))
    assert found == pytest.approx(speed * np.arange(0.0, 3000.0, 30.0), rel=1e-9)


# Presets


@pytest.mark.parametrize("name", PRESETS)
def test_every_number_has_a_unit_and_a_source(name):
    hull = tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))["hull"]
    assert len(hull) >= 9
    assert [key for key, entry in hull.items() if not entry.get("unit") or not entry.get("source")] == []


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_neutral_and_still(name):
    plant = load_vehicle(name)
    found = run(plant, np.arange(0.0, 3600.0, 60.0), depth=30.0, piston_m=plant.hull.piston_neutral)
    assert np.array_equal(found, np.tile([30.0, 0.0], (60, 1)))


def test_the_lake_float_takes_minutes_to_forty_metres():
    plant = load_vehicle("qiandao_float")
    t = np.arange(0.0, 600.0, 0.7)
    found = run(plant, t, depth=0.0, piston_m=np.where(t < 1.0, 0.55, 0.5))
    assert 300.0 < t[np.argmax(found[:, 0] > 40.0)] < 360.0
    assert found[-1, 1] == pytest.approx(0.12, abs=0.015)


def test_its_piston_takes_25_s_from_end_to_end():
    plant = load_vehicle("qiandao_float")
    x = plant.initial(np.array([20.0, 0.0]))
    u = np.array([{**plant.constants, "piston_m": 0.6}.get(name, 0.0) for name in plant.inputs])
    positions = []
    for _ in range(20):
        x = plant.step(x, u)
        positions.append(x[plant.states.index("piston_m position")])
    assert positions == pytest.approx(np.minimum(0.55 + 0.004 * 0.7 * np.arange(1, 21), 0.6), abs=1e-12)


def test_mermaid_makes_the_speed_of_its_source():
    found = run(load_vehicle("mermaid"), [0.0, 1000.0], depth=800.0, volume=2.2e-4)
    assert (800.0 - found[1, 0]) / 1000.0 == pytest.approx(0.08, abs=0.002)


@pytest.mark.parametrize(
    "values, words",
    [
        ({"hull.piston_low": 0.6, "hull.piston_high": 0.5}, "piston_low must be less than"),
        ({"hull.piston_neutral": 0.7}, "piston_neutral must lie between"),
    ],
)
def test_a_piston_that_cannot_be_is_refused(values, words, tmp_path):
    save_vehicle(replace_at(load_vehicle("qiandao_float"), values), tmp_path / "mine.toml")
    with pytest.raises(ValueError, match=words):
        load_vehicle(tmp_path / "mine.toml")


@given(depth=st.floats(0.0, 1500.0), rate=speeds, volume=st.floats(-3e-4, 3e-4), interval=st.floats(1.0, 400.0))
@settings(max_examples=25)
def test_no_free_run_of_a_preset_leaves_what_is_possible(depth, rate, volume, interval):
    for name in PRESETS:
        found = run(load_vehicle(name), interval * np.arange(12), depth=depth, rate=rate, volume=volume, piston_m=0.55)
        assert np.isfinite(found).all()
        assert found[:, 0].min() > -0.5
        assert np.abs(found[2:, 1]).max() < 0.6


# The guide


def test_the_examples_in_the_guide_run():
    blocks = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    assert any("qiandao_float" in block for block in blocks)
    for block in blocks:
        exec(compile(block, "vehicles.md", "exec"), {})


def test_the_guide_lists_every_effect_with_its_unit_and_probe():
    plant = load_vehicle("mermaid")
    specs = {path.removeprefix("effects."): spec_at(plant, path) for path in list_paths(plant)}
    probed = {
        path: (spec.unit, f"{spec.probe:g}")
        for path, spec in specs.items()
        if spec.probe and not path.startswith("hull.")
    }
    section = GUIDE.read_text(encoding="utf-8").partition("### What may be missing")[2].partition("###")[0]
    rows = re.findall(r"^\| `(\S+)` \| (.*?) \| (\S+) \|", section, re.MULTILINE)
    assert {path: (unit, probe) for path, unit, probe in rows} == probed
