from dataclasses import dataclass, field, replace
from math import cos, hypot, pi, radians, sin

import gymnasium
import numpy as np
import pytest

from auv_gym.envs.task_env import TaskEnv
from auv_gym.envs.tasks import TASKS
from auv_gym.models.spliced import splice
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.cruise import find_cruise, find_helm
from tests.envs.env_runs import run

PRESETS = ("npsauv", "heu_torpedo", "remus100", "vt690")
CURRENT = {"effects.current.north": (-0.3, 0.3), "effects.current.east": (-0.3, 0.3)}


# ---------------------------------------------------------------------------- cruise


@pytest.mark.parametrize("vehicle", PRESETS)
def test_the_cruise_is_steady_and_level(vehicle):
    plant = load_vehicle(vehicle)
    cruise = find_cruise(plant)
    x = plant.initial(np.full(len(plant.outputs), np.nan))
    x[: cruise.state.size] = cruise.state
    x[plant.states.index("depth_m")] = 50.0
    for at, name in enumerate(plant.states):
        if name.endswith(("position", "play", "[-0]")):
            x[at] = cruise.commands[plant.inputs.index(name.split()[0].removesuffix("[-0]"))]
    later = plant.step(x, cruise.commands)
    moved = (later - x)[: cruise.state.size]
    along = [plant.states.index(name) for name in ("north_m", "east_m")]
    # steady to the accuracy to which the cruise is sought, and forward at its speed over the sample
    assert np.abs(np.delete(moved, [*along, plant.states.index("wave_phase_rad")])).max() < 1e-6
    speed = np.linalg.norm(cruise.state[:3])
    assert hypot(*moved[along]) == pytest.approx(speed * plant.dt, rel=1e-9)
    assert cruise.speed == cruise.state[0]


def test_a_vehicle_that_cannot_fly_level_is_refused():
    heavy = replace_at(load_vehicle("remus100"), "hull.buoyancy", 420.0)
    with pytest.raises(ValueError, match="cannot hold with its fins"):
        TaskEnv("Depth", heavy)


def test_the_regulator_is_the_one_of_the_riccati_equation():
    from scipy.linalg import solve_discrete_are

    from auv_gym.plant.cruise import _linear_quadratic_gains

    a = np.array([[0.9, 0.1, 0.0], [-0.05, 0.8, 0.02], [0.0, 0.1, 1.0]])
    b, weights = np.array([0.02, 0.3, 0.015]), np.array([0.0, 0.1, 3.0])
    p = solve_discrete_are(a, b[:, None], np.diag(weights**2), np.eye(1))
    expected = b @ p @ a / (1.0 + b @ p @ b)
    np.testing.assert_allclose(_linear_quadratic_gains(a, b, weights), expected, rtol=1e-9)


@pytest.mark.parametrize("vehicle", PRESETS)
@pytest.mark.parametrize("task", ["Depth", "Heading", "Speed"])
def test_held_fins_keep_depth_and_heading(task, vehicle):
    env = TaskEnv(task, vehicle, duration=120.0)
    length, cruise = env.plant.hull.length, find_cruise(env.plant)
    _, first = env.reset(seed=2)
    still = cruise.commands[[env.plant.inputs.index(a) for a in env.episodes.actions]] / env.episodes.limits
    action = {"Depth": still, "Heading": still + 0.5, "Speed": 0.75 * still}[task].astype(np.float32)
    for _ in range(1200):
        _, _, terminated, truncated, info = env.step(action)
        assert not terminated, info["reason"]
    assert truncated
    assert task == "Depth" or abs(info["state"]["depth_m"] - first["state"]["depth_m"]) < 1.5 * length
    turned = abs(info["state"]["heading_rad"] - first["state"]["heading_rad"])
    assert turned > 1.0 if task == "Heading" else turned < 0.2


# ---------------------------------------------------------------------------- tables of the documentation


def test_the_observation_of_depth():
    env = TaskEnv("Depth", "remus100")
    first, info = env.reset(seed=3, options={"target": 15.0, "start": {"depth_m": 13.0}})
    cruise, length = find_cruise(env.plant), env.plant.hull.length
    plane = cruise.commands[1] / env.plant.parts.stern_plane.limit
    expected = [
        2.0 / (5 * length),
        cruise.state[10] / (pi / 2),
        0.0,
        cruise.state[2] / (0.5 * cruise.speed),
        0.0,
        plane,
    ]
    np.testing.assert_allclose(first, expected, atol=1e-6)
    observation, _, _, _, info = env.step(np.array([0.5], np.float32))
    y = info["reading"]
    expected = [
        (15.0 - y["depth_m"]) / (5 * length),
        y["pitch_rad"] / (pi / 2),
        y["q_radps"] * length / cruise.speed,
        y["w_mps"] / (0.5 * cruise.speed),
        y["u_mps"] / cruise.speed - 1.0,
        0.5,
    ]
    np.testing.assert_allclose(observation, expected, atol=1e-6)
    assert env.episodes.observations == ("depth_error", "pitch", "pitch_rate", "heave", "speed", "stern_plane")
    assert info["command"]["stern_plane_rad"] == 0.5 * env.plant.parts.stern_plane.limit
    assert info["command"]["rudder_rad"] == pytest.approx(cruise.commands[0], abs=1e-12)  # held, with nothing to mend


def test_the_observation_of_heading():
    env = TaskEnv("Heading", "remus100")
    env.reset(seed=3, options={"target": 1.0, "start": {"heading_rad": 0.2}})
    observation, _, _, _, info = env.step(np.array([-0.5], np.float32))
    cruise, y = find_cruise(env.plant), info["reading"]
    expected = [
        sin(1.0 - y["heading_rad"]),
        cos(1.0 - y["heading_rad"]),
        y["r_radps"] * env.plant.hull.length / cruise.speed,
        y["v_mps"] / (0.5 * cruise.speed),
        y["roll_rad"] / (pi / 2),
        y["u_mps"] / cruise.speed - 1.0,
        -0.5,
    ]
    np.testing.assert_allclose(observation, expected, atol=1e-6)


def test_the_observation_of_speed():
    env = TaskEnv("Speed", "vt690")
    env.reset(seed=3, options={"target": 1.2})
    observation, _, _, _, info = env.step(np.array([0.4], np.float32))
    cruise, y = find_cruise(env.plant), info["reading"]
    expected = [
        (1.2 - y["u_mps"]) / cruise.speed,
        y["u_mps"] / cruise.speed - 1.0,
        y["pitch_rad"] / (pi / 2),
        np.float32(0.4),
    ]
    np.testing.assert_allclose(observation, expected, atol=1e-6)
    assert info["command"]["speed_cmd_mps"] == pytest.approx(0.4 * env.plant.parts.propeller.limit)


def test_the_observation_and_reward_of_a_path():
    env = TaskEnv("Path", "remus100", waypoints=[(40.0, 0.0, 15.0), (40.0, 30.0, 15.0)], randomise={})
    start = {"north_m": 0.0, "east_m": 2.0, "depth_m": 15.0, "heading_rad": 0.1, "roll_rad": 0.0}
    env.reset(seed=0, options={"start": start})
    before = np.array([0.0, 2.0, 15.0])
    observation, reward, _, _, info = env.step(np.array([0.1, -0.4, 0.9], np.float32))
    cruise, length, x, y = find_cruise(env.plant), env.plant.hull.length, info["state"], info["reading"]
    at = np.array([x["north_m"], x["east_m"], x["depth_m"]])
    leg = np.array([40.0, 0.0, 15.0]) - before
    size, course = np.linalg.norm(leg), np.arctan2(leg[1], leg[0])
    starboard = np.array([-sin(course), cos(course), 0.0])
    off = at - before
    across, below, along = off @ starboard, off[2], off @ leg / size
    by_name = dict(zip(env.episodes.observations, observation, strict=True))
    expected = {
        "across": across / (5 * length),
        "below": below / (5 * length),
        "remaining": (size - along) / (30 * length),
        "course_error_sin": sin(course - y["heading_rad"]),
        "course_error_cos": cos(course - y["heading_rad"]),
        "descent": 0.0,
        "next_course_error_sin": sin(pi / 2 - y["heading_rad"]),
        "next_course_error_cos": cos(pi / 2 - y["heading_rad"]),
        "next_descent": 0.0,
        "roll": y["roll_rad"] / (pi / 2),
        "pitch": y["pitch_rad"] / (pi / 2),
        "roll_rate": y["p_radps"] * length / cruise.speed,
        "speed_ground": y["u_dvl_mps"] / cruise.speed - 1.0,
        "rudder": 0.1,
        "stern_plane": -0.4,
        "propulsion": 0.9,
    }
    for name, value in expected.items():
        assert by_name[name] == pytest.approx(value, abs=1e-6), name
    terms = info["reward_terms"]
    assert terms["path"] == pytest.approx(-0.5 * hypot(across, below) / (5 * length), rel=1e-9)
    wanted, helm = 0.8 * cruise.speed, find_helm(env.plant)
    assert terms["progress"] == pytest.approx(-0.5 * abs(wanted - along / env.plant.dt) / wanted, rel=1e-9)
    commands = (
        np.array([0.1, -0.4, 0.9], np.float32)
        - cruise.commands[[helm.rudder, helm.plane, helm.drive]] / env.episodes.limits
    )
    assert terms["command_travel"] == pytest.approx(-0.05 * np.abs(commands).mean() / 2, rel=1e-9)
    assert reward == sum(terms.values())
    assert info["target"] == {"north_m": 40.0, "east_m": 0.0, "depth_m": 15.0}


@pytest.mark.parametrize("task, channel, scale", [("Depth", "depth_m", 5 * 1.3327), ("Heading", "heading_rad", pi)])
def test_the_reward_of_a_target(task, channel, scale):
    env = TaskEnv(task, "remus100", target=1.5)
    _, reward, _, _, info = run(env, [0.5])[0]
    error = 1.5 - info["state"][channel]
    error = (error + pi) % (2 * pi) - pi if task == "Heading" else error
    assert info["reward_terms"][task.lower()] == pytest.approx(-min(abs(error) / scale, 1.0), rel=1e-9)
    assert reward == sum(info["reward_terms"].values())


@pytest.mark.slow
def test_bow_planes_are_part_of_the_action_where_a_vehicle_has_them():
    env = TaskEnv("Depth", "npsauv")
    assert env.episodes.actions == ("stern_plane_rad", "bow_plane_rad")
    assert env.action_space.shape == (2,)
    _, _, _, _, info = run(env, [(0.5, -1.0)])[0]
    assert info["command"]["bow_plane_rad"] == -env.plant.parts.bow_plane.limit


# ---------------------------------------------------------------------------- targets and paths


@pytest.mark.parametrize("task", ["Depth", "Heading", "Speed"])
def test_targets_change_in_steps_within_their_band(task):
    env = TaskEnv(task, "remus100", duration=600.0)
    cruise, length = find_cruise(env.plant), env.plant.hull.length
    unit = {"Depth": length, "Heading": 1.0, "Speed": cruise.speed}[task]
    low, high = TASKS[task].step
    channel = TASKS[task].channel
    targets, times = [], []
    _, info = env.reset(seed=5)
    for _ in range(6000):
        action = 0.8 * (task == "Speed")
        if task == "Depth":
            deep = info["reading"]["depth_m"] - info["target"]["depth_m"]
            action = held_plane(cruise, info["reading"], deep) / env.episodes.limits[0]
        _, _, terminated, _, info = env.step(np.array([action], np.float32))
        assert not terminated, info["reason"]
        if not targets or info["target"][channel] != targets[-1]:
            targets.append(info["target"][channel])
            times.append(info["time_s"])
    steps = np.abs(np.diff(targets))
    if task == "Heading":
        steps = np.abs((np.diff(targets) + pi) % (2 * pi) - pi)
    pauses = np.diff(times[1:])
    assert len(targets) > 600.0 / (35.0 * length / cruise.speed)
    assert steps.max() <= high * unit + 1e-9
    assert (steps >= low * unit - 1e-9).mean() > 0.8  # a step may be cut short at the end of the band
    assert pauses.min() >= 15.0 * length / cruise.speed - env.plant.dt
    assert pauses.max() <= 35.0 * length / cruise.speed + env.plant.dt
    if task != "Heading":
        assert min(targets) >= TASKS[task].band[0] * unit
        assert max(targets) <= TASKS[task].band[1] * unit


def held_plane(cruise, y, deep):
    """The stern plane, rad, that takes a depth error back to zero."""
    error = [y["w_mps"] - cruise.state[2], y["q_radps"], y["pitch_rad"] - cruise.state[10], np.clip(deep, -1.0, 1.0)]
    return cruise.commands[1] - cruise.plane_gains @ error


def follow(env, steps):
    """Steps with a plain controller of heading, depth and speed along the path; the infos."""
    cruise, drive, infos = find_cruise(env.plant), find_helm(env.plant).drive, []
    _, info = env.reset(seed=4)
    k_rudder = cruise.rudder_gains
    for _ in range(steps):
        y, target = info["reading"], info["target"]
        north, east = target["north_m"] - y["north_m"], target["east_m"] - y["east_m"]
        off = (y["heading_rad"] - np.arctan2(east, north) + pi) % (2 * pi) - pi
        deep = y["depth_m"] - target["depth_m"]
        rudder = -k_rudder @ [y["v_mps"], y["r_radps"], np.clip(off, -0.5, 0.5)]
        plane = held_plane(cruise, y, deep)
        command = {"rudder_rad": rudder, "stern_plane_rad": plane, env.plant.inputs[drive]: cruise.commands[drive]}
        action = [command[name] / limit for name, limit in zip(env.episodes.actions, env.episodes.limits, strict=True)]
        _, _, terminated, truncated, info = env.step(np.array(action, np.float32))
        infos.append(info)
        if terminated or truncated:
            break
    return infos


@pytest.mark.parametrize("vehicle", PRESETS)
def test_a_drawn_path_leads_from_waypoint_to_waypoint(vehicle):
    env = TaskEnv("Path", vehicle)
    infos = follow(env, 3000)
    assert infos[-1]["reason"] == ""
    points = list(dict.fromkeys(tuple(info["target"].values()) for info in infos))
    length = env.plant.hull.length
    legs = np.diff(points, axis=0)
    assert len(points) >= 3
    assert np.linalg.norm(legs, axis=1).max() <= 30.0 * length * 1.001
    assert np.abs(np.arcsin(legs[:, 2] / np.linalg.norm(legs, axis=1))).max() <= 0.251
    courses = np.arctan2(legs[:, 1], legs[:, 0])
    turns = (np.diff(courses) + pi) % (2 * pi) - pi
    assert np.abs(turns).max(initial=0.0) <= radians(75.0) + 1e-9
    assert all(5.0 * length - 1e-9 <= point[2] <= 25.0 * length + 1e-9 for point in points)


def test_given_waypoints_end_the_episode_without_penalty():
    env = TaskEnv("Path", "remus100", waypoints=[(20.0, 0.0, 15.0), (40.0, 15.0, 17.0)], randomise={})
    infos = follow(env, 3000)
    assert infos[-1]["reason"].startswith("arrived at the last waypoint")
    assert sum(infos[-1]["reward_terms"].values()) > -1.05
    points = list(dict.fromkeys(tuple(info["target"].values()) for info in infos))
    assert points == [(20.0, 0.0, 15.0), (40.0, 15.0, 17.0)]


def test_a_path_has_a_drawn_current_unless_told_otherwise():
    env = TaskEnv("Path", "remus100")
    _, info = env.reset(seed=0)
    _, other = env.reset()
    assert info["randomised"].keys() == {"effects.current.north", "effects.current.east"}
    assert info["randomised"] != other["randomised"]
    drift = info["reading"]["u_dvl_mps"] - info["reading"]["u_mps"]
    heading = info["state"]["heading_rad"]
    along = info["randomised"]["effects.current.north"] * cos(heading)
    along += info["randomised"]["effects.current.east"] * sin(heading)
    pitch = info["state"]["pitch_rad"]
    assert drift == pytest.approx(along * cos(pitch), rel=1e-9)
    assert TaskEnv("Path", randomise={}).reset(seed=0)[1]["randomised"] == {}
    fixed = TaskEnv("Path", effects={"effects.current.north": 0.1}).reset(seed=0)[1]
    assert fixed["randomised"].keys() == {"effects.current.east"}


# ---------------------------------------------------------------------------- truth against the plant


def test_randomised_parameters_act():
    ranges = {"hull.surge.u_u": (-3.0, -1.0), "effects.load.net_buoyancy": (-3.0, 3.0)}
    env = TaskEnv("Speed", "remus100", randomise=ranges)
    _, info = env.reset(seed=11)
    drawn = info["randomised"]
    assert all(low <= drawn[path] <= high for path, (low, high) in ranges.items())
    plant = replace_at(load_vehicle("remus100"), drawn)
    x = np.array(list(info["state"].values()))
    for _ in range(20):
        _, _, _, _, info = env.step(np.array([0.5], np.float32))
        x = plant.step(x, np.array(list(info["command"].values())))
    assert list(info["state"].values()) == x.tolist()
    values = [env.reset()[1]["randomised"]["hull.surge.u_u"] for _ in range(200)]
    assert np.mean(values) == pytest.approx(-2.0, abs=4 * 2.0 / np.sqrt(12 * 200))


# ---------------------------------------------------------------------------- sensing


def readings(channel, steps=400, **effects):
    env = TaskEnv("Heading", "remus100", duration=1e4, effects={f"effects.sampling.{k}": v for k, v in effects.items()})
    found = run(env, [0.0] * steps)
    return (
        np.array([info["reading"][channel] for *_, info in found]),
        np.array([info["state"][channel] for *_, info in found]),
    )


def test_noise_has_its_deviation_and_leaves_the_truth():
    noisy, true = readings("depth_m", **{"depth.noise": 0.2})
    _, quiet = readings("depth_m")
    assert np.std(noisy - true) == pytest.approx(0.2, rel=0.15)  # 4 standard errors of 400 samples
    assert np.abs(np.corrcoef((noisy - true)[1:], (noisy - true)[:-1])[0, 1]) < 0.2
    assert not np.array_equal(true, quiet)  # the held planes act on the reading


def test_delay_shifts_by_whole_samples():
    late, true = readings("heading_rad", **{"compass.delay": 0.3})
    np.testing.assert_array_equal(late[3:], true[:-3])
    assert (late[:3] == late[0]).all()


def test_quantisation_rounds():
    coarse, true = readings("depth_m", **{"depth.quantisation": 0.05})
    np.testing.assert_allclose(coarse / 0.05, np.round(coarse / 0.05), atol=1e-9)
    assert np.abs(coarse - true).max() <= 0.025 + 1e-12


def test_dropouts_hold_all_readings_of_a_sensor():
    p, true = readings("p_radps", **{"gyros.dropout": 0.3, "gyros.noise": 1e-3})
    r, _ = readings("r_radps", **{"gyros.dropout": 0.3, "gyros.noise": 1e-3})
    held = np.diff(p) == 0.0
    assert held.mean() == pytest.approx(0.3, abs=0.1)  # 4 standard errors of 400 samples
    np.testing.assert_array_equal(held, np.diff(r) == 0.0)
    assert not (np.diff(true) == 0.0).all()


# ---------------------------------------------------------------------------- ends


@pytest.mark.parametrize(
    "start, effects, reason",
    [
        ({"depth_m": 0.05, "pitch_rad": 0.6}, {}, "broached"),
        ({"depth_m": 66.6, "pitch_rad": -0.6}, {}, "too deep"),
        ({"pitch_rad": 1.39, "q_radps": 1.0}, {}, "pitch_rad is"),
        ({"roll_rad": 2.09, "p_radps": 3.0}, {}, "roll_rad is"),
        ({"heading_rad": 0.0}, {"effects.load.tether_north": 2000.0}, "the speed is"),
        ({}, {"effects.load.moment_x": 50.0}, "the rate of turn is"),
        ({"north_m": 2e9}, {}, "diverged"),
    ],
)
def test_leaving_the_envelope_ends_the_episode_with_the_reason(start, effects, reason):
    env = TaskEnv("Depth", "remus100", duration=10.0, effects=effects)
    env.reset(seed=0, options={"start": start})
    terminated = truncated = False
    while not (terminated or truncated):
        observation, reward, terminated, truncated, info = env.step(np.zeros(1, np.float32))
    assert (terminated, truncated) == (True, False)
    count = round(info["time_s"] / env.plant.dt)
    assert reason in info["reason"]
    assert f"at {info['time_s']:g} s" in info["reason"]
    assert reward == pytest.approx(-1.05 * (100 - count + 1))
    assert reward == sum(info["reward_terms"].values())
    assert env.observation_space.contains(observation)
    assert np.isfinite(list(info["state"].values())).all()
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        env.step(np.zeros(1, np.float32))


# ---------------------------------------------------------------------------- models in place of the vehicle


@dataclass(frozen=True)
class Glide:
    """A model of depth alone: it dives at a rate proportional to the stern plane."""

    dt: float = 0.1
    gain: float = 2.0
    growth: float = 1.0
    inputs: tuple = ("stern_plane_rad",)
    states: tuple = ("depth_m",)
    outputs: tuple = ("depth_m", "pitch_rad", "q_radps", "w_mps", "u_mps")
    constants: dict = field(default_factory=dict)

    def initial(self, y0):
        return np.array(y0[:1], dtype=float)

    def step(self, x, u):
        return self.growth * x + self.gain * self.dt * u

    def output(self, x):
        return np.array([x[0], 0.0, 0.0, 0.0, 1.5])

    def correct(self, x, y):
        return np.array(y[:1], dtype=float)


def test_a_model_drives_the_environment():
    env = TaskEnv("Depth", model=Glide())
    _, info = env.reset(seed=1, options={"start": {"depth_m": 12.0}, "target": 15.0})
    depth, limit = 12.0, env.plant.parts.stern_plane.limit
    assert info["reading"]["depth_m"] == depth
    for k in range(30):
        observation, reward, _, _, info = env.step(np.array([0.5], np.float32))
        depth += 2.0 * 0.1 * 0.5 * limit
        assert info["state"] == {"depth_m": pytest.approx(depth, rel=1e-12)}, k
        assert info["reading"]["u_mps"] == 1.5
    scale = 5 * env.plant.hull.length
    assert observation[0] == pytest.approx((15.0 - depth) / scale, abs=1e-6)
    assert info["reward_terms"]["depth"] == pytest.approx(-abs(15.0 - depth) / scale)
    assert reward == sum(info["reward_terms"].values())


def test_a_model_is_measured_by_noisy_sensors_too():
    env = TaskEnv("Depth", model=Glide(gain=0.0), effects={"effects.sampling.depth.noise": 0.1})
    _, info = env.reset(seed=1)
    read = [info["reading"]["depth_m"]]
    read += [env.step(np.zeros(1))[-1]["reading"]["depth_m"] for _ in range(200)]
    assert np.std(read) == pytest.approx(0.1, rel=0.25)


def test_a_model_that_diverges_ends_the_episode():
    env = TaskEnv("Depth", model=Glide(growth=1e60), duration=10.0)
    env.reset(seed=0)
    _, reward, terminated, _, info = env.step(np.zeros(1))
    while not terminated:
        _, reward, terminated, _, info = env.step(np.zeros(1))
    assert "diverged" in info["reason"] or "too deep" in info["reason"]
    assert np.isfinite(info["state"]["depth_m"])
    assert reward < -50.0


def test_a_spliced_model_drives_the_environment():
    @dataclass(frozen=True)
    class YawRate:
        """A yaw rate that follows the rudder with a lag."""

        dt: float = 0.1
        inputs: tuple = ("rudder_rad",)
        states: tuple = ("r_radps",)
        outputs: tuple = ("r_radps",)

        def initial(self, y0):
            return np.nan_to_num(y0)

        def step(self, x, u):
            return x + 0.1 * (-0.5 * u - x)

        def output(self, x):
            return x

        def correct(self, x, y):
            return np.where(np.isfinite(y), y, x)

    env = TaskEnv("Heading", "vt690", model=splice(load_vehicle("vt690"), YawRate()))
    _, first = env.reset(seed=0)
    rate = 0.0
    for _ in range(100):
        _, _, terminated, _, info = env.step(np.array([0.5], np.float32))
        rate += 0.1 * (-0.5 * info["command"]["rudder_rad"] - rate)
    assert not terminated
    assert info["state"]["r_radps"] == pytest.approx(rate, rel=1e-9)
    # a ramp of a rate that settles within two seconds, in nearly level flight
    assert info["state"]["heading_rad"] - first["state"]["heading_rad"] == pytest.approx(rate * (10.0 - 1.0), rel=0.05)
    assert abs(info["state"]["depth_m"] - first["state"]["depth_m"]) < 2.0


@pytest.mark.slow
def test_an_agent_may_have_other_actuators_than_the_tasks():
    env = TaskEnv("Depth", "npsauv", actions=["rudder_rad", "propeller_rpm"], duration=20.0, target=30.0)
    env.reset(seed=1, options={"start": {"depth_m": 30.0}})
    command = {"rudder_rad": 0.1, "propeller_rpm": 1000.0}
    for _ in range(200):
        _, _, _, truncated, info = env.step(env.action_for(command))
    assert truncated
    assert {name: info["command"][name] for name in command} == pytest.approx(command, rel=1e-12)
    assert abs(info["state"]["r_radps"]) > 0.01
    assert abs(info["state"]["depth_m"] - 30.0) < 1.0  # the stern plane is a regulator's now
    assert "stern_plane" not in env.episodes.observations
    same = TaskEnv("Depth", "npsauv", actions=["stern_plane_rad", "bow_plane_rad"])
    usual = TaskEnv("Depth", "npsauv")
    np.testing.assert_array_equal(same.episodes.plan, usual.episodes.plan)


def lacking(**changes):
    return replace(Glide(), **changes)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"task": "Dept"}, "Did you mean 'Depth'"),
        ({"vehicle": "slocum"}, "six degrees of freedom"),
        ({"effects": {"effects.rudder.offset": 9.0}}, "needs a value from"),
        ({"randomise": {"hull.x_g": (0.0, 5.0)}}, "impossible vehicle"),
        ({"target": "deep"}, "target needs a number"),
        (
            {"target": 500.0},
            r"target\['depth_m'\] needs a value from 0 to 66.6 m, the limits of the environment; got 500",
        ),
        ({"waypoints": [(0.0, 0.0, 10.0)]}, "has a target, not waypoints"),
        ({"task": "Path", "target": 1.0}, "has waypoints, not a target"),
        ({"task": "Path", "waypoints": [(1.0, 2.0)]}, "rows of north, east and depth"),
        ({"task": "Path", "waypoints": [(1.0, 2.0, -3.0)]}, "depths from 0 to 66.6 m, got -3"),
        ({"task": "Path", "waypoints": [(1.0, 2.0, float("nan"))]}, "finite numbers in m, got .*nan"),
        ({"task": "Path", "waypoints": "abc"}, "finite numbers in m, got 'abc'"),
        ({"task": "Heading", "target": 100.0}, r"target\['heading_rad'\] needs a value from -6.28 to 6.28 rad"),
        ({"task": "Speed", "target": -3.0}, r"target\['u_mps'\] needs a value from 0 to 5.91 m/s"),
        ({"vehicle": 3}, "A vehicle is the name of a preset .*, got 3"),
        ({"model": 3}, "model= needs a model, got 3"),
        ({"effects": [1]}, "effects= needs values by parameter path, .*`auv-gym list effects VEHICLE` lists the paths"),
        ({"dt": "0.1"}, "dt needs a number above 0"),
        ({"actions": ["rudder_rad", "propeller_rp"]}, "does not move remus100. Did you mean 'propeller_rpm'"),
        ({"actions": ["bow_plane_rad"]}, "does not move remus100"),
        ({"actions": []}, "actions= needs one or more names"),
        ({"actions": "rudder_rad"}, "actions= needs one or more names"),
        ({"actions": ["rudder_rad", "rudder_rad"]}, "each once"),
        (
            {"near": (0.8, 0.36)},
            "has no option 'near' for remus100. .*actions, waypoints",
        ),
        ({"model": lacking(dt=0.2)}, "dt=0.2"),
        ({"model": lacking(outputs=("depth_m",))}, "needs pitch_rad among its outputs"),
        ({"model": lacking(inputs=("rudder_rad",))}, "needs v_mps among its outputs"),  # which the held rudder needs
        ({"model": lacking(inputs=("propeller_rpm",))}, "needs stern_plane_rad among its inputs"),
        ({"model": lacking(inputs=("stern_plane_rad", "piston_m"))}, "piston_m that the environment does not have"),
    ],
)
def test_what_does_not_fit_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        TaskEnv(**{"task": "Depth", **options})


@pytest.mark.parametrize(
    "start, limits",
    [
        ({"depth_m": 1e5}, "from 0 to 66.6 m"),
        ({"depth_m": -3.0}, "from 0 to 66.6 m"),
        ({"pitch_rad": 2.0}, "from -1.4 to 1.4 rad"),
        ({"u_mps": 1e9}, "from -5.91 to 5.91 m/s"),
    ],
)
def test_a_start_outside_the_envelope_is_refused(start, limits):
    with pytest.raises(ValueError, match=limits):
        TaskEnv("Depth", "remus100").reset(options={"start": start})
