"""Trapped air and the volume above the water."""

import pytest
from hypothesis import given, strategies as st

from auv_gym.physics.buoyancy import ATMOSPHERE, GRAVITY, air_volume, exposed_volume

depths = st.floats(0.0, 3000.0)


@given(volume=st.floats(1e-6, 1e-3), depth=depths, density=st.floats(990.0, 1040.0))
def test_pressure_times_volume_of_trapped_air_is_constant(volume, depth, density):
    pressure = ATMOSPHERE + density * GRAVITY * depth
    assert pressure * air_volume(volume, depth, density) == pytest.approx(ATMOSPHERE * volume, rel=1e-14)


def test_ten_metres_of_sea_halve_trapped_air():
    # one atmosphere is 10.06 m of water of 1027 kg/m^3
    assert air_volume(1.0, 10.06, 1027.0) == pytest.approx(0.5, abs=5e-4)
    assert air_volume(1.0, 0.0, 1027.0) == 1.0


def test_above_the_water_air_is_under_one_atmosphere():
    assert air_volume(2e-5, -0.3, 1000.0) == 2e-5


@given(depth=st.floats(-1.0, 1.0))
def test_what_stands_out_of_the_water_is_a_cylinder(depth):
    out = exposed_volume(depth, 0.03)
    assert out == (-0.03 * depth if depth < 0.0 else 0.0)
