import numpy as np
import pytest
from scipy.io import loadmat

from auv_gym.plant import load_vehicle
from auv_gym.plant.cruise import find_cruise

control = pytest.importorskip("control", reason="the extra `control` is not installed")
from auv_gym.exports import control_system  # noqa: E402
from auv_gym.exports.for_control import save_system  # noqa: E402


@pytest.mark.parametrize("continuous", [False, True])
def test_a_small_step_is_the_simulators(continuous):
    """A step of 0.1 mrad at both planes over 2 s; what is quadratic in it is a ten-thousandth of the response."""
    plant, size = load_vehicle("npsauv"), 1e-4
    system = control_system(plant, continuous=continuous)
    assert system.input_labels == ["stern_plane_rad", "bow_plane_rad"]
    assert system.state_labels[0] == "w_mps change"
    assert control.isctime(system) == continuous
    times = plant.dt * np.arange(21)
    response = np.asarray(control.forced_response(system, times, np.full((2, times.size), size)).outputs)
    cruise = find_cruise(plant)
    x, u = plant.settled(cruise.state, cruise.commands), cruise.commands.copy()
    for name in system.input_labels:
        u[plant.inputs.index(name)] += size
    at = [plant.outputs.index(name) for name in system.output_labels]
    rest = plant.output(x)[at]
    for sample in range(times.size):
        own = plant.output(x)[at] - rest
        assert response[:, sample] == pytest.approx(own, rel=1e-3, abs=1e-3 * size)
        x = plant.step(x, u)


def test_a_mat_file_has_the_matrices_and_the_names(tmp_path):
    system = control_system(load_vehicle("npsauv"))
    save_system(system, tmp_path / "npsauv.mat")
    found = loadmat(tmp_path / "npsauv.mat", simplify_cells=True)
    assert np.array_equal(found["a"], system.A)
    assert found["dt"] == system.dt
    assert list(found["inputs"]) == system.input_labels
