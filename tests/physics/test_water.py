"""Waves: orbital velocity is that of an irrotational, incompressible flow under a moving surface."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from auv_gym.effects import WaveEffects
from auv_gym.param import pack, record_type
from auv_gym.physics.water import orbital_velocity

GRAVITY = 9.81
phases = st.floats(-20.0, 20.0)
periods = st.floats(3.0, 15.0)
amplitudes = st.floats(-3.0, 3.0)


def waves(a: float, b: float, period: float):
    return pack(WaveEffects(amplitude_cos=a, amplitude_sin=b, period=period)).view(record_type(WaveEffects))[0]


def velocity(phase: float, depth: float, a=1.0, b=0.0, period=8.0) -> np.ndarray:
    return np.array(orbital_velocity(phase, depth, waves(a, b, period), GRAVITY))


@given(a=amplitudes, b=amplitudes, period=periods, phase=phases, depth=st.floats(0.0, 100.0))
def test_water_moves_in_circles_that_shrink_exponentially_with_depth(a, b, period, phase, depth):
    omega = 2.0 * math.pi / period
    wavenumber = omega**2 / GRAVITY
    speed = math.hypot(a, b) * omega * math.exp(-wavenumber * depth)
    assert math.hypot(*velocity(phase, depth, a, b, period)) == pytest.approx(speed, rel=1e-13)


@given(a=amplitudes, b=amplitudes, period=periods, phase=phases)
def test_at_the_surface_water_rises_with_it(a, b, period, phase):
    omega = 2.0 * math.pi / period
    rising = omega * (-a * math.sin(phase) + b * math.cos(phase))  # rate of a cos + b sin
    assert velocity(phase, 0.0, a, b, period)[1] == pytest.approx(-rising, abs=1e-13)


@given(a=amplitudes, b=amplitudes, phase=phases)
def test_water_under_a_crest_moves_with_the_wave(a, b, phase):
    elevation = a * math.cos(phase) + b * math.sin(phase)
    along = velocity(phase, 2.0, a, b)[0]
    assert along * elevation >= 0.0


@given(a=amplitudes, b=amplitudes, period=periods, phase=phases, depth=st.floats(0.5, 30.0))
def test_the_flow_has_no_divergence_and_no_rotation(a, b, period, phase, depth):
    wavenumber = (2.0 * math.pi / period) ** 2 / GRAVITY
    h = 1e-3  # m; central differences err by (k h)^2 / 6

    def at(x, z):
        return velocity(phase - wavenumber * x, depth + z, a, b, period)

    by_x, by_z = (at(h, 0.0) - at(-h, 0.0)) / (2 * h), (at(0.0, h) - at(0.0, -h)) / (2 * h)
    assert by_x[0] + by_z[1] == pytest.approx(0.0, abs=1e-5)
    assert by_z[0] - by_x[1] == pytest.approx(0.0, abs=1e-5)


def test_above_still_water_the_velocity_is_that_at_the_surface():
    assert np.array_equal(velocity(0.3, -2.0), velocity(0.3, 0.0))


@given(phase=phases, depth=st.floats(-1.0, 50.0))
def test_no_amplitude_no_motion(phase, depth):
    assert np.array_equal(velocity(phase, depth, 0.0, 0.0), [0.0, 0.0])
