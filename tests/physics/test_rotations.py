"""Rotation vectors: they lead to the attitude that they came from, from nothing up to half a turn, and scipy agrees."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from auv_gym.physics.frames import quaternion_of
from auv_gym.physics.rotations import into_chart, into_level_chart, out_of_chart, turn_between, turned

turns = st.floats(-4.0, 4.0)
angles = st.tuples(turns, turns, turns)
sizes = st.floats(0.0, math.pi - 1e-6) | st.floats(-300.0, -3.0).map(lambda e: 10.0**e)
axes = st.tuples(turns, turns, turns).filter(lambda v: np.linalg.norm(v) > 0.1)


def vector(size: float, axis) -> np.ndarray:
    return size * np.array(axis) / np.linalg.norm(axis)


def rotation(of) -> Rotation:
    """Of roll, pitch and heading."""
    return Rotation.from_euler("ZYX", np.array(of)[::-1])


@given(start=angles, size=sizes, axis=axes)
def test_a_turn_is_found_again(start, size, axis):
    v, e = vector(size, axis), quaternion_of(*start)
    # of small turns, what two quaternions of length 1 differ by is known to rounding; from none, all digits are
    assert turn_between(*e, *turned(*e, *v)) == pytest.approx(v, abs=1e-14)
    if size > 1e-140:  # squares of smaller ones are zero
        assert turn_between(1.0, 0.0, 0.0, 0.0, *turned(1.0, 0.0, 0.0, 0.0, *v)) == pytest.approx(v, rel=1e-13)


@given(start=angles, axis=axes, off=st.floats(0.0, 1e-6) | st.floats(-1e-6, 0.0))
def test_about_half_a_turn_either_way_leads_there(start, axis, off):
    e = quaternion_of(*start)
    f = turned(*e, *vector(math.pi + off, axis))
    back = np.array(turn_between(*e, *f))
    assert np.linalg.norm(back) <= math.pi * (1.0 + 1e-15)
    assert abs(np.dot(turned(*e, *back), f)) == pytest.approx(1.0, abs=1e-15)


@given(first=angles, second=angles, v=angles)
def test_turns_are_those_of_scipy(first, second, v):
    e, f = quaternion_of(*first), quaternion_of(*second)
    between = rotation(first).inv() * rotation(second)
    assert rotation_error(Rotation.from_rotvec(turn_between(*e, *f)), between) < 1e-14
    expected = rotation(first) * Rotation.from_rotvec(v)
    assert rotation_error(Rotation.from_quat(turned(*e, *v), scalar_first=True), expected) < 1e-14


@given(reference=angles, roll=turns, heading=turns, pitch=turns | st.sampled_from([0.5 * math.pi, -0.5 * math.pi]))
def test_angles_go_into_a_chart_and_out_of_it(reference, roll, pitch, heading):
    seen, e = np.array([roll, pitch, heading]), np.array(quaternion_of(*reference))
    into_chart(e, seen)
    between = rotation(reference).inv() * rotation((roll, pitch, heading))
    assert rotation_error(Rotation.from_rotvec(seen), between) < 1e-14
    out_of_chart(e, seen)
    assert rotation_error(rotation(seen), rotation((roll, pitch, heading))) < 1e-14
    assert abs(seen[1]) <= 0.5 * math.pi


@given(reference=angles, off=st.floats(-3.0, 3.0))
def test_a_compass_errs_about_the_vertical_whatever_the_tilt(reference, off):
    roll, pitch, heading = reference
    seen = np.array([roll, pitch, heading + off])
    into_level_chart(np.array(quaternion_of(*reference)), seen)
    assert seen == pytest.approx([0.0, 0.0, off], abs=1e-12)


@given(reference=angles, v=angles)
def test_level_axes_are_those_of_the_reference_turned_by_its_heading(reference, v):
    e = np.array(quaternion_of(*reference))
    seen = np.array(v)
    out_of_chart(e, seen)
    into_level_chart(e, seen)
    short = Rotation.from_rotvec(v).as_rotvec()  # of at most half a turn
    ahead = rotation(reference).apply([1.0, 0.0, 0.0])
    level = Rotation.from_euler("z", math.atan2(ahead[1], ahead[0])).inv() * rotation(reference)
    assert rotation_error(Rotation.from_rotvec(seen), Rotation.from_rotvec(level.apply(short))) < 1e-12


def rotation_error(one: Rotation, other: Rotation) -> float:
    return float(np.abs(one.as_matrix() - other.as_matrix()).max())


def test_attitudes_of_nothing_are_nothing():
    seen = np.array([0.1, np.nan, 0.3])
    into_chart(np.array(quaternion_of(0.0, 0.0, 0.0)), seen)
    assert np.isnan(seen).all()
