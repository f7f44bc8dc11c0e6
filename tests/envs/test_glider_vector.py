"""The vector environment of gliders is the single one many times, to the last bit."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import auv_gym.envs  # noqa: F401  (registers)
from auv_gym.models.linear import StateSpace
from auv_gym.plant import load_vehicle
from tests.envs.test_glider_heading import Turner

NAME = "auv_gym/GliderHeading-v0"
LINEAR = StateSpace(
    np.array([[0.9, 0.0], [1.0, 1.0]]), np.array([[0.02], [0.0]]), np.eye(2)[1:], ("rudder_rad",), ("heading_rad",), 4.0
)


def pair(mode, options, num_envs=4):
    ours = gymnasium.make_vec(NAME, num_envs=num_envs, autoreset_mode=mode, **options)
    theirs = gymnasium.make_vec(
        NAME,
        num_envs=num_envs,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": AutoresetMode(mode)},
        **options,
    )
    return ours, theirs


def assert_same(ours, theirs):
    """Infos are the same where the masks say that they are there."""
    assert ours.keys() == theirs.keys()
    for name, there in theirs.items():
        if name.startswith("_"):
            assert ours[name][there].all()  # of final infos, ours has also those of environments that go on
        elif isinstance(there, dict):
            assert_same(ours[name], there)
        else:
            mask = theirs.get(f"_{name}", np.ones(len(there), dtype=bool))
            for one, other, held in zip(ours[name], there, mask, strict=True):
                if held:
                    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
@pytest.mark.parametrize(
    "options",
    [
        {"duration": 100.0, "compass_noise": 0.02, "speed": (0.2, 0.4)},
        {"vehicle": "ganeshblue", "duration": 150.0, "effects": {"effects.rudder.offset": 0.05}, "target": 0.3},
        {"duration": 100.0, "model": LINEAR},
        {"duration": 100.0, "model": Turner(growth=20.0)},  # leaves the headings that can be told
    ],
    ids=["noise", "effects", "linear model", "diverging"],
)
def test_it_is_the_single_one_many_times(mode, options):
    ours, theirs = pair(mode, options)
    first, again = ours.reset(seed=7), theirs.reset(seed=7)
    np.testing.assert_array_equal(first[0], again[0])
    assert_same(first[1], again[1])
    draws = np.random.default_rng(1)
    terminations = 0
    for _ in range(120):
        actions = draws.uniform(-1.2, 1.2, (4, 1)).astype(np.float32)
        mine, other = ours.step(actions), theirs.step(actions)
        for one, two in zip(mine[:4], other[:4], strict=True):
            np.testing.assert_array_equal(one, two)
        assert_same(mine[4], other[4])
        terminations += mine[2].sum()
    assert (terminations > 0) == (isinstance(options.get("model"), Turner))


def test_disabled_waits_for_a_reset_of_those_that_ended():
    envs = gymnasium.make_vec(NAME, num_envs=3, autoreset_mode="Disabled", duration=8.0)
    envs.reset(seed=0)
    still = np.zeros((3, 1))
    envs.step(still)
    assert envs.step(still)[3].all()
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset_mask"):
        envs.step(still)
    _, infos = envs.reset(options={"reset_mask": np.array([True, False, True])})
    np.testing.assert_array_equal(infos["time_s"], [0.0, 8.0, 0.0])
    with pytest.raises(gymnasium.error.ResetNeeded, match="1 environments"):
        envs.step(still)


def test_options_of_reset_count_for_all():
    envs = gymnasium.make_vec(NAME, num_envs=2, vehicle=load_vehicle("slocum"))
    _, infos = envs.reset(seed=[3, 3], options={"heading": 0.5, "target": 1.0})
    np.testing.assert_allclose(infos["reading"]["heading_rad"], 0.5, rtol=1e-12)
    assert infos["target_rad"].tolist() == [1.0, 1.0]
    assert envs.unwrapped.np_random_seed == (3, 3)


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda: gymnasium.make_vec(NAME, num_envs=0), "whole number of environments"),
        (lambda: gymnasium.make_vec(NAME, num_envs=2, render_mode="rgb_array"), "draws nothing"),
        (lambda: gymnasium.make_vec(NAME, num_envs=2).reset(options={"headng": 1.0}), "reset has the options"),
        (lambda: gymnasium.make_vec(NAME, num_envs=2).reset(seed=[1]), "one for each of 2"),
        (lambda: gymnasium.make_vec(NAME, num_envs=2).reset(options={"reset_mask": [True, True]}), "array of 2 bool"),
    ],
)
def test_bad_input_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()


@pytest.mark.parametrize("actions", [np.zeros(2), np.array([[0.0], [np.nan]])])
def test_bad_actions_are_refused(actions):
    envs = gymnasium.make_vec(NAME, num_envs=2)
    with pytest.raises(gymnasium.error.ResetNeeded, match="not begun"):
        envs.step(np.zeros((2, 1)))
    envs.reset(seed=0)
    with pytest.raises(ValueError, match=r"shape \(2, 1\)"):
        envs.step(actions)
