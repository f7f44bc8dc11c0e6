from dataclasses import replace
from math import inf, nan, pi, radians

import numpy as np
import pytest
from hypothesis import given, strategies as st

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.vehicles.glider import linear_yaw_coefficients
from controllers.controller import Controller
from controllers.pid import Pid, float_depth_pid, heading_pid

VEHICLES = ["slocum", "ganeshblue", "ganeshblue_corrected"]


def act(pid, state, heading, target, dt=1.0):
    command, state = pid.act(state, {"heading_rad": heading, "dt_s": dt}, {"heading_rad": target})
    return command["rudder_rad"], state


def follow(plant, pid, targets, heading=0.0):
    """True headings and commands of a closed loop without noise."""
    x, state = plant.initial(np.array([heading, 0.0, 0.0, 0.0])), pid.start()
    u = np.array([plant.constants.get(name, 0.0) for name in plant.inputs])
    headings, commands = [], []
    for target in targets:
        u[0], state = act(pid, state, plant.output(x)[0], target, plant.dt)
        headings.append(x[0])
        commands.append(u[0])
        x = plant.step(x, u)
    return np.array(headings), np.array(commands)


def test_each_term_by_hand():
    pid = Pid(2.0, integral=0.5, derivative=3.0, filter_time=1.0)
    first, state = act(pid, pid.start(), 0.1, 0.5)
    assert first == pytest.approx(2.0 * 0.4)
    second, state = act(pid, state, 0.2, 0.5)
    # rate 0.1 through a filter of one sample: half of it; the integral holds the first error
    assert second == pytest.approx(2.0 * 0.3 + 0.5 * 0.4 - 3.0 * 0.05)
    assert state.integral == pytest.approx(0.5 * (0.4 + 0.3))


def test_it_turns_the_short_way():
    command, _ = act(Pid(1.0), Pid(1.0).start(), radians(170.0), radians(-170.0))
    assert command == pytest.approx(radians(20.0))


def test_a_reading_that_passes_south_has_no_kick():
    pid = Pid(1.0, derivative=1.0)
    _, state = act(pid, pid.start(), pi - 0.01, pi)
    command, _ = act(pid, state, -pi + 0.01, pi)
    assert command == pytest.approx(-0.01 - 0.02)


def test_a_step_of_the_target_does_not_kick_the_derivative():
    pid = Pid(1.0, derivative=100.0)
    _, state = act(pid, pid.start(), 0.0, 0.0)
    command, _ = act(pid, state, 0.0, 0.3)
    assert command == pytest.approx(0.3)


def test_limits_of_the_command_and_of_its_rate():
    pid = Pid(10.0, limit=0.5, rate_limit=0.4)
    first, state = act(pid, pid.start(), 0.0, 1.0)
    second, state = act(pid, state, 0.0, 1.0)
    third, _ = act(pid, state, 1.0, 0.0)
    assert first == pytest.approx(0.4)  # from rest, at its rate
    assert second == 0.5
    assert third == pytest.approx(0.1)


def test_it_is_pure():
    pid = Pid(1.0, integral=1.0)
    state = pid.start()
    one, two = act(pid, state, 0.0, 1.0), act(pid, state, 0.0, 1.0)
    assert one == two
    assert state == pid.start()
    assert isinstance(pid, Controller)


def test_without_a_reading_the_last_command_stands():
    pid = Pid(1.0, integral=0.1)
    before, state = act(pid, pid.start(), 0.0, 0.3)
    held, after = act(pid, state, float("nan"), 0.3)
    assert held == before
    assert after == state
    assert act(pid, pid.start(), float("nan"), 0.3)[0] == 0.0


def test_the_integral_does_not_wind_up_at_the_stop():
    pid = Pid(1.0, integral=0.1, limit=0.2)
    state = pid.start()
    for _ in range(500):
        command, state = act(pid, state, 0.0, 1.0)
    assert command == 0.2
    assert state.integral == 0.0  # the error pushed further all along
    command, state = act(pid, state, 1.1, 1.0)
    assert command == pytest.approx(-0.1)  # off the stop at the first sample past the target


def test_the_integral_leaves_the_stop_when_the_error_turns():
    pid = Pid(0.1, integral=0.1, limit=0.2)
    state = replace(pid.start(), integral=5.0)
    _, state = act(pid, state, 1.0, 0.0)
    assert state.integral == pytest.approx(5.0 - 0.1)


def test_windup_would_overshoot_and_clamping_does_not():
    """A slow vehicle at the stop for a minute; a copy of the controller that integrates all the same overshoots."""
    plant = load_vehicle("ganeshblue_corrected")
    pid = replace(heading_pid(plant), integral_range=inf)
    clamped, commands = follow(plant, pid, [radians(60.0)] * 400)
    assert np.mean(np.abs(commands) >= plant.hull.rudder_limit) > 0.2
    x, integral = plant.initial(np.zeros(4)), 0.0
    u = np.array([plant.constants.get(name, 0.0) for name in plant.inputs])
    wound = []
    for _ in range(400):
        error = radians(60.0) - x[0]
        u[0] = np.clip(pid.proportional * error + integral, -pid.limit, pid.limit)
        integral += pid.integral * error
        wound.append(x[0])
        x = plant.step(x, u)
    assert max(wound) > radians(90.0)
    assert clamped.max() < radians(63.0)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_heading_pid_follows_a_step_and_leaves_no_error(vehicle):
    # a moment that some 0.05 rad of rudder hold: the rudder of `slocum` gives 0.047 N m/rad
    plant = replace_at(load_vehicle(vehicle), {"effects.rudder.offset": 0.03, "effects.yaw.moment": 0.0025})
    samples = int(600.0 / plant.dt)
    headings, commands = follow(plant, heading_pid(plant), [radians(50.0)] * samples)
    assert headings.max() < radians(55.0)
    assert abs(headings[-1] - radians(50.0)) < radians(0.5)
    assert np.abs(commands).max() <= plant.hull.rudder_limit


@pytest.mark.parametrize("vehicle", ["slocum", "ganeshblue"])
@pytest.mark.parametrize("settling", [20.0, 60.0])
def test_the_poles_are_where_they_were_put(vehicle, settling):
    plant = load_vehicle(vehicle)
    pid = heading_pid(plant, settling=settling)
    damping, rudder = linear_yaw_coefficients(plant.family.view(plant.vector).hull)
    # s^3 - a s^2 + b (Kd s^2 + Kp s + Ki), from (14) with an unfiltered derivative
    polynomial = [1.0, rudder * pid.derivative - damping, rudder * pid.proportional, rudder * pid.integral]
    poles = np.sort(np.abs(np.roots(polynomial)))
    assert poles[0] == pytest.approx(0.2 / settling, rel=1e-6)
    assert poles[1] == pytest.approx(1.0 / settling, rel=1e-5)  # a double pole: roots lose half the digits
    assert (np.real(np.roots(polynomial)) < 0.0).all()


@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize(
    "effect, value",
    [
        ("effects.rudder.dead_time", 1.5),
        ("effects.rudder.lag", 1.5),
        ("effects.rudder.gain", 1.3),
        ("effects.rudder.backlash", 0.09),
        ("effects.compass.lag", 1.5),
    ],
)
def test_it_stays_stable_with_effects_at_three_probes(vehicle, effect, value):
    plant = load_vehicle(vehicle)
    headings, _ = follow(replace_at(plant, effect, value), heading_pid(plant), [radians(40.0)] * int(600.0 / plant.dt))
    settled = headings[-int(120.0 / plant.dt) :]
    assert np.abs(settled - radians(40.0)).max() < radians(5.0)


def test_a_vehicle_that_does_not_turn_is_refused():
    with pytest.raises(ValueError, match="does not turn it steadily"):
        heading_pid(replace_at(load_vehicle("slocum"), "hull.n_delta", 0.0))
    with pytest.raises(ValueError, match="settling > 0"):
        heading_pid(load_vehicle("slocum"), settling=0.0)


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"proportional": float("nan")}, "finite proportional"),
        ({"proportional": 1.0, "integral": -1.0}, "one sign"),
        ({"proportional": 1.0, "limit": 0.0}, "positive limits"),
        ({"proportional": 1.0, "filter_time": -1.0}, "filter_time"),
        ({"proportional": 1.0, "integral_range": 0.0}, "integral_range"),
        ({"proportional": 1.0, "measured": "heading_furlongs"}, "unknown unit suffix"),
    ],
)
def test_bad_settings_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        Pid(**settings)


def test_a_vehicle_in_six_degrees_of_freedom_has_no_poles_to_place():
    with pytest.raises(ValueError, match="glider's linear form, got 'remus100' of family 'body'"):
        heading_pid(load_vehicle("remus100"))


def dive(plant, pid, target, duration=600.0, start=0.0):
    """Times, depths and commands of a float that holds one target depth, without noise."""
    x, state = plant.initial(np.array([start, 0.0])), pid.start()
    u = np.array([plant.constants.get(name, 0.0) for name in plant.inputs])
    times, depths, commands = plant.dt * np.arange(round(duration / plant.dt)), [], []
    for _ in times:
        depth = float(plant.output(x)[0])
        command, state = pid.act(state, {"depth_m": depth, "dt_s": plant.dt}, {"depth_m": target})
        u[0] = command["piston_m"]
        depths.append(depth)
        commands.append(u[0])
        x = plant.step(x, u)
    return times, np.array(depths), np.array(commands)


def test_the_command_starts_at_neutral_and_keeps_to_its_limits():
    pid = Pid(-1.0, measured="depth_m", command="piston_m", neutral=0.55, middle=0.54, limit=0.05, rate_limit=0.004)
    _, state = pid.act(pid.start(), {"depth_m": float("nan"), "dt_s": 1.0}, {"depth_m": 10.0})
    assert state == pid.start()
    commands = []
    for _ in range(30):
        command, state = pid.act(state, {"depth_m": 0.0, "dt_s": 1.0}, {"depth_m": 10.0})
        commands.append(command["piston_m"])
    assert commands[0] == pytest.approx(0.546)
    assert commands[-1] == pytest.approx(0.49)
    for _ in range(40):
        command, state = pid.act(state, {"depth_m": 20.0, "dt_s": 1.0}, {"depth_m": 10.0})
    assert command["piston_m"] == pytest.approx(0.59)
    with pytest.raises(ValueError, match="neutral within its limits"):
        Pid(-1.0, neutral=0.7, middle=0.55, limit=0.05)


@pytest.mark.parametrize("target", [30.0, 40.0, 50.0, 60.0])
def test_a_float_reaches_its_depth_in_minutes_and_hardly_overshoots(target):
    plant = load_vehicle("qiandao_float")
    times, depths, commands = dive(plant, float_depth_pid(plant), target, 900.0)
    arrived = times[np.abs(depths - target) > 1.0].max()
    assert 60.0 < arrived < 600.0
    assert depths.max() < target + 1.0
    assert np.abs(depths[-300:] - target).max() < 0.2
    assert commands.min() >= plant.hull.piston_low
    assert commands.max() <= plant.hull.piston_high
    assert np.abs(np.diff(commands)).max() <= plant.dt / plant.hull.piston_slowness * (1.0 + 1e-9)


@pytest.mark.parametrize(
    "effect, value",
    [
        ("effects.volume.offset", 6e-6),
        ("effects.volume.offset", -6e-6),
        ("effects.water.current", 6e-3),
        ("effects.water.gradient", 3e-3),
        ("effects.piston.dead_time", 6.0),
        ("effects.piston.lag", 6.0),
        ("effects.piston.slowness", 150.0),
        ("effects.depth.lag", 1.5),
    ],
)
def test_a_float_settles_with_effects_as_well(effect, value):
    plant = load_vehicle("qiandao_float")
    _, depths, _ = dive(replace_at(plant, effect, value), float_depth_pid(plant), 40.0, 900.0)
    assert depths.max() < 41.0
    assert np.abs(depths[-300:] - 40.0).max() < 0.2


def test_the_poles_of_depth_control_are_where_they_were_put():
    plant = load_vehicle("qiandao_float")
    hull = replace(plant.hull, drag_quadratic=1e-3, piston_square=0.0)  # as good as linear
    plant = replace(plant, parameters=replace(plant.parameters, hull=hull))
    pid = float_depth_pid(plant, settling=15.0)
    mass = hull.mass + hull.added_mass
    force = hull.density * 9.81 * hull.piston_area
    polynomial = [mass, hull.drag_linear - force * pid.derivative, -force * pid.proportional, -force * pid.integral]
    poles = np.sort(np.abs(np.roots(polynomial)))
    assert poles == pytest.approx([0.2 / 15.0, 1.0 / 15.0, 1.0 / 15.0], rel=1e-3)


def test_depth_control_needs_a_piston_and_a_time():
    with pytest.raises(ValueError, match="moves a float's piston, got 'mermaid' of family 'float_oil'"):
        float_depth_pid(load_vehicle("mermaid"))
    with pytest.raises(ValueError, match="settling > 0"):
        float_depth_pid(load_vehicle("qiandao_float"), settling=-1.0)


def test_the_derivative_is_taken_of_a_measured_rate_where_there_is_one():
    pid = Pid(1.0, derivative=2.0, rate_measured="r_radps")
    reading = {"heading_rad": 0.0, "r_radps": 0.1, "dt_s": 1.0}
    command, state = pid.act(pid.start(), reading, {"heading_rad": 0.3})
    assert command["rudder_rad"] == pytest.approx(0.3 - 0.2)
    command, _ = pid.act(state, {**reading, "heading_rad": 0.05, "r_radps": nan}, {"heading_rad": 0.3})
    assert command["rudder_rad"] == pytest.approx(0.25 - 2.0 * 0.05)
    without, _ = act(pid, state, 0.05, 0.3)
    assert without == command["rudder_rad"]


def test_a_measured_rate_passes_the_same_filter():
    by_rate = Pid(1.0, derivative=1.0, filter_time=2.0, rate_measured="r_radps")
    by_difference = replace(by_rate, rate_measured="")
    one, two, heading = by_rate.start(), by_difference.start(), 0.0
    for k in range(20):
        rate = 0.0 if k == 0 else 0.1
        heading += 0.5 * rate
        reading = {"heading_rad": heading, "r_radps": rate, "dt_s": 0.5}
        first, one = by_rate.act(one, reading, {"heading_rad": 1.0})
        second, two = by_difference.act(two, reading, {"heading_rad": 1.0})
        assert first["rudder_rad"] == pytest.approx(second["rudder_rad"], rel=1e-12)


def test_the_command_that_holds_a_target_is_fed_forward():
    points = ((0.0, 0.0), (1.0, 2.0), (2.0, 6.0))
    pid = Pid(1.0, measured="u_mps", command="propeller_V", limit=5.0, steady=points)
    for speed, volts in ((-1.0, 0.0), (0.5, 1.0), (1.0, 2.0), (1.5, 4.0)):
        command, _ = pid.act(pid.start(), {"u_mps": speed, "dt_s": 1.0}, {"u_mps": speed})
        assert command["propeller_V"] == pytest.approx(volts)
    command, _ = pid.act(pid.start(), {"u_mps": 3.0, "dt_s": 1.0}, {"u_mps": 3.0})
    assert command["propeller_V"] == 5.0  # 6 at the last point, and the limit
    with pytest.raises(ValueError, match="order of their targets"):
        replace(pid, steady=((1.0, 0.0), (1.0, 1.0)))


@given(st.lists(st.floats(-pi, pi), min_size=1, max_size=30), st.floats(0.01, 2.0), st.floats(0.01, 5.0))
def test_the_rate_limit_is_never_exceeded(headings, rate_limit, dt):
    pid = Pid(2.0, 0.3, 4.0, limit=0.5, rate_limit=rate_limit)
    state, last = pid.start(), 0.0
    for heading in headings:
        command, state = act(pid, state, heading, 0.0, dt)
        assert abs(command - last) <= rate_limit * dt + 1e-12
        last = command


def test_after_long_saturation_it_recovers_without_much_overshoot():
    pid = Pid(2.0, 1.0, measured="depth_m", command="piston_m", limit=1.0)
    for clamped in (True, False):
        law = pid if clamped else replace(pid, limit=1e9)  # the same law without clamping, and an actuator that has it
        depth, state, deepest = 0.0, law.start(), 0.0
        for k in range(1200):
            target = 50.0 if k < 200 else 10.0  # 20 s of full travel towards a depth far away, then one near by
            command, state = law.act(state, {"depth_m": depth, "dt_s": 0.1}, {"depth_m": target})
            depth += 0.1 * min(max(command["piston_m"], -1.0), 1.0)
            deepest = depth if k == 200 else max(deepest, depth)
        if clamped:
            assert deepest - 10.0 < 10.5  # where it was when the target came back, and no further
            assert depth == pytest.approx(10.0, abs=0.05)
        else:
            assert deepest - 10.0 > 30.0
