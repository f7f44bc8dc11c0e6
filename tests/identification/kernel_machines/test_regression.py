"""LS-SVM regression: its system, its leave-one-out errors, its compiled predictions and what it refuses."""

import numpy as np
import pytest

from auv_gym.physics.radial import BITS, radial_blocks, radial_distances
from identification.kernel_machines.bordered import Spectrum, solved
from identification.kernel_machines.machine import sums_of_rows
from identification.kernel_machines.regression import LsSvmRegression, Training

RNG = np.random.default_rng(4)
X = RNG.normal(size=(40, 3)) * [1.0, 20.0, 0.05] + [0.0, 100.0, 1.0]
Y = np.column_stack([np.sin(X[:, 0]) + X[:, 1] / 50.0, X[:, 2] * X[:, 0]]) + 0.05 * RNG.normal(size=(40, 2))
WEIGHTS = RNG.uniform(0.2, 3.0, 40)


def kernel_between(a, b, settings):
    scale = X.std(axis=0) if settings.scaled else np.ones(3)
    if settings.kernel == "linear":
        return (a / scale) @ (b / scale).T
    return np.exp(-np.sum(((a[:, None] - b[None]) / scale) ** 2, axis=2) / settings.sigma**2)


def bordered(settings, x, y, weights):
    """Bias and coefficients by a dense solve of the system with its border."""
    n = len(x)
    matrix = np.ones((n + 1, n + 1))
    matrix[0, 0] = 0.0
    matrix[1:, 1:] = kernel_between(x, x, settings) + np.diag(1.0 / (settings.penalty * weights))
    solution = np.linalg.solve(matrix, np.vstack([np.zeros(y.shape[1]), y]))
    return solution[0], solution[1:]


@pytest.mark.parametrize("weights", [np.ones(40), WEIGHTS], ids=["even", "weighted"])
@pytest.mark.parametrize(
    "settings",
    [LsSvmRegression(30.0, 1.7), LsSvmRegression(5.0, 9.0, scaled=False), LsSvmRegression(2.0, kernel="linear")],
    ids=["scaled", "unscaled", "linear"],
)
def test_machine_solves_the_bordered_system(settings, weights):
    machine = settings.fit(X, Y, weights)
    bias, coefficients = bordered(settings, X, Y, weights)
    at = X[:7] + 0.3 * X.std(axis=0)
    expected = kernel_between(at, X, settings) @ coefficients + bias
    # the dense solve loses digits to the offset of 100 that the machine takes away first
    np.testing.assert_allclose(machine.coefficients, coefficients, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(machine(at), expected, rtol=1e-7, atol=1e-8)
    one = settings.fit(X, Y[:, 1], weights)
    np.testing.assert_allclose(one(at), machine(at)[:, 1], rtol=1e-10)
    np.testing.assert_allclose(machine.coefficients.sum(axis=0), 0.0, atol=1e-8)


def test_machine_of_a_hundred_samples_solves_the_published_system():
    """Source: Xu, Zou, Yin and Cao 2013, Ocean Engineering 67, equation (18), with its six outputs on six inputs."""
    rng = np.random.default_rng(7)
    x = rng.normal(size=(100, 6))
    y = x * np.abs(np.roll(x, 1, axis=1)) * [1.0, 10.0, 10.0, 0.1, 5.0, 5.0]
    machine = LsSvmRegression(100.0, 2.5, scaled=False).fit(x, y)
    matrix = np.ones((101, 101))
    matrix[0, 0] = 0.0
    matrix[1:, 1:] = np.exp(-np.sum((x[:, None] - x[None]) ** 2, axis=2) / 2.5**2) + np.eye(100) / 100.0
    solution = np.linalg.solve(matrix, np.vstack([np.zeros(6), y]))
    size = np.abs(solution).max(axis=0)
    # condition of some 1e4 times 1e-16
    np.testing.assert_allclose(machine.coefficients / size, solution[1:] / size, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(machine.bias / size, solution[0] / size, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("kernel", ["rbf", "linear"])
def test_leave_one_out_is_what_leaving_out_gives(kernel):
    settings = LsSvmRegression(20.0, 8.0, kernel, scaled=False)  # a scale would change with the sample left out
    machine = settings.fit(X, Y, WEIGHTS)
    for i in (0, 11, 39):
        rest = np.arange(40) != i
        left_out = settings.fit(X[rest], Y[rest], WEIGHTS[rest])
        np.testing.assert_allclose(machine.leave_one_out[i], Y[i] - left_out(X[i : i + 1])[0], rtol=1e-8)


def test_one_spectrum_gives_the_cholesky_solution_of_every_penalty():
    training = Training.of(X, Y, WEIGHTS, LsSvmRegression())
    kernel, penalties = training.kernel(1.3), np.array([0.01, 1.0, 1e3, 1e6])
    spectrum = Spectrum.of(kernel, WEIGHTS)
    errors = spectrum.leave_one_out(penalties, Y)
    for penalty, error in zip(penalties, errors):
        direct, shared = solved(kernel, 1.0 / (penalty * WEIGHTS), Y), spectrum.solution(penalty, Y)
        for name in ("coefficients", "bias", "leave_one_out"):
            np.testing.assert_allclose(getattr(shared, name), getattr(direct, name), rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(error, direct.leave_one_out, rtol=1e-6)


def test_smooth_function_is_recovered_between_its_samples():
    x = np.random.default_rng(1).uniform(-1.0, 1.0, (300, 2))
    inside = 0.9 * np.random.default_rng(2).uniform(-1.0, 1.0, (100, 2))

    def truth(x):
        return x[:, 0] * np.abs(x[:, 0]) + np.sin(2.0 * x[:, 1])

    machine = LsSvmRegression(1e8, 1.5).fit(x, truth(x))
    # x |x| has a jump in its second derivative, which no smooth kernel follows at a spacing of 0.1
    assert np.max(np.abs(machine(inside) - truth(inside))) < 0.01


def test_compiled_rows_equal_plain_ones():
    machine = LsSvmRegression(50.0, 1.5).fit(X, Y)
    at = X[3:5] + 0.1
    scaled, blocks = (
        (at - machine.middle) * (machine.rate * BITS),
        radial_blocks(machine.support - machine.middle, machine.rate, machine.coefficients),
    )
    for function, shape in ((sums_of_rows, (2, 2)), (radial_distances, (2,))):
        fast, plain = np.empty(shape), np.empty(shape)
        function(scaled, blocks, fast)
        getattr(function, "py_func", function)(scaled, blocks, plain)
        np.testing.assert_allclose(fast, plain, rtol=1e-12)


def test_wide_bells_with_a_large_penalty_keep_their_digits():
    rng = np.random.default_rng(3)
    x = rng.normal(size=(400, 3))
    y = x[:, 0] * x[:, 1] + x[:, 2] + 0.05 * rng.normal(size=400)
    settings = LsSvmRegression(1.0 / (1e3 * np.finfo(float).eps * 400), 150.0)  # the largest that tuning tries
    machine = settings.fit(x, y)
    # y - f = coefficients / C at every sample, whatever the condition, here 1e12: what is left is rounding at 1e-16 of
    # coefficients of some 1e9, a few hundred of them
    residuals = y - machine(x)
    np.testing.assert_allclose(machine.coefficients[:, 0] / settings.penalty, residuals, rtol=0.0, atol=1e-4)
    assert np.std(residuals) == pytest.approx(0.05, rel=0.2)  # less than the noise: some of it is followed


def test_constant_output_is_its_bias_alone_and_said():
    machine = LsSvmRegression().fit(X, np.column_stack([Y[:, 0], np.full(40, 0.1)]))
    assert machine(X)[:, 1] == pytest.approx(0.1, abs=0.0)
    assert "output 1 is 0.1 in every sample" in machine.notes[0]
    assert np.ptp(machine(X)[:, 0]) > 0.5


def test_repeated_samples_need_a_penalty():
    twice, targets = np.vstack([X, X[:2]]), np.vstack([Y, Y[:2] + 0.1])
    machine = LsSvmRegression(1e3, 0.5).fit(twice, targets)
    np.testing.assert_allclose(machine(X[:2]), Y[:2] + 0.05, atol=0.01)
    with pytest.raises(ValueError, match="2 samples repeat another's inputs"):
        LsSvmRegression(np.inf, 0.5).fit(twice, targets)
    np.testing.assert_allclose(LsSvmRegression(np.inf, 0.5).fit(X, Y)(X), Y, atol=1e-10)


@pytest.mark.parametrize(
    "settings, change, message",
    [
        ({"sigma": 1e-9}, None, "unit matrix"),
        ({"sigma": 1e9}, None, "constant: all samples look alike"),
        ({"penalty": 1e16, "sigma": 50.0}, None, "singular to rounding, as neighbouring samples"),
        ({"penalty": 0.0}, None, "penalty > 0"),
        ({"penalty": np.nan}, None, "penalty > 0"),
        ({"sigma": -1.0}, None, "finite sigma > 0"),
        ({"kernel": "cubic"}, None, "'rbf' or 'linear'"),
        ({}, lambda x, y: (x[:2], y[:2]), "at least 3 samples, got 2"),
        ({}, lambda x, y: (np.where(x == x[4, 1], np.nan, x), y), "1 of 40 samples without, first in row 4"),
        ({}, lambda x, y: (x * [1.0, 0.0, 1.0] + 0.1, y), "0.1 in every sample of column 1"),
        ({}, lambda x, y: (x, y[:-1]), "one row for each sample"),
    ],
)
def test_what_cannot_be_fitted_is_refused_in_words(settings, change, message):
    with pytest.raises(ValueError, match=message):
        LsSvmRegression(**settings).fit(*(change(X, Y) if change else (X, Y)))


def test_weights_and_rows_are_checked():
    with pytest.raises(ValueError, match="leave out samples of no weight"):
        LsSvmRegression().fit(X, Y, np.zeros(40))
    machine = LsSvmRegression().fit(X, Y)
    with pytest.raises(ValueError, match="rows of 3 inputs"):
        machine(X[0])
    with pytest.raises(ValueError, match=r"finite inputs, got .* in row 1"):
        machine(np.where(X[1, 2] == X, np.nan, X))
