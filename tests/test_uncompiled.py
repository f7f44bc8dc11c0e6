"""The physics as plain Python: the same trajectories as compiled, to rounding."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from auv_gym.param import list_paths, replace_at, spec_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.record import Record

ROOT = Path(__file__).parents[1]
SAMPLES = 60


def plants() -> dict[str, Plant]:
    """The presets bare, and one with each effect at three probes, and one with all."""
    slocum = load_vehicle("slocum")
    probed = {
        path: spec_at(slocum, path).neutral + 3.0 * spec_at(slocum, path).probe
        for path in list_paths(slocum)
        if path.startswith("effects.")
    }
    corrected = load_vehicle("ganeshblue_corrected")
    return {
        "slocum": slocum,
        "ganeshblue_corrected": corrected,
        **{path: replace_at(slocum, path, value) for path, value in probed.items()},
        "all effects": replace_at(slocum, probed),
        "all effects, corrected": replace_at(corrected, probed),
    }


def trajectory(plant: Plant) -> np.ndarray:
    """Outputs of a rollout and of the same commands stepped one by one, shape (2, SAMPLES, n_outputs)."""
    k = np.arange(SAMPLES)
    rudder = 0.6 * np.sin(0.3 * k)
    columns = {"rudder_rad": rudder, "u_mps": 0.4 + 0.1 * np.sin(0.1 * k), "roll_rad": 0.1 * np.cos(0.2 * k)}
    record = Record.from_arrays(plant.dt * k, columns)
    x = plant.initial(np.array([0.3, 0.01, 0.0, 0.0]))
    rolled, stepped = plant.run(record, record.segments, x[None, :]), []
    for row in range(SAMPLES):
        u = np.array([record[name][row] if record.has(name) else plant.constants[name] for name in plant.inputs])
        stepped.append(plant.output(x))
        x = plant.step(x, u)
    return np.stack([rolled, np.array(stepped)])


def test_plain_python_agrees_with_compiled_code(tmp_path):
    out = tmp_path / "plain.npz"
    environment = {**os.environ, "AUV_GYM_JIT": "0", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, __file__, str(out)], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    with np.load(out) as plain:
        assert not plain["numba_imported"]
        for name, plant in plants().items():
            # angles of some 10 rad after a thousand operations, each rounded at 1e-16
            assert plain[name] == pytest.approx(trajectory(plant), rel=1e-10, abs=1e-11), name


if __name__ == "__main__":
    found = {name: trajectory(plant) for name, plant in plants().items()}
    np.savez(sys.argv[1], numba_imported="numba" in sys.modules, **found)
