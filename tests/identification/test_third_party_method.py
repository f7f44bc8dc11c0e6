"""A method of another package: installed beside ours, it is listed, takes settings, fits, and its model is written."""

import os
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from auv_gym.models.files import load_model, model_header
from auv_gym.models.linear import Polynomial
from tests.identification.linear.known_systems import record_of

PACKAGE = '''
"""A first-order lag by least squares."""

from dataclasses import dataclass
from collections.abc import Sequence

import numpy as np

from auv_gym.models.linear import Polynomial
from identification.estimate import Estimate
from identification.estimator import Method


@dataclass(frozen=True)
class Found:
    model: Polynomial
    estimates: tuple[Estimate, ...]


@dataclass(frozen=True)
class Lag:
    inputs: Sequence[str]
    outputs: Sequence[str]
    slowest: float = 1.0

    def fit(self, *records):
        u, y = (np.concatenate([r[name] for r in records]) for name in (self.inputs[0], self.outputs[0]))
        pole, gain = np.linalg.lstsq(np.stack([y[:-1], u[:-1]], axis=1), y[1:])[0]
        pole = min(pole, self.slowest)
        model = Polynomial.from_coefficients(
            {self.outputs[0]: [-pole]}, {self.outputs[0]: {self.inputs[0]: [gain]}}, records[0].sample_interval
        )
        return Found(model, (Estimate("pole", "1", float(pole), 0.0, (float(pole), float(pole)), ""),))


method = Method("first_order_lag", "A lag, by a package of somebody else.", Lag)
'''
USE = """
import sys
from pathlib import Path

from auv_gym.cli import main
from auv_gym.records.record import Record
from identification.estimator import list_methods, make_estimator

folder = Path(sys.argv[1])
assert main(["list", "methods"]) == 0
given = ["--input", "rudder_rad", "--output", "r_radps"]
told = ["identify", str(folder / "train.nc"), "--method", "first_order_lag", *given]
assert main([*told, "--out", str(folder / "lag.npz"), "--set", "slowest=0.85"]) == 0
assert main([*told, "--out", str(folder / "no.npz"), "--set", "fastest=1"]) == 1
lag = make_estimator("first_order_lag", inputs=["rudder_rad"], outputs=["r_radps"])
print(f"pole {lag.fit(Record.load(folder / 'train.nc')).model.a[1, 0, 0]:.3f}")
print(list_methods()["broken_lag"].problem)
"""


def install(folder, name, files, entries):
    """What an installer leaves of a package: its code, and what it says of itself."""
    package, known = folder / name, folder / f"{name}-0.1.dist-info"
    package.mkdir()
    known.mkdir()
    for file, text in files.items():
        (package / file).write_text(text)
    (known / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.1\n")
    (known / "entry_points.txt").write_text(textwrap.dedent(entries))


@pytest.mark.slow
def test_a_method_that_another_package_offers_is_used_like_ours(tmp_path):
    install(
        tmp_path,
        "tiny_lag",
        {"__init__.py": PACKAGE},
        """\
        [auv_gym.methods]
        first_order_lag = tiny_lag:method
        broken_lag = tiny_lag:nothing
        """,
    )
    truth = Polynomial.from_coefficients({"r_radps": [-0.9]}, {"r_radps": {"rudder_rad": [0.3]}}, 0.5)
    record_of(truth, 200, np.random.default_rng(0)).save(tmp_path / "train.nc")
    path = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, "-c", USE, str(tmp_path)],
        env={**os.environ, "PYTHONPATH": path, "COLUMNS": "200"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "A lag, by a package of somebody else." in done.stdout
    assert "pole -0.900" in done.stdout
    assert "its entry point tiny_lag:nothing is broken" in done.stdout
    assert "Method first_order_lag has no setting 'fastest'" in " ".join(done.stderr.split())
    model = load_model(tmp_path / "lag.npz")
    assert model.a[1, 0, 0] == pytest.approx(-0.85)
    assert model_header(tmp_path / "lag.npz")["attrs"]["method"] == "first_order_lag"
    assert not (tmp_path / "no.npz").exists()
