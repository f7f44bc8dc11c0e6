"""LS-SVM with a linear kernel: the dual's solution, and a diving model without covariance."""

import numpy as np
import pytest

from auv_gym.model import simulate
from auv_gym.plant import load_vehicle
from identification.experiments.float_dives import depth_control
from identification.kernel_machines.ls_svm import LsSvm, linear_machine


def dual(features: np.ndarray, target: np.ndarray, penalty: float) -> tuple[np.ndarray, float]:
    """Weights and bias by the dual system with the linear kernel (Suykens et al. 2002, equation 3.12)."""
    n = target.size
    system = np.zeros((n + 1, n + 1))
    system[0, 1:] = system[1:, 0] = 1.0
    system[1:, 1:] = features @ features.T + np.eye(n) / penalty
    found = np.linalg.solve(system, np.r_[0.0, target])
    return features.T @ found[1:], float(found[0])


@pytest.mark.parametrize("penalty", [1e-2, 5.8731, 1e4])
def test_the_machine_is_that_of_the_dual_system(penalty):
    rng = np.random.default_rng(0)
    features = rng.standard_normal((60, 4)) + 2.0
    target = features @ [1.0, -0.5, 0.2, 0.0] + 3.0 + 0.1 * rng.standard_normal(60)
    machine = linear_machine(features, target, penalty)
    weights, bias = dual(features, target, penalty)
    assert machine.weights == pytest.approx(weights, rel=1e-8, abs=1e-9)
    assert machine.bias == pytest.approx(bias, rel=1e-8)
    assert machine(features[:1]) == pytest.approx(features[:1] @ weights + bias)


def lake_dive(noise: float, seed: int = 0):
    plant, rng = load_vehicle("qiandao_float"), np.random.default_rng(seed)
    return depth_control(plant, [20.0, 5.0], rng=rng, hold=350.0, noise=noise)


def test_it_dives_and_says_that_it_has_no_covariance():
    record = lake_dive(0.005)
    fit = LsSvm().fit(record)
    assert fit.covariance is None
    assert fit.history is None
    assert "no parameter covariance" in fit["damping"].problem
    assert not fit["damping"].identifiable
    depth = record["depth_m"]
    assert fit.theta[0] == pytest.approx(1.0, abs=1e-2)
    assert np.var(simulate(fit.model, record)["depth_m"] - depth) < np.var(depth)


def test_a_small_penalty_shrinks_the_weights():
    record = lake_dive(0.02)
    sizes = [np.linalg.norm(LsSvm(penalty).fit(record).theta[1:]) for penalty in (1e-2, 1.0, 1e2)]
    assert sizes == sorted(sizes)
    assert sizes[0] < 0.5 * sizes[2]


def test_settings_and_records_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="penalty > 0"):
        LsSvm(penalty=0.0)
    record = lake_dive(0.02)
    with pytest.raises(ValueError, match="add piston_m"):
        LsSvm().fit(record.without("piston_m"))
    with pytest.raises(ValueError, match="nothing excites"):
        LsSvm().fit(record.with_channels({"piston_m": np.full(len(record), 0.5)}))
