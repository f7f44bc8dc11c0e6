import gymnasium
import numpy as np
import pytest
from scipy import stats

import auv_gym.envs  # noqa: F401  (registers)
from auv_gym.rl import Policy, Summary, evaluate, fresh_seeds, returns
from auv_gym.rl.pictures import draw_episode
from auv_gym.rl.policy import Scaling
from controllers.piloting import pilot_for
from identification.experiments.driving import drive

NAME = "auv_gym/GliderHeading-v0"


def policy_of(weight, **fields):
    return Policy((np.array([weight], dtype=np.float32),), (np.zeros(1, np.float32),), **fields)


STEERS = policy_of([-2.0, 0.0, 0.5, 0.0, 0.0])


def test_returns_are_sums_of_rewards_and_the_same_for_the_same_seeds():
    env, seeds = gymnasium.make(NAME, duration=80.0), fresh_seeds(1, 4)
    found = evaluate(STEERS, env, seeds)
    observation, _ = env.reset(seed=seeds[2])
    total, ended = 0.0, False
    while not ended:
        observation, reward, terminated, truncated, _ = env.step(STEERS.act(observation))
        total, ended = total + reward, terminated or truncated
    assert found.returns[2] == total
    assert found.steps.tolist() == [20] * 4
    assert found.cut == 0
    np.testing.assert_array_equal(returns(STEERS, env, seeds), found.returns)
    assert len(set(found.returns)) == 4


def test_episodes_that_are_cut_are_counted_with_the_reason():
    env = gymnasium.make("auv_gym/Depth-v0", duration=40.0)
    dives = Policy((np.zeros((1, 6), np.float32),), (np.ones(1, np.float32),))
    rises = Policy((np.zeros((1, 6), np.float32),), (-np.ones(1, np.float32),))
    found = [evaluate(one, env, fresh_seeds(0, 2)) for one in (dives, rises)]
    reasons = [reason for one in found for reason in one.reasons if reason]
    assert reasons
    assert sum(one.cut for one in found) == len(reasons)


def test_seeds_of_different_purposes_differ():
    seeds = [set(fresh_seeds(seed, 50, purpose)) for seed in range(3) for purpose in range(3)]
    assert len(set.union(*seeds)) == 450
    assert fresh_seeds(1, 3) == fresh_seeds(1, 5)[:3]
    for bad in (-1, 1.5, True):
        with pytest.raises(ValueError, match="whole number"):
            fresh_seeds(bad, 3)
    with pytest.raises(ValueError, match="from 1 on"):
        fresh_seeds(1, 0)


def test_the_summary_is_that_of_scipy():
    x = np.random.default_rng(0).gamma(2.0, size=40)
    found = Summary.of(x)
    assert found.mean == pytest.approx(x.mean(), rel=1e-12)
    assert found.iqm == pytest.approx(stats.trim_mean(x, 0.25), rel=1e-12)
    other = stats.bootstrap((x,), np.mean, method="percentile", n_resamples=9999, rng=np.random.default_rng(1))
    # two bootstraps of ten thousand differ by a hundredth or two of the interval
    width = other.confidence_interval.high - other.confidence_interval.low
    np.testing.assert_allclose(found.mean_interval, other.confidence_interval, atol=0.05 * width)
    assert found.iqm_interval[0] < found.iqm < found.iqm_interval[1]
    # of 6 values the middle half is 3: the 2 in the middle and half of each neighbour
    assert Summary.of([0.0, 1.0, 2.0, 3.0, 5.0, 100.0]).iqm == pytest.approx((0.5 * 1.0 + 2.0 + 3.0 + 0.5 * 5.0) / 3.0)


def test_intervals_hold_the_mean_as_often_as_they_say():
    draws = np.random.default_rng(2)
    held = sum(low <= 0.0 <= high for low, high in (Summary.of(draws.normal(size=50)).mean_interval for _ in range(60)))
    assert 51 <= held <= 60  # 95 % of 60 is 57, and 50 or fewer would come once in ten thousand times


@pytest.mark.parametrize("values", [[1.0], [1.0, np.nan], [[1.0, 2.0]]])
def test_what_has_no_summary_is_refused(values):
    with pytest.raises(ValueError, match="2 finite returns"):
        Summary.of(values)


def test_a_pilot_gets_what_its_controller_gets_when_it_drives():
    for name in (NAME, "auv_gym/FloatDepth-v0"):
        env = gymnasium.make(name, duration=60.0)
        pilot = pilot_for(env, "pid")
        total = evaluate(pilot, env, [11]).returns[0]
        record = drive(env, pilot.controller, seed=11).record
        command = "rudder_rad" if name == NAME else "piston_m"
        _, info = env.reset(seed=11)
        act, again, ended = pilot.begin(env), 0.0, False
        commands = []
        while not ended:
            _, reward, terminated, truncated, info = env.step(act(None, info))
            again, ended = again + reward, terminated or truncated
            commands.append(info["command"][command])
        assert again == total
        np.testing.assert_array_equal(commands, record[command][:-1])


@pytest.mark.parametrize(
    "name, kind, words",
    [
        (NAME, "lqr", "No autopilot of kind 'lqr'"),
        (NAME, "s-plane", "six degrees of freedom"),
        ("auv_gym/Path-v0", "pid", "No controller follows"),
    ],
)
def test_controllers_that_are_not_there_are_said(name, kind, words):
    with pytest.raises(ValueError, match=words):
        pilot_for(gymnasium.make(name), kind)


def test_activations_and_scaling():
    x = np.array([0.5, -2.0], dtype=np.float32)
    two = np.eye(2, dtype=np.float32)
    for name, expected in (("relu", [0.5, 0.0]), ("elu", [0.5, np.expm1(-2.0)]), ("tanh", np.tanh(x))):
        found = Policy((two, two), (np.zeros(2), np.zeros(2)), activation=name).act(x)
        np.testing.assert_allclose(found, np.clip(expected, -1.0, 1.0), rtol=1e-6)
    scaled = Policy((two,), (np.zeros(2),), scaling=Scaling(np.array([0.5, 0.0]), np.array([1.0, 16.0]))).act(x)
    np.testing.assert_allclose(scaled, [0.0, -0.5], atol=1e-6)
    with pytest.raises(ValueError, match="observations of 2 numbers"):
        Policy((two,), (np.zeros(2),)).act(np.zeros(3))


@pytest.mark.parametrize("suffix, frames", [(".png", 1), (".gif", 6)])
def test_an_episode_is_drawn(tmp_path, suffix, frames):
    image = pytest.importorskip("PIL.Image")
    env = gymnasium.make(NAME, duration=20.0, render_mode="rgb_array")
    path = tmp_path / f"episode{suffix}"
    times = draw_episode(STEERS, env, 0, path)
    assert times == [0.0, 4.0, 8.0, 12.0, 16.0, 20.0]
    with image.open(path) as picture:
        assert getattr(picture, "n_frames", 1) == frames
        assert np.ptp(np.asarray(picture.convert("L"))) > 100
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_pictures_that_cannot_be_drawn_are_refused(tmp_path):
    env = gymnasium.make(NAME, duration=20.0)
    with pytest.raises(ValueError, match=r"ends in \.png or \.gif"):
        draw_episode(STEERS, env, 0, tmp_path / "episode.jpg")
    with pytest.raises(ValueError, match=r"make .* first"):
        draw_episode(STEERS, env, 0, tmp_path / "none" / "episode.png")
    with pytest.raises(ValueError, match="render_mode='rgb_array'"):
        draw_episode(STEERS, env, 0, tmp_path / "episode.png")
