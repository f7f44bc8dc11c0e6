from math import radians

import numpy as np
import pytest

from auv_gym.channels import set_point_of
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.cruise import find_cruise
from auv_gym.plant.float_engine import find_engine
from controllers.autopilots import autopilot, gpc_autopilot
from controllers.composed.loops import Joint
from controllers.gains import Gains
from controllers.kinds.body import PITCH_LIMIT
from controllers.predictive.gpc import Gpc
from controllers.trials.settling import step_response
from controllers.trials.trial import at_rest, level_flight, run_trial

PITCH = radians(5.0)


def errors(run, name):
    return np.abs(run[name] - run[set_point_of(name)])


@pytest.mark.parametrize("vehicle", ["npsauv", "heu_torpedo"])
def test_a_torpedo_reaches_depth_heading_and_speed(vehicle):
    plant = load_vehicle(vehicle)
    cruise, length = find_cruise(plant), plant.hull.length
    targets = {
        "depth_m": [(0.0, 20.0 + 2.0 * length)],
        "heading_rad": [(0.0, 0.8)],
        "u_mps": [(0.0, 0.9 * cruise.speed)],
    }
    duration = 35.0 * length / cruise.speed
    run = run_trial(plant, gpc_autopilot(plant), targets, duration, start=level_flight(plant, 20.0))
    last = slice(-len(run["time_s"]) // 10, None)
    assert errors(run, "depth_m")[last].max() < 0.05 * length
    assert errors(run, "heading_rad")[last].max() < 0.01
    assert errors(run, "u_mps")[last].max() < 0.03 * cruise.speed
    # the linear form does not know all of the vehicle, and plans see it at their own samples only
    assert np.abs(run["pitch_rad"]).max() < PITCH_LIMIT + radians(4.0)


def test_an_unstable_vehicle_with_a_list_stays_level():
    plant = load_vehicle("remus100")
    targets = {"depth_m": [(0.0, 21.0)], "heading_rad": [(0.0, 1.5)], "u_mps": [(0.0, 1.4)]}
    run = run_trial(plant, gpc_autopilot(plant), targets, 60.0, start=level_flight(plant, 20.0))
    assert run["heading_rad"].max() < 1.55
    assert errors(run, "depth_m")[-100:].max() < 0.05
    assert errors(run, "heading_rad")[-100:].max() < 0.02


@pytest.mark.parametrize("vehicle", ["slocum", "ganeshblue"])
def test_a_glider_turns(vehicle):
    plant = load_vehicle(vehicle)
    run = run_trial(
        plant, gpc_autopilot(plant), {"heading_rad": [(0.0, 1.0)]}, 60.0 * plant.dt, start=at_rest(plant, {})
    )
    assert errors(run, "heading_rad")[-5:].max() < 1e-3
    assert np.abs(run["rudder_rad"]).max() <= plant.hull.rudder_limit


@pytest.mark.parametrize("vehicle", ["qiandao_float", "mermaid"])
def test_a_float_dives(vehicle):
    plant = load_vehicle(vehicle)
    engine = find_engine(plant)
    targets = {"depth_m": [(0.0, 100.0 + engine.speed * engine.time)]}
    run = run_trial(plant, gpc_autopilot(plant), targets, 5.0 * engine.time, start=at_rest(plant, {"depth_m": 100.0}))
    assert errors(run, "depth_m")[-3:].max() < 0.01 * engine.speed * engine.time
    assert run[engine.channel].min() >= engine.middle - engine.half
    assert run[engine.channel].max() <= engine.middle + engine.half


def test_a_heavy_torpedo_keeps_its_depth():
    """Net weight, a stern plane that stands wrong, and a pitch sensor that reads wrong: none leaves an offset."""
    plant = load_vehicle("npsauv")
    pilot = gpc_autopilot(plant, ["depth_m"])
    laden = replace_at(plant, {"effects.load.force_z": 40.0, "effects.stern_plane.offset": 0.02})
    run = run_trial(laden, pilot, {"depth_m": [(0.0, 20.0)]}, 400.0, start=level_flight(plant, 20.0))
    assert errors(run, "depth_m").max() > 0.05
    assert errors(run, "depth_m")[-50:].max() < 2e-3


@pytest.mark.parametrize("dt", [0.1, 4.0])
def test_with_a_pitch_limit_it_tracks_depth_better_than_pid(dt):
    """The sum of squared errors over steps of 2 lengths, from the same start, both told of the limit."""
    plant = load_vehicle("npsauv", dt=dt)
    targets = {"depth_m": [(0.0, 20.0), (8.0, 30.6), (208.0, 20.0)]}
    cost, pitch = {}, {}
    for kind in ("pid", "gpc"):
        pilot = autopilot(plant, kind, ["depth_m"], pitch_limit=PITCH)
        run = run_trial(plant, pilot, targets, 400.0, start=level_flight(plant, 20.0))
        cost[kind] = float(np.sum(errors(run, "depth_m") ** 2))
        pitch[kind] = float(np.abs(run["pitch_rad"]).max())
    assert cost["gpc"] < cost["pid"]
    assert pitch["gpc"] < PITCH + radians(0.5)


@pytest.mark.parametrize("channel, start, target", [("heading_rad", 0.0, 0.87), ("depth_m", 20.0, 25.0)])
@pytest.mark.parametrize("seed", [None, 0])
def test_it_settles_no_later_than_pid(channel, start, target, seed):
    plant, settled = load_vehicle("heu_torpedo"), {}
    steps = {"depth_m": 20.0, "heading_rad": 0.0, "u_mps": find_cruise(plant).speed, channel: target}
    for kind in ("pid", "gpc"):
        rng = None if seed is None else np.random.default_rng(seed)
        targets = {name: [(0.0, value)] for name, value in steps.items()}
        run = run_trial(plant, autopilot(plant, kind), targets, 30.0, start=level_flight(plant, 20.0), rng=rng)
        settled[kind] = step_response(run["time_s"], run[channel], target, 0.05 * abs(target - start))
    assert settled["gpc"].settling_time <= settled["pid"].settling_time
    assert abs(settled["gpc"].steady_error) < 0.005 * abs(target - start)


@pytest.mark.parametrize("vehicle, settling", [("heu_torpedo", 10.0), ("npsauv", 50.0), ("remus100", 12.0)])
def test_the_speed_has_no_offset_where_the_drag_bends(vehicle, settling):
    """A fifth slower than the speed of the linear form; the time, s, is a third more than the vehicle takes."""
    plant = load_vehicle(vehicle)
    speed = find_cruise(plant).speed
    targets = {"depth_m": [(0.0, 20.0)], "heading_rad": [(0.0, 0.0)], "u_mps": [(0.0, 0.8 * speed)]}
    run = run_trial(plant, gpc_autopilot(plant), targets, 3.0 * settling, start=level_flight(plant, 20.0))
    step = step_response(run["time_s"], run["u_mps"], 0.8 * speed, 0.01 * speed)
    assert step.settling_time < settling
    assert abs(step.steady_error) < 1e-3 * speed


def test_each_motion_has_a_controller_of_its_own():
    plant = load_vehicle("npsauv")
    pilot = gpc_autopilot(plant, horizon=20, moves=5, pitch_limit=PITCH)
    assert isinstance(pilot, Joint)
    assert set(pilot.commands) == set(plant.inputs)
    assert set(pilot.targets) == {"depth_m", "heading_rad", "u_mps"}
    depth, heading, speed = pilot.controllers
    assert isinstance(depth.controller, Gpc)
    assert depth.controller.output_limits["pitch_rad"] == pytest.approx((-PITCH, PITCH))
    assert (heading.controller.horizon, speed.moves) == (20, 5)
    slow = gpc_autopilot(plant, ["u_mps"], dt=0.5)
    assert (slow.model.dt, slow.every) == (plant.dt, 5)


def test_pitch_can_stand_in_the_place_of_depth():
    plant = load_vehicle("heu_torpedo")
    pilot = gpc_autopilot(plant, ["pitch_rad"])
    run = run_trial(plant, pilot, {"pitch_rad": [(0.0, 0.1)]}, 20.0, start=level_flight(plant, 50.0))
    assert errors(run, "pitch_rad")[-20:].max() < 0.005
    with pytest.raises(ValueError, match="stern_plane_rad twice"):
        gpc_autopilot(plant, ["depth_m", "pitch_rad"])


@pytest.mark.parametrize(
    "vehicle, options, message",
    [
        ("npsauv", {"targets": ["roll_rad"]}, "targets among depth_m, heading_rad, u_mps, pitch_rad, got roll_rad"),
        ("npsauv", {"targets": []}, "got none"),
        ("npsauv", {"pitch_limit": 2.0}, "for vehicles that dive by pitch"),
        ("slocum", {"pitch_limit": 0.1}, "for vehicles that dive by pitch"),
        ("npsauv", {"dt": 0.25}, "dt a multiple of the 0.1 s of 'npsauv', got 0.25"),
    ],
)
def test_what_a_vehicle_cannot_follow_is_refused(vehicle, options, message):
    with pytest.raises(ValueError, match=message):
        gpc_autopilot(load_vehicle(vehicle), **options)


def test_gains_set_each_channels_plan_and_settings_go_before_them():
    plant = load_vehicle("slocum")
    gains = Gains(plant.name, plant.dt, loops={"gpc": {"heading_rad": {"effort": 3.0, "drift_factor": 0.5}}})
    plain, tuned, given = (
        autopilot(plant, "gpc", **settings) for settings in ({}, {"gains": gains}, {"gains": gains, "effort": 1.0})
    )
    assert (tuned.effort, tuned.drift_factor, given.effort) == (3.0, 0.5, 1.0)
    reading = {"heading_rad": 0.0, "dt_s": plant.dt}
    first = [abs(pilot.act(pilot.start(), reading, {"heading_rad": 0.02})[0]["rudder_rad"]) for pilot in (plain, tuned)]
    assert first[1] < 0.8 * first[0]
