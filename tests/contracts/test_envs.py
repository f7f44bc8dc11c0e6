"""What every registered environment promises."""

import subprocess
import sys
import warnings
from functools import reduce
from operator import add

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import auv_gym.envs  # noqa: F401  (registers)
from auv_gym.envs.registration import ENVIRONMENTS, register_envs

pytestmark = pytest.mark.parametrize("name", list(ENVIRONMENTS))


def rollout(env, seed, steps=40):
    """Observations, rewards and infos of a run with actions drawn from a seed of their own."""
    actions = np.random.default_rng(99)
    observation, info = env.reset(seed=seed)
    observations, rewards, infos = [observation], [], [info]
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(actions.uniform(-1.0, 1.0, env.action_space.shape))
        observations.append(observation)
        rewards.append(reward)
        infos.append(info)
        if terminated or truncated:
            break
    return np.array(observations), np.array(rewards), infos


def test_gymnasium_finds_no_fault(name, monkeypatch):
    monkeypatch.setattr("auv_gym.rendering.Window.show", lambda window, picture: None)  # no display is needed
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(name)
        check_env(env.unwrapped)
    assert env.spec.id == name


def test_same_seed_same_rollout(name):
    one, two = gymnasium.make(name), gymnasium.make(name)
    first, again, other = rollout(one, 5), rollout(two, 5), rollout(two, 6)
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], again[1])
    assert first[2] == again[2]
    assert not np.array_equal(first[0], other[0])


def test_same_seed_same_rollout_in_another_process(name):
    code = (
        "import gymnasium, auv_gym.envs, numpy as np\n"
        f"env = gymnasium.make({name!r})\n"
        "env.reset(seed=5)\n"
        "draws = np.random.default_rng(1)\n"
        "print([env.step(draws.uniform(-1, 1, env.action_space.shape))[0].tobytes().hex() for _ in range(5)])"
    )
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    env = gymnasium.make(name)
    env.reset(seed=5)
    draws = np.random.default_rng(1)
    here = [env.step(draws.uniform(-1, 1, env.action_space.shape))[0].tobytes().hex() for _ in range(5)]
    assert there == str(here)


def test_observations_stay_in_their_space(name):
    env = gymnasium.make(name)
    observations, rewards, _ = rollout(env, 1, steps=10_000)
    assert all(env.observation_space.contains(o) for o in observations)
    assert np.isfinite(rewards).all()


def test_reward_is_the_sum_of_its_terms(name):
    _, rewards, infos = rollout(gymnasium.make(name), 2)
    terms = [list(info["reward_terms"].values()) for info in infos[1:]]
    assert rewards.tolist() == [reduce(add, values) for values in terms]  # from Python 3.12 on, sum() rounds once only


def test_unknown_options_of_reset_are_refused(name):
    with pytest.raises(ValueError, match="reset has the options"):
        gymnasium.make(name).reset(options={"headng": 1.0})


def test_registering_again_changes_nothing(name):
    before = gymnasium.registry[name]
    register_envs()
    assert gymnasium.registry[name] is before


def test_vector_environments_run_it(name):
    envs = gymnasium.make_vec(name, num_envs=3, vectorization_mode="sync")
    observations, _ = envs.reset(seed=3)
    observations, rewards, *_ = envs.step(np.zeros((3, *envs.single_action_space.shape), np.float32))
    assert observations.shape == (3, *envs.single_observation_space.shape)
    assert np.isfinite(rewards).all()


def test_the_native_vector_environment_is_the_single_one_many_times(name):
    if "vector_entry_point" not in ENVIRONMENTS[name]:
        assert gymnasium.spec(name).vector_entry_point is None
        return
    envs = gymnasium.make_vec(name, num_envs=2)
    assert isinstance(envs.metadata["autoreset_mode"], gymnasium.vector.AutoresetMode)
    observations, _ = envs.reset(seed=5)
    for i in range(2):
        env = gymnasium.make(name)
        assert env.observation_space == envs.single_observation_space
        assert env.action_space == envs.single_action_space
        np.testing.assert_array_equal(observations[i], env.reset(seed=5 + i)[0])


def test_a_step_after_the_end_asks_for_a_reset(name):
    env = gymnasium.make(name, duration=0.4).unwrapped
    env.reset(seed=0)
    ended = False
    while not ended:
        _, _, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape))
        ended = terminated or truncated
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        env.step(np.zeros(env.action_space.shape))
