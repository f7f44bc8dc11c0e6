"""Attitude: rotations stay orthogonal, and quaternions and Euler angles give each other back, also bow down."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from auv_gym.physics.frames import (
    compiled_euler_rates,
    compiled_velocity_ned,
    euler_angles_of,
    euler_rates,
    quaternion_of,
    rotation_of,
    velocity_ned,
    wrapped,
)

turns = st.floats(-4.0, 4.0)
half_turns = st.floats(-0.5 * math.pi, 0.5 * math.pi)
vertical = st.sampled_from([0.5 * math.pi, -0.5 * math.pi])


def rotation(roll: float, pitch: float, heading: float) -> np.ndarray:
    return np.reshape(rotation_of(*quaternion_of(roll, pitch, heading)), (3, 3))


def angles(matrix: np.ndarray) -> tuple[float, float, float]:
    return euler_angles_of(*matrix[0], *matrix[1], matrix[2, 0])


@given(roll=turns, pitch=turns, heading=turns)
def test_the_rotation_is_heading_then_pitch_then_roll(roll, pitch, heading):
    expected = Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix()
    assert rotation(roll, pitch, heading) == pytest.approx(expected, abs=2e-15)


def test_body_axes_of_a_vehicle_that_has_turned_pitched_and_rolled():
    east, up, port_down = rotation(0.0, 0.0, math.pi / 2), rotation(0.0, math.pi / 2, 0.0), rotation(-math.pi / 2, 0, 0)
    assert east @ [1, 0, 0] == pytest.approx([0, 1, 0], abs=1e-15)
    assert up @ [1, 0, 0] == pytest.approx([0, 0, -1], abs=1e-15)
    assert port_down @ [0, 1, 0] == pytest.approx([0, 0, -1], abs=1e-15)


@given(roll=turns, pitch=turns, heading=turns)
def test_a_body_velocity_turns_as_the_rotation_does(roll, pitch, heading):
    v = np.array([0.4, -0.2, 0.1])
    expected = Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix() @ v
    assert velocity_ned(*v, roll, pitch, heading) == pytest.approx(expected, abs=2e-15)
    assert compiled_velocity_ned(*v, roll, pitch, heading) == pytest.approx(expected, abs=2e-15)


@given(roll=turns, pitch=st.floats(-1.4, 1.4), heading=turns)
def test_euler_rates_are_those_of_a_small_rotation(roll, pitch, heading):
    body = np.array([0.3, -0.5, 0.2])
    h = 1e-5  # central differences leave h^2 of the third derivative, which tan(pitch) < 6 makes 200 times larger
    attitude = Rotation.from_euler("ZYX", [heading, pitch, roll])
    after, before = ((attitude * Rotation.from_rotvec(side * h * body)).as_euler("ZYX") for side in (1.0, -1.0))
    expected = (after - before + math.pi) % (2.0 * math.pi) - math.pi
    assert euler_rates(*body, roll, pitch) == pytest.approx(expected[::-1] / (2.0 * h), abs=1e-6)
    assert compiled_euler_rates(*body, roll, pitch) == pytest.approx(euler_rates(*body, roll, pitch), rel=1e-14)


@given(q=st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_a_rotation_is_orthogonal_whatever_the_norm_of_its_quaternion(q):
    matrix = np.reshape(rotation_of(*q), (3, 3))
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=3e-15)
    assert np.linalg.det(matrix) == pytest.approx(1.0, abs=3e-15)


@given(roll=turns, pitch=turns, heading=turns)
def test_a_quaternion_of_angles_has_length_one(roll, pitch, heading):
    assert math.hypot(*quaternion_of(roll, pitch, heading)) == pytest.approx(1.0, abs=1e-15)


@given(roll=turns, pitch=half_turns | vertical | vertical.map(lambda p: p * (1.0 - 1e-9)), heading=turns)
def test_euler_angles_give_the_rotation_back_even_bow_down(roll, pitch, heading):
    matrix = rotation(roll, pitch, heading)
    found = angles(matrix)
    assert rotation(*found) == pytest.approx(matrix, abs=3e-15)
    assert abs(found[1]) <= 0.5 * math.pi


@given(roll=st.floats(-3.1, 3.1), pitch=st.floats(-1.5, 1.5), heading=st.floats(-3.1, 3.1))
def test_euler_angles_come_back_where_the_bow_is_not_vertical(roll, pitch, heading):
    # the directions of heading and roll are known to rounding over cos(1.5) = 0.07
    assert angles(rotation(roll, pitch, heading)) == pytest.approx((roll, pitch, heading), abs=1e-14)


@given(pitch=vertical, roll=turns, heading=turns)
def test_bow_down_only_one_of_heading_and_roll_counts(pitch, roll, heading):
    # both turn about the vertical: the rotation depends on their difference, and bow down on their sum
    side = math.copysign(1.0, pitch)
    together = rotation(roll - side * heading, pitch, 0.0)
    assert rotation(roll, pitch, heading) == pytest.approx(together, abs=3e-15)


@given(angle=st.floats(-1e3, 1e3))
def test_wrapped_angles_lie_within_half_a_turn_and_differ_by_whole_turns(angle):
    found = wrapped(angle)
    assert -math.pi <= found <= math.pi
    assert (angle - found) / (2.0 * math.pi) == pytest.approx(round((angle - found) / (2.0 * math.pi)), abs=1e-12)


@pytest.mark.parametrize(
    "angle, expected", [(math.pi, -math.pi), (-math.pi, -math.pi), (0.0, 0.0), (7.0, 7 - 2 * math.pi)]
)
def test_half_a_turn_is_taken_as_one_to_port(angle, expected):
    assert wrapped(angle) == pytest.approx(expected, abs=1e-15)
