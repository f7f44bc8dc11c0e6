"""A policy that begins from what a controller does."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from auv_gym.rl import Training, evaluate, fresh_seeds, train
from auv_gym.rl.agents import make_agent, policy_network
from auv_gym.rl.evaluation import Summary
from auv_gym.rl.hyperparameters import Imitation, checked
from auv_gym.rl.imitation import Demonstrations, demonstrate, follow, returns_to_come
from auv_gym.rl.settings import make_env
from controllers.piloting import pilot_for

SMALL = {
    "n_timesteps": 128, "n_envs": 2, "n_steps": 32, "batch_size": 64, "n_epochs": 1, "normalize": True,
    "policy_kwargs": {"net_arch": [32, 32]},
}  # fmt: skip
FOLLOW = {"controller": "pid", "episodes": 4, "passes": 100, "value_steps": 128}
BRIEF = FOLLOW | {"episodes": 1, "passes": 2}


@pytest.mark.slow
def test_a_policy_that_followed_a_controller_is_nearly_as_good(tmp_path):
    training = Training("GliderHeading-v0", hyperparameters=SMALL | {"imitate": FOLLOW}, evaluations=1, episodes=2)
    followed = train(training, tmp_path / "followed").policy
    alone = train(Training("GliderHeading-v0", hyperparameters=SMALL, evaluations=1, episodes=2), tmp_path / "alone")
    env, seeds = followed.env(), fresh_seeds(0, 5)
    pid, policy, other = (
        evaluate(agent, env, seeds).summary.mean for agent in (pilot_for(env, "pid"), followed, alone.policy)
    )
    assert other < 2.0 * pid  # returns are negative
    assert policy > 1.15 * pid
    assert followed.settings["hyperparameters"]["imitate"] == FOLLOW


@pytest.mark.slow
def test_values_are_learnt_before_actions(tmp_path):
    held, moved = (
        train(Training("GliderHeading-v0", hyperparameters=SMALL | {"imitate": BRIEF | {"value_steps": steps}},
                       evaluations=2, episodes=2), tmp_path / str(steps))
        for steps in (128, 64)
    )  # fmt: skip
    first, *later = (row["mean_return"] for row in held.curve)
    assert later == pytest.approx([first, first], rel=1e-7)  # with the same actions, scaled alike
    assert [row["mean_return"] for row in moved.curve[:2]] == pytest.approx([first, first], rel=1e-7)
    assert abs(moved.curve[2]["mean_return"] - first) > 1e-3


def test_what_was_stopped_goes_on_without_being_shown_again(tmp_path, monkeypatch):
    training = Training("GliderHeading-v0", hyperparameters=SMALL | {"imitate": BRIEF}, evaluations=2, episodes=2)

    monkeypatch.setattr("auv_gym.rl.training._SHOWN_EVERY", 0.0)

    def stop(share, words):
        if share > 0.6:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(training, tmp_path, stop)
    monkeypatch.setattr("auv_gym.rl.imitation.imitate", None)
    trained = train(training, tmp_path)
    assert trained.result["times_resumed"] == 1
    returns = [row["mean_return"] for row in trained.curve]
    assert returns == pytest.approx(returns[:1] * 3, rel=1e-7)


def test_gains_alone_follow_a_linear_controller_exactly():
    gains_alone = SMALL | {"policy_kwargs": {"net_arch": {"pi": [], "vf": [8]}}}
    agent, _ = make_agent(Training("GliderHeading-v0", hyperparameters=gains_alone))
    observations = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 5)).astype(np.float32)
    actions = observations @ [[0.3], [-0.2], [0.1], [0.0], [0.2]] + 0.05
    shown = Demonstrations(observations, actions, np.ones(40), (40,), (False,))
    follow(agent, shown, 1, np.random.default_rng(0))
    np.testing.assert_allclose(policy_network(agent).act(observations), actions, atol=1e-5)  # single precision


def test_offsets_move_the_vehicle_and_not_what_is_to_be_learnt():
    env = make_env("GliderHeading-v0", duration=200.0)
    pilot, rng = pilot_for(env, "pid"), np.random.default_rng(0)
    calm = demonstrate(pilot, env, Imitation(controller="pid", noise=0.0), [4], rng, lambda share: None)
    moved = demonstrate(pilot, env, Imitation(controller="pid", noise=1.0, hold=3), [4], rng, lambda share: None)
    assert calm.lengths == moved.lengths == (50,)
    np.testing.assert_array_equal(calm.actions[0], moved.actions[0])
    assert np.abs(calm.observations - moved.observations).max() > 0.05
    assert calm.rewards.sum() == pytest.approx(evaluate(pilot, env, [4]).returns[0])
    assert np.abs(moved.actions).max() <= 1.0


def test_returns_to_come_end_with_the_episode_or_are_not_known():
    shown = Demonstrations(np.zeros((7, 1)), np.zeros((7, 1)), np.ones(7), (3, 4), (True, False))
    found = returns_to_come(shown, 0.5)
    np.testing.assert_allclose(found[:3], [1.75, 1.5, 1.0])
    assert found[3] == 1.875
    assert np.isnan(found[4:]).all()


def test_a_controller_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"imitate.controller.*'s_plane'"):
        checked({"n_timesteps": 10, "imitate": {"controller": "lqr"}})
    with pytest.raises(ValueError, match="Did you mean 'episodes'"):
        checked({"n_timesteps": 10, "imitate": {"controller": "pid", "episode": 3}})
    path = Training("Path-v0", hyperparameters=SMALL | {"imitate": FOLLOW})
    with pytest.raises(ValueError, match="No controller follows"):
        train(path, tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_noise_with_which_station_keeping_is_learnt_is_small_beside_what_pid_commands():
    """With noise as large as the commands, PPO learns gains that suit the noise and lose to PID without it."""
    training = Training("StationKeeping-v0")
    env, chosen = make_env(training.env, **training.options), training.chosen
    commands = []
    for seed in fresh_seeds(0, 4):
        observation, info = env.reset(seed=seed)
        act, ended = pilot_for(env, "pid").begin(env), False
        while not ended:
            commands.append(act(observation, info))
            observation, _, terminated, truncated, info = env.step(commands[-1])
            ended = terminated or truncated
    assert chosen.policy_kwargs.log_std_init is not None
    noise = np.exp(chosen.policy_kwargs.log_std_init) * np.max(chosen.action_scale)
    assert noise < 0.15 * np.sqrt(np.mean(np.square(commands), axis=0)).max()


@pytest.mark.slow
def test_a_policy_keeps_station_better_than_the_pid_that_it_begins_from(tmp_path):
    policy = train(Training("StationKeeping-v0", seed=2), tmp_path / "keeper").policy
    env, seeds = policy.env(), fresh_seeds(4002, 40)
    found, pid = (evaluate(agent, env, seeds) for agent in (policy, pilot_for(env, "pid")))
    assert found.cut == 0
    assert Summary.of(found.returns - pid.returns).mean_interval[0] > 0.0
