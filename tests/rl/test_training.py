"""Small trainings: what they leave, how they go on, and policies without the code that trained them."""

import csv
import json
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from auv_gym.models.files import load_model, save_model
from auv_gym.models.linear import StateSpace
from auv_gym.plant import load_vehicle
from auv_gym.rl import Policy, Training, evaluate, fresh_seeds, train
from auv_gym.rl.agents import make_agent, make_vector_env, policy_network

SMALL = {
    "n_timesteps": 256, "n_envs": 4, "n_steps": 16, "batch_size": 32, "n_epochs": 2, "normalize": True,
    "policy_kwargs": {"net_arch": [8]},
}  # fmt: skip
LINEAR = StateSpace(
    np.array([[0.9, 0.0], [1.0, 1.0]]), np.array([[0.02], [0.0]]), np.eye(2)[1:], ("rudder_rad",), ("heading_rad",), 4.0
)


def small(env="GliderHeading-v0", hyperparameters=None, **settings):
    options = {"duration": 40.0} | settings.pop("options", {})
    training = {"evaluations": 4, "episodes": 2, "seed": 3} | settings
    return Training(env, options=options, hyperparameters=SMALL | (hyperparameters or {}), **training)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    return train(small(), tmp_path_factory.mktemp("policies") / "ppo")


def test_the_folder_says_all(trained):
    folder = trained.folder
    names = {
        "policy.zip",
        "network.npz",
        "settings.json",
        "learning_curve.csv",
        "learning_curve.png",
        "trained_on.toml",
        "scaling.npz",
    }
    assert {path.name for path in folder.iterdir()} == names
    settings = json.loads((folder / "settings.json").read_text())
    assert settings["complete"]
    assert settings["env"] == "auv_gym/GliderHeading-v0"
    assert settings["options"] == {"duration": 40.0}
    assert settings["versions"]["stable-baselines3"] != "none"
    result = settings["result"]
    assert result["steps"] >= SMALL["n_timesteps"]
    assert 0.0 < result["share_of_time_in_env"] < 1.0
    with (folder / "learning_curve.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert float(rows[0]["steps"]) == 0.0
    assert float(rows[-1]["steps"]) == result["steps"]
    assert len(rows) == 5
    assert max(float(row["mean_return"]) for row in rows) == pytest.approx(result["best_mean_return"], rel=1e-9)
    assert load_model(folder / "trained_on.toml").name == "slocum"


def test_a_policy_is_the_best_of_the_curve(trained):
    seeds = fresh_seeds(3, 2, 1)
    found = evaluate(trained.policy, trained.policy.env(), seeds)
    assert found.summary.mean == pytest.approx(trained.result["best_mean_return"], rel=1e-12)


def test_a_policy_acts_as_the_agent_did_and_needs_numpy_only(trained):
    from stable_baselines3 import PPO

    agent = PPO.load(trained.folder / "policy.zip", device="cpu")
    observations = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 5)).astype(np.float32)
    expected, _ = agent.predict(trained.policy.scaling(observations), deterministic=True)
    # single precision, summed in another order
    np.testing.assert_allclose(trained.policy.act(observations), expected, atol=2e-6)
    np.testing.assert_allclose(trained.policy.act(observations[3]), expected[3], atol=2e-6)
    code = (
        "import sys, numpy as np\nfrom auv_gym.rl import Policy\n"
        f"policy = Policy.load({str(trained.folder)!r})\n"
        "observations = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 5)).astype(np.float32)\n"
        "print(policy.act(observations).tobytes().hex())\n"
        "print([m for m in ('torch', 'stable_baselines3', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == [trained.policy.act(observations).tobytes().hex(), "[]"]


def test_a_policy_drives_an_episode(trained):
    env = gymnasium.make("auv_gym/GliderHeading-v0", duration=40.0)
    observation, _ = env.reset(seed=0)
    ended = False
    while not ended:
        action = trained.policy.act(observation)
        assert env.action_space.contains(action)
        observation, _, terminated, truncated, _ = env.step(action)
        ended = terminated or truncated


class Stop(Exception):
    pass


def test_a_stopped_training_goes_on_to_its_end(tmp_path, monkeypatch):
    monkeypatch.setattr("auv_gym.rl.training._SHOWN_EVERY", 0.0)
    out = tmp_path / "policy"

    def stop_at(share):
        def progress(done, words):
            if done > share:
                raise Stop

        return progress

    with pytest.raises(Stop):
        train(small(), out, stop_at(0.6))
    with pytest.raises(ValueError, match="was stopped"):
        Policy.load(out)
    before = json.loads((out / "latest" / "state.json").read_text())
    assert 0 < before["steps"] < SMALL["n_timesteps"]
    trained = train(small(), out)
    assert trained.result["times_resumed"] == 1
    assert trained.result["steps"] >= SMALL["n_timesteps"]
    steps = [row["steps"] for row in trained.curve]
    assert steps == sorted(set(steps))
    assert list(trained.curve[: len(before["curve"])]) == before["curve"]
    assert not (out / "latest").exists()
    again = train(small(), out)  # nothing is left to do
    assert again.result == trained.result


def test_a_checkpoint_holds_all_that_learns(tmp_path):
    from auv_gym.rl.checkpoint import Checkpoint

    agent, _ = make_agent(small())
    agent.learn(64)
    Checkpoint(tmp_path / "latest").write(agent)
    other, _ = make_agent(small(), steps_before=64)
    checkpoint = Checkpoint.read(tmp_path / "latest")
    checkpoint.put_into(other)
    assert other.num_timesteps == agent.num_timesteps
    observations = np.random.default_rng(0).uniform(-1.0, 1.0, (9, 5)).astype(np.float32)
    np.testing.assert_array_equal(policy_network(other).act(observations), policy_network(agent).act(observations))
    mine, other_state = (one.policy.optimizer for one in (agent, other))
    for one, two in zip(mine.state_dict()["state"].values(), other_state.state_dict()["state"].values(), strict=True):
        np.testing.assert_array_equal(one["exp_avg"].numpy(), two["exp_avg"].numpy())


@pytest.mark.parametrize("settings", [{"frames": 3}, {"recurrent": True}, {"frames": 2, "recurrent": True}])
def test_policies_that_remember_act_as_their_agents_did(settings, tmp_path):
    if settings.get("recurrent"):
        pytest.importorskip("sb3_contrib")
    agent, _ = make_agent(small(**settings))
    agent.learn(64)
    policy_network(agent).save(tmp_path)
    (tmp_path / "settings.json").write_text('{"format": "auv-gym policy", "version": 1, "complete": true}')
    policy, envs, normalizer = Policy.load(tmp_path), agent.env, agent.get_vec_normalize_env()
    normalizer.training = False
    observations, acting = envs.reset(), [policy.begin() for _ in range(4)]
    state, starts = None, np.ones(4, bool)
    for _ in range(9):  # of an episode's ten steps
        expected, state = agent.predict(observations, state, starts, deterministic=True)
        found = [act(one) for act, one in zip(acting, normalizer.get_original_obs(), strict=True)]
        np.testing.assert_allclose(found, expected, atol=1e-5)  # single precision, summed in another order
        observations, _, starts, _ = envs.step(expected)
    with pytest.raises(ValueError, match="begin"):
        policy.act(np.zeros(5))


@pytest.mark.slow
def test_policies_that_remember_are_trained_and_judged(tmp_path):
    pytest.importorskip("sb3_contrib")
    for name, settings in (("frames", {"frames": 3}), ("recurrent", {"recurrent": True})):
        trained = train(small(**settings), tmp_path / name)
        again = evaluate(Policy.load(tmp_path / name), trained.policy.env(), fresh_seeds(3, 2, 1))
        assert again.summary.mean == pytest.approx(trained.result["best_mean_return"], rel=1e-12)


def test_the_same_seed_trains_the_same_policy(tmp_path):
    one, two, other = (train(small(seed=seed), tmp_path / name) for name, seed in (("a", 5), ("b", 5), ("c", 6)))
    for mine, same in zip(one.policy.weights, two.policy.weights, strict=True):
        np.testing.assert_array_equal(mine, same)
    assert not np.array_equal(one.policy.weights[0], other.policy.weights[0])


@pytest.mark.parametrize("env", ["GliderHeading-v0", "Heading-v0"])
def test_a_model_in_place_of_the_vehicle(env, tmp_path):
    dt = 4.0 if env.startswith("Glider") else 0.1
    a = np.array([[0.5, 0.0], [dt, 1.0]])
    more = (
        []
        if env.startswith("Glider")
        else ["v_mps", "r_radps", "roll_rad", "u_mps", "depth_m", "pitch_rad", "w_mps", "q_radps"]
    )
    model = StateSpace(
        np.block([[a, np.zeros((2, len(more)))], [np.zeros((len(more), 2)), 0.9 * np.eye(len(more))]]),
        np.vstack([[[0.02], [0.0]], np.zeros((len(more), 1))]),
        np.eye(2 + len(more))[1:],
        ("rudder_rad",),
        ("heading_rad", *more),
        dt,
    )
    path = tmp_path / "surrogate.npz"
    save_model(model, path)
    options = {"duration": 10.0 * dt}
    trained = train(small(env=env, on=path, options=options), tmp_path / "policy")
    assert trained.policy.settings["on"] == "surrogate.npz"
    np.testing.assert_array_equal(load_model(tmp_path / "policy" / "trained_on.npz").a, model.a)
    for on in ("true", path):
        assert evaluate(trained.policy, trained.policy.env(on), [0, 1]).steps.tolist() == [10, 10]
    by_model = trained.policy.env(path).unwrapped
    assert isinstance(by_model.model, StateSpace)


def test_a_vehicle_of_ones_own_lies_beside_the_policy(tmp_path):
    from dataclasses import replace

    mine = replace(load_vehicle("slocum"), name="mine")
    trained = train(small(options={"vehicle": mine, "effects": {"effects.rudder.offset": 0.1}}), tmp_path / "policy")
    env = trained.policy.env()
    assert env.unwrapped.plant.name == "mine"
    assert env.unwrapped.model.effects.rudder.offset == 0.1
    assert trained.policy.env(effects={"effects.rudder.offset": 0.0}).unwrapped.model.effects.rudder.offset == 0.0


def test_single_environments_do_what_the_dummy_of_stable_baselines_does():
    from stable_baselines3.common.vec_env import DummyVecEnv

    from auv_gym.envs.stable_baselines import SingleEnvs

    def one():
        return gymnasium.make("auv_gym/Depth-v0", duration=0.5)

    dummy, ours = DummyVecEnv([one] * 2), SingleEnvs([one(), one()])
    dummy.seed(4), ours.seed(4)
    np.testing.assert_array_equal(dummy.reset(), ours.reset())
    draws = np.random.default_rng(0)
    for _ in range(12):
        actions = draws.uniform(-1.0, 1.0, (2, 1)).astype(np.float32)
        expected, found = dummy.step(actions), ours.step(actions)
        for mine, theirs in zip(found[:3], expected[:3], strict=True):
            np.testing.assert_array_equal(mine, theirs)
        for mine, theirs in zip(found[3], expected[3], strict=True):
            assert mine["TimeLimit.truncated"] == theirs["TimeLimit.truncated"]
            np.testing.assert_array_equal(mine.get("terminal_observation"), theirs.get("terminal_observation"))
    assert [plant.name for plant in ours.get_attr("plant")] == ["remus100"] * 2
    assert ours.env_is_wrapped(gymnasium.wrappers.TimeLimit) == [False, False]
    ours.close()


def test_native_environments_are_taken_where_there_are_any():
    from auv_gym.envs.stable_baselines import SingleEnvs, StableBaselinesVecEnv

    assert isinstance(make_vector_env("Depth", 2), StableBaselinesVecEnv)
    assert isinstance(make_vector_env("GliderHeading", 2, LINEAR), StableBaselinesVecEnv)
    assert isinstance(make_vector_env("Pendulum-v1", 2), SingleEnvs)


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"env": "Depht-v0"}, "No environment 'Depht-v0'. Did you mean|Ours are"),
        ({"env": "GliderHeading-v0", "seed": -1}, "seed needs"),
        ({"env": "GliderHeading-v0", "steps": 0}, "steps needs"),
        ({"env": "GliderHeading-v0", "envs": 1.5}, "envs needs"),
        ({"env": "GliderHeading-v0", "frames": 0}, "frames needs"),
        ({"env": "GliderHeading-v0", "options": {"model": "x"}}, "give it as `on`"),
        ({"env": "GliderHeading-v0", "hyperparameters": {"n_timesteps": 5, "lr": 1}}, "unknown key lr"),
    ],
)
def test_bad_settings_are_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        Training(**settings)


def test_options_of_the_hyperparameters_are_those_of_the_environment():
    given = {"env_kwargs": {"compass_noise": 0.01, "dt": 2.0}, "train_env_kwargs": {"duration": 20.0}}
    training = Training("GliderHeading-v0", hyperparameters=SMALL | given, options={"compass_noise": 0.02})
    assert training.options == {"compass_noise": 0.02, "dt": 2.0}
    assert training.learning_options == {"compass_noise": 0.02, "dt": 2.0, "duration": 20.0}


def test_what_cannot_be_trained_is_said_before_anything_is_written(tmp_path):
    for settings, words in (
        ({"options": {"vehicle": "remus100"}}, "heading of an underwater glider"),
        ({"on": tmp_path / "none.npz"}, "There is no file"),
        ({"options": {"durations": 3.0}}, "Did you mean 'duration'"),
        ({"hyperparameters": {"policy_kwargs": {"n_critics": 3}}}, "unknown key policy_kwargs.n_critics"),
    ):
        with pytest.raises(ValueError, match=words):
            train(small(**settings), tmp_path / "policy")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("x")
    with pytest.raises(ValueError, match="holds other files"):
        train(small(), tmp_path / "full")


def test_another_training_in_the_same_folder_is_refused(trained):
    with pytest.raises(ValueError, match=r"holds another training \(seed 3, now 4\)"):
        train(small(seed=4), trained.folder)


def test_without_sb3_contrib_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    with pytest.raises(ImportError, match=r"pip install '\.\[rl\]'"):
        make_agent(small(recurrent=True))


def test_without_stable_baselines_the_error_names_the_extra(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(ImportError, match=r"pip install '\.\[rl\]'"):
        train(small(), tmp_path / "policy")


def test_few_steps_are_said_to_be_few():
    assert small().remarks == ()
    rounded, unchanged = small(
        steps=10, hyperparameters={"imitate": {"controller": "pid", "episodes": 2, "value_steps": 64}}
    ).remarks
    assert "training takes 64 steps instead of 10" in rounded
    assert "The policy will be the imitated controller (pid) unchanged: in the first 64 steps" in unchanged
