"""A command's way to the fin: the memoryless effects, backlash, and travel with lag and rate limit."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from auv_gym.effects import ActuatorEffects
from auv_gym.param import pack, record_type
from auv_gym.physics.actuators import command_within, held, play, shape_command, travel

angles = st.floats(-1.5, 1.5)
LIMIT = 0.5


def shaped(command, memory=0.0, **effects):
    packed = pack(replace(ActuatorEffects(), **effects)).view(record_type(ActuatorEffects))[0]
    return shape_command(command, memory, LIMIT, packed)


def integrated(error, lag, slowness, duration, steps=4000):
    """Mean, slope and end of the distance to the target, from the differential equation by Heun's method."""

    def rate(x):
        linear = -x / lag if lag > 0.0 else -math.copysign(math.inf, x) if x else 0.0
        limit = 1.0 / slowness if slowness > 0.0 else math.inf
        return min(max(linear, -limit), limit)

    h, x, path = duration / steps, error, [error]
    for _ in range(steps):
        if lag > 0.0:
            first = rate(x)
            x += 0.5 * h * (first + rate(x + h * first))
        else:
            x = math.copysign(max(abs(x) - h / slowness, 0.0), x) if slowness > 0.0 else 0.0
        path.append(x)
    t = np.linspace(-0.5, 0.5, steps + 1) * duration
    mean = np.trapezoid(path, t) / duration
    return mean, 12.0 * np.trapezoid(path * t, t) / duration**3, x


@given(
    error=st.floats(-1.0, 1.0),
    lag=st.just(0.0) | st.floats(0.05, 50.0),
    slowness=st.just(0.0) | st.floats(0.05, 50.0),
    duration=st.floats(0.1, 5.0),
    target=angles,
)
def test_travel_is_the_solution_of_the_differential_equation(error, lag, slowness, duration, target):
    assume(lag > 0.0 or slowness > 0.0)
    mean, slope, end = travel(target + error, target, lag, slowness, duration)
    expected = integrated((target + error) - target, lag, slowness, duration)
    # Heun and the trapezoidal rule err by the square of 1/4000 of the duration over the shortest time constant (1/50 of
    # it), and by a step's length at the knee.
    assert (mean - target, slope * duration, end - target) == pytest.approx(
        (expected[0], expected[1] * duration, expected[2]), abs=2e-3 * abs(error) + 1e-12
    )


@given(position=angles, target=angles, duration=st.floats(1e-3, 100.0))
def test_without_lag_or_rate_limit_the_fin_stands_where_it_is_told_to(position, target, duration):
    assert travel(position, target, 0.0, 0.0, duration) == (target, 0.0, target)


@given(target=angles, lag=st.floats(0.0, 10.0), slowness=st.floats(0.0, 10.0))
def test_a_fin_at_its_target_stays(target, lag, slowness):
    assert travel(target, target, lag, slowness, 0.5) == (target, 0.0, target)


@given(position=angles, target=angles, lag=st.floats(0.0, 10.0), slowness=st.floats(0.0, 10.0))
def test_two_halves_of_a_time_are_the_whole(position, target, lag, slowness):
    whole = travel(position, target, lag, slowness, 2.0)
    first = travel(position, target, lag, slowness, 1.0)
    second = travel(first[2], target, lag, slowness, 1.0)
    # positions are of order 1; the difference to the target is taken twice
    assert second[2] == pytest.approx(whole[2], abs=1e-14)
    assert 0.5 * (first[0] + second[0]) == pytest.approx(whole[0], abs=1e-14)


@pytest.mark.parametrize("lag, slowness", [(1e-4, 0.0), (0.0, 1e-4), (1e-4, 1e-4)])
def test_a_small_lag_or_slowness_shows_at_first_order(lag, slowness):
    def delay(scale):
        return travel(0.4, 0.0, scale * lag, scale * slowness, 2.0)[0]

    assert delay(1.0) > 0.0
    assert delay(2.0) / delay(1.0) == pytest.approx(2.0, abs=1e-9)


@pytest.mark.parametrize("lag, slowness, area", [(1e-4, 0.0, 0.4e-4), (0.0, 1e-4, 0.4**2 / 2 * 1e-4)])
def test_mean_after_a_small_lag_or_slowness(lag, slowness, area):
    # the area under an exponential from 0.4, and under a triangle of height 0.4; rounding of 1e-16 over 1e-5
    assert travel(0.4, 0.0, lag, slowness, 2.0)[0] == pytest.approx(area / 2.0, rel=1e-10)


def test_slope_of_a_slow_fin_is_free_of_cancellation():
    # 1 s of a lag of 1e6 s: a straight line of slope -error/lag, up to terms of 1/lag^2
    assert travel(1.0, 0.0, 1e6, 0.0, 1.0)[1] == pytest.approx(-1e-6, abs=2e-9)


@given(position=angles, memory=angles)
def test_play_of_no_width_is_the_identity(position, memory):
    assert play(position, memory, 0.0) == position


@given(positions=st.lists(angles, min_size=2, max_size=20), width=st.floats(0.0, 0.5))
def test_play_follows_within_half_its_width_and_only_when_pushed(positions, width):
    memory = positions[0]
    for position in positions[1:]:
        moved = play(position, memory, width)
        assert abs(moved - position) <= 0.5 * width + 1e-15
        assert moved == memory or abs(moved - position) == pytest.approx(0.5 * width, abs=1e-15)
        memory = moved


@given(positions=st.lists(angles, min_size=2, max_size=20), stiction=st.floats(1e-3, 0.5))
def test_what_sticks_stands_still_until_it_jumps_to_where_it_is_told(positions, stiction):
    memory = positions[0]
    for position in positions[1:]:
        moved = held(position, memory, 0.0, stiction)
        assert moved == (position if abs(position - memory) >= stiction else memory)
        assert abs(position - moved) < stiction
        memory = moved


def test_what_has_play_and_sticks_jumps_to_the_edge_of_its_play():
    assert held(0.3, 0.0, 0.2, 0.25) == 0.0  # told to stand at 0.2, at the edge of its play
    assert held(0.4, 0.0, 0.2, 0.25) == pytest.approx(0.3)


@given(command=st.floats(-LIMIT, LIMIT), memory=angles)
def test_a_neutral_actuator_is_the_identity_bit_for_bit(command, memory):
    assert shaped(command, memory) == (command, command)


@pytest.mark.parametrize(
    "command, effects, expected",
    [
        (0.2, {"gain": 1.1}, 0.22),
        (0.2, {"offset": 0.05}, 0.25),
        (0.2, {"gain": 2.0, "offset": 0.05}, 0.45),  # the offset is not amplified
        (0.2, {"deadband": 0.05}, 0.15),
        (-0.2, {"deadband": 0.05}, -0.15),
        (0.04, {"deadband": 0.05}, 0.0),
        (0.04, {"deadband": 0.05, "offset": 0.05}, 0.04),  # the deadband comes after the offset
        (0.2, {"backlash": 0.06}, 0.17),
        (0.2, {"stiction": 0.15}, 0.2),
        (0.2, {"stiction": 0.25}, 0.0),
        (0.2, {"offset": 0.1, "stiction": 0.25}, 0.3),  # the offset comes before
        (0.6, {}, LIMIT),
        (-0.6, {}, -LIMIT),
        (0.6, {"lost_travel": 0.1}, 0.4),
        (0.6, {"lost_travel": 0.9}, 0.0),
    ],
)
def test_the_shaped_command(command, effects, expected):
    assert shaped(command, **effects)[0] == pytest.approx(expected, abs=1e-15)


def test_backlash_memory_is_not_cut_by_the_stops():
    assert shaped(0.8, backlash=0.1) == (LIMIT, pytest.approx(0.75))


def within(
    command,
    memory=0.0,
    rest=2.0,
    low=2.0,
    high=9.0,
    gain=1.0,
    offset=0.0,
    deadband=0.0,
    backlash=0.0,
    stiction=0.0,
    lost=0.0,
):
    return command_within(command, memory, rest, low, high, gain, offset, deadband, backlash, stiction, lost)[0]


def test_a_range_that_begins_at_rest_is_shortened_at_its_other_end_only():
    assert [within(c) for c in (-5.0, 2.0, 5.0, 20.0)] == [2.0, 2.0, 5.0, 9.0]
    assert [within(c, lost=3.0) for c in (-5.0, 2.0, 5.0, 20.0)] == [2.0, 2.0, 5.0, 6.0]
    assert [within(c, rest=5.0, lost=1.0) for c in (-5.0, 5.0, 20.0)] == [3.0, 5.0, 8.0]


def test_gain_deadband_and_offset_of_a_range_act_about_rest():
    assert within(4.0, gain=1.5) == 5.0
    assert within(4.0, deadband=0.5) == 3.5
    assert within(2.0, offset=0.25) == 2.25
    assert within(4.0, memory=3.0, backlash=1.0) == 3.5


@given(angles)
def test_a_range_about_zero_is_that_of_a_fin(command):
    own = command_within(command, 0.1, 0.0, -LIMIT, LIMIT, 1.1, 0.02, 0.03, 0.04, 0.06, 0.1)
    packed = {"gain": 1.1, "offset": 0.02, "deadband": 0.03, "backlash": 0.04, "stiction": 0.06, "lost_travel": 0.1}
    assert own[0] == pytest.approx(shaped(command, 0.1, **packed)[0], abs=1e-15)
