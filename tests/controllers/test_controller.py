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
    "vehicle, kind, target, words",
    [
        ("slocum", "pid", {"heading": 0.5}, "no channel 'heading' to follow. Did you mean 'heading_rad'"),
        ("slocum", "pid", {"heading_deg": 30.0}, "no channel 'heading_deg' to follow. Did you mean 'heading_rad'"),
        ("slocum", "pid", {"heading_rad": 0.5, "depth": 12.0}, "no channel 'depth' to follow. This .* heading_rad, in"),
        ("slocum", "gpc", {"heading": 0.5}, "no channel 'heading' to follow"),
        ("slocum", "pid", {"depth_m": 12.0}, "Pid needs a target for heading_rad, got targets for depth_m: add it"),
        ("slocum", "pid", {}, "Pid needs a target for heading_rad, got none: add it"),
        ("heu_torpedo", "s_plane", {"depth": 12.0}, "Did you mean 'depth_m'.* follows depth_m, heading_rad and u_mps"),
        ("remus100", "pid", {"depth": 12.0}, "Did you mean 'depth_m'.* follows depth_m, heading_rad and u_mps"),
        ("remus100", "gpc", {"depth": 12.0}, "Did you mean 'depth_m'.* follows depth_m, heading_rad and u_mps"),
        ("bluerov2_heavy", "pid", {"depth": 12.0}, "Did you mean 'depth_m'"),
        ("bluerov2_heavy", "gpc", {"depth": 12.0}, "Did you mean 'depth_m'"),
        ("seaglider", "pid", {"depth": 12.0}, "Did you mean 'depth_m'"),
        ("seaglider", "pid", {"depth_m": 12.0, "heading": 1.0}, "no channel 'heading' to follow"),
        ("seawing", "pid", {"heading": 0.5}, "Did you mean 'heading_rad'"),
        ("seawing", "pid", {"north_m": 9.0}, "Yo needs a target for east_m, got targets for north_m: add it"),
    ],
)
def test_targets_are_channels_and_those_of_a_single_loop_are_needed(vehicle, kind, target, words):
    plant = load_vehicle(vehicle)
    controller = autopilot(plant, kind)
    reading = {**dict.fromkeys(plant.outputs, 0.0), "dt_s": plant.dt}
    with pytest.raises(ValueError, match=words):
        controller.act(controller.start(), reading, target)


def test_channels_that_a_controller_does_not_follow_are_ignored():
    plant = load_vehicle("slocum")
    controller, reading = autopilot(plant), {"heading_rad": 0.1, "dt_s": plant.dt}
    alone = controller.act(controller.start(), reading, {"heading_rad": 0.5})
    assert controller.act(controller.start(), reading, {"heading_rad": 0.5, "depth_m": 12.0, "surge_N": 1.0}) == alone
    torpedo = load_vehicle("remus100")
    controller, reading = autopilot(torpedo), {**dict.fromkeys(torpedo.outputs, 0.0), "dt_s": torpedo.dt}
    assert controller.act(controller.start(), reading, {"altitude_m": 12.0})[0] == {}


@pytest.mark.parametrize("vehicle, name", [("slocum", "heading_rad"), ("remus100", "depth_m"), ("seawing", "depth_m")])
def test_readings_that_are_missing_are_asked_for(vehicle, name):
    controller = autopilot(load_vehicle(vehicle))
    with pytest.raises(ValueError, match=f"needs a reading of {name}, got readings of dt_s: add it"):
        controller.act(controller.start(), {"dt_s": 4.0}, {name: 1.0})


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
