import numpy as np
import pytest

from identification.kernel_machines.regression import LsSvmRegression
from identification.kernel_machines.tuning.outward import MOST_PENALTY, tune_outward, tune_outward_each
from identification.kernel_machines.tuning.tuning import descend


def flows(n: int, rng: np.random.Generator, reach: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and two forces that go with their squares, one of them with a kink."""
    v = reach * rng.uniform(-1.0, 1.0, (n, 3))
    return v, np.column_stack([v[:, 0] * v[:, 1] + v[:, 2] ** 2, v[:, 0] * np.abs(v[:, 0]) - v[:, 1] * v[:, 2]])


def beyond(settings: LsSvmRegression, seed: int) -> float:
    """Error of the machine of samples within 1 at samples within 1.5, relative."""
    machine = settings.fit(*flows(300, np.random.default_rng(seed)))
    x, y = flows(500, np.random.default_rng(99), 1.5)
    return float(np.sqrt(np.mean((machine(x) - y) ** 2) / np.mean(y**2)))


@pytest.mark.slow  # twelve tunings
def test_beyond_the_samples_it_does_better_than_leave_one_out():
    ratios = []
    for seed in range(6):
        x, y = flows(300, np.random.default_rng(seed))
        ratios.append(
            beyond(tune_outward(LsSvmRegression(), x, y).settings, seed)
            / beyond(descend(LsSvmRegression(), x, y).settings, seed)
        )
    assert np.exp(np.mean(np.log(ratios))) < 0.8  # in the mean: one draw of samples may favour the other
    assert np.median(ratios) < 0.8


def test_noise_makes_the_machine_stiffer_and_each_output_may_have_its_own():
    rng = np.random.default_rng(3)
    x, y = flows(400, rng)
    clean = tune_outward(LsSvmRegression(), x, y).settings
    noisy = tune_outward(LsSvmRegression(), x, y + 0.1 * rng.standard_normal(y.shape)).settings
    assert clean.penalty <= MOST_PENALTY
    # of a wide kernel, squares of the inputs are a part sigma^-4, which C has to make up for
    assert noisy.penalty / noisy.sigma**4 < 0.03 * clean.penalty / clean.sigma**4
    each = tune_outward_each(LsSvmRegression(), x, np.column_stack([y[:, 0], 0.0 * y[:, 0] + 2.0, y[:, 1]]))
    assert len(each) == 3
    assert each[0].settings.sigma > each[2].settings.sigma  # the kink wants a narrower kernel
    assert each[1].loss == 0.0
    assert each[0].errors[0] < 1e-4 * np.var(y[:, 0])


def test_the_linear_kernel_has_a_penalty_alone():
    rng = np.random.default_rng(5)
    x = rng.standard_normal((200, 2))
    y = x @ np.array([1.0, -2.0]) + 0.5
    tuned = tune_outward(LsSvmRegression(kernel="linear"), x, y)
    assert tuned.settings.fit(x, y)(np.array([[10.0, 10.0]]))[0] == pytest.approx(-9.5, rel=1e-4)
