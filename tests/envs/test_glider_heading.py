from dataclasses import dataclass, replace
from math import cos, pi, radians, sin

import gymnasium
import numpy as np
import pytest

import auv_gym.envs  # noqa: F401  (registers)
from auv_gym.envs.glider_heading import GliderHeading
from auv_gym.models.files import save_model
from auv_gym.models.linear import StateSpace
from auv_gym.param import list_paths, replace_at, value_at
from auv_gym.plant import load_vehicle, save_vehicle
from auv_gym.vehicles.glider import yaw_rates


def run(env, actions, seed=0, **options):
    env.reset(seed=seed, options=options)
    return [env.step(np.array([action])) for action in actions]


def coefficients(plant):
    return yaw_rates(plant.family.view(plant.vector).hull)


@dataclass(frozen=True)
class Turner:
    """A model that turns at a rate proportional to the rudder, and by `growth` faster every sample."""

    inputs: tuple = ("rudder_rad",)
    outputs: tuple = ("heading_rad",)
    states: tuple = ("heading_rad",)
    dt: float = 4.0
    gain: float = 0.05
    growth: float = 1.0

    def initial(self, y0):
        return np.array(y0, dtype=float)

    def step(self, x, u):
        return self.growth * x + self.gain * self.dt * u

    def output(self, x):
        return x

    def correct(self, x, y):
        return np.array(y, dtype=float)


def test_targets_readings_and_commands_go_by_channel():
    env = GliderHeading("slocum", compass_noise=0.1)
    env.reset(seed=0)
    _, _, _, _, info = env.step(env.action_for({"rudder_rad": 0.1}))
    assert info["command"] == {"rudder_rad": pytest.approx(0.1)}
    assert info["target"] == {"heading_rad": info["target_rad"]}
    assert info["reading"] == {"heading_rad": info["reading_rad"], "u_mps": info["speed_mps"]}


def test_a_model_file_drives_the_environment(tmp_path):
    dt, lag = 4.0, 0.9
    model = StateSpace(
        a=np.array([[1.0, dt], [0.0, lag]]),
        b=np.array([[0.0], [0.01]]),
        c=np.array([[1.0, 0.0]]),
        inputs=("rudder_rad",),
        outputs=("heading_rad",),
        dt=dt,
    )
    save_model(model, tmp_path / "turn.npz")
    by_file = GliderHeading("slocum", model=tmp_path / "turn.npz")
    by_model = GliderHeading("slocum", model=model)
    actions = np.linspace(-0.5, 0.5, 20)
    found, expected = (
        [step[-1]["heading_rad"] for step in run(env, actions, heading=0.0)] for env in (by_file, by_model)
    )
    assert found == expected
    assert abs(found[-1]) > 0.01


@pytest.mark.parametrize("vehicle", ["ganeshblue", "slocum"])
def test_constant_rudder_gives_the_closed_form(vehicle):
    plant = load_vehicle(vehicle)
    damping, rudder = coefficients(plant)
    angle = 0.4 * plant.hull.rudder_limit
    info = run(GliderHeading(vehicle), [0.4] * 30, heading=0.0)[-1][-1]
    t = info["time_s"]
    rate = -rudder * angle / damping
    heading = rate * (t - (1.0 - np.exp(damping * t)) / -damping)
    # RK4 in steps of a quarter of the time constant or less
    assert info["heading_rad"] == pytest.approx(heading, rel=2e-4)
    assert info["state"]["r_radps"] == pytest.approx(rate * (1.0 - np.exp(damping * t)), rel=2e-4)


def test_the_observation_table():
    env = GliderHeading("ganeshblue", target=1.0, speed=0.33)
    first, _ = env.reset(seed=1, options={"heading": 0.2})
    np.testing.assert_allclose(first, [sin(0.8), cos(0.8), 0.0, 0.0, 0.1], atol=1e-6)
    observation, _, _, _, info = env.step(np.array([0.5]))
    rate = (info["reading_rad"] - 0.2) / env.plant.dt
    error = 1.0 - info["reading_rad"]
    expected = [sin(error), cos(error), rate / env.turn_rate_scale, 0.5, 0.1]
    np.testing.assert_allclose(observation, expected, atol=1e-6)
    damping, rudder = coefficients(env.plant)
    assert env.turn_rate_scale == pytest.approx(2.0 * rudder / damping * env.rudder_limit, rel=1e-6)
    assert info["rudder_rad"] == 0.5 * env.rudder_limit


def test_the_reward_table():
    env = GliderHeading("slocum", target=1.0)
    _, reward, _, _, info = run(env, [0.5], heading=0.2)[0]
    assert info["reward_terms"]["heading"] == pytest.approx(-abs(1.0 - info["heading_rad"]) / pi)
    assert info["reward_terms"]["rudder_travel"] == pytest.approx(-0.05 * 0.5 / 2.0)
    assert reward == sum(info["reward_terms"].values())


def test_actions_are_clipped_to_the_stop():
    beyond, at = (run(GliderHeading(), [a] * 5)[-1][-1] for a in (7.0, 1.0))
    assert beyond == at
    assert at["rudder_rad"] == load_vehicle("slocum").hull.rudder_limit


@pytest.mark.parametrize("action", [np.nan, np.inf, [0.1, 0.2]])
def test_a_bad_action_is_refused(action):
    env = GliderHeading()
    env.reset(seed=0)
    with pytest.raises(ValueError, match="one finite number"):
        env.step(np.array(action))


def test_it_is_truncated_after_its_duration():
    steps = run(GliderHeading("slocum", duration=40.0), [0.0] * 10)
    assert [truncated for _, _, _, truncated, _ in steps] == [False] * 9 + [True]
    assert steps[-1][-1]["time_s"] == 40.0


def test_a_step_after_the_end_asks_for_a_reset():
    env = GliderHeading("slocum", duration=4.0)
    run(env, [0.0])
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        env.step(np.array([0.0]))


def test_effects_at_neutral_change_no_bit():
    neutral = {p: value_at(load_vehicle("slocum"), p) for p in list_paths(load_vehicle("slocum")) if "effects." in p}
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, 60)
    plain = run(GliderHeading("slocum", compass_noise=0.01), actions)
    drawn = run(GliderHeading("slocum", compass_noise=0.01, effects=neutral), actions)
    for one, two in zip(plain, drawn):
        np.testing.assert_array_equal(one[0], two[0])
        assert one[1:] == two[1:]


def test_an_effect_changes_the_run_and_not_the_scale_of_observations():
    plain, bent = GliderHeading("slocum"), GliderHeading("slocum", effects={"effects.rudder.offset": 0.1})
    assert bent.turn_rate_scale == plain.turn_rate_scale
    assert run(bent, [0.0] * 10, heading=0.0)[-1][-1]["heading_rad"] > 0.1
    assert run(plain, [0.0] * 10, heading=0.0)[-1][-1]["heading_rad"] == 0.0


def test_bias_and_noise_are_in_the_reading_only():
    env = GliderHeading("slocum", effects={"effects.compass.bias": 0.2}, compass_noise=radians(0.5), duration=4000.0)
    infos = [step[-1] for step in run(env, [0.0] * 1000, seed=4)]
    errors = np.array([info["reading_rad"] - info["heading_rad"] for info in infos])
    assert errors.mean() == pytest.approx(0.2, abs=4.0 * radians(0.5) / np.sqrt(errors.size))
    assert errors.std() == pytest.approx(radians(0.5), rel=0.1)


def test_targets_change_in_steps_of_the_stated_size_and_time():
    env = GliderHeading("slocum", duration=20_000.0)
    infos = [step[-1] for step in run(env, [0.0] * 5000, seed=2)]
    target = np.unwrap([info["target_rad"] for info in infos])
    changes = np.flatnonzero(np.diff(target))
    sizes, times = np.abs(np.diff(target)[changes]), 4.0 * np.diff(changes)
    assert sizes.size > 100
    assert sizes.min() >= radians(20.0) - 1e-9
    assert sizes.max() <= radians(70.0) + 1e-9
    assert times.min() >= 60.0
    assert times.max() <= 184.0  # a change waits for the next sample


def test_a_fixed_target_and_a_range_of_speeds():
    env = GliderHeading("slocum", target=0.7, speed=(0.2, 0.5))
    speeds = []
    for seed in range(20):
        _, info = env.reset(seed=seed)
        assert info["target_rad"] == 0.7
        speeds.append(info["speed_mps"])
    assert 0.2 <= min(speeds) < 0.27
    assert 0.43 < max(speeds) <= 0.5


def test_vehicle_as_preset_file_or_plant(tmp_path):
    plant = replace_at(load_vehicle("slocum"), "effects.yaw.moment", 0.01)
    save_vehicle(plant, tmp_path / "vehicle.toml")
    runs = [
        run(GliderHeading(vehicle), [0.3] * 10)[-1][-1]["heading_rad"]
        for vehicle in (plant, tmp_path / "vehicle.toml", str(tmp_path / "vehicle.toml"))
    ]
    assert runs[0] == runs[1] == runs[2]
    assert runs[0] != run(GliderHeading("slocum"), [0.3] * 10)[-1][-1]["heading_rad"]


def test_dt_is_the_sample_time():
    coarse, fine = (
        run(GliderHeading("slocum"), [0.5] * 10, heading=0.0),
        run(GliderHeading("slocum", dt=1.0), [0.5] * 40, heading=0.0),
    )
    assert coarse[-1][-1]["time_s"] == fine[-1][-1]["time_s"] == 40.0
    assert coarse[-1][-1]["heading_rad"] == pytest.approx(fine[-1][-1]["heading_rad"], rel=1e-4)  # RK4 steps 2 s, 1 s
    plant = load_vehicle("slocum")
    assert GliderHeading(plant, dt=1.0).plant == replace(plant, dt=1.0)


def test_a_model_drives_it_in_place_of_the_plant():
    env = GliderHeading("slocum", model=Turner())
    info = run(env, [0.5] * 10, heading=0.3)[-1][-1]
    assert info["heading_rad"] == pytest.approx(0.3 + 0.05 * 40.0 * 0.5 * env.rudder_limit)
    assert set(info["state"]) == {"heading_rad"}


def test_a_plant_as_model_gives_the_plants_run():
    plant = replace_at(load_vehicle("slocum"), "effects.rudder.lag", 2.0)
    as_model = run(GliderHeading("slocum", model=plant), [0.5, -0.2] * 10)
    as_vehicle = run(GliderHeading(plant), [0.5, -0.2] * 10)
    assert as_model[-1][-1] == as_vehicle[-1][-1]


@pytest.mark.parametrize(
    "model, words",
    [
        (Turner(outputs=("r_radps",), states=("r_radps",)), "heading_rad among its outputs"),
        (Turner(inputs=("bow_thruster_N",)), "rudder_rad among its inputs"),
        (Turner(inputs=("rudder_rad", "piston_m")), "an input piston_m"),
        (Turner(dt=1.0), r"dt=1, or fit the model to record.resample\(4\)"),
        (load_vehicle("ganeshblue"), r"steps 1 s and the environment 4 s: make the environment with dt=1"),
    ],
)
def test_a_model_that_does_not_fit_is_refused_by_name(model, words):
    with pytest.raises(ValueError, match=words):
        GliderHeading("slocum", model=model)


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"vehicle": "slocm"}, "Did you mean 'slocum'"),
        ({"effects": {"effects.ruder.offset": 0.1}}, "Did you mean 'effects.rudder.offset'"),
        ({"effects": {"effects.rudder.offset": 0.1}, "model": Turner()}, "give one of the two"),
        ({"duration": 0.0}, "duration needs a number above 0 in s"),
        ({"compass_noise": -1.0}, "compass_noise needs a number of at least 0 in rad"),
        ({"target": float("nan")}, "target needs a number in rad"),
        ({"speed": (0.5, 0.2)}, "speed needs a number of at least 0.5 in m/s"),
        ({"render_mode": "human"}, "rgb_array"),
        ({"effects": {"hull.n_delta": 0.0}}, "does not turn the vehicle"),
    ],
)
def test_bad_settings_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        GliderHeading(**settings)


@pytest.mark.parametrize("growth, reason", [(30.0, "heading_rad is"), (np.inf, "is not finite")])
def test_divergence_ends_the_run_with_its_reason_and_no_nan(growth, reason):
    env = GliderHeading("slocum", model=Turner(growth=growth), duration=400.0)
    env.reset(seed=0, options={"heading": 1.0})
    for count in range(1, 101):
        observation, reward, terminated, truncated, info = env.step(np.array([1.0]))
        assert env.observation_space.contains(observation)
        assert np.isfinite([reward, info["heading_rad"], *info["state"].values()]).all()
        if terminated or truncated:
            assert reward == pytest.approx(-1.05 * (100 - count + 1))  # as if all that was left were at its worst
            break
    assert terminated
    assert not truncated
    assert reason in info["reason"]


def test_the_plan_view_shows_the_run():
    env = gymnasium.make("auv_gym/GliderHeading-v0", render_mode="rgb_array", target=1.0)
    env.reset(seed=0)
    before = env.render()
    for _ in range(10):
        env.step(np.array([1.0], np.float32))
    after = env.render()
    assert before.shape == after.shape == (640, 960, 3)
    assert before.dtype == np.uint8
    assert (before != after).any()
    assert GliderHeading().render() is None
