"""The compass: deviation, lag and bias against closed forms."""

import math
from dataclasses import replace

import pytest
from hypothesis import given, strategies as st

from auv_gym.effects import CompassEffects
from auv_gym.param import pack, record_type
from auv_gym.physics.sensors import compass_reading, deviation, lag_error

headings = st.floats(-50.0, 50.0)


def compass(**effects):
    return pack(replace(CompassEffects(), **effects)).view(record_type(CompassEffects))[0]


@given(heading=headings)
def test_a_neutral_compass_is_the_identity_bit_for_bit(heading):
    assert compass_reading(heading, 0.0, compass()) == heading


@given(heading=headings, bias=st.floats(-3.0, 3.0), error=st.floats(-1.0, 1.0))
def test_bias_and_lag_error_add(heading, bias, error):
    assert compass_reading(heading, error, compass(bias=bias)) == pytest.approx(heading + bias + error, abs=1e-14)


@pytest.mark.parametrize(
    "heading, expected", [(0.0, 0.02), (math.pi / 2, 0.05), (math.pi, -0.02), (-math.pi / 2, -0.05)]
)
def test_deviation_at_the_cardinal_points(heading, expected):
    # coefficient B is the deviation on east, C the deviation on north; pi/2 is rounded
    found = deviation(heading, compass(deviation_sin=0.05, deviation_cos=0.02))
    assert found == pytest.approx(expected, abs=1e-15)


@given(rate=st.floats(-1.0, 1.0), lag=st.floats(0.1, 20.0), duration=st.floats(0.1, 20.0), start=st.floats(-1.0, 1.0))
def test_the_lag_error_solves_its_differential_equation(rate, lag, duration, start):
    # de/dt = -e/lag - rate
    exact = (start + rate * lag) * math.exp(-duration / lag) - rate * lag
    assert lag_error(start, rate * duration, lag, duration) == pytest.approx(exact, abs=1e-13)


@given(error=st.floats(-1.0, 1.0), change=st.floats(-1.0, 1.0))
def test_a_sensor_without_lag_has_no_error(error, change):
    assert lag_error(error, change, 0.0, 0.5) == 0.0


def test_a_small_lag_shows_at_first_order():
    # after a second the transient is gone: the error is minus the rate times the lag
    assert lag_error(0.0, 0.3, 1e-3, 1.0) == pytest.approx(-0.3e-3, rel=1e-12)
