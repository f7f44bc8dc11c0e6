import sys

import gymnasium
import numpy as np
import pytest

import auv_gym.envs  # noqa: F401  (registers)
from auv_gym.envs.registration import ENVIRONMENTS


def test_without_stable_baselines_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.vec_env", None)
    monkeypatch.delitem(sys.modules, "auv_gym.envs.stable_baselines", raising=False)
    with pytest.raises(ImportError, match=r"pip install '\.\[rl\]'"):
        import auv_gym.envs.stable_baselines  # noqa: F401


@pytest.fixture
def adapt():
    """The adapter class; the test is skipped without stable-baselines3."""
    pytest.importorskip("stable_baselines3")
    from auv_gym.envs.stable_baselines import StableBaselinesVecEnv

    return StableBaselinesVecEnv


def make(num_envs=3, name="Depth", **options):
    return gymnasium.make_vec(f"auv_gym/{name}-v0", num_envs=num_envs, autoreset_mode="SameStep", **options)


@pytest.mark.parametrize("name", list(ENVIRONMENTS))
@pytest.mark.filterwarnings("ignore::UserWarning")  # advice on spaces and sizes
def test_stable_baselines_finds_no_fault(name):
    pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.env_checker import check_env

    env = gymnasium.make(name)
    check_env(env.unwrapped, skip_render_check=True)
    assert env.unwrapped.np_random is not None


@pytest.mark.slow
def test_it_does_what_the_dummy_of_stable_baselines_does(adapt):
    from stable_baselines3.common.vec_env import DummyVecEnv

    options = {"duration": 1.0, "randomise": {"effects.current.north": (-0.3, 0.3)}}
    dummy = DummyVecEnv([lambda: gymnasium.make("auv_gym/Depth-v0", **options) for _ in range(3)])
    ours = adapt(make(**options), step_infos=True)
    dummy.seed(4), ours.seed(4)
    np.testing.assert_array_equal(dummy.reset(), ours.reset())
    draws = np.random.default_rng(0)
    for _ in range(25):
        actions = draws.uniform(-1.0, 1.0, (3, 1)).astype(np.float32)
        expected, found = dummy.step(actions), ours.step(actions)
        for one, other in zip(expected[:3], found[:3], strict=True):
            np.testing.assert_array_equal(one, other)
            assert one.dtype == other.dtype
        for one, other in zip(expected[3], found[3], strict=True):
            assert one.keys() == other.keys()
            assert one["TimeLimit.truncated"] == other["TimeLimit.truncated"]
            assert one["state"] == other["state"]
            np.testing.assert_array_equal(one.get("terminal_observation"), other.get("terminal_observation"))
    assert [info["randomised"] for info in dummy.reset_infos] != [{}] * 3


def test_a_terminated_episode_is_not_one_out_of_time(adapt):
    env = adapt(make(num_envs=2))
    env.set_options([{"start": {"depth_m": 0.05, "pitch_rad": 0.5}}, {}])
    env.seed(0)
    env.reset()
    for _ in range(30):
        _, _, ended, infos = env.step(np.zeros((2, 1), np.float32))
        if ended[0]:
            break
    assert infos[0]["reason"].startswith("broached")
    assert infos[0]["TimeLimit.truncated"] is False
    assert env.observation_space.contains(infos[0]["terminal_observation"])
    assert not ended[1]
    assert infos[1] == {"TimeLimit.truncated": False}


def test_another_autoreset_mode_is_refused(adapt):
    with pytest.raises(ValueError, match="autoreset_mode='SameStep'"):
        adapt(gymnasium.make_vec("auv_gym/Depth-v0", num_envs=2))


def test_attributes_are_those_of_the_whole(adapt):
    env = adapt(make())
    assert env.get_attr("plant", [0, 2]) == [env.envs.plant] * 2
    assert env.env_is_wrapped(gymnasium.Wrapper) == [False] * 3
    env.set_attr("label", "x")
    assert env.envs.label == "x"
    assert not env.has_attr("nothing")
    with pytest.raises(ValueError, match="all of them only"):
        env.set_attr("label", "y", indices=[0])
    with pytest.raises(ValueError, match="one object"):
        env.env_method("render")


def test_ppo_learns_on_it(adapt):
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor

    env = VecMonitor(adapt(make(num_envs=4, duration=2.0)))
    agent = PPO("MlpPolicy", env, n_steps=32, batch_size=64, n_epochs=2, seed=1, device="cpu").learn(400)
    assert agent.num_timesteps >= 400
    episodes = list(agent.ep_info_buffer)
    assert len(episodes) >= 16
    assert {episode["l"] for episode in episodes} == {20}
    action, _ = agent.predict(env.reset(), deterministic=True)
    assert action.shape == (4, 1)
