"""What every controller asks of its readings."""

import pytest

from auv_gym.plant import load_vehicle
from controllers.autopilots import autopilot


@pytest.mark.parametrize("vehicle, kind", [("slocum", "pid"), ("slocum", "gpc"), ("heu_torpedo", "s_plane")])
def test_readings_without_the_time_since_the_last_call_are_refused(vehicle, kind):
    plant = load_vehicle(vehicle)
    controller = autopilot(plant, kind)
    reading, target = dict.fromkeys(plant.outputs, 0.0), {"heading_rad": 0.1, "depth_m": 5.0, "u_mps": 1.0}
    _, memory = controller.act(
        controller.start(), {**reading, "dt_s": plant.dt}, target
    )  # predictive control asks later
    with pytest.raises(
        ValueError,
        match=r"needs dt_s, the time since its last call in s, above 0 among its readings; got .*heading_rad",
    ):
        controller.act(memory, reading, target)
    with pytest.raises(ValueError, match=r"above 0 among its readings; got .*-4"):
        controller.act(memory, {**reading, "dt_s": -4.0}, target)


@pytest.mark.parametrize(
    "vehicle, targets, words",
    [
        ("remus100", None, r"autopilot needs a vehicle, got 'remus100': give load_vehicle\('remus100'\)"),
        (load_vehicle("remus100"), "depth_m", r"targets needs a list of names, .*: write \['depth_m'\]"),
    ],
)
def test_a_name_is_neither_a_vehicle_nor_a_list_of_targets(vehicle, targets, words):
    with pytest.raises(ValueError, match=words):
        autopilot(vehicle, targets=targets)
