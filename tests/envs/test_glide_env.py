"""Glide: what its tables promise, its options, and the operators' rule at the wheel."""

from itertools import pairwise
from math import hypot

import numpy as np
import pytest

from auv_gym.envs.task_env import TaskEnv
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.flying import neutral_engine, steered
from auv_gym.vehicles.glide_steered import GLIDE_STEERED
from controllers.autopilots import autopilot
from controllers.gains import Gains
from controllers.piloting import pilot_for
from tests.envs.env_runs import run

CURRENT = {"effects.current.north": 0.06, "effects.current.east": -0.08}
NAMES = ("seaglider", "slocum_flight", "seaexplorer")


def flown(env, seed=0, **settings):
    """Infos of an episode that the operators' rule flies, and the states beside them."""
    act = pilot_for(env, "pid", **settings).begin(env)
    observation, info = env.reset(seed=seed)
    infos, over = [info], False
    while not over:
        observation, _, terminated, truncated, info = env.step(act(observation, info))
        infos.append(info)
        over = terminated or truncated
    return infos


@pytest.fixture(scope="module")
def dives():
    return flown(TaskEnv("Glide", effects=CURRENT, randomise={}, waypoints=[(9e3, 2e3, 0.0)], duration=12_000.0))


def test_an_action_commands_engine_battery_and_what_turns_the_glider():
    for name, turning in zip(NAMES, ("battery_roll_rad", "rudder_rad", "battery_roll_rad"), strict=True):
        env = TaskEnv("Glide", name)
        hull, s = env.plant.hull, env.plant.parameters.steering
        assert env.episodes.actions == ("buoyancy_volume_m3", "battery_position_m", turning)
        command = run(env, [[-2.0, 1.0, -0.5]])[0][-1]["command"]
        assert command["buoyancy_volume_m3"] == pytest.approx(hull.engine_low)
        assert command["battery_position_m"] == pytest.approx(s.battery_high)
        assert command[turning] == pytest.approx(-0.5 * (s.rudder_limit if turning == "rudder_rad" else s.roll_limit))


def test_energy_is_pump_work_over_efficiency_and_hotel_load(dives):
    env = TaskEnv("Glide")
    hull, s = env.plant.hull, env.plant.parameters.steering
    spent, engine = 0.0, hull.engine_high
    for before, after in pairwise(dives):
        most = env.plant.dt / s.pump_slowness
        move = np.clip(after["command"]["buoyancy_volume_m3"] - engine, -most, most)
        engine += move
        pressure = hull.density * 9.81 * max(before["reading"]["depth_m"], 0.0)
        spent += pressure * max(move, 0.0) / s.pump_efficiency + s.hotel * env.plant.dt
        assert after["energy_J"] == pytest.approx(spent)
        assert engine == pytest.approx(after["state"]["buoyancy_volume_m3 position"], abs=1e-9)
    assert spent > 2.0 * s.hotel * dives[-1]["time_s"]


def test_a_fix_tells_the_current_of_the_dive_before(dives):
    shown = [(i["reading"]["current_north_mps"], i["reading"]["current_east_mps"]) for i in dives]
    first = next(k for k, current in enumerate(shown) if current != (0.0, 0.0))
    assert dives[first]["reading"]["depth_m"] < 1.0
    assert dives[first]["time_s"] > 1000.0
    # the path is reckoned by a usual angle of attack, of another lift than the rule flies with
    assert shown[first] == pytest.approx(tuple(CURRENT.values()), abs=0.03)
    off = [hypot(i["state"][n] - i["reading"][n], i["state"][e] - i["reading"][e]) for i in dives
           for n, e in [("north_m", "east_m")]]  # fmt: skip
    assert off[first] < 1e-9
    assert max(off[:first]) > 2.0 * max(off[first:])


def test_the_operators_rule_flies_yos_to_the_waypoint_and_crabs_across_the_current(dives):
    depth = np.array([i["state"]["depth_m"] for i in dives])
    assert 150.0 < depth.max() < 190.0
    bottoms = np.flatnonzero((depth[1:-1] > 140.0) & (depth[1:-1] > depth[:-2]) & (depth[1:-1] >= depth[2:]))
    assert len(bottoms) >= 4
    to = np.array([[i["state"]["north_m"], i["state"]["east_m"]] for i in dives])
    after = to[len(to) // 3 :]
    made = after[-1] - after[0]
    wanted = np.array([9e3, 2e3]) - after[0]
    assert made @ wanted / np.linalg.norm(made) / np.linalg.norm(wanted) > 0.995
    heading = dives[-20]["state"]["heading_rad"]
    assert abs(np.remainder(heading - np.arctan2(made[1], made[0]) + np.pi, 2 * np.pi) - np.pi) > 0.15


@pytest.mark.parametrize("name", NAMES)
def test_the_rule_arrives_with_every_preset(name):
    infos = flown(TaskEnv("Glide", name, randomise={}, waypoints=[(900.0, 600.0, 0.0)]))
    assert "arrived at the last waypoint" in infos[-1]["reason"]
    assert max(i["state"]["depth_m"] for i in infos) < 200.0


def test_an_episode_ends_at_the_bottom():
    env = TaskEnv("Glide", bottom=60.0)
    env.reset(seed=0)
    taken, terminated = 0, False
    while not terminated:
        _, reward, terminated, _, info = env.step([-1.0, -0.5, 0.0])
        taken += 1
    assert "touched the bottom: depth_m is 6" in info["reason"]
    assert reward == pytest.approx(-(env.episodes.settings["steps"] - taken + 1.0))


def test_a_glider_whose_attitude_was_an_input_steps_30_s_and_a_steered_one_its_own():
    assert TaskEnv("Glide").plant.dt == 30.0
    assert TaskEnv("Glide", dt=10.0).plant.dt == 10.0
    mine = steered(load_vehicle("seaglider"), dt=20.0)
    assert TaskEnv("Glide", mine).plant.dt == 20.0
    assert TaskEnv("Glide", mine).plant.family is GLIDE_STEERED


@pytest.mark.parametrize(
    "options, words",
    [
        ({"target": 5.0}, "has waypoints, not a target"),
        ({"bottom": 10.0}, "bottom needs a number of at least 30"),
        ({"waypoints": [(1.0, 2.0)]}, "waypoints needs one or more rows"),
        ({"waypoints": [(100.0, 0.0, 50.0)]}, "depths of 0 m, as they are at the surface, got 50"),
        ({"vehicle": "slocum"}, "Glide needs a glider that flies, such as 'seaglider' or .* 'seawing', got 'slocum'"),
        ({"vehicle": replace_at(load_vehicle("seaglider"), "hull.mass", 60.0)}, "engine .* cannot take it down and up"),
    ],
)
def test_bad_options_are_refused(options, words):
    with pytest.raises(ValueError, match=words):
        TaskEnv("Glide", **options)


def test_autopilots_of_gliders_say_what_they_follow():
    attitude, masses = load_vehicle("seaglider"), steered(load_vehicle("seaglider"))
    with pytest.raises(ValueError, match="follows depth_m, or flies yos"):
        autopilot(attitude, targets=("north_m", "east_m", "depth_m"))
    with pytest.raises(ValueError, match="Yos need apogee > 1 m"):
        autopilot(masses, targets=("north_m", "east_m", "depth_m"), apogee=0.5)
    with pytest.raises(ValueError, match="is a rule without gains: leave out gains="):
        autopilot(attitude, gains=Gains("seaglider", attitude.dt))
    command, _ = autopilot(masses).act(None, {"depth_m": 50.0}, {"depth_m": 80.0})
    assert command["buoyancy_volume_m3"] < neutral_engine(masses, 50.0)
    assert command["battery_position_m"] == pytest.approx(-0.6 / 64.2, rel=0.01)
