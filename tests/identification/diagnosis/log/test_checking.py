"""What of a log is compared: speeds that nothing tells, and the depth that follows from them."""

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.diagnosis.log.checking import _adrift
from identification.fit.stretches import Stretches

TIME = np.arange(0.0, 20.0, 0.05)
SPEEDS = ("u_mps", "v_mps", "w_mps")


def log_of(steep: float, *more: str) -> Record:
    """A vehicle that pitches so far, its thrusters idle."""
    rng = np.random.default_rng(0)
    names = ("roll_rad", "heading_rad", "p_radps", "q_radps", "r_radps", "depth_m", *more)
    channels = {name: 0.01 * rng.standard_normal(TIME.size) for name in names}
    channels |= {f"t{k}_us": np.full(TIME.size, 1500.0) for k in range(1, 7)}
    return Record.from_arrays(TIME, channels | {"pitch_rad": steep * np.sin(TIME)})


@pytest.mark.parametrize(
    "steep, more, left_out",
    [
        (1.4, (), ("depth_m",)),
        (0.3, (), ()),
        (1.4, ("u_dvl_mps", "v_dvl_mps", "w_dvl_mps"), ()),
        (1.4, ("north_m", "east_m"), ()),
    ],
)
def test_the_depth_of_a_vehicle_that_loops_needs_its_speeds(steep, more, left_out):
    load_vehicle("bluerov")
    assert _adrift(log_of(steep, *more), load_vehicle("bluerov")) == left_out
    assert _adrift(log_of(steep), load_vehicle("vt690")) == ()  # a torpedo's speed is that of its propeller


@pytest.mark.parametrize(
    "dropped, more, resting",
    [
        (("depth_m",), (), set(SPEEDS)),
        ((), (), {"u_mps", "v_mps"}),
        ((), ("u_dvl_mps", "v_dvl_mps", "w_dvl_mps"), set()),
    ],
)
def test_speeds_that_nothing_tells_begin_at_rest_and_nothing_pushes_them(dropped, more, resting):
    plant, record = load_vehicle("bluerov"), log_of(0.3, *more).without(dropped)
    problem = Stretches(plant, record, record.segments)
    states = [(*plant.family.states, *plant.family.sensors)[i] for i in problem.live]
    assert set(SPEEDS) - set(states) == resting
    assert set(SPEEDS) - set(problem.pushed) == resting
    assert not problem.starts[:, [plant.family.states.index(name) for name in sorted(resting)]].any()
