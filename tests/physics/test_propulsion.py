"""Thrust laws, and the slipstream of the NPS form."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from auv_gym.physics.propulsion import (
    INFLOWS,
    VOLTAGES,
    shaft_law,
    slipstream_speed,
    table_thrust,
)

inflows = st.floats(-2.0, 2.0)


@st.composite
def tables(draw) -> np.ndarray:
    """A table that rises with voltage and whose row at 0 V, the drag of the stopped propeller, is odd in the inflow."""
    drag = draw(st.tuples(st.floats(0.0, 1.0), st.floats(1.0, 4.0)))
    stopped = [drag[1], drag[0], 0.0, -drag[0], -drag[1]]
    rises = draw(st.lists(st.floats(0.05, 10.0), min_size=25, max_size=25))
    return np.vstack([stopped, stopped + np.cumsum(np.reshape(rises, (5, 5)), axis=0)]).ravel()


@given(n=st.floats(-200.0, 200.0), u=st.floats(-2.0, 2.0))
def test_the_shaft_law_is_a_thrust_coefficient_linear_in_the_advance_number(n, u):
    density, diameter, at_rest, slope = 1025.0, 0.14, 0.4566, -0.42
    turns = n / (2.0 * math.pi)
    assume(abs(turns) > 1e-3)
    advance = u / (turns * diameter)
    thrust = density * turns * abs(turns) * diameter**4 * (at_rest + slope * advance)
    per_square = density * diameter**4 * at_rest / (2.0 * math.pi) ** 2
    per_speed = density * diameter**3 * slope / (2.0 * math.pi)
    assert shaft_law(n, u, per_square, per_speed) == pytest.approx(thrust, rel=1e-12, abs=1e-12)


@given(table=tables(), i=st.integers(0, len(VOLTAGES) - 1), j=st.integers(0, len(INFLOWS) - 1))
def test_the_table_is_met_at_its_points(table, i, j):
    assert table_thrust(VOLTAGES[i], INFLOWS[j], table) == pytest.approx(table.reshape(6, 5)[i, j], abs=1e-13)


@given(table=tables(), voltage=st.floats(0.0, 5.0), u=st.floats(-1.5, 1.5))
def test_between_the_points_the_table_is_linear_in_each_direction(table, voltage, u):
    rows = [np.interp(u, INFLOWS, row) for row in table.reshape(6, 5)]
    assert table_thrust(voltage, u, table) == pytest.approx(np.interp(voltage, VOLTAGES, rows), abs=1e-12)


@given(table=tables(), voltage=st.floats(-5.0, 5.0), u=inflows)
def test_beyond_its_edges_the_table_is_held(table, voltage, u):
    held = max(min(u, 1.5), -1.5)
    assert table_thrust(voltage, u, table) == table_thrust(voltage, held, table)
    assert table_thrust(math.copysign(9.0, voltage), u, table) == table_thrust(math.copysign(5.0, voltage), u, table)


@given(table=tables(), voltage=st.floats(1e-6, 5.0), u=inflows)
def test_the_propeller_astern_is_the_propeller_ahead_turned_round(table, voltage, u):
    assert table_thrust(-voltage, u, table) == -table_thrust(voltage, -u, table)


@given(table=tables(), voltage=st.floats(-4.999, 4.999), more=st.floats(0.0, 2.0), u=inflows)
def test_thrust_rises_with_voltage(table, voltage, more, u):
    # each volt adds at least 0.05 N; some 1e-15 of thrusts of up to 50 N
    gain = table_thrust(min(voltage + more, 5.0), u, table) - table_thrust(voltage, u, table)
    assert gain >= 0.05 * (min(voltage + more, 5.0) - voltage) - 1e-13


@given(n=st.floats(-200.0, 200.0), u=st.floats(-3.0, 3.0), c_t1=st.floats(0.01, 5.0))
def test_the_slipstream_is_the_printed_form_where_that_has_a_value(n, u, c_t1):
    pitch = 0.012
    assume(abs(u) > 1e-3)
    eta = pitch * n / u
    loading = c_t1 * eta * abs(eta)
    assume(loading > -1.0)
    eps = -1.0 + np.sign(n) / np.sign(u) * (math.sqrt(loading + 1.0) - 1.0) / (math.sqrt(c_t1 + 1.0) - 1.0)
    # the root near 1 cancels, and is divided by its value at self propulsion, at least 0.005
    assert slipstream_speed(n, u, pitch, c_t1) == pytest.approx(u * eps, abs=1e-11)


@given(n=st.floats(-1e3, 1e3), u=st.just(0.0) | st.floats(-1e-9, 1e-9) | inflows, c_t1=st.floats(1e-3, 10.0))
def test_the_slipstream_is_finite_at_every_speed(n, u, c_t1):
    assert math.isfinite(slipstream_speed(n, u, 0.012, c_t1))


@given(u=st.floats(0.0, 3.0))
def test_at_self_propulsion_the_slipstream_adds_nothing(u):
    assert slipstream_speed(u / 0.012, u, 0.012, 0.1) == pytest.approx(0.0, abs=1e-13)


def test_from_rest_the_slipstream_is_that_of_the_propeller():
    pitch, n, c_t1 = 0.012, 100.0, 0.1
    expected = math.sqrt(c_t1) * pitch * n / (math.sqrt(c_t1 + 1.0) - 1.0)
    assert slipstream_speed(n, 0.0, pitch, c_t1) == pytest.approx(expected, rel=1e-14)
    assert slipstream_speed(n, 1e-12, pitch, c_t1) == pytest.approx(expected, rel=1e-9)  # no jump at u = 0
    assert slipstream_speed(0.0, 0.0, pitch, c_t1) == 0.0
