"""Glide with a glider in six degrees of freedom: its tables, laws of motion, its energy, and the operators' rule."""

import re
import warnings
from itertools import pairwise

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import auv_gym.envs  # noqa: F401  (registers)
from auv_gym.envs.task_env import TaskEnv
from auv_gym.envs.vector_env import TaskVectorEnv
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from controllers.piloting import pilot_for
from tests.envs.env_runs import drawn_actions, run
from tests.vehicles.body.test_seawing import steady

VOLUME, WAY, ANGLE = 4.87804878e-4, 0.05, np.pi / 2  # m^3, m and rad, from rest to an end: Zhang et al. 2013
BODY = ("u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps", "roll_rad", "pitch_rad")
STILL = {"randomise": {}}
pytestmark = pytest.mark.slow  # the environment's programs take half a minute to compile


def made(**options):
    return TaskEnv("Glide", "seawing", **{**STILL, **options})


def body_of(info):
    return np.array([info["state"][name] for name in BODY])


def flown(env, seed=0, **settings):
    """Infos and rewards of an episode that the operators' rule flies."""
    act = pilot_for(env, "pid", **settings).begin(env)
    observation, info = env.reset(seed=seed)
    infos, rewards, over = [info], [], False
    while not over:
        observation, reward, terminated, truncated, info = env.step(act(observation, info))
        infos.append(info)
        rewards.append(reward)
        over = terminated or truncated
    return infos, rewards


@pytest.fixture(scope="module")
def yos():
    return flown(made(duration=1500.0), seed=3)


def test_an_action_commands_volume_and_the_place_and_angle_of_the_battery():
    env = made()
    assert env.episodes.actions == ("ballast_m3", "battery_m", "battery_rad")
    command = run(env, [[-2.0, 0.5, -0.25]])[0][-1]["command"]
    assert [*command.values()] == pytest.approx([-VOLUME, 0.5 * WAY, -0.25 * ANGLE], rel=1e-6)


def test_its_units_are_those_of_the_published_equations():
    """U, T and L of a dive and a climb with all of the ballast at a pitch of 0.4 rad, by root finding apart."""
    env, guess = made(bottom=80.0), np.array([0.5, 0.0, 0.02, 0.0, 0.0, 0.0, 0.0, -0.4])
    ways, level, vertical = [], [], []
    for side in (-1.0, 1.0):
        low, high = sorted((-side * 0.005, -side * 0.03))
        for _ in range(60):  # the place of the battery that gives the pitch: more forward, more bow down
            way = 0.5 * (low + high)
            found = steady(side * VOLUME, way, 0.0, guess * np.array([1, 1, -side, 1, 1, 1, 1, -side]))
            low, high = (way, high) if found[7] > side * 0.4 else (low, way)
        path, speed = found[7] - np.arctan2(found[2], found[0]), np.hypot(found[0], found[2])
        ways.append(way)
        level.append(speed * np.cos(path))
        vertical.append(abs(speed * np.sin(path)))
    speed, time = np.mean(level), 80.0 / vertical[0] + 80.0 / vertical[1]
    settings = env.episodes.settings
    assert settings["path_speed"] == pytest.approx(1.15 * speed, rel=1e-6)
    assert settings["error_scale"] == pytest.approx(speed * time, rel=1e-6)
    assert settings["steps"] == round(16.0 * time)
    pumped = 1025.0 * 9.81 / 0.25 * 80.0 * 2.0 * VOLUME
    assert settings["usual_power"] == pytest.approx(pumped / time + 0.5, rel=1e-6)
    assert run(env, [[0.0, 0.0, 0.0]])[0][-1]["state"]["battery_m position"] != 0.0
    _, info = env.reset(seed=0)
    assert info["command"]["battery_m"] == pytest.approx(ways[0], abs=1e-7)


def test_it_starts_in_the_steady_glide_of_the_published_equations_and_stays_in_it():
    env = made(bottom=400.0)
    _, info = env.reset(seed=2, options={"start": {"depth_m": 20.0}})
    command = list(info["command"].values())
    expected = steady(command[0], command[1], 0.0, body_of(info))
    action = env.action_for(info["command"])
    for _ in range(300):
        _, _, _, _, info = env.step(action)
    np.testing.assert_allclose(body_of(info), expected, atol=1e-6)
    path = expected[7] - np.arctan2(expected[2], expected[0])
    sunk = -300.0 * np.hypot(expected[0], expected[2]) * np.sin(path)
    assert info["state"]["depth_m"] == pytest.approx(20.0 + sunk, abs=1e-3)  # m: the action is a float32
    assert info["reading"]["depth_rate_mps"] == pytest.approx(sunk / 300.0, abs=1e-6)


def test_it_is_the_plant_simulated_with_the_same_commands():
    env = made(effects={"effects.current.east": 0.05, "effects.ballast.lag": 3.0})
    _, first = env.reset(seed=0, options={"start": {"depth_m": 25.0}})
    # the first action keeps what was commanded before, as a rollout takes its first inputs to have been
    actions = [env.action_for(first["command"]), *drawn_actions(env, 79)]
    steps = run(env, actions, start={"depth_m": 25.0})
    infos, plant = [first, *(info for *_, info in steps)], env.model
    given = {name: [info["command"][name] for info in infos[1:]] for name in plant.inputs}
    record = Record.from_arrays(plant.dt * np.arange(81), {name: [*told, told[-1]] for name, told in given.items()})
    start = np.array(list(first["state"].values()))
    simulated = plant.run(record, record.segments, start[None, :])
    for name in ("depth_m", "north_m", "heading_rad", "pitch_rad", "r_radps"):
        read = [info["reading"][name] for info in infos]
        np.testing.assert_allclose(
            simulated[:, plant.outputs.index(name)], read, atol=1e-6, err_msg=name
        )  # a float32 kept it


def test_a_turn_to_port_is_the_mirror_of_one_to_starboard():
    sides = []
    for side in (-1.0, 1.0):
        env = made(waypoints=[(5000.0, 0.0, 0.0)])
        steps = run(env, [[-1.0, 0.3, 0.4 * side]] * 100, start={"heading_rad": 0.0, "depth_m": 15.0})
        sides.append((np.array([list(i["state"].values())[:12] for *_, i in steps]), [s[1] for s in steps]))
    (port, rewards), (starboard, same) = sides
    mirror = np.array([1, -1, 1, -1, 1, -1, 1, -1, 1, -1, 1, -1])
    np.testing.assert_allclose(port, starboard * mirror, atol=1e-9)
    np.testing.assert_allclose(rewards, same, atol=1e-9)
    assert abs(port[-1, 11]) > 0.3  # rad: it did turn


@pytest.mark.parametrize(
    "action, words, at",
    [
        ([1.0, -0.5, 0.0], "surfaced: depth_m is -0", 0.0),
        ([-1.0, 0.5, 0.0], "touched the bottom: depth_m is 4.* 40", 40.0),
    ],
)
def test_an_episode_ends_at_the_surface_and_at_the_bottom_with_the_worst_of_the_rest(action, words, at):
    env = made(bottom=40.0)
    env.reset(seed=0)
    taken, terminated, depth = 0, False, 20.0
    while not terminated:
        before = depth
        _, reward, terminated, truncated, info = env.step(action)
        taken, depth = taken + 1, info["state"]["depth_m"]
        assert not truncated
    assert re.search(words, info["reason"])
    assert min(before, depth) <= at <= max(before, depth)
    assert reward == pytest.approx(-(env.episodes.settings["steps"] - taken + 1.0))


def test_energy_is_pump_work_over_efficiency_and_hotel_load():
    env = made(hotel=2.0, pump_efficiency=0.4, effects={"effects.ballast.slowness": 1e5})
    engine, spent, usual = -VOLUME, 0.0, env.episodes.settings["usual_power"]
    _, before = env.reset(seed=0, options={"start": {"depth_m": 30.0}})
    for action in ([1.0, 0.0, 0.0],) * 60 + ([-1.0, 0.0, 0.0],) * 30:
        *_, after = env.step(action)
        # the effect, which the environment does not know, makes the pump half as fast as its rate says
        move = np.clip(after["command"]["ballast_m3"] - engine, -1e-5, 1e-5)
        engine += move
        energy = 1025.0 * 9.81 * before["reading"]["depth_m"] * max(move, 0.0) / 0.4 + 2.0
        spent += energy
        assert after["energy_J"] == pytest.approx(spent)
        assert after["reward_terms"]["energy"] == pytest.approx(-0.2 * energy / usual)
        before = after
    assert spent > 2.0 * 2.0 * 90.0


def test_terms_of_place_and_progress_are_of_the_true_motion_over_ground():
    env = made(
        waypoints=[(5000.0, 0.0, 0.0)], effects={"effects.current.east": 0.2, "effects.sampling.position.noise": 30.0}
    )
    steps = run(env, [[-0.8, 0.2, 0.0]] * 40, start={"heading_rad": 0.0, "depth_m": 15.0, "east_m": 0.0})
    wanted, scale = env.episodes.settings["path_speed"], env.episodes.settings["error_scale"]
    for (*_, before), (*_, after) in pairwise(steps):
        made_good = after["state"]["north_m"] - before["state"]["north_m"]
        assert after["reward_terms"]["path"] == pytest.approx(-0.3 * abs(after["state"]["east_m"]) / scale)
        assert after["reward_terms"]["progress"] == pytest.approx(-0.5 * abs(wanted - made_good) / wanted)
    assert steps[-1][-1]["state"]["east_m"] > 7.0
    assert np.std([i["reading"]["east_m"] - i["state"]["east_m"] for *_, i in steps]) > 15.0


def test_what_a_glider_does_not_measure_it_does_not_read():
    _, info = made().reset(seed=0)
    assert set(info["reading"]) == {
        "depth_m", "depth_rate_mps", "roll_rad", "pitch_rad", "heading_rad", "p_radps", "q_radps", "r_radps", "north_m",
        "east_m",
    }  # fmt: skip


def test_each_episode_draws_a_current_unless_told_otherwise():
    env = TaskEnv("Glide", "seawing")
    drawn = [env.reset(seed=seed)[1]["randomised"] for seed in range(20)]
    north = np.array([values["effects.current.north"] for values in drawn])
    most = 0.15 * env.episodes.settings["path_speed"] / 1.15
    assert 0.7 * most < np.abs(north).max() < most
    assert made().reset(seed=0)[1]["randomised"] == {}


def test_the_operators_rule_flies_yos_below_the_surface_to_its_waypoints(yos):
    infos, rewards = yos
    depth = np.array([info["state"]["depth_m"] for info in infos])
    assert infos[-1]["reason"] == ""
    assert 4.0 < depth[200:].min() < 12.0
    assert 48.0 < depth.max() < 57.0
    turned = np.flatnonzero(np.diff(np.sign(np.diff(depth))))
    assert len(turned) >= 5
    roll = np.array([info["state"]["roll_rad"] for info in infos])
    assert np.abs(roll).max() < 0.6
    assert np.mean(rewards) > -0.5
    # without a rudder, still on the way to the waypoint after the first dive
    last = infos[-1]
    bearing = np.arctan2(
        last["target"]["east_m"] - last["state"]["east_m"], last["target"]["north_m"] - last["state"]["north_m"]
    )
    assert abs(np.remainder(bearing - last["state"]["heading_rad"] + np.pi, 2 * np.pi) - np.pi) < 0.1


def test_the_rule_arrives_and_the_episode_ends_without_a_penalty():
    env = made(waypoints=[(400.0, 100.0, 0.0), (200.0, 500.0, 0.0)], effects={"effects.current.north": 0.06})
    infos, rewards = flown(env, seed=1)
    assert "arrived at the last waypoint" in infos[-1]["reason"]
    assert min(rewards) > -8.0  # the pump at the bottom
    where = np.array([infos[-1]["state"][name] for name in ("north_m", "east_m")])
    assert np.linalg.norm(where - [200.0, 500.0]) < env.episodes.settings["radius"] + 1.0


def test_gymnasium_finds_no_fault_and_its_pictures_change(monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("auv_gym.rendering.Window.show", lambda window, picture: None)  # no display is needed
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make("auv_gym/Glide-v0", vehicle="seawing").unwrapped)
    env = made(render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    run(env, [[-0.5, 0.2, 0.4]] * 30)
    later = env.render()
    assert first.shape == later.shape == (600, 960, 3)
    assert (first != later).any()
    env.close()


@pytest.mark.slow  # it compiles the programs of many
def test_many_are_each_the_single_one_with_its_seed_and_actions():
    options = {"effects": {"effects.sampling.depth.noise": 0.1}}
    many = TaskVectorEnv("Glide", 3, vehicle="seawing", **options)
    observations, _ = many.reset(seed=5)
    singles = [TaskEnv("Glide", "seawing", **options) for _ in range(3)]
    firsts = [env.reset(seed=5 + i)[0] for i, env in enumerate(singles)]
    np.testing.assert_array_equal(observations, firsts)
    for actions in np.random.default_rng(0).uniform(-1.0, 1.0, (60, 3, 3)).astype(np.float32):
        observations, rewards, *_ = many.step(actions)
        for i, env in enumerate(singles):
            observation, reward, *_ = env.step(actions[i])
            np.testing.assert_array_equal(observations[i], observation)
            assert rewards[i] == reward


@pytest.mark.parametrize(
    "options, words",
    [
        ({"target": 5.0}, "has waypoints, not a target"),
        ({"bottom": 10.0}, "bottom needs a number of at least 30"),
        ({"hotel": -1.0}, "hotel needs a number of at least 0 in W"),
        ({"pump_efficiency": 0.0}, "pump_efficiency needs a number above 0"),
        ({"waypoints": [(1.0, 2.0)]}, "waypoints needs one or more rows"),
        ({"actions": ["battery_m"]}, "bottom and waypoints and hotel and pump_efficiency, got 'actions'"),
        (
            {"vehicle": "remus100"},
            "such as 'seaglider' or a glider in six degrees of freedom .*'seawing', got 'remus100'",
        ),
        ({"vehicle": replace_at(load_vehicle("seawing"), "hull.mass", 60.0)}, "cannot take it down and up"),
        ({"model": load_vehicle("seaglider", dt=1.0)}, "model= needs"),
    ],
)
def test_bad_options_are_refused(options, words):
    with pytest.raises(ValueError, match=words):
        TaskEnv("Glide", **{"vehicle": "seawing", **options})
