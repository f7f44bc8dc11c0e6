import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from auv_gym.physics.frames import euler_angles_of, quaternion_of, rotation_of
from auv_gym.records.attitude import (
    ANGLES,
    QUATERNION,
    angles,
    continuous,
    from_angles,
    from_enu_flu,
    interpolated,
    proper,
    turns,
    turns_far,
    unrolled,
)
from auv_gym.records.merging import merged
from auv_gym.records.record import Record
from auv_gym.records.streams import Stream

FINE = st.floats(-np.pi, np.pi)


@given(roll=FINE, pitch=st.floats(-np.pi / 2, np.pi / 2), heading=FINE)
def test_the_angles_are_those_of_the_compiled_form_and_give_the_attitude_back(roll, pitch, heading):
    q = np.array([quaternion_of(roll, pitch, heading)])
    found = [float(a[0]) for a in angles(q)]
    r = rotation_of(*q[0])
    assert found == pytest.approx(euler_angles_of(*r[:7]), abs=1e-9)
    assert rotation_of(*quaternion_of(*found)) == pytest.approx(r, abs=1e-9)


@given(roll=FINE, pitch=FINE, yaw=FINE)
def test_ros_axes_are_turned_to_ours(roll, pitch, yaw):
    """Against matrices: a vector in FLU turned to ENU is the same vector in FRD turned to NED."""
    q = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    ours = Rotation.from_quat(from_enu_flu([q.as_quat(scalar_first=True)])[0], scalar_first=True)
    flu = np.array([0.3, -0.7, 1.1])
    east, north, up = q.apply(flu)
    assert ours.apply(flu * [1, -1, -1]) == pytest.approx([north, east, -up], abs=1e-12)


def test_a_vehicle_that_looks_east_in_ros_has_a_heading_of_ninety_degrees():
    roll, pitch, heading = angles(from_enu_flu([[1.0, 0.0, 0.0, 0.0]]))
    assert np.degrees([roll[0], pitch[0], heading[0]]) == pytest.approx([0, 0, 90], abs=1e-12)


def test_signs_are_continuous_and_what_is_no_attitude_is_missing():
    q = np.array([[1, 0, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 0], [np.nan, 0, 0, 0], [-0.9, 0, 0, 0.1]], dtype=float)
    fine = proper(q)
    assert np.isnan(fine[2:4]).all()
    assert np.linalg.norm(fine[4]) == pytest.approx(1.0)
    assert (continuous(fine)[[0, 1, 4], 0] > 0).all()


@given(turns=st.floats(0.5, 3.0))
def test_a_loop_through_the_vertical_is_kept_by_resampling(turns):
    time = np.arange(0, 20, 0.1)
    angle = 2 * np.pi * turns * time / 20
    q = Rotation.from_rotvec(np.column_stack([0 * angle, angle, 0 * angle])).as_quat(scalar_first=True)
    record = Record.from_arrays(time, dict(zip(QUATERNION, continuous(q).T)))
    finer = record.resample(0.04)
    truth = Rotation.from_rotvec(np.column_stack([0 * finer.time, 2 * np.pi * turns * finer.time / 20, 0 * finer.time]))
    found = Rotation.from_quat(finer.matrix(QUATERNION), scalar_first=True)
    assert np.abs((truth.inv() * found).magnitude()).max() < 1e-9
    assert np.linalg.norm(finer.matrix(QUATERNION), axis=1) == pytest.approx(1.0, abs=1e-12)


def test_one_attitude_is_held():
    q = np.array([[1.0, 0, 0, 0]])
    assert interpolated(np.array([0.0, 5.0]), np.array([1.0]), q).tolist() == [[1, 0, 0, 0]] * 2


def looping(count: int, turn: float) -> tuple[np.ndarray, np.ndarray]:
    """Steps of a steady turn about the starboard axis through the vertical, and their angles, wrapped, (n, 3)."""
    steps = turn * np.arange(count)
    first = Rotation.from_euler("ZYX", [0.4, 0.0, 0.2])
    return steps, (first * Rotation.from_rotvec(np.outer(steps, [0.0, 1.0, 0.0]))).as_euler("ZYX")[:, ::-1]


def as_rotations(table: np.ndarray) -> Rotation:
    return Rotation.from_euler("ZYX", table[:, ::-1])


@given(roll=FINE, pitch=FINE, heading=FINE)
def test_quaternions_are_those_of_the_compiled_form(roll, pitch, heading):
    found, one = from_angles([roll], [pitch], [heading])[0], np.array(quaternion_of(roll, pitch, heading))
    assert min(np.abs(found - one).max(), np.abs(found + one).max()) < 1e-14


def test_turns_add_up_through_the_vertical():
    steps, table = looping(60, 0.2)
    assert np.ptp(table[:, 1]) > 2.5
    q = from_angles(*table.T)
    assert turns(q) == pytest.approx(np.tile([0.0, 0.2, 0.0], (59, 1)), abs=1e-12)
    assert unrolled(q) == pytest.approx(np.outer(steps, [0.0, 1.0, 0.0]), abs=1e-11)


def test_an_attitude_turns_far_where_it_is_steep_or_roll_jumps():
    calm, none = np.linspace(-0.9, 0.9, 20), np.zeros(20)
    assert not turns_far(calm, calm)
    assert not turns_far(3.0 * calm + 20.0, calm)  # a roll that goes on past half a turn is smooth
    assert turns_far(none, 1.2 * calm)
    assert turns_far(np.where(calm > 0.0, np.pi, 0.0), none)
    assert not turns_far(none, 2.0 * np.pi + calm)  # a pitch that was unwrapped


def test_resampled_attitudes_follow_the_shortest_turn_through_the_vertical():
    _, table = looping(200, 0.2)
    record = Record.from_arrays(0.1 * np.arange(200), dict(zip(ANGLES, table.T, strict=True)))
    fine = record.resample(0.025)
    expected = looping(len(fine), 0.05)[1]
    # the angle between two rotations that agree to 1e-15 is known to its root
    assert (as_rotations(fine.matrix(ANGLES)).inv() * as_rotations(expected)).magnitude().max() < 1e-7
    assert np.abs(np.diff(fine["roll_rad"])).max() < np.pi + 0.1  # jumps of half a turn, none of a whole one


def test_level_attitudes_are_resampled_as_angles():
    time = 0.1 * np.arange(50)
    channels = {name: 0.5 * np.sin(time + k) for k, name in enumerate(ANGLES)}
    fine = Record.from_arrays(time, channels).resample(0.05)
    for name in ANGLES:
        assert np.array_equal(fine[name], np.interp(fine.time, time, channels[name]))


def test_merged_attitudes_follow_the_shortest_turn_through_the_vertical():
    _, table = looping(200, 0.2)
    time = 0.1 * np.arange(200)
    values = dict(zip(ANGLES, table.T, strict=True))
    values = {name: np.insert(column, 70, np.nan) for name, column in values.items()}  # a row that missed it
    attitude = Stream(np.insert(time, 70, 6.95), values)
    depth = Stream(0.025 * np.arange(797), {"depth_m": np.zeros(797)})
    found = merged([depth, attitude], leading="depth_m")
    brought = np.column_stack([found.values[name] for name in ANGLES])
    assert np.isfinite(brought).all()
    expected = looping(797, 0.05)[1]
    assert (as_rotations(brought).inv() * as_rotations(expected)).magnitude().max() < 1e-7
