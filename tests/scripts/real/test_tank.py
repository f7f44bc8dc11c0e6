"""A BlueROV2 Heavy in a tank: what its joystick does to thrusters, and samples that cannot be."""

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from auv_gym.plant.thrusters import AXES, find_thrusters
from scripts.real.tank import JUDGED, tank_record

THRUSTERS = find_thrusters(load_vehicle("bluerov2_heavy"))


def table(**columns) -> np.ndarray:
    axes = ["cmd_heave_down_norm" if axis == "heave" else f"cmd_{axis}_norm" for axis in AXES]
    names = ["time_s", "x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad", *JUDGED, *axes]
    rows = np.zeros(8, dtype=[(name, float) for name in names])
    rows["time_s"] = 0.2 * np.arange(8)
    for name, values in columns.items():
        rows[name] = values
    return rows


@pytest.mark.parametrize("axis", range(6))
def test_an_axis_of_the_joystick_pushes_along_that_axis(axis):
    name = "heave_down" if AXES[axis] == "heave" else AXES[axis]
    record = tank_record(table(**{f"cmd_{name}_norm": 0.25}), THRUSTERS, "run")
    wrench = THRUSTERS.wrench @ record.matrix(THRUSTERS.channels)[0]
    assert wrench[axis] > 0.0
    assert np.abs(np.delete(wrench, axis)).max() < 1e-12


def test_a_heading_halfway_through_its_jump_is_left_out():
    yaw = [2.4, 2.5, 2.6, -0.5, -3.6, -3.5, -3.4, -3.3]
    record = tank_record(table(yaw_rad=yaw), THRUSTERS, "run")
    assert len(record) == 7
    np.testing.assert_allclose(np.diff(record["heading_rad"]), [0.1, 0.1, 2.0 * np.pi - 6.2, 0.1, 0.1, 0.1])
