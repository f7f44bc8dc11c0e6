"""`auv-gym train` and `auv-gym evaluate`: a policy learned, stopped, gone on with, and judged beside controllers."""

import json

import numpy as np
import pytest

from auv_gym.cli import main
from auv_gym.models.files import save_model
from auv_gym.models.linear import StateSpace

pytest.importorskip("stable_baselines3")
pytestmark = pytest.mark.usefixtures("wide")

SMALL = """GliderHeading-v0:
  n_timesteps: 256
  n_envs: 4
  n_steps: 16
  batch_size: 32
  n_epochs: 2
  normalize: true
  policy_kwargs: {net_arch: [8]}
"""


@pytest.fixture(scope="module")
def hyperparameters(tmp_path_factory):
    file = tmp_path_factory.mktemp("settings") / "small.yml"
    file.write_text(SMALL)
    return file


def train(out, hyperparameters, *arguments):
    given = ["--env", "GliderHeading-v0", "--out", out, "--hyperparameters", hyperparameters, "--duration", 40]
    return main(["train", *map(str, [*given, *arguments])])


@pytest.fixture(scope="module")
def folder(tmp_path_factory, hyperparameters):
    out = tmp_path_factory.mktemp("policies") / "ppo"
    effects = ["--effect", "effects.rudder.offset=0.02", "--seed", 7]
    assert train(out, hyperparameters, *effects) == 0
    return out


def test_what_was_trained_is_told(folder, hyperparameters, capsys):
    again = ["--effect", "effects.rudder.offset=0.02", "--seed", 7]
    assert train(folder, hyperparameters, *again) == 0  # there is nothing left to do
    said = capsys.readouterr().out
    assert "Learning curve" in said
    assert "steps/s" in said
    settings = json.loads((folder / "settings.json").read_text())
    assert settings["options"] == {"duration": 40.0, "effects": {"effects.rudder.offset": 0.02}}
    assert settings["seed"] == 7
    assert settings["result"]["times_resumed"] == 0


def test_a_policy_is_evaluated_beside_controllers(folder, tmp_path, capsys):
    picture = tmp_path / "strip.png"
    arguments = [str(folder), "--episodes", "5", "--against", "pid, gpc", "--seed", "2"]
    assert main(["evaluate", *arguments, "--picture", str(picture)]) == 0
    said = capsys.readouterr().out
    assert all(words in said for words in ("policy", "pid", "gpc", "interquartile mean", str(picture)))
    assert picture.stat().st_size > 1000
    told = []
    for _ in range(2):
        assert main(["evaluate", *arguments, "--json"]) == 0
        told.append(json.loads(capsys.readouterr().out))
    assert told[0] == told[1]
    agents = told[0]["agents"]
    assert list(agents) == ["policy", "pid", "gpc"]
    assert len(set(map(tuple, (agent["seeds"] for agent in agents.values())))) == 1
    gain = np.mean(np.subtract(agents["policy"]["returns"], agents["pid"]["returns"]))
    assert agents["pid"]["policy_minus_this"]["mean"] == pytest.approx(gain)
    assert main(["evaluate", str(folder), "--episodes", "5", "--seed", "3", "--json"]) == 0
    other = json.loads(capsys.readouterr().out)["agents"]["policy"]
    assert other["returns"] != agents["policy"]["returns"]


def test_trained_on_a_model_and_evaluated_on_the_vehicle(tmp_path, hyperparameters, capsys):
    model = StateSpace(
        np.array([[0.9, 0.0], [1.0, 1.0]]),
        np.array([[-0.02], [0.0]]),
        np.eye(2)[1:],
        ("rudder_rad",),
        ("heading_rad",),
        4.0,
    )
    save_model(model, tmp_path / "surrogate.npz")
    out = tmp_path / "policy"
    assert train(out, hyperparameters, "--on", tmp_path / "surrogate.npz") == 0
    capsys.readouterr()
    found = {}
    for on in ("true", str(out / "trained_on.npz")):
        assert main(["evaluate", str(out), "--on", on, "--episodes", "3", "--json"]) == 0
        found[on] = json.loads(capsys.readouterr().out)["agents"]["policy"]["returns"]
    one, other = found.values()
    assert one != other


def test_ctrl_c_stops_and_the_same_command_goes_on(tmp_path, hyperparameters, capsys, monkeypatch):
    from auv_gym.rl import training

    def interrupted(*arguments, **more):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(training._Watch, "tick", interrupted)
        assert train(tmp_path / "policy", hyperparameters) == 130
    assert "the same command resumes it" in capsys.readouterr().err
    assert main(["evaluate", str(tmp_path / "policy")]) == 1
    assert "was stopped" in capsys.readouterr().err
    assert train(tmp_path / "policy", hyperparameters) == 0


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--env", "Depht-v0"], "has no hyperparameters for 'Depht-v0'"),
        (["--effect", "effects.rudder.offset"], "PATH=VALUE"),
        (["--randomise", "effects.rudder.offset=1"], "PATH=LOW:HIGH"),
        (["--randomise", "effects.rudder.offset=0:1"], "needs a value from"),
        (["--on", "none.npz"], "There is no file none.npz"),
    ],
)
def test_what_cannot_be_trained_is_said(tmp_path, hyperparameters, capsys, arguments, words):
    assert train(tmp_path / "policy", hyperparameters, *arguments) == 1
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "policy" / "settings.json").exists()


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--against", "lqr"], "No autopilot of kind 'lqr'"),
        pytest.param(["--env", "Depth-v0", "--vehicle", "remus100"], "5 observations", marks=pytest.mark.slow),
        (["--picture", "strip.jpg"], "ends in .png or .gif"),
        (["--on", "none.toml"], "No vehicle file 'none.toml'"),
    ],
)
def test_what_cannot_be_evaluated_is_said(folder, capsys, arguments, words):
    assert main(["evaluate", str(folder), *arguments]) == 1
    assert words in " ".join(capsys.readouterr().err.split())


def test_a_folder_without_a_policy_is_refused(tmp_path, folder, capsys):
    assert main(["evaluate", str(tmp_path)]) == 1
    assert "auv-gym train" in capsys.readouterr().err
    for text, words in (
        ("{", "damaged"),
        ("{}", "contains no policy"),
        ('{"format": "auv-gym policy", "version": 9}', "update"),
    ):
        (tmp_path / "settings.json").write_text(text)
        assert main(["evaluate", str(tmp_path)]) == 1
        assert words in capsys.readouterr().err
    (tmp_path / "settings.json").write_bytes((folder / "settings.json").read_bytes())
    assert main(["evaluate", str(tmp_path)]) == 1
    assert "network.npz" in capsys.readouterr().err
    (tmp_path / "network.npz").write_bytes(b"PK")
    assert main(["evaluate", str(tmp_path)]) == 1
    assert "damaged" in capsys.readouterr().err
