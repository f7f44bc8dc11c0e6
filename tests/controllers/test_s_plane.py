from math import exp, inf, nan, pi

import pytest
from hypothesis import given, strategies as st

from controllers.controller import Controller
from controllers.s_plane import SPlane

TABLE_4 = {"k1": 0.9, "k2": 1.7, "k3": 0.0024}
NUMBERS = st.floats(-1e3, 1e3)


def act(controller, state, heading, target, **more):
    reading = {"heading_rad": heading, "dt_s": 0.1, **more}
    command, state = controller.act(state, reading, {"heading_rad": target})
    return command["rudder_rad"], state


def test_it_is_equation_21():
    controller = SPlane(**TABLE_4, error_scale=0.5, rate_scale=0.2, span=2.0, rate_measured="r_radps")
    _, state = act(controller, controller.start(), 0.0, 0.1, r_radps=0.0)
    command, _ = act(controller, state, 0.02, 0.1, r_radps=0.06)
    error, rate, integral = 0.08 / 0.5, -0.06 / 0.2, 0.1 * 0.1 / 0.5
    m = 2.0 / (1.0 + exp(-0.9 * error - 1.7 * rate)) - 1.0 + 0.0024 * integral
    assert command == pytest.approx(2.0 * m, rel=1e-12)
    assert isinstance(controller, Controller)


@given(NUMBERS, NUMBERS, st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=5))
def test_left_is_right_mirrored_and_nothing_is_beyond_the_limits(error, rate, headings):
    controller = SPlane(2.3, 2.4, 0.5, 0.01, 0.01, span=-0.5, limit=0.4, rate_measured="r_radps")
    left, right = controller.start(), controller.start()
    for heading in headings:
        one, left = act(controller, left, heading, heading + min(max(error, -3.0), 3.0), r_radps=rate)
        other, right = act(controller, right, -heading, -heading - min(max(error, -3.0), 3.0), r_radps=-rate)
        assert one == pytest.approx(-other, abs=1e-9)
        assert abs(one) <= 0.4


@given(st.lists(st.floats(-pi, pi), min_size=2, max_size=20))
def test_the_command_keeps_to_its_rate(headings):
    controller = SPlane(2.0, 1.0, 0.1, 0.1, 0.1, span=0.5, limit=0.4, rate_limit=0.7)
    state, last = controller.start(), 0.0
    for heading in headings:
        command, state = act(controller, state, heading, 0.0)
        assert abs(command - last) <= 0.07 + 1e-12
        last = command


def test_the_integral_is_bounded_and_rests_at_a_limit():
    bounded = SPlane(0.0, 0.0, 1.0, 1.0, 1.0, span=1.0, integral_limit=0.3)
    resting = SPlane(5.0, 0.0, 1.0, 1.0, 1.0, span=1.0, limit=0.5)
    one, two = bounded.start(), resting.start()
    for _ in range(200):
        _, one = act(bounded, one, 0.0, 1.0)
        _, two = act(resting, two, 0.0, 1.0)
    assert one.integral == 0.3
    assert two.integral == 0.0
    command, _ = act(resting, two, 1.0, 1.0)
    assert command == pytest.approx(0.0, abs=1e-12)


def test_pure_and_held_without_a_reading():
    controller = SPlane(**TABLE_4, error_scale=0.5, rate_scale=0.2, span=1.0, neutral=0.1)
    assert act(controller, controller.start(), nan, 0.0) == (0.1, controller.start())
    _, state = act(controller, controller.start(), 0.0, 0.3)
    assert act(controller, state, 0.1, 0.3) == act(controller, state, 0.1, 0.3)
    assert state != controller.start()
    before = state.command
    assert act(controller, state, nan, 0.3) == (before, state)


def test_a_step_of_the_target_does_not_kick():
    controller = SPlane(0.0, 5.0, 0.0, 1.0, 0.01, span=1.0)
    _, state = act(controller, controller.start(), 0.0, 0.0)
    assert act(controller, state, 0.0, 1.0)[0] == 0.0


@pytest.mark.parametrize(
    "settings, message",
    [
        ({"k1": -0.9}, "k1 >= 0, got -0.9: the sign goes into span"),
        ({"k3": inf}, "k3 >= 0"),
        ({"error_scale": 0.0}, "error_scale > 0"),
        ({"rate_scale": nan}, "rate_scale > 0"),
        ({"span": 0.0}, "not 0"),
        ({"limit": -1.0}, "positive limits"),
        ({"filter_time": -1.0}, "filter_time >= 0"),
        ({"measured": "heading"}, "does not say its unit"),
    ],
)
def test_impossible_settings_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        SPlane(**{**TABLE_4, "error_scale": 1.0, "rate_scale": 1.0, "span": 1.0, **settings})
