from dataclasses import dataclass, field

import gymnasium
import numpy as np
import pytest

import auv_gym.envs  # noqa: F401  (registers)
from auv_gym.envs.task_env import TaskEnv
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.float_engine import OIL, PUMP, find_engine
from auv_gym.records.record import Record
from controllers.pid import float_depth_pid
from tests.envs.env_runs import run

PRESETS = ("qiandao_float", "mermaid")
NEAR = (0.8, 0.36)  # the two sampling rates of Zhong et al. 2024


def make(**options):
    return gymnasium.make("auv_gym/FloatDepth-v0", **options).unwrapped


def wander(count, seed=1):
    """Actions that stay for a while each."""
    return np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, count // 20 + 1), 20)[:count]


# ---------------------------------------------------------------------------- engine and tables of the documentation


@pytest.mark.parametrize("vehicle", PRESETS)
def test_the_speed_is_the_steady_one_at_the_slower_end(vehicle):
    plant = load_vehicle(vehicle)
    engine, hull = find_engine(plant), plant.hull
    # the closed form of (d1 + d2 w) w = rho g V, with the part of the piston's lift that grows with its square
    forces = []
    for side in (-1.0, 1.0):
        value = engine.middle + side * engine.half
        square = hull.piston_square * (value * abs(value) - hull.piston_neutral**2) if vehicle == PRESETS[0] else 0.0
        forces.append(abs(hull.density * 9.81 * engine.volume * side * engine.half + square))
    force = min(forces)
    speed = 2.0 * force / (hull.drag_linear + np.sqrt(hull.drag_linear**2 + 4.0 * hull.drag_quadratic * force))
    assert engine.speed == pytest.approx(speed, rel=1e-5)  # an hour at a time constant of seconds, started from rest
    lag = (hull.mass + hull.added_mass) / (hull.drag_linear + 2.0 * hull.drag_quadratic * speed)
    assert engine.time == pytest.approx(3.0 * (engine.half / engine.rate + lag), rel=1e-4)


def test_a_float_that_cannot_dive_is_refused():
    with pytest.raises(ValueError, match="dives both ways"):
        make(vehicle=replace_at(load_vehicle("qiandao_float"), {"hull.piston_neutral": 0.5}))


def test_the_observation():
    env = make()
    engine, plant = find_engine(env.plant), env.plant
    length = engine.speed * engine.time
    first, info = env.reset(seed=3, options={"target": 25.0, "start": {"depth_m": 20.0}})
    deepest = 7.5 * length
    np.testing.assert_allclose(first, [5.0 / (3.0 * length), 20.0 / deepest, 0.0, 0.0, 0.0], atol=1e-6)
    before = info["reading"]["depth_m"]
    for k in range(3):
        observation, _, _, _, info = env.step(np.array([-0.5], np.float32))
        depth = info["reading"]["depth_m"]
        position = -min(0.7 * (k + 1) / (plant.hull.piston_slowness * engine.half), 0.5)
        rate = (depth - before) / 0.7
        expected = [(25.0 - depth) / (3.0 * length), depth / deepest, rate / engine.speed, -0.5, position]
        np.testing.assert_allclose(observation, expected, atol=1e-6)
        assert info["reading"]["depth_rate_mps"] == pytest.approx(rate, rel=1e-9)
        before = depth
    assert env.episodes.observations == ("depth_error", "depth", "depth_rate", "command", "position")
    assert info["command"]["piston_m"] == pytest.approx(0.525)
    assert info["state"]["piston_m position"] == pytest.approx(0.55 + 0.05 * position)  # it goes as it is said to


def test_the_reward():
    env = make(target=30.0)
    engine = find_engine(env.plant)
    _, reward, _, _, info = run(env, [0.5], start={"depth_m": 28.0})[0]
    error = 30.0 - info["state"]["depth_m"]
    terms = info["reward_terms"]
    assert terms["depth"] == pytest.approx(-error / (3.0 * engine.speed * engine.time), rel=1e-9)
    assert terms["command_travel"] == pytest.approx(-0.05 * 0.5 / 2.0)
    assert reward == sum(terms.values())
    assert run(env, [0.0], start={"depth_m": 100.0})[0][1] == pytest.approx(-1.0)


def test_an_action_without_a_command_is_refused():
    env = TaskEnv("FloatDepth")
    with pytest.raises(ValueError, match="action_for needs a command for each action, piston_m; missing: piston_m"):
        env.action_for({"depth_m": 3.0})


def test_an_action_for_a_command():
    env = make()
    assert env.episodes.action_for({"piston_m": 0.6}) == pytest.approx([1.0])
    info = run(env, [env.episodes.action_for({"piston_m": 0.52})])[0][-1]
    assert info["command"]["piston_m"] == pytest.approx(0.52)


# ---------------------------------------------------------------------------- truth against the plant


@pytest.mark.parametrize("near", [None, NEAR])
def test_a_record_of_a_run_is_what_the_plant_makes_of_its_commands(near):
    """Also where steps differ in length: past commands, which a dead time brings back, have their own times."""
    effects = {
        "effects.piston.dead_time": 2.0,
        "effects.piston.lag": 1.0,
        "effects.piston.backlash": 0.004,
        "effects.water.heave_cos": 0.03,
        "effects.depth.lag": 1.5,
    }
    env = make(effects=effects, randomise={}, near=near, target=19.0)
    _, info = env.reset(seed=0, options={"start": {"depth_m": 19.0}})
    start = np.array([list(info["state"].values())[:3]])
    times, depths, pistons = [0.0], [info["reading"]["depth_m"]], []
    for action in wander(300, seed=4):
        _, _, terminated, _, info = env.step([0.5 * action])
        assert not terminated
        times.append(info["time_s"])
        depths.append(info["reading"]["depth_m"])
        pistons.append(info["command"]["piston_m"])
    assert (np.ptp(np.diff(times)) > 0.3) == (near is not None)
    rest = 0.7 * np.arange(-7.0, 0.0)  # at which the piston was where it is at first
    elapsed, pistons = np.array([*rest, *times]), np.array([*np.full(7, 0.55), *pistons, 0.55])
    record = Record.from_arrays(elapsed, {"piston_m": pistons, "elapsed_s": elapsed})
    found = env.model.run(record, [slice(7, elapsed.size)], start)[:, 0]
    np.testing.assert_allclose(found, depths, atol=1e-9)  # rounding of 300 steps


def test_oil_goes_at_the_pump_s_rate_and_is_logged():
    env = make(vehicle="mermaid", dt=10.0, randomise={})
    env.reset(seed=0)
    oil, pumped, valved, at_depth = [0.0], 0.0, 0.0, 0.0
    depth = env.reset(seed=0)[1]["reading"]["depth_m"]
    for action in wander(200):
        observation, _, _, _, info = env.step([action])
        command = info["command"]
        change = np.clip(OIL * action - oil[-1], -10.0 * PUMP, 10.0 * PUMP)
        oil.append(oil[-1] + change)
        pumped += max(change, 0.0)
        valved -= min(change, 0.0)
        at_depth -= min(change, 0.0) * depth
        depth = info["reading"]["depth_m"]
        assert command["oil_volume_m3"] == pytest.approx(oil[-1], abs=1e-15)
        assert command["pumped_volume_m3"] == pytest.approx(pumped, abs=1e-15)
        assert command["valved_volume_m3"] == pytest.approx(valved, abs=1e-15)
        assert command["valved_depth_m4"] == pytest.approx(at_depth, rel=1e-9, abs=1e-15)
        assert observation[4] == pytest.approx(oil[-1] / OIL, abs=1e-6)
    assert max(oil) > 0.2 * OIL  # it got somewhere
    assert info["command"]["piston_m"] == env.plant.hull.piston_neutral


def test_errors_of_the_oil_s_log_act():
    plain, faulty = (
        run(make(vehicle="mermaid", effects=effects, randomise={}), [0.8] * 20)[-1][-1]
        for effects in (None, {"effects.oil.pump_gain": 0.2})
    )
    assert plain["command"] == faulty["command"]
    assert faulty["state"]["depth_m"] < plain["state"]["depth_m"] - 1.0


def test_randomised_parameters_act():
    ranges = {"hull.drag_linear": (3.0, 9.0), "hull.temperature": (10.0, 25.0), "hull.piston_neutral": (0.54, 0.56)}
    env = make(randomise=ranges)
    _, info = env.reset(seed=11)
    plant = replace_at(load_vehicle("qiandao_float"), info["randomised"])
    assert info["command"]["temperature_C"] == plant.hull.temperature  # constants are those of the drawn float
    assert info["state"]["piston_m position"] == pytest.approx(plant.hull.piston_neutral)
    x = np.array(list(info["state"].values()))
    for _ in range(20):
        _, _, _, _, info = env.step([0.5])
        x = plant.step(x, np.array(list(info["command"].values())))
    assert list(info["state"].values()) == x.tolist()


def test_the_trim_is_drawn_unless_told_otherwise():
    env = make()
    found = [env.reset(seed=seed)[1]["randomised"]["effects.volume.offset"] for seed in range(200)]
    half = 0.05 * env.plant.hull.piston_area
    assert max(np.abs(found)) <= 0.1 * half
    assert max(np.abs(found)) > 0.09 * half
    assert make(randomise={}).reset(seed=0)[1]["randomised"] == {}
    assert make(effects={"effects.volume.offset": 1e-6}).reset(seed=0)[1]["randomised"] == {}
    assert make(vehicle="mermaid").reset(seed=0)[1]["randomised"].keys() == {"effects.volume.offset"}


# ---------------------------------------------------------------------------- targets, sampling rates, control


@pytest.mark.parametrize("vehicle", PRESETS)
def test_targets_change_in_steps_within_their_band(vehicle):
    env = make(vehicle=vehicle)
    engine = find_engine(env.plant)
    length = engine.speed * engine.time
    for seed in range(30):
        targets, times = [], []
        _, info = env.reset(seed=seed)
        start, ended = info["state"]["depth_m"], False
        while not ended:
            if not targets or info["target"]["depth_m"] != targets[-1]:
                targets.append(info["target"]["depth_m"])
                times.append(info["time_s"])
            observation, _, terminated, ended, info = env.step(-1.5 * env_error(info, length))
            assert not terminated, info["reason"]
        steps, pauses = np.abs(np.diff([start, *targets])), np.diff(times)
        assert 3 <= len(targets) <= 4
        assert steps.max() <= 3.0 * length + 1e-9
        assert pauses.min() >= 4.0 * engine.time - env.plant.dt
        assert pauses.max() <= 7.0 * engine.time + env.plant.dt
        assert min(start, *targets) >= 0.5 * length - 1e-9
        assert max(start, *targets) <= 7.5 * length + 1e-9


def env_error(info, length):
    return np.array([(info["target"]["depth_m"] - info["reading"]["depth_m"]) / (3.0 * length)], np.float32)


def test_steps_are_shorter_near_the_target():
    env = make(near=NEAR, target=20.0, randomise={}, effects={"effects.sampling.depth.noise": 0.05})
    _, info = env.reset(seed=0, options={"start": {"depth_m": 18.5}})
    found, travelled = {0.36: 0, 0.7: 0}, []
    assert info["dt_s"] == 0.7
    for _ in range(200):
        coming, before, position = info["dt_s"], info["time_s"], info["state"]["piston_m position"]
        observation, _, _, _, info = env.step(-env_error(info, 1.0))
        assert info["time_s"] - before == pytest.approx(coming, abs=1e-9)
        off = abs(info["target"]["depth_m"] - info["reading"]["depth_m"])
        assert info["dt_s"] == (0.36 if off < 0.8 else 0.7)
        travelled.append(abs(info["state"]["piston_m position"] - position) / coming)
        error = abs(20.0 - info["state"]["depth_m"]) / env.episodes.settings["error_scale"]
        assert info["reward_terms"]["depth"] == pytest.approx(-error * coming / 0.7)  # it counts time, not steps
        found[coming] += 1
    assert min(found.values()) > 20
    assert max(travelled) == pytest.approx(0.004, rel=1e-9)
    assert make().reset(seed=0)[1]["dt_s"] == 0.7


@pytest.mark.parametrize("near", [None, NEAR])
def test_a_controller_follows_the_target(near):
    env = make(near=near, target=40.0, effects={"effects.sampling.depth.noise": 0.01})
    controller = float_depth_pid(env.plant)
    _, info = env.reset(seed=1, options={"start": {"depth_m": 5.0}})
    memory, ended, depths = controller.start(), False, []
    while not ended:
        reading = {"depth_m": info["reading"]["depth_m"], "dt_s": info["dt_s"]}
        command, memory = controller.act(memory, reading, info["target"])
        _, _, terminated, ended, info = env.step(env.episodes.action_for(command))
        depths.append((info["time_s"], info["state"]["depth_m"]))
    assert not terminated
    late = np.array([depth for time, depth in depths if time > 800.0])
    assert np.abs(late - 40.0).max() < 0.3  # thirty times the noise, a hundredth of the dive


# ---------------------------------------------------------------------------- sensing


def readings(steps=400, env_options=None, **effects):
    env = make(
        duration=1e4, randomise={}, effects={f"effects.sampling.depth.{k}": v for k, v in effects.items()},
        **(env_options or {}),
    )  # fmt: skip
    found = run(env, wander(steps), start={"depth_m": 30.0})
    return (np.array([info[group]["depth_m"] for *_, info in found]) for group in ("reading", "state"))


def test_noise_has_its_deviation_and_leaves_the_truth():
    noisy, true = readings(noise=0.2)
    _, quiet = readings()
    assert np.std(noisy - true) == pytest.approx(0.2, rel=0.15)  # 4 standard errors of 400 samples
    np.testing.assert_array_equal(true, quiet)


def test_delay_quantisation_and_dropouts():
    late, true = readings(delay=2.1)
    np.testing.assert_array_equal(late[3:], true[:-3])
    coarse, true = readings(quantisation=0.05)
    np.testing.assert_allclose(coarse / 0.05, np.round(coarse / 0.05), atol=1e-9)
    assert np.abs(coarse - true).max() <= 0.025 + 1e-12
    held, true = readings(dropout=0.3)
    assert (np.diff(held) == 0.0).mean() == pytest.approx(0.3, abs=0.1)  # 4 standard errors of 400 samples
    assert not (np.diff(true) == 0.0).all()


# ---------------------------------------------------------------------------- ends


@pytest.mark.parametrize(
    "start, reason",
    [
        ({"depth_m": 116.7, "depth_rate_mps": 0.1}, "too deep: depth_m is"),
        ({"volume_m3": -0.05}, "out of its envelope: the speed is"),
        ({"volume_m3": 2e9}, "diverged"),
    ],
)
@pytest.mark.parametrize("near", [None, NEAR])
def test_leaving_the_envelope_ends_the_episode_with_the_reason(start, reason, near):
    env = make(duration=70.0, near=near)
    env.reset(seed=0, options={"start": start})
    terminated = truncated = False
    while not (terminated or truncated):
        observation, reward, terminated, truncated, info = env.step([-1.0])
    assert (terminated, truncated) == (True, False)
    assert reason in info["reason"]
    assert f"at {info['time_s']:g} s" in info["reason"]
    assert reward == pytest.approx(-1.05 * ((70.0 - info["time_s"]) / 0.7 + 1.0))
    assert env.observation_space.contains(observation)
    assert np.isfinite(list(info["state"].values())).all()
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        env.step([0.0])


def test_it_is_truncated_after_its_duration():
    steps = run(make(duration=7.0), [0.0] * 10)
    assert [truncated for _, _, _, truncated, _ in steps] == [False] * 9 + [True]
    uneven = run(make(duration=7.0, near=(100.0, 0.3)), [0.0] * 24)
    assert [truncated for _, _, _, truncated, _ in uneven] == [False] * 23 + [True]
    assert uneven[-1][-1]["time_s"] == pytest.approx(24 * 0.3)


def test_a_model_that_leaves_the_water_ends_the_episode():
    env = make(model=Drift())
    *_, terminated, _, info = run(env, [1.0] * 15, start={"depth_m": 0.0})[-1]
    assert terminated
    assert info["reason"] == "out of the water: depth_m is -1.05 at 10.5 s"


def test_a_float_afloat_stays_afloat():
    env = make(duration=300.0)
    env.reset(seed=0, options={"start": {"depth_m": 1.0}})
    truncated = False
    while not truncated:
        _, _, terminated, truncated, info = env.step([1.0])
        assert not terminated, info["reason"]
    assert -0.1 < info["state"]["depth_m"] < 0.1


# ---------------------------------------------------------------------------- models in place of the vehicle


@dataclass(frozen=True)
class Drift:
    """A model of depth alone, which sinks at a rate proportional to the piston's position above the middle."""

    dt: float = 0.7
    growth: float = 1.0
    inputs: tuple = ("piston_m",)
    states: tuple = ("depth_m",)
    outputs: tuple = ("depth_m",)
    constants: dict = field(default_factory=dict)

    def initial(self, y0):
        return np.array(y0[:1], dtype=float)

    def step(self, x, u):
        return self.growth * x - 2.0 * self.dt * (u[:1] - 0.55)

    def output(self, x):
        return x

    def correct(self, x, y):
        return np.array(y[:1], dtype=float)


def test_a_model_drives_the_environment():
    env = make(model=Drift())
    _, info = env.reset(seed=1, options={"start": {"depth_m": 12.0}, "target": 15.0})
    assert info["reading"]["depth_m"] == 12.0
    assert info["randomised"] == {}
    depth = 12.0
    for _ in range(30):
        observation, reward, _, _, info = env.step([-0.5])
        depth += 2.0 * 0.7 * 0.025
        assert info["state"] == {"depth_m": pytest.approx(depth, rel=1e-12)}
        assert info["reading"]["depth_rate_mps"] == pytest.approx(2.0 * 0.025)
    engine = find_engine(env.plant)
    assert observation[0] == pytest.approx((15.0 - depth) / (3.0 * engine.speed * engine.time), abs=1e-6)
    assert reward == sum(info["reward_terms"].values())


def test_a_model_that_diverges_ends_the_episode():
    env = make(model=Drift(growth=1e60), duration=70.0)
    env.reset(seed=0)
    terminated = False
    while not terminated:
        _, reward, terminated, _, info = env.step([0.0])
    assert "diverged" in info["reason"] or "too deep" in info["reason"]
    assert np.isfinite(info["state"]["depth_m"])
    assert reward < -50.0


@pytest.mark.parametrize(
    "options, message",
    [
        ({"vehicle": "remus100"}, "needs a profiling float, such as 'qiandao_float', got 'remus100' of family 'body'"),
        ({"vehicle": "qiandao"}, "Did you mean 'qiandao_float'"),
        ({"randomise": {"hull.piston_low": (0.4, 0.7)}}, "impossible vehicle"),
        ({"target": -3.0}, r"target\['depth_m'\] needs a value from 0 to"),
        ({"target": 1e6}, r"from 0 to 1.1e\+04 m"),
        (
            {"waypoints": [(0.0, 0.0, 10.0)]},
            "has no option 'waypoints' for qiandao_float. .*near, depths",
        ),
        ({"near": 0.8}, r"near= needs a pair \(m, s\)"),
        ({"near": (0.0, 0.36)}, "near.0. needs a number above 0 in m"),
        ({"near": (0.8, 0.0)}, "near.1. needs a number above 0 in s"),
        ({"near": (0.8, 1.0)}, "at most dt = 0.7 s, got 1.0 s: give a larger dt="),
        ({"depths": 30.0}, r"depths= needs a pair \(shallowest, deepest\)"),
        ({"depths": (-1.0, 5.0)}, "depths.0. needs a number of at least 0"),
        ({"depths": (5.0, 5.0)}, "depths.1. needs a number above 5 in m"),
        ({"model": Drift(dt=0.36)}, "dt=0.36"),
        ({"model": Drift(), "near": NEAR}, "Steps of two lengths \\(near=\\) are nothing that Drift was made for"),
        ({"model": Drift(outputs=("heading_rad",))}, "needs depth_m among its outputs"),
        ({"model": Drift(inputs=("oil_volume_m3",))}, "needs piston_m among its inputs"),
        ({"model": Drift(inputs=("piston_m", "rudder_rad"))}, "rudder_rad that the environment does not have"),
        ({"model": Drift(), "effects": {"effects.volume.offset": 1e-6}}, "which model= replaces"),
    ],
)
def test_what_does_not_fit_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        TaskEnv("FloatDepth", **options)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"start": {"heading_rad": 1.0}}, "depth_m, depth_rate_mps, volume_m3"),
        ({"target": -1.0}, "from 0 to"),
        ({"start": {"depth_m": 1e5}}, r"start\['depth_m'\] needs a value from 0 to"),
        ({"depth": 1.0}, "reset has the options"),
    ],
)
def test_bad_options_of_reset_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        make().reset(options=options)


def test_depths_and_a_deep_target_move_the_limits():
    env = make(vehicle="mermaid", depths=(200.0, 1800.0))
    depths = [env.reset(seed=seed)[1]["state"]["depth_m"] for seed in range(100)]
    assert min(depths) >= 200.0
    assert max(depths) <= 1800.0
    assert np.ptp(depths) > 1000.0
    assert env.episodes.settings["depth_limit"] == 3600.0
    assert make(target=500.0).episodes.settings["depth_limit"] == 1000.0


def test_an_unknown_volume_can_be_given():
    heavy, light = (run(make(randomise={}), [0.0] * 60, start={"volume_m3": v})[-1][-1] for v in (-2e-5, 2e-5))
    assert heavy["state"]["depth_m"] > light["state"]["depth_m"] + 0.5
