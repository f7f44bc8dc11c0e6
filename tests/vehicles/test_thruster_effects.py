"""What can happen to a vehicle with thrusters as a whole: how its IMU sits in it, and what its battery does."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auv_gym.model import simulate
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.attitude import ANGLES
from auv_gym.records.record import Record

RATES = ("p_radps", "q_radps", "r_radps")


def telegraph(seconds: float = 10.0, shift: float = 0.0) -> Record:
    plant, rng = load_vehicle("bluerov"), np.random.default_rng(3)
    time = plant.dt * np.arange(round(seconds / plant.dt))
    holds = [np.repeat(rng.choice([-160.0, 160.0], time.size // 10 + 1), 10)[: time.size] for _ in range(6)]
    return Record.from_arrays(shift + time, {f"t{k}_us": 1500.0 + hold for k, hold in enumerate(holds, 1)})


def turns(record: Record) -> Rotation:
    return Rotation.from_euler("xyz", record.matrix(ANGLES))


@pytest.mark.slow
@pytest.mark.parametrize("roll, pitch, yaw", [(0.1, 0.0, 0.0), (0.0, -0.2, 0.0), (0.3, 0.2, -0.5)])
def test_an_imu_that_is_turned_in_its_mount_turns_all_that_it_reads(roll, pitch, yaw):
    plant, record = load_vehicle("bluerov"), telegraph()
    mounted = {"effects.mount.roll": roll, "effects.mount.pitch": pitch, "effects.mount.yaw": yaw}
    true, read = simulate(plant, record), simulate(replace_at(plant, mounted), record)
    own = Rotation.from_euler("xyz", [roll, pitch, yaw])
    assert ((turns(true) * own).inv() * turns(read)).magnitude().max() < 1e-12
    np.testing.assert_allclose(read.matrix(RATES), own.inv().apply(true.matrix(RATES)), atol=1e-12)
    assert np.abs(np.diff(read["heading_rad"])).max() < 1.0  # no jump of a turn
    np.testing.assert_array_equal(read["depth_m"], true["depth_m"])


@pytest.mark.slow
def test_a_battery_sags_from_where_a_log_begins():
    plant = load_vehicle("bluerov")
    sagging = replace_at(plant, "effects.supply.sag", 0.05)
    early, late = simulate(sagging, telegraph()), simulate(sagging, telegraph(shift=100.0))
    np.testing.assert_allclose(late.matrix(RATES), early.matrix(RATES), atol=1e-9)
    record = telegraph()
    known = record.with_channels({"supply_V": 16.0 - 0.05 * record.elapsed})
    np.testing.assert_array_equal(simulate(plant, known).matrix(RATES), early.matrix(RATES))
    assert np.abs(simulate(plant, record).matrix(RATES) - early.matrix(RATES)).max() > 1e-3
