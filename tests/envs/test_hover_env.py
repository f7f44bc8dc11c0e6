"""Environments of vehicles that thrusters move: poses, actions as commands or as a wrench, their errors and sums."""

from itertools import pairwise

import gymnasium
import numpy as np
import pytest

from auv_gym.envs.task_env import TaskEnv
from auv_gym.envs.vector_env import TaskVectorEnv
from auv_gym.model import simulate
from auv_gym.param import list_paths, replace_at
from auv_gym.physics.frames import velocity_ned
from auv_gym.plant import load_vehicle, vehicle_of_text, vehicle_text
from auv_gym.plant.hover import find_hover
from auv_gym.plant.thrusters import AXES
from auv_gym.records.record import Record
from tests.envs.env_runs import run

TASKS = ("StationKeeping", "Pose", "Path")
STILL = {"effects.current.north": (0.0, 0.0), "effects.current.east": (0.0, 0.0)}


def seen(env, observation):
    """An observation by name, in units of its own."""
    return dict(zip(env.episodes.observations, observation.tolist(), strict=True))


@pytest.mark.parametrize(
    "vehicle, task, actions",
    [
        *(("bluerov2_heavy", task, "wrench") for task in TASKS),
        # its step is compiled for this test only
        *(pytest.param("bluerov2_heavy", task, "thrusters", marks=pytest.mark.slow) for task in TASKS),
        ("bluerov", "Pose", "wrench"),
    ],
)
def test_a_vector_is_the_single_one_many_times_bit_for_bit(vehicle, task, actions):
    options = {"vehicle": vehicle, "actions": actions, "duration": 2.0}
    many = TaskVectorEnv(task, 3, **options)
    singles = [TaskEnv(task, **options) for _ in range(3)]
    observations, _ = many.reset(seed=4)
    for i, env in enumerate(singles):
        np.testing.assert_array_equal(observations[i], env.reset(seed=4 + i)[0])
    for drawn in np.random.default_rng(0).uniform(-1.0, 1.0, (30, 3, *many.single_action_space.shape)):
        observations, rewards, *_ = many.step(drawn)
        for i, env in enumerate(singles):
            observation, reward, *_ = env.step(drawn[i])
            np.testing.assert_array_equal(observations[i], observation)
            assert rewards[i] == reward


def test_without_a_current_nothing_to_do_costs_nothing():
    env = TaskEnv("StationKeeping", randomise={}, actions="wrench")
    steps = run(env, np.zeros((200, 6)))
    assert [reward for _, reward, *_ in steps] == pytest.approx([0.0] * 200, abs=1e-9)


@pytest.mark.parametrize("vehicle", ["bluerov", "bluerov2", "bluerov2_heavy"])
def test_a_wrench_is_what_the_vehicle_feels(vehicle):
    """The change of velocity in a short first step, times the mass, over the step, without the thrusters' lag."""
    plant = load_vehicle(vehicle, dt=1e-4)
    plant = replace_at(plant, {path: 0.0 for path in list_paths(plant) if path.startswith("parts.") and "lag" in path})
    hover, mass = find_hover(plant), plant.family.view(plant.derived).computed.mass
    env = TaskEnv("StationKeeping", plant, randomise={}, actions="wrench")
    assert env.episodes.actions == hover.axes
    names = ("u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps")
    served = [AXES.index(axis) for axis in hover.axes]
    for k, axis in enumerate(hover.axes):
        env.reset(seed=1)
        action = np.zeros(len(hover.axes))
        action[k] = 0.3
        *_, info = env.step(action)
        felt = mass @ np.array([info["state"][name] for name in names]) / plant.dt
        wanted = np.zeros(6)
        wanted[AXES.index(axis)] = 0.3 * hover.largest[axis]
        # in 0.1 ms damping and righting take a share of some 1e-4
        np.testing.assert_allclose(felt[served], wanted[served], atol=1e-3 * hover.largest[axis])


def test_a_wrench_beyond_the_thrusters_is_scaled_down_as_a_whole():
    env = TaskEnv("StationKeeping", "bluerov2_heavy", randomise={}, actions="wrench")
    hover = find_hover(env.plant)
    env.reset(seed=0)
    *_, info = env.step(np.array([1.0, 1.0, 1.0, 1.0, 1.0, -1.0]))
    commands = np.array([info["command"][name] for name in hover.thrusters.channels])
    pushed = hover.allocation @ (np.array([1.0, 1.0, 1.0, 1.0, 1.0, -1.0]) * list(hover.largest.values()))
    share = hover.thrusters.share_within(pushed, hover.thrusts)
    assert 0.2 < share < 0.6
    np.testing.assert_allclose(hover.thrusters.thrusts(commands), hover.thrusts + share * pushed, atol=1e-12)
    assert np.abs(commands).max() <= 1.0
    wrench = hover.thrusters.wrench @ (hover.thrusters.thrusts(commands) - hover.thrusts)
    np.testing.assert_allclose(wrench / share, hover.thrusters.wrench @ pushed, atol=1e-9)


@pytest.mark.slow
def test_action_for_takes_a_wrench_or_commands():
    by_wrench = TaskEnv("StationKeeping", actions="wrench")
    hover = find_hover(by_wrench.plant)
    wanted = {axis: held + 0.25 * most for held, (axis, most) in zip(hover.wrench, hover.largest.items(), strict=True)}
    np.testing.assert_allclose(by_wrench.action_for(wanted), 0.25)
    pulses = TaskEnv("StationKeeping", "bluerov", render_mode="rgb_array")  # its step is not compiled at once
    assert pulses.action_for(dict.fromkeys(pulses.episodes.actions, 1700.0)) == pytest.approx([0.5] * 6)


def test_axes_that_are_not_asked_for_stay_as_they_hold_the_vehicle():
    whole, part = (TaskEnv("StationKeeping", randomise={}, actions=a) for a in ("wrench", ["yaw", "surge"]))
    shares = {"surge": 0.2, "yaw": -0.1}
    told = [[shares.get(axis, 0.0) for axis in env.episodes.actions] for env in (whole, part)]
    assert told[1] == [-0.1, 0.2]
    for env in (whole, part):
        env.reset(seed=3)
    for _ in range(5):
        ends = [env.step(np.array(action))[-1]["state"] for env, action in zip((whole, part), told, strict=True)]
        assert dict(ends[0]) == pytest.approx(dict(ends[1]), abs=1e-12)


def test_errors_are_in_body_axes_and_sums_turn_with_the_vehicle():
    env = TaskEnv("Pose", randomise={}, target={"north_m": 0.0, "east_m": 0.0, "depth_m": 8.0, "heading_rad": 0.0})
    start = {"north_m": -0.3, "east_m": 0.2, "depth_m": 7.9, "heading_rad": 1.0, "roll_rad": 0.2, "pitch_rad": -0.3}
    observation, info = env.reset(seed=0, options={"start": start})
    length = env.plant.hull.length
    found = seen(env, observation)
    off = np.array([found[name] for name in ("ahead", "starboard", "below")]) * 5.0 * length
    np.testing.assert_allclose(velocity_ned(*off, 0.2, -0.3, 1.0), [0.3, -0.2, 0.1], atol=1e-6)
    assert found["heading_error_sin"] == pytest.approx(np.sin(-1.0), abs=1e-6)
    assert found["roll_error"] * np.pi / 2 == pytest.approx(-0.2, abs=1e-6)
    assert found["sum_ahead"] == found["sum_heading"] == 0.0
    observation, *_, info = env.step(np.zeros(8))
    state, found = info["state"], seen(env, observation)
    rate = env.episodes.settings["sum_rate"]
    left = np.array([-state["north_m"], -state["east_m"], 8.0 - state["depth_m"]]) / length * rate
    sums = np.array([found[name] for name in ("sum_ahead", "sum_starboard", "sum_below")]) * 25.0
    turned = velocity_ned(*sums, state["roll_rad"], state["pitch_rad"], state["heading_rad"])
    np.testing.assert_allclose(turned, left, atol=1e-6)


def test_sums_stay_within_their_limit_and_start_anew():
    env = TaskEnv("StationKeeping", randomise={}, target={"north_m": 30.0, "heading_rad": 2.0})
    env.reset(seed=0, options={"start": {"heading_rad": 0.0}})
    for _ in range(600):
        observation, *_ = env.step(np.zeros(8))
    assert seen(env, observation)["sum_ahead"] == pytest.approx(1.0, abs=1e-3)
    observation, _ = env.reset(seed=0)
    assert seen(env, observation)["sum_ahead"] == 0.0


def test_a_regulator_with_sums_holds_the_station_in_a_current_and_one_without_does_not():
    """PID on a wrench from what is observed: the offset of PD vanishes."""
    ends = {}
    for name, integral in (("pd", 0.0), ("pid", 1.0)):
        effects = {"effects.current.north": 0.1, "effects.current.east": -0.05}
        env = TaskEnv("StationKeeping", actions="wrench", effects=effects, duration=60.0)
        observation, info = env.reset(seed=2)
        ended = False
        while not ended:
            found = seen(env, observation)
            action = [
                6.0 * found["ahead"] - 2.0 * found["speed_ground"] + integral * 6.0 * found["sum_ahead"],
                6.0 * found["starboard"] - 2.0 * found["sway_ground"] + integral * 6.0 * found["sum_starboard"],
                6.0 * found["below"] - 2.0 * found["heave_ground"],
                found["heading_error_sin"] - found["yaw_rate"],
                -found["roll"] - found["roll_rate"],
                -found["pitch"] - found["pitch_rate"],
            ]
            observation, _, terminated, truncated, info = env.step(action)
            ended = terminated or truncated
        assert info["reason"] == ""
        state, target = info["state"], info["target"]
        ends[name] = np.hypot(state["north_m"] - target["north_m"], state["east_m"] - target["east_m"])
    assert ends["pid"] < 0.01
    assert ends["pd"] > 10.0 * ends["pid"]


def test_a_supply_sags_over_an_episode_as_in_a_simulated_log():
    sagging = {"effects.supply.sag": 0.1, **{f"parts.t{k}.power": 1.2 for k in range(1, 9)}}
    plant = replace_at(load_vehicle("bluerov2_heavy"), sagging)
    env = TaskEnv("StationKeeping", plant, randomise={}, actions="wrench", duration=25.0)
    _, info = env.reset(seed=0)
    states, told = [info["state"]["u_mps"]], []
    for _ in range(400):
        _, _, _, _, info = env.step([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
        states.append(info["state"]["u_mps"])
        told.append([info["command"][name] for name in plant.family.actuators])
    commands = dict(zip(plant.family.actuators, np.array([*told, told[-1]]).T, strict=True))
    still = dict.fromkeys(plant.outputs, np.zeros(401)) | {"depth_m": np.full(401, info["state"]["depth_m"])}
    log = Record.from_arrays(plant.dt * np.arange(401), {**commands, **still})
    # the log begins with the thrusters where they are told to be, the episode at rest
    np.testing.assert_allclose(states[100:], simulate(plant, log)["u_mps"][100:], atol=1e-6)
    assert states[-1] < 0.95 * max(states)  # 2 V of 16 are gone


def test_poses_are_drawn_anew_and_what_is_given_stays():
    env = TaskEnv("Pose", randomise=STILL, target={"depth_m": 9.0}, duration=400.0, actions="wrench")
    _, info = env.reset(seed=3, options={"target": {"heading_rad": 0.5}})
    assert info["target"]["heading_rad"] == 0.5
    poses = [tuple(info["target"].values())]
    ended = False
    while not ended:
        _, _, terminated, truncated, info = env.step(np.zeros(6))
        ended = terminated or truncated
        if tuple(info["target"].values()) != poses[-1]:
            poses.append(tuple(info["target"].values()))
    assert not terminated
    length, rate = env.plant.hull.length, find_hover(env.plant).speed / env.plant.hull.length
    assert 400.0 * rate / 120.0 - 1.0 <= len(poses) <= 400.0 * rate / 60.0 + 1.0
    for one, other in pairwise(poses):
        assert 2.0 * length <= np.hypot(other[0] - one[0], other[1] - one[1]) <= 8.0 * length
        assert other[2] == 9.0
        assert other[4:] == (0.0, 0.0)
    assert len({pose[3] for pose in poses}) == len(poses)


@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2_heavy"])
def test_waypoints_are_reached_by_thrusters(vehicle):
    axes, waypoints = ["surge", "sway", "heave", "yaw"], [(3.0, 0.0, 6.0), (3.0, 3.0, 6.0)]
    env = TaskEnv("Path", vehicle, randomise={}, waypoints=waypoints, actions=axes)
    observation, _ = env.reset(seed=0, options={"start": {"depth_m": 6.0, "heading_rad": 0.0}})
    reason = ""
    for _ in range(1500):
        found = seen(env, observation)
        ahead = np.array([found["course_error_cos"], found["course_error_sin"]])
        push = 0.15 * ahead - 0.5 * found["across"] * np.array([-ahead[1], ahead[0]])
        down = -2.0 * found["below"] - found["heave_ground"]
        observation, _, terminated, truncated, info = env.step([*push, down, -found["yaw_rate"]])
        if terminated or truncated:
            reason = info["reason"]
            break
    assert reason.startswith("arrived at the last waypoint")
    assert np.hypot(info["state"]["north_m"] - 3.0, info["state"]["east_m"] - 3.0) < 2.0 * env.plant.hull.length


@pytest.mark.parametrize(
    "task, vehicle",
    [
        ("Pose", "bluerov2_heavy"),
        ("Path", "bluerov2_heavy"),
        ("Path", "bluerov2"),
        ("Path", "bluerov"),
    ],
)
def test_a_picture_shows_the_goal_and_every_thruster(task, vehicle):
    pytest.importorskip("matplotlib")
    from auv_gym.envs.kinds.hover.view import goal
    from auv_gym.envs.track import BodyView

    env = TaskEnv(task, vehicle, render_mode="rgb_array")
    env.reset(seed=1)
    before = env.render()
    *_, info = env.step(np.full(env.action_space.shape, 0.5))
    view = BodyView(env.episodes, env._row, goal)
    view.follow(begin=True)
    scene = view.scene()
    assert list(scene.commands) == list(env.episodes.actions)
    assert all(value == info["command"][name] for name, (value, _) in scene.commands.items())
    wanted = [info["target"][name] for name in ("north_m", "east_m", "depth_m")]
    np.testing.assert_allclose(scene.target.next_waypoint, wanted)
    assert (scene.target.heading is None) == (task == "Path")
    for k in range(len(scene.commands)):  # each bar has moved
        top = 362 + 28 + int(k * 192 / len(scene.commands))
        assert (before[top : top + 20, 612:942] != env.render()[top : top + 20, 612:942]).any()
    env.close()


@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2_heavy"])
def test_chosen_thrusters_move_and_the_others_hold_the_trim(vehicle):
    env = TaskEnv("StationKeeping", vehicle, actions=["t3_share", "t1_share"], randomise={})
    hover = find_hover(env.plant)
    env.reset(seed=0)
    *_, info = env.step([0.5, -0.25])
    command = info["command"]
    assert (command["t3_share"], command["t1_share"]) == (0.5, -0.25)
    held = dict(zip(env.plant.inputs, hover.commands.tolist(), strict=True))
    others = {*env.plant.inputs} - {"t3_share", "t1_share"}
    assert {"t2_share", "t6_share", "supply_V"} <= others
    assert all(command[name] == held[name] for name in others)
    assert env.episodes.observations[-2:] == ("t3_share", "t1_share")


def test_a_lost_thruster_is_felt():
    ends = []
    for effects in (None, {"effects.t2.lost": 1.0}):
        env = TaskEnv("StationKeeping", randomise={}, effects=effects)
        steps = run(env, np.tile([0.4, 0.4, -0.4, -0.4, 0.0, 0.0, 0.0, 0.0], (20, 1)), seed=0)
        ends.append(steps[-1][-1]["state"])
    assert abs(ends[0]["r_radps"]) < 1e-9 < 0.1 < abs(ends[1]["r_radps"])


@pytest.mark.parametrize(
    "options, words",
    [
        (
            {"vehicle": "remus100"},
            "StationKeeping needs a vehicle that thrusters move, such as 'bluerov2_heavy', got 'remus100'",
        ),
        (
            {"actions": "wrenches"},
            "actions= is 'thrusters', 'wrench' or a list of axes",
        ),
        ({"actions": ["t9_share"]}, "actions= has 't9_share', which does not move bluerov2_heavy"),
        (
            {"actions": ["surge", "pich"]},
            "actions= has 'pich', which does not move bluerov2_heavy. Did you mean 'pitch'. It has the axes surge, .*, "
            "and the inputs t1_share",
        ),
        ({"actions": ["surge", "t1_share"]}, "needs axes alone or inputs alone, got both: surge, t1_share"),
        ({"actions": []}, "actions= needs one or more names"),
        (
            {"target": {"depth_m": 500.0}},
            r"target\['depth_m'\] needs a value from 0 to 23 m, the limits of the environment; got 500",
        ),
        ({"target": {"depth_m": -1.0}}, "from 0 to 23 m"),
        ({"target": {"pitch_rad": 3.0}}, "from -1.4 to 1.4 rad"),
        (
            {"waypoints": [(0.0, 0.0, 5.0)]},
            "StationKeeping has a pose, not waypoints: give target= with values by channel",
        ),
        ({"target": 3.0}, "target needs values by channel, such as {'north_m': 3.0}"),
        (
            {"target": {"speed": 3.0}},
            "target has north_m, east_m, depth_m, heading_rad, roll_rad, pitch_rad, got 'speed'",
        ),
        ({"target": {"north_m": "far"}}, r"target\['north_m'\] needs a number in the channel's unit, got 'far'"),
    ],
)
def test_bad_options_are_refused(options, words):
    with pytest.raises(ValueError, match=words):
        TaskEnv("StationKeeping", **options)


def test_a_vehicle_that_cannot_pitch_has_neither_such_a_target_nor_such_an_action():
    ends = [f"parts.t{k}.x" for k in range(5, 9)]  # all vertical thrusters abreast of the origin
    flat = replace_at(load_vehicle("bluerov2_heavy"), dict.fromkeys(ends, 0.0))
    words = r"target\['pitch_rad'\] has to stay at 0 rad, since the vehicle cannot control it; got 0.2"
    with pytest.raises(ValueError, match=words):
        TaskEnv("Pose", flat, target={"pitch_rad": 0.2})
    with pytest.raises(ValueError, match="actions= has 'pitch', which does not move"):
        TaskEnv("StationKeeping", flat, actions=["surge", "pitch"])
    env = TaskEnv("Pose", flat, target={"pitch_rad": 0.0, "roll_rad": 0.2})
    with pytest.raises(ValueError, match=f"reset option {words}"):
        env.reset(options={"target": {"pitch_rad": 0.2}})


def test_other_bad_requests_are_refused():
    with pytest.raises(ValueError, match="Path has waypoints, not a target"):
        TaskEnv("Path", "bluerov2", target={"north_m": 1.0})
    with pytest.raises(ValueError, match="or a vehicle that thrusters move, such as 'bluerov2', got 'slocum'"):
        TaskEnv("Path", "slocum")
    env = gymnasium.make("auv_gym/StationKeeping-v0")
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"An action needs 8 finite numbers in \[-1, 1\] \(t1_share, .*, t8_share\)"):
        env.step(np.zeros(9))
    with pytest.raises(ValueError, match="reset option 'target' needs values by channel"):
        env.reset(options={"target": 1.0})


@pytest.mark.slow
def test_more_thrusters_than_an_observation_has_room_for_are_refused():
    text = vehicle_text(load_vehicle("bluerov2_heavy"))
    part = text[text.index("[parts.t8]") :]
    more = "\n".join(part.replace("parts.t8", f"parts.t{k}") for k in range(9, 15))
    with pytest.raises(ValueError, match="Pose observes at most 32 numbers, got 33 with the 14 actions"):
        TaskEnv("Pose", vehicle_of_text(text + more, "a test"))
