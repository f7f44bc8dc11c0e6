"""ARMAX, extended least squares and output error: truth found again, gradients, starts, integrators, full matrices."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter

from auv_gym.models.linear import Polynomial, StateSpace
from auv_gym.records.record import Record
from identification.linear.polynomials import filtering
from identification.linear.polynomials.armax import Armax
from identification.linear.polynomials.arx import Arx
from identification.linear.polynomials.els import Els
from identification.linear.polynomials.filtering import is_stable, largest_root
from identification.linear.polynomials.levenberg_marquardt import Stopping, linearised, minimise
from identification.linear.polynomials.output_error import OutputError
from identification.linear.polynomials.prediction import Prediction
from identification.linear.regressors import Series
from identification.linear.scaled import Scaled
from tests.identification.linear.known_systems import INPUTS, OUTPUTS, TRUTH, record_of

# two complex pairs, coloured noise: the channels are neither angles nor poses, so that nothing is unwrapped
A = np.real(np.poly([0.9 * np.exp(0.3j), 0.9 * np.exp(-0.3j), 0.7 * np.exp(1.0j), 0.7 * np.exp(-1.0j)]))
B, C = np.array([0.0, 0.05, 0.12, -0.04]), np.array([1.0, -0.8, 0.3])
ONE = (("rudder_rad",), ("u_mps",))


def coloured(n, seed, a=A, b=B, c=C, noise=0.1, dt=1.0):
    """A record of the ARMAX system with an error of this share of the clean output's spread."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], n), 2)[:n]
    y, v = lfilter(b, a, u), lfilter(c, a, rng.standard_normal(n))
    v *= noise * y.std() / v.std() if noise else 0.0
    return Record.from_arrays(dt * np.arange(n), {"rudder_rad": u, "u_mps": y + v})


def errors_of(record, method, *orders, block=(0,), offset=True, skip=0):
    estimator = method(*orders[:2], **orders[2])
    series = Series.of([record], *orders[:2], "test")
    return Prediction.of(Scaled.of(series, offset, "test"), estimator.orders, list(block), skip)


def coupled(n, seed):
    """Two outputs in innovations form, so that A and C are full matrices."""
    rng = np.random.default_rng(seed)
    a = np.array([[[1, 0], [0, 1]], [[-1.2, 0.2], [-0.1, -0.9]], [[0.5, 0.0], [0.1, 0.3]]])
    b = np.array([[[0, 0], [0, 0]], [[0.5, 0.1], [-0.2, 0.4]], [[0.1, 0.0], [0.0, 0.2]]])
    c = np.array([[[1, 0], [0, 1]], [[-0.6, 0.2], [0.1, 0.3]]])
    truth = Polynomial(a, b, ("rudder_rad", "stern_plane_rad"), ("u_mps", "w_mps"), 1.0, c=c)
    u, e = (
        np.repeat(rng.choice([-1.0, 1.0], (n, 2)), 2, axis=0)[:n],
        rng.multivariate_normal([0, 0], [[0.04, 0.03], [0.03, 0.09]], n),
    )
    y = np.zeros((n, 2))
    for t in range(2, n):
        y[t] = e[t] + c[1] @ e[t - 1]
        for k in (1, 2):
            y[t] += b[k] @ u[t - k] - a[k] @ y[t - k]
    columns = dict(zip((*truth.inputs, *truth.outputs), np.concatenate([u, y], axis=1).T))
    return truth, Record.from_arrays(np.arange(n) * 1.0, columns)


@pytest.mark.parametrize(
    "orders, block",
    [
        ((Armax, *ONE, {"n_a": 4, "n_b": 3, "n_c": 2}), (0,)),
        ((Armax, *ONE, {"n_a": 4, "n_b": 3, "n_c": 3, "integrating": ("u_mps",)}), (0,)),
        ((OutputError, *ONE, {"n_a": 4, "n_b": 3, "integrating": ("u_mps",)}), (0,)),
        (
            (
                Armax,
                ("rudder_rad", "stern_plane_rad"),
                ("u_mps", "w_mps"),
                {"n_a": 2, "n_b": 2, "n_c": 2, "structure": "full", "integrating": ("w_mps",)},
            ),
            (0, 1),
        ),
        (
            (
                OutputError,
                ("rudder_rad", "stern_plane_rad"),
                ("u_mps", "w_mps"),
                {"n_a": 2, "n_b": 2, "structure": "full"},
            ),
            (0, 1),
        ),
    ],
)
def test_the_gradient_and_normal_matrix_are_those_of_differences(orders, block):
    method, inputs, outputs, settings = orders
    record = coloured(60, 0) if len(outputs) == 1 else coupled(60, 0)[1]
    errors = errors_of(record, method, inputs, outputs, settings, block=block, skip=6)
    rng = np.random.default_rng(1)
    free, starts = 0.1 * rng.standard_normal(errors.free), 0.1 * rng.standard_normal(errors.starts().shape)
    weight = np.eye(len(block)) + 0.2 * rng.standard_normal((len(block), len(block)))

    def weighted(free, starts):
        return np.concatenate([(e @ weight).ravel() for e in errors.errors(free, starts)])

    step, e = 1e-6, weighted(free, starts)
    one = np.eye(errors.free)
    slopes = np.array(
        [(weighted(free + step * d, starts) - weighted(free - step * d, starts)) / (2 * step) for d in one]
    )
    begin = []
    for k in range(starts.size):
        moved = np.zeros(starts.size)
        moved[k] = step
        up, down = (weighted(free, starts + side * moved.reshape(starts.shape)) for side in (1, -1))
        begin.append((up - down) / (2 * step))
    begin = np.array(begin).reshape(-1, e.size)
    found = linearised(errors, free, starts, weight)
    assert found.value == pytest.approx(0.5 * e @ e, rel=1e-12)
    np.testing.assert_allclose(found.gradient, slopes @ e, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.matrix, slopes @ slopes.T, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.start_gradient[0], begin @ e, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.across[0], slopes @ begin.T, rtol=1e-6, atol=1e-6)
    rest = slopes.T - begin.T @ np.linalg.lstsq(begin.T, slopes.T, rcond=None)[0]
    np.testing.assert_allclose(found.reduced, rest.T @ rest, rtol=1e-5, atol=1e-5)
    triangle = errors.triangle(free, starts, weight)
    np.testing.assert_allclose(triangle.T @ triangle, rest.T @ rest, rtol=1e-6, atol=1e-6)


def test_the_compiled_filters_are_those_of_plain_python():
    record = coupled(40, 0)[1]
    settings = {"n_a": 2, "n_b": 2, "n_c": 2, "structure": "full"}
    errors = errors_of(record, Armax, ("rudder_rad", "stern_plane_rad"), ("u_mps", "w_mps"), settings, block=(0, 1))
    rng = np.random.default_rng(1)
    free, starts = 0.1 * rng.standard_normal(errors.free), rng.standard_normal(errors.starts().shape)
    problem, c, weight = errors.problem, errors.c(free), np.array([[1.0, 0.2], [0.0, 0.7]])
    p, q = errors.free, starts.size
    shapes = [(p,), (p, p), (1, q), (1, p, q), (1, q, q)]

    def all_of(of):
        e, arrays = np.empty((problem.rows, 2)), [np.zeros(shape) for shape in shapes]
        of(filtering.fill_errors)(problem, errors.terms(free), c, starts, e)
        slopes = np.zeros((2 + 30, 2, problem.described.shape[1] + q + 1))
        of(filtering.fill_slopes)(problem, 0, c, e, 3, slopes)
        of(filtering.normal_equations)(problem, c, e, weight, problem.mix, *arrays)
        return [e, slopes, *arrays]

    for one, other in zip(all_of(lambda f: f), all_of(lambda f: getattr(f, "py_func", f))):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-11)


def test_armax_finds_the_truth_where_arx_is_biased():
    truth = np.r_[A[1:], B[1:], C[1:]]
    worst = []
    for seed in range(5):
        record = coloured(3000, seed)
        fit = Armax(*ONE, n_a=4, n_b=3, n_c=2).fit(record)
        assert len(fit.estimates) == 10  # with the intercept
        assert all(e.ci95[0] - e.error < t < e.ci95[1] + e.error for e, t in zip(fit.estimates, truth))
        worst.append(np.abs(fit.vector[:9] - truth).max())
    assert np.median(worst) < 0.05
    biased = Arx(*ONE, n_a=4, n_b=3).fit(coloured(3000, 0))
    assert np.abs(biased.vector[:4] - A[1:]).max() > 0.3


def test_els_is_near_the_truth_and_its_errors_are_no_smaller_than_those_of_pem():
    record = coloured(3000, 1)
    rough, fine = (method(*ONE, n_a=4, n_b=3, n_c=2).fit(record) for method in (Els, Armax))
    assert np.abs(rough.vector[:7] - np.r_[A[1:], B[1:]]).max() < 0.15
    assert fine.loss[0] <= rough.loss[0]


def test_the_minimum_does_not_depend_on_units_or_on_what_surrounds_it():
    record = coloured(500, 2)
    fit = Armax(*ONE, n_a=4, n_b=3, n_c=2).fit(record)
    scaled = record.with_channels({"u_mps": 300.0 * record["u_mps"] + 5.0, "rudder_rad": 1e-3 * record["rudder_rad"]})
    other = Armax(*ONE, n_a=4, n_b=3, n_c=2).fit(scaled)
    np.testing.assert_allclose(other.model.a, fit.model.a, rtol=1e-6)
    np.testing.assert_allclose(other.model.c, fit.model.c, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(other.model.b, 3e5 * fit.model.b, rtol=1e-6, atol=1e-3)
    np.testing.assert_allclose(other.noise, 9e4 * fit.noise, rtol=1e-6)
    errors = [e.error for e in fit.estimates]
    np.testing.assert_allclose([e.error for e in other.estimates][:4], errors[:4], rtol=1e-5)
    # offsets are points of one equation: the same steady relation in other units
    gain = fit.model.b.sum() / fit.model.a.sum()
    level = fit.model.output_offset - gain * fit.model.input_offset
    there = other.model.output_offset - 3e5 * gain * other.model.input_offset
    np.testing.assert_allclose(there, 300.0 * level + 5.0, rtol=1e-6)


def test_without_noise_the_iteration_ends_at_the_error_threshold_with_the_truth():
    record = coloured(200, 0, noise=0.0)
    fit = Armax(*ONE, n_a=4, n_b=3, n_c=2, offset=False).fit(record)
    np.testing.assert_allclose(fit.model.a[:, 0, 0], A, atol=1e-9)
    assert all(np.isfinite(e.error) for e in fit.estimates)
    errors = errors_of(record, Armax, *ONE, {"n_a": 4, "n_b": 3, "n_c": 2}, offset=False)
    found = minimise(errors, np.r_[A[1:], B[1:] * 1.0, 0.0, 0.0], errors.starts(), np.eye(1), Stopping())
    assert found.iterations <= 10


def test_each_threshold_ends_the_iteration():
    errors = errors_of(coloured(400, 3), Armax, *ONE, {"n_a": 4, "n_b": 3, "n_c": 2})
    start = np.zeros(errors.free)

    def reason(**settings):
        found = minimise(errors, start, errors.starts(), np.eye(1), Stopping(**settings))
        return found.reason, found.iterations

    assert reason(iterations=3) == ("iterations", 3)
    assert reason(gradient=0.1)[0] == "gradient"
    assert reason(step=0.1)[0] == "step"
    assert reason(error=10.0) == ("error", 0)
    assert reason()[0] in ("gradient", "step", "rounding")


def test_a_fit_that_has_not_come_to_rest_says_so():
    fit = Armax(*ONE, n_a=4, n_b=3, n_c=2, stopping=Stopping(iterations=1)).fit(coloured(400, 3))
    assert all("not at rest after 1 iterations" in estimate.problem for estimate in fit.estimates)
    assert not any(estimate.problem for estimate in Armax(*ONE, n_a=4, n_b=3, n_c=2).fit(coloured(400, 3)).estimates)


def test_output_error_is_right_where_the_measurement_is_noisy():
    rng = np.random.default_rng(5)
    clean = coloured(2000, 5, noise=0.0)
    noisy = clean.with_channels({"u_mps": clean["u_mps"] + 0.1 * clean["u_mps"].std() * rng.standard_normal(2000)})
    fit = OutputError(*ONE, n_a=4, n_b=3).fit(noisy)
    off = np.abs(fit.model.a[1:, 0, 0] - A[1:]) / [fit[f"a{k}[u_mps]"].error for k in (1, 2, 3, 4)]
    assert off.max() < 3.5
    np.testing.assert_array_equal(fit.model.a, fit.model.c)
    assert np.sqrt(fit.noise[0, 0]) == pytest.approx(0.1 * clean["u_mps"].std(), rel=0.06)
    assert not any(e.path.startswith("c") for e in fit.estimates)
    assert np.abs(Arx(*ONE, n_a=4, n_b=3).fit(noisy).model.a[:, 0, 0] - A).max() > 0.3


def test_a_larger_output_error_model_is_no_worse():
    """Of orders that do not hold the truth, where one start alone comes to rest in other minima."""
    record = coloured(1000, 2, noise=0.2)
    losses = [OutputError(*ONE, n_a=a, n_b=b, skip=8).fit(record).loss[0] for a, b in ((2, 3), (3, 3), (3, 4), (4, 4))]
    assert all(larger <= smaller * (1.0 + 1e-6) for smaller, larger in pairwise(losses))


def test_segments_begin_where_they_are():
    """Free runs from states far from rest, in many short pieces: what a fit that starts from rest gets wrong."""
    rng = np.random.default_rng(7)
    pieces = []
    for _ in range(12):
        u = np.repeat(rng.choice([-1.0, 1.0], 40), 2)[:60]
        before = 5.0 * rng.standard_normal(4)
        y = lfilter(B, A, u, zi=before)[0] + 0.02 * rng.standard_normal(60)
        pieces.append(Record.from_arrays(np.arange(60) * 1.0, {"rudder_rad": u, "u_mps": y}))
    fit = OutputError(*ONE, n_a=4, n_b=3, offset=False).fit(*pieces)
    np.testing.assert_allclose(fit.model.a[:, 0, 0], A, atol=4 * fit["a2[u_mps]"].error)
    assert np.sqrt(fit.noise[0, 0]) == pytest.approx(0.02, rel=0.1)


def test_a_pole_at_one_is_exact_where_it_is_asked_for():
    a = np.convolve([1.0, -1.0], [1.0, -1.5, 0.7])
    record = coloured(400, 0, a=a, b=np.array([0.0, 0.2, 0.1]), c=np.array([1.0, -0.9]), noise=0.02)
    for method in (Arx, Els, Armax, OutputError):
        fit = method(*ONE, n_a=3, n_b=2, integrating=("u_mps",)).fit(record)
        assert abs(fit.model.a[:, 0, 0].sum()) < 1e-14
        poles = fit.model.to_state_space().poles()
        assert np.abs(poles - 1.0).min() < 1e-7
        assert fit.parameters == {Arx: 4, Els: 6, Armax: 6, OutputError: 4}[method]
        # one sum of the coefficients is known, so that their errors go together
        assert fit.vector.size == fit.parameters + 1
        np.testing.assert_allclose(fit.model.a[:, 0, 0], a, atol=0.2)


def test_an_unstable_plant_under_feedback_is_found():
    rng = np.random.default_rng(3)
    n, a, b = 2000, np.real(np.poly([1.05, 0.5])), np.array([0.0, 0.3, 0.1])
    e, u, y = 0.05 * rng.standard_normal(n), np.zeros(n), np.zeros(n)
    r = np.repeat(rng.choice([-1.0, 1.0], n), 5)[:n]
    for t in range(n):
        y[t] = e[t] - 0.6 * (e[t - 1] if t else 0.0)
        for k in (1, 2):
            y[t] += b[k] * u[t - k] - a[k] * y[t - k] if t >= k else 0.0
        u[t] = r[t] - 0.8 * y[t]
    fit = Armax(*ONE, n_a=2, n_b=2, n_c=1).fit(Record.from_arrays(np.arange(n) * 1.0, {"rudder_rad": u, "u_mps": y}))
    assert fit["a1[u_mps]"].value == pytest.approx(a[1], abs=4 * fit["a1[u_mps]"].error)
    assert np.abs(fit.model.to_state_space().poles()).max() == pytest.approx(1.05, abs=0.02)
    assert is_stable(fit.model.c)


def test_full_matrices_of_coupled_outputs():
    truth, record = coupled(4000, 0)
    fit = Armax(truth.inputs, truth.outputs, n_a=2, n_b=2, n_c=1, structure="full").fit(record)
    np.testing.assert_allclose(fit.model.a, truth.a, atol=0.05)
    np.testing.assert_allclose(fit.model.b, truth.b, atol=0.05)
    np.testing.assert_allclose(fit.model.c, truth.c, atol=0.1)
    np.testing.assert_allclose(fit.noise, [[0.04, 0.03], [0.03, 0.09]], rtol=0.1)
    assert fit.parameters == 8 + 8 + 4
    assert "a1[u_mps, w_mps]" in [e.path for e in fit.estimates]
    np.testing.assert_allclose(np.linalg.eigvalsh(fit.covariance) > 0.0, True)
    rough = Els(truth.inputs, truth.outputs, n_a=2, n_b=2, n_c=1, structure="full").fit(record)
    np.testing.assert_allclose(rough.model.a, truth.a, atol=0.1)
    one_by_one = Arx(truth.inputs, truth.outputs, n_a=2, n_b=2, structure="full").fit(record)
    assert one_by_one.model.a[1, 0, 1] != 0.0


def test_outputs_of_a_diagonal_model_are_fitted_apart():
    record = record_of(TRUTH, 600, np.random.default_rng(4), noise=0.02)
    both = Armax(INPUTS, OUTPUTS, n_a=(3, 2), n_b=2, n_c=(1, 2)).fit(record)
    for name, n_a, n_c in (("depth_m", 3, 1), ("pitch_rad", 2, 2)):
        alone = Armax(INPUTS, (name,), n_a=n_a, n_b=2, n_c=n_c).fit(record)
        assert both[f"a1[{name}]"].value == pytest.approx(alone[f"a1[{name}]"].value, rel=1e-9)
        assert both[f"c1[{name}]"].error == pytest.approx(alone[f"c1[{name}]"].error, rel=1e-9)


def test_at_gives_the_model_of_other_parameters():
    record = record_of(TRUTH, 400, np.random.default_rng(4), noise=0.02)
    fit = Armax(INPUTS, OUTPUTS, n_a=(3, 2), n_b=2, n_c=1, integrating=("depth_m",)).fit(record)
    same = fit.at(fit.vector)
    for name in ("a", "b", "c", "input_offset", "output_offset"):
        np.testing.assert_array_equal(getattr(same, name), getattr(fit.model, name))
    moved = fit.at(fit.vector + 0.01)
    assert abs(moved.a[:, 0, 0].sum()) < 1e-14
    assert not np.allclose(moved.b, fit.model.b)


def test_skipped_samples_only_serve_as_lags():
    record = coloured(300, 0)
    fits = [Armax(*ONE, n_a=n, n_b=2, n_c=1, skip=10).fit(record) for n in (1, 2, 3)]
    assert {fit.samples for fit in fits} == {290}
    assert fits[0].loss[0] > fits[1].loss[0] > fits[2].loss[0]
    late = Armax(*ONE, n_a=2, n_b=2, n_c=1).fit(record.between(8.0, 300.0))
    assert late.loss[0] == pytest.approx(fits[1].loss[0], rel=1e-6)


def test_a_root_of_c_at_the_unit_circle_is_told():
    rng = np.random.default_rng(0)
    n = 3000
    u = np.repeat(rng.choice([-1.0, 1.0], n), 2)[:n]
    y = lfilter([0.0, 0.5], [1.0, -0.8], u)
    slope = np.diff(y + 0.3 * rng.standard_normal(n), prepend=0.0)  # differences of a noisy measurement
    record = Record.from_arrays(np.arange(n) * 1.0, {"rudder_rad": u, "u_mps": slope})
    fit = Armax(*ONE, n_a=1, n_b=2, n_c=2).fit(record)
    assert largest_root(fit.model.c) <= 1.0
    told = [e.problem for e in fit.estimates]
    if largest_root(fit.model.c) > 0.999:
        assert all("unit circle" in problem for problem in told)
    model = fit.model.to_state_space()
    assert isinstance(model, StateSpace)
    np.testing.assert_allclose(model.poles()[0], 0.8, atol=0.05)


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"structure": "square"}, "structure to be one of diagonal, full"),
        ({"integrating": ("w_mps",)}, "list of its outputs"),
        ({"n_a": 0, "integrating": ("u_mps",)}, "n_a of at least 1"),
        ({"n_c": -1}, "n_c >= 0"),
        ({"n_c": [[1, 2]]}, "n_c >= 0"),
    ],
)
def test_settings_are_checked(settings, words):
    with pytest.raises(ValueError, match=words):
        Armax(*ONE, **settings)


def test_a_skip_below_zero_and_too_little_data_are_refused():
    with pytest.raises(ValueError, match="skip >= 0"):
        Arx(*ONE, skip=-1).fit(coloured(100, 0))
    with pytest.raises(ValueError, match="at least 4 samples per coefficient"):
        Armax(*ONE, n_a=4, n_b=4, n_c=2).fit(coloured(40, 0))
