import sys

import pytest

from auv_gym.envs.registration import ENVIRONMENTS
from auv_gym.rl.hyperparameters import checked, hyperparameters_for

pytest.importorskip("yaml")


@pytest.mark.parametrize("env", list(ENVIRONMENTS))
def test_every_environment_has_them(env):
    found = hyperparameters_for(env)
    assert found == hyperparameters_for(env.removeprefix("auv_gym/"))
    assert found.n_timesteps >= 10_000
    assert "n_timesteps" not in found.agent_settings


def test_numbers_are_read_as_rl_zoo_writes_them(tmp_path):
    file = tmp_path / "own.yml"
    file.write_text(
        "Depth-v0:\n  n_timesteps: !!float 1e6\n  learning_rate: lin_3e-4\n  clip_range: 2e-1\n  gamma: 0.98\n"
        "  normalize: {norm_reward: false}\n  policy_kwargs: {net_arch: [32, 16], activation_fn: relu}\n"
    )
    found = hyperparameters_for("Depth-v0", file)
    assert found.n_timesteps == 1_000_000
    assert (found.learning_rate, found.clip_range) == ("lin_3e-4", 0.2)
    assert found.normalizer.norm_obs
    assert not found.normalizer.norm_reward
    assert found.policy_kwargs.net_arch == [32, 16]
    assert found.agent_settings == {"gamma": 0.98}


@pytest.mark.parametrize(
    "values, words",
    [
        ({"n_timesteps": 10, "n_step": 5}, "unknown key n_step. Did you mean 'n_steps'"),
        ({"n_timesteps": 10, "tau": 0.1}, "unknown key tau"),
        ({"n_timesteps": 10, "policy_kwargs": {"net_arc": [3]}}, "Did you mean 'net_arch'"),
        ({"n_timesteps": 10, "policy_kwargs": "dict(net_arch=[64])"}, "policy_kwargs"),
        ({"n_timesteps": 10, "normalize": {"norm": True}}, "unknown key normalize"),
        ({}, "n_timesteps is needed"),
        ({"n_timesteps": 10, "policy": "MlpLstmPolicy", "imitate": {"controller": "pid"}}, "cannot begin from"),
        ({"n_timesteps": 10, "policy_kwargs": {"lstm_hidden_size": 8}}, "needs policy MlpLstmPolicy"),
        ({"n_timesteps": 0}, "n_timesteps: .* got 0"),
        ({"n_timesteps": 10, "learning_rate": "log_3e-4"}, "lin_3e-4"),
        ({"n_timesteps": 10, "learning_rate": "lin_0"}, "above 0"),
        ({"n_timesteps": 10, "gamma": 1.5}, "gamma"),
        ({"n_timesteps": 10, "n_envs": 1, "n_steps": 1}, "2 or more"),
        ([1], "keys and values"),
    ],
)
def test_what_is_wrong_is_said_by_name(values, words):
    with pytest.raises(ValueError, match=words):
        checked(values)


@pytest.mark.parametrize(
    "text, words",
    [
        ("Depth-v0: [", "no YAML"),
        ("- 1", "environments as keys"),
        ("Heading-v0: {n_timesteps: 5}", "It has Heading-v0"),
    ],
)
def test_a_file_that_says_nothing_is_refused(tmp_path, text, words):
    file = tmp_path / "own.yml"
    file.write_text(text)
    with pytest.raises(ValueError, match=words):
        hyperparameters_for("Depth-v0", file)


def test_a_missing_file_and_a_missing_package(tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="Cannot read"):
        hyperparameters_for("Depth-v0", tmp_path / "none.yml")
    monkeypatch.setitem(sys.modules, "yaml", None)
    with pytest.raises(ImportError, match=r"pip install '\.\[rl\]'"):
        hyperparameters_for("Depth-v0")
