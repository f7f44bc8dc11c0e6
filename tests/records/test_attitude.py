import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from auv_gym.physics.frames import euler_angles_of, quaternion_of, rotation_of
from auv_gym.records.attitude import QUATERNION, angles, continuous, from_enu_flu, interpolated, proper
from auv_gym.records.record import Record

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
