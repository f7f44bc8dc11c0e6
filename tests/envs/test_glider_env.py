"""GliderHeading: what its tables promise, its options, and models in the vehicle's place."""

from dataclasses import dataclass, replace
from math import cos, pi, radians, sin

import gymnasium
import numpy as np
import pytest

from auv_gym.envs.task_env import TaskEnv
from auv_gym.envs.vector_env import TaskVectorEnv
from auv_gym.models.files import save_model
from auv_gym.models.linear import StateSpace
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.vehicles.glider import linear_yaw_coefficients
from tests.envs.env_runs import run


def make(vehicle="slocum", **options):
    return TaskEnv("GliderHeading", vehicle, **options)


def headings(steps):
    return [info["state"]["heading_rad"] for *_, info in steps]


def coefficients(plant):
    return linear_yaw_coefficients(plant.family.view(plant.vector).hull)


def steady_turn(plant):
    damping, rudder = coefficients(plant)
    return rudder / damping * plant.hull.rudder_limit


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


# ---------------------------------------------------------------------------- tables of the documentation


@pytest.mark.parametrize("vehicle", ["ganeshblue", "slocum"])
def test_constant_rudder_gives_the_closed_form(vehicle):
    damping, rudder = coefficients(load_vehicle(vehicle))
    env = make(vehicle)
    info = run(env, [0.4] * 30, start={"heading_rad": 0.0})[-1][-1]
    t, rate = info["time_s"], -rudder * 0.4 * env.plant.hull.rudder_limit / damping
    heading = rate * (t - (1.0 - np.exp(damping * t)) / -damping)
    # RK4 in steps of a quarter of the time constant or less
    assert info["state"]["heading_rad"] == pytest.approx(heading, rel=2e-4)
    assert info["state"]["r_radps"] == pytest.approx(rate * (1.0 - np.exp(damping * t)), rel=2e-4)


def test_the_observation_and_the_info():
    env = make("ganeshblue", target=1.0, speed=0.33)
    first, info = env.reset(seed=1, options={"start": {"heading_rad": 0.2}})
    np.testing.assert_allclose(first, [sin(0.8), cos(0.8), 0.0, 0.0, 0.1], atol=1e-6)
    observation, _, _, _, info = env.step(np.array([0.5]))
    reading = info["reading"]["heading_rad"]
    rate = (reading - 0.2) / env.plant.dt
    expected = [sin(1.0 - reading), cos(1.0 - reading), rate / (2.0 * abs(steady_turn(env.plant))), 0.5, 0.1]
    np.testing.assert_allclose(observation, expected, atol=1e-6)
    assert env.episodes.observations == ("heading_error_sin", "heading_error_cos", "turn_rate", "rudder", "speed")
    assert info["target"] == {"heading_rad": 1.0}
    assert info["reading"] == {"heading_rad": info["state"]["heading_rad"], "u_mps": 0.33}
    assert info["command"]["rudder_rad"] == 0.5 * env.plant.hull.rudder_limit
    assert info["command"]["u_mps"] == 0.33


def test_the_change_of_the_heading_is_measured_across_the_half_turn():
    env = make("slocum", model=Turner(gain=1.0))
    env.reset(seed=0, options={"start": {"heading_rad": pi - 0.01}})
    first, *_ = env.step([0.1])
    scale = 2.0 * abs(steady_turn(env.plant))
    assert first[2] == pytest.approx(min(0.1 * env.plant.hull.rudder_limit / scale, 1.0), rel=1e-5)


def test_the_reward():
    env = make(target=1.0)
    _, reward, _, _, info = run(env, [0.5], start={"heading_rad": 0.2})[0]
    terms = info["reward_terms"]
    assert terms["heading"] == pytest.approx(-abs(1.0 - info["state"]["heading_rad"]) / pi)
    assert terms["command_travel"] == pytest.approx(-0.05 * 0.5 / 2.0)
    assert reward == sum(terms.values())


def test_actions_are_clipped_to_the_stop():
    beyond, at = (run(make(), [a] * 5)[-1][-1] for a in (7.0, 1.0))
    assert beyond == at
    assert at["command"]["rudder_rad"] == load_vehicle("slocum").hull.rudder_limit


def test_an_effect_changes_the_run_and_not_the_scale_of_observations():
    plain, bent = make(), make(effects={"effects.rudder.offset": 0.1})
    np.testing.assert_array_equal(bent.episodes.plan, plain.episodes.plan)
    assert headings(run(bent, [0.0] * 10, start={"heading_rad": 0.0}))[-1] > 0.1
    assert headings(run(plain, [0.0] * 10, start={"heading_rad": 0.0}))[-1] == 0.0


def test_targets_change_in_steps_of_the_stated_size_and_time():
    infos = [info for *_, info in run(make(duration=20_000.0), [0.0] * 5000, seed=2)]
    target = np.unwrap([info["target"]["heading_rad"] for info in infos])
    changes = np.flatnonzero(np.diff(target))
    sizes, times = np.abs(np.diff(target)[changes]), 4.0 * np.diff(changes)
    assert sizes.size > 100
    assert sizes.min() >= radians(20.0) - 1e-9
    assert sizes.max() <= radians(70.0) + 1e-9
    assert times.min() >= 60.0
    assert times.max() <= 184.0  # a change waits for the next sample


# ---------------------------------------------------------------------------- options


def test_a_fixed_target_and_a_range_of_speeds():
    env = make(target=0.7, speed=(0.2, 0.5))
    infos = [env.reset(seed=seed)[1] for seed in range(20)]
    speeds = [info["reading"]["u_mps"] for info in infos]
    assert {info["target"]["heading_rad"] for info in infos} == {0.7}
    assert 0.2 <= min(speeds) < 0.27
    assert 0.43 < max(speeds) <= 0.5


def test_randomised_vehicles_move_as_they_do_and_are_observed_alike():
    env = make(randomise={"effects.yaw.moment": (-0.03, 0.03), "hull.speed": (0.3, 0.4)})
    drawn = []
    for seed in (1, 2, 1):
        _, info = env.reset(seed=seed, options={"start": {"heading_rad": 0.0}})
        drawn.append(info["randomised"])
        assert info["reading"]["u_mps"] == drawn[-1]["hull.speed"]
        plant, x = replace_at(load_vehicle("slocum"), drawn[-1]), np.array(list(info["state"].values()))
        for _ in range(10):
            observation, *_, info = env.step([0.5])
            x = plant.step(x, np.array(list(info["command"].values())))
        assert list(info["state"].values()) == x.tolist()
        assert observation[4] == pytest.approx(drawn[-1]["hull.speed"] / 0.35 - 1.0, abs=1e-6)
    assert drawn[0] == drawn[2] != drawn[1]


def test_bias_and_noise_are_in_the_reading_only():
    env = make(effects={"effects.compass.bias": 0.2}, compass_noise=radians(0.5), duration=4000.0)
    infos = [info for *_, info in run(env, [0.0] * 1000, seed=4)]
    errors = np.array([info["reading"]["heading_rad"] - info["state"]["heading_rad"] for info in infos])
    assert errors.mean() == pytest.approx(0.2, abs=4.0 * radians(0.5) / np.sqrt(errors.size))
    assert errors.std() == pytest.approx(radians(0.5), rel=0.1)


def test_the_compass_is_sampled():
    late = run(make(effects={"effects.sampling.compass.delay": 8.0}), [0.5] * 40)
    read, true = ([info[group]["heading_rad"] for *_, info in late] for group in ("reading", "state"))
    assert read[2:] == true[:-2]
    coarse = run(make(effects={"effects.sampling.compass.quantisation": 0.05}), [0.5] * 40)
    steps = np.array([info["reading"]["heading_rad"] for *_, info in coarse]) / 0.05
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    held = run(make(effects={"effects.sampling.compass.dropout": 0.3}, duration=4000.0), [0.5] * 900)
    repeats = np.diff([info["reading"]["heading_rad"] for *_, info in held]) == 0.0
    assert repeats.mean() == pytest.approx(0.3, abs=0.07)  # 4 standard errors


def test_what_no_sensor_measures_gets_no_noise():
    env = make(compass_noise=1.0)
    run(env, [0.5] * 5)
    state = env._record["raw"].tolist()
    assert env._record["features"].tolist()[1:4] == state[1:4]
    assert env._record["features"][0] != state[0]


def test_compass_noise_is_short_for_the_effect():
    short, long = make(compass_noise=0.1), make(effects={"effects.sampling.compass.noise": 0.1})
    assert [step[-1] for step in run(short, [0.2] * 9)] == [step[-1] for step in run(long, [0.2] * 9)]


def test_dt_is_the_sample_time():
    coarse, fine = (
        run(make(), [0.5] * 10, start={"heading_rad": 0.0}),
        run(make(dt=1.0), [0.5] * 40, start={"heading_rad": 0.0}),
    )
    assert coarse[-1][-1]["time_s"] == fine[-1][-1]["time_s"] == 40.0
    assert headings(coarse)[-1] == pytest.approx(headings(fine)[-1], rel=1e-4)  # RK4 steps 2 s, 1 s
    plant = load_vehicle("slocum")
    assert make(plant, dt=1.0).plant == replace(plant, dt=1.0)


@pytest.mark.parametrize(
    "options, words",
    [
        ({"vehicle": "slocm"}, "Did you mean 'slocum'"),
        ({"vehicle": "remus100"}, "needs the heading of an underwater glider, such as 'slocum', got 'remus100'"),
        ({"effects": {"effects.ruder.offset": 0.1}}, "Did you mean 'effects.rudder.offset'"),
        ({"effects": {"effects.rudder.offset": 0.1}, "model": Turner()}, "which model= replaces"),
        (
            {"compass_noise": 0.1, "effects": {"effects.sampling.compass.noise": 0.2}},
            "needs one value of effects.sampling.compass.noise, got one by effects= and one by",
        ),
        ({"compass_noise": -1.0}, "compass_noise needs a number of at least 0 in rad"),
        ({"target": float("nan")}, "target needs a number"),
        ({"speed": (0.5, 0.2)}, "speed needs a number of at least 0.5 in m/s"),
        ({"speed": 0.0}, "speed needs a number above 0 in m/s"),
        ({"depths": (1.0, 2.0)}, "has no option 'depths' for slocum. .*speed, compass_noise"),
        ({"target": 100.0}, r"target\['heading_rad'\] needs a value from -6.28 to 6.28 rad"),
        ({"speed": (0.1, 0.2, 0.3)}, "speed needs a number or a pair"),
        ({"vehicle": replace_at(load_vehicle("slocum"), "hull.n_delta", 0.0)}, "does not turn the vehicle"),
        ({"model": Turner(outputs=("r_radps",), states=("r_radps",))}, "heading_rad among its outputs"),
        ({"model": Turner(inputs=("bow_thruster_N",))}, "rudder_rad among its inputs"),
        ({"model": Turner(inputs=("rudder_rad", "piston_m"))}, "an input piston_m"),
        ({"model": Turner(dt=1.0)}, r"dt=1, or fit the model to record.resample\(4\)"),
    ],
)
def test_what_does_not_fit_is_refused(options, words):
    with pytest.raises(ValueError, match=words):
        make(**options)


# ---------------------------------------------------------------------------- models in the vehicle's place


def test_a_model_drives_it_in_place_of_the_plant():
    env = make(model=Turner())
    info = run(env, [0.5] * 10, start={"heading_rad": 0.3})[-1][-1]
    heading = 0.3 + 0.05 * 40.0 * 0.5 * env.plant.hull.rudder_limit
    assert info["state"] == {"heading_rad": pytest.approx(heading)}
    assert info["reading"] == {"heading_rad": pytest.approx(heading), "u_mps": 0.35}


def test_a_model_file_drives_the_environment(tmp_path):
    a, b, c = np.array([[1.0, 4.0], [0.0, 0.9]]), np.array([[0.0], [0.01]]), np.array([[1.0, 0.0]])
    model = StateSpace(a=a, b=b, c=c, inputs=("rudder_rad",), outputs=("heading_rad",), dt=4.0)
    save_model(model, tmp_path / "turn.npz")
    found, expected = (
        [info["reading"]["heading_rad"] for *_, info in run(make(model=m), np.linspace(-0.5, 0.5, 20))]
        for m in (tmp_path / "turn.npz", model)
    )
    assert found == expected
    assert abs(found[-1] - found[0]) > 0.01


@pytest.mark.parametrize("growth", [1e5, np.inf])
def test_a_model_that_diverges_ends_the_run_with_its_reason_and_no_nan(growth):
    env = make(model=Turner(growth=growth), duration=400.0)
    env.reset(seed=0, options={"start": {"heading_rad": 1.0}})
    terminated, count = False, 0
    while not terminated:
        observation, reward, terminated, truncated, info = env.step(np.array([1.0]))
        count += 1
    assert "diverged" in info["reason"]
    assert not truncated
    assert reward == pytest.approx(-1.05 * (100 - count + 1))  # as if all that was left were at its worst
    assert env.observation_space.contains(observation)
    assert np.isfinite([*info["reading"].values(), *info["state"].values()]).all()


def test_a_model_of_the_heading_alone_is_drawn_where_it_is_reckoned_to_be():
    pytest.importorskip("matplotlib")
    env = make(model=Turner(), render_mode="rgb_array", speed=0.5)
    env.reset(seed=0, options={"start": {"heading_rad": 0.0}})
    for _ in range(10):
        env.step([0.0])
    view = env.episodes.kind.view(env.episodes, env._row)
    view.follow(begin=True)
    for _ in range(10):
        env.step([0.0])
        view.follow()
    np.testing.assert_allclose(view.scene().trail[-1], [20.0, 0.0, 0.0], atol=1e-9)


def test_the_vector_environment_takes_any_model_too():
    envs = TaskVectorEnv("GliderHeading", 3, model=Turner(), duration=12.0, autoreset_mode="SameStep")
    _, infos = envs.reset(seed=3, options={"start": {"heading_rad": 0.5}, "target": 1.0})
    assert infos["state"]["heading_rad"].tolist() == [0.5] * 3
    for _ in range(3):
        *_, truncated, infos = envs.step(np.array([[0.5], [0.0], [-0.5]]))
    assert truncated.all()
    change = 0.05 * 12.0 * 0.5 * envs.plant.hull.rudder_limit
    last = infos["final_info"]["state"]["heading_rad"]
    np.testing.assert_allclose(last, [0.5 + change, 0.5, 0.5 - change], rtol=1e-12)
    assert gymnasium.make_vec("auv_gym/GliderHeading-v0", num_envs=2, model=Turner()).unwrapped.num_envs == 2
