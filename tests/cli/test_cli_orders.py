"""`auv-gym identify --search`: orders tried, chosen, fitted and told."""

import json

import numpy as np
import pytest

from auv_gym.cli import main
from auv_gym.models.files import load_model, model_header
from auv_gym.models.linear import Polynomial
from tests.identification.linear.known_systems import TRUTH, record_of

CHANNELS = ["--input", "bow_plane_rad", "--input", "stern_plane_rad", "--output", "depth_m", "--output", "pitch_rad"]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs") / "train.nc"
    record_of(TRUTH, 600, np.random.default_rng(0), noise=0.01).save(path)
    return path


def run(log, out, *arguments):
    return main(["identify", str(log), "--out", str(out), "--method", "arx", *CHANNELS, *map(str, arguments)])


def test_orders_are_searched_and_the_chosen_fitted(log, tmp_path, capsys):
    out = tmp_path / "model.npz"
    assert run(log, out, "--search", "n_a=1:4", "--search", "n_b=1:3") == 0
    said = capsys.readouterr().out
    assert "MDL, chosen" in said
    assert "parsimony" in said
    assert "held-out" not in said.partition("Parameters")[0]
    model = load_model(out)
    assert isinstance(model, Polynomial)
    np.testing.assert_allclose(model.a, TRUTH.a, atol=0.05)
    attrs = model_header(out)["attrs"]
    assert attrs["settings"] == {"n_a": [3, 2], "n_b": [[2, 2], [2, 2]], "delay": [[1, 1], [1, 1]]}
    tried = {"n_a": [1, 2, 3, 4], "n_b": [1, 2, 3]}
    assert attrs["order_search"] == {"criterion": "mdl", "tolerance": 0.5, "tried": tried}
    assert json.dumps(attrs)


def test_another_criterion_may_choose(log, tmp_path, capsys):
    out = tmp_path / "model.npz"
    assert run(log, out, "--search", "n_a=1:3", "--search", "n_b=2", "--choose", "held_out") == 0
    assert "held-out, chosen" in capsys.readouterr().out
    loose = ["--choose", "parsimony", "--tolerance", "1e9"]
    assert run(log, out, "--search", "n_a=1:3", "--search", "n_b=1:2", *loose) == 0
    assert "n_a of" not in capsys.readouterr().out
    assert model_header(out)["attrs"]["settings"]["n_a"] == [1, 1]


@pytest.mark.parametrize(
    "given, words",
    [
        (["--search", "n_a=3:1"], "empty, from 3 to 1"),
        (["--search", "order=1:3"], "no 'order'"),
        (["--search", "n_c=1:3"], "arx has no n_c"),
        (["--search", "n_a=1:3", "--choose", "best"], "No criterion 'best'"),
        (["--choose", "mdl"], "give --search"),
        (["--search", "n_a=1:3", "--tolerance", "0.1"], "give --choose parsimony"),
        (["--search", "n_a=1:3", "--set", "n_b=2"], "sets n_b itself"),
        (["--search", "n_a=1:3", "--set", "structure=full"], "diagonal models"),
    ],
)
def test_what_cannot_be_searched_is_said(log, tmp_path, capsys, given, words):
    assert run(log, tmp_path / "model.npz", *given) == 1
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "model.npz").exists()
