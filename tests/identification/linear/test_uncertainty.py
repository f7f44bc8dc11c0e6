"""Errors of poles, responses and free runs: against their spread over seeds, and against closed forms."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import signal, stats

from auv_gym.models.linear import Polynomial, StateSpace
from auv_gym.records.record import Record
from identification.experiments.excitation import prbs
from identification.linear.fit import Known, has_errors, is_linear
from identification.linear.poles import pole_intervals, zeros
from identification.linear.polynomials.arx import Arx
from identification.linear.uncertainty import response_band, simulated_band
from tests.identification.linear.known_systems import INPUTS, OUTPUTS, TRUTH, record_of

GIVEN, SEEN = ("stern_plane_rad",), ("q_radps",)
A, B = [1.0, -1.7, 0.76], [0.0, 0.5, 0.3]  # poles 0.85 +- 0.194j
SEEDS, SAMPLES, NOISE, DT = 120, 400, 0.1, 0.5
OMEGA = np.array([0.05, 0.2, 0.5, 1.0, 3.0, 4.5])


def polynomial(a, b, **further) -> Polynomial:
    return Polynomial(np.reshape(a, (-1, 1, 1)), np.reshape(b, (-1, 1, 1)), GIVEN, SEEN, DT, **further)


def made(rng, samples=SAMPLES, noise=NOISE, a=A) -> Record:
    u = prbs(samples, 2, 0.1, rng)
    y = signal.lfilter(B, a, u) + signal.lfilter([1.0], a, noise * rng.standard_normal(samples))
    return Record.from_arrays(DT * np.arange(samples), {GIVEN[0]: u, SEEN[0]: y})


@dataclass(frozen=True, eq=False)
class Given(Known):
    """A fit whose parameters are the coefficients of A, with a covariance that a test chooses."""

    covariance: np.ndarray = None
    noise: np.ndarray = None
    freedom: int = 1000

    @property
    def vector(self):
        return self.model.a[1:, 0, 0]

    def at(self, vector):
        return replace(self.model, a=np.r_[1.0, vector].reshape(-1, 1, 1))


def given(a, variance, b=B) -> Given:
    return Given(polynomial(a, b), covariance=variance * np.eye(len(a) - 1), noise=np.eye(1))


@pytest.fixture(scope="module")
def fits():
    return [Arx(GIVEN, SEEN, offset=False).fit(made(np.random.default_rng(seed))) for seed in range(SEEDS)]


@pytest.mark.slow
def test_regions_of_poles_hold_the_truth_at_the_stated_rate(fits):
    truth = complex(0.85, np.sqrt(0.76 - 0.85**2))
    found = [pole_intervals(fit) for fit in fits]
    assert all(len(poles) == 1 and poles[0].pair and not poles[0].problem for poles in found)
    inside, damped = 0, 0
    s = np.log(truth) / DT
    for (pole,) in found:
        away = np.array([truth.real - pole.value.real, truth.imag - pole.value.imag])
        inside += away @ np.linalg.solve(pole.covariance, away) < 2.0 * stats.f.ppf(0.95, 2, pole.freedom)
        low, high = pole.damping.ci95
        damped += low < -s.real / abs(s) < high
        low, high = pole.time_constant.ci95
        assert low < -1.0 / pole.continuous.real < high
    # 120 draws at 0.95 lie in 0.89 to 0.99 with a chance of 0.99
    assert 0.89 <= inside / SEEDS <= 0.99
    assert 0.89 <= damped / SEEDS <= 0.99
    values = np.array([pole.value for (pole,) in found])
    stated = np.mean([pole.covariance for (pole,) in found], axis=0)
    # a standard deviation of 120 draws is known to 7 %
    np.testing.assert_allclose([values.real.std(), values.imag.std()], np.sqrt(np.diag(stated)), rtol=0.2)
    border = found[0][0].ellipse()
    np.testing.assert_allclose(border.mean(), found[0][0].value, atol=0.1 * np.abs(border - border.mean()).max())


@pytest.mark.slow
def test_bands_of_the_response_hold_the_truth_at_the_stated_rate(fits):
    truth = polynomial(A, B).state_space.frequency_response(OMEGA)
    gains, phases, logs, stated = [], [], [], []
    for fit in fits:
        band = response_band(fit, OMEGA)
        low, high = band.gain_bounds
        gains.append((low < np.abs(truth)) & (np.abs(truth) < high))
        low, high = band.phase_bounds
        phases.append(np.abs(np.angle(band.response / truth)) < 0.5 * (high - low))
        logs.append(np.log(band.gain))
        stated.append(band.gain_error)
    assert (np.abs(np.mean(gains, axis=0) - 0.95) < 0.06).all()
    assert (np.abs(np.mean(phases, axis=0) - 0.95) < 0.06).all()
    np.testing.assert_allclose(np.std(logs, axis=0), np.mean(stated, axis=0), rtol=0.25)


@pytest.mark.slow
def test_bands_of_free_runs_hold_what_they_promise(fits):
    clean, inside, measured = made(np.random.default_rng(10**6), 200, 0.0), [], []
    for seed, fit in enumerate(fits[:25]):
        band = simulated_band(fit, clean)
        inside.append(np.abs(band.model - clean[SEEN[0]][:, None]) < band.half)
        noisy = made(np.random.default_rng(2 * 10**6 + seed), 200)
        band = simulated_band(fit, noisy, noise=True)
        measured.append(np.abs(band.model - noisy[SEEN[0]][:, None]) < band.half)
    # samples of a run go together: 25 fits are some hundreds of independent samples
    assert 0.9 <= np.mean(inside) <= 0.985
    assert 0.92 <= np.mean(measured) <= 0.98
    start, later = np.mean(np.array(measured)[:, :10]), np.mean(np.array(measured)[:, 20:])
    assert start == pytest.approx(later, abs=0.06)  # also where the start is fitted to the same noise


@pytest.mark.slow
def test_draws_and_slopes_agree_where_the_fit_is_sure(fits):
    record = made(np.random.default_rng(7), 150)
    fit = replace(fits[0], covariance=1e-4 * fits[0].covariance)
    sloped = simulated_band(fit, record)
    drawn = simulated_band(fit, record, draws=300, rng=np.random.default_rng(0))
    assert drawn.diverged == 0
    kept = sloped.half > 0.2 * sloped.half.max()
    np.testing.assert_allclose(drawn.half[kept], sloped.half[kept], rtol=0.25)  # quantiles of 300 draws
    with pytest.raises(ValueError, match="needs rng"):
        simulated_band(fit, record, draws=10)


def test_draws_that_diverge_are_counted_and_too_many_refused():
    # in 3800 samples a pole beyond 1.21 leaves the finite numbers
    record = made(np.random.default_rng(7), 3800)
    band = simulated_band(given([1.0, -0.9], 0.25), record, draws=40, rng=np.random.default_rng(1))
    assert 0 < band.diverged < 20
    with pytest.raises(ValueError, match="too unsure of its poles"):
        simulated_band(given([1.0, -1.19], 100.0), record, draws=40, rng=np.random.default_rng(1))


def test_noise_of_a_random_walk_spreads_with_the_root_of_time():
    record = made(np.random.default_rng(7), 100)
    walk = given([1.0, -1.0], 0.0)
    band = simulated_band(walk, record, starts=np.zeros((1, len(walk.model.states))), noise=True)
    width = stats.t.ppf(0.975, 1000)
    np.testing.assert_allclose(band.half[:, 0], width * np.sqrt(1.0 + np.arange(100)), rtol=1e-9)
    still = simulated_band(walk, record, starts=np.zeros((1, len(walk.model.states))))
    assert not still.half.any()


def test_an_integrator_has_no_error_and_leaves_the_others_theirs():
    record = record_of(TRUTH, 600, np.random.default_rng(0), noise=0.02)
    free, fixed = (Arx(INPUTS, OUTPUTS, n_a=[3, 2], integrating=names).fit(record) for names in ((), ("depth_m",)))
    one, *others = pole_intervals(fixed)
    assert one.value == 1.0
    assert one.fixed
    assert one.outputs == ("depth_m",)
    assert one.real.ci95 == (1.0, 1.0)
    assert one.time_constant.value == np.inf
    assert one.damping.value == 0.0
    assert one.ellipse().size == 0
    assert [pole.outputs for pole in others] == [("pitch_rad",), ("depth_m",), ("depth_m",)]
    same = {pole.outputs: pole for pole in pole_intervals(free) if pole.pair}
    np.testing.assert_allclose(others[0].covariance, same["pitch_rad",].covariance, rtol=1e-6)
    assert 0.0 < pole_intervals(free)[0].real.error < 0.01
    with pytest.raises(ValueError, match="pole at 1"):
        response_band(fixed, [0.0])


def test_slopes_of_poles_are_those_of_differences():
    record = record_of(TRUTH, 600, np.random.default_rng(0), noise=0.02)
    fit = Arx(INPUTS, OUTPUTS, n_a=2, structure="full").fit(record)
    values, size = {}, 1e-3
    for pole in pole_intervals(fit):
        spread = 0.0
        for direction in np.linalg.cholesky(fit.covariance).T:
            ends = [fit.at(fit.vector + sign * size * direction).state_space.poles() for sign in (1.0, -1.0)]
            near = [end[np.argmin(np.abs(end - pole.value))] for end in ends]
            spread += abs((near[0] - near[1]) / (2.0 * size)) ** 2
        values[pole.value] = np.trace(pole.covariance) / spread
    assert len(values) >= 2
    np.testing.assert_allclose(list(values.values()), 1.0, rtol=1e-3)  # second order in the step of the difference


def test_poles_that_coincide_or_nearly_do_have_no_linear_interval():
    for pole in pole_intervals(given(np.poly([0.8, 0.8]), 1e-6)):
        assert "repeated" in pole.problem
        assert pole.real.ci95 == (-np.inf, np.inf)
        assert pole.ellipse().size == 0
    for pole in pole_intervals(given(np.poly([0.8, 0.79]), 1e-6)):
        assert "no farther from another" in pole.problem
    for pole in pole_intervals(given(np.poly([0.8, 0.5]), 1e-6)):
        assert not pole.problem
        assert pole.ellipse().size == 2


def test_a_time_constant_may_reach_infinity_and_a_mode_may_grow():
    (slow,) = pole_intervals(given([1.0, -0.999], 1e-6))
    assert slow.time_constant.ci95[1] == np.inf
    assert 0.0 < slow.time_constant.ci95[0] < slow.time_constant.value
    (grows,) = pole_intervals(given([1.0, -1.1], 1e-6))
    low, high = grows.time_constant.ci95
    assert grows.time_constant.value == pytest.approx(-DT / np.log(1.1))
    assert low < grows.time_constant.value < high < 0.0


def test_a_fit_without_errors_says_so_and_a_known_model_has_no_width(fits):
    blind = replace(fits[0], covariance=np.full_like(fits[0].covariance, np.nan))
    assert is_linear(blind)
    assert not has_errors(blind)
    assert all("no errors" in pole.problem for pole in pole_intervals(blind))
    assert np.isnan(response_band(blind, OMEGA).covariance).all()
    with pytest.raises(ValueError, match="no errors"):
        simulated_band(blind, made(np.random.default_rng(0)))
    known = Known(fits[0].model)
    assert is_linear(known)
    assert not response_band(known, OMEGA).gain_error.any()
    assert all(pole.fixed for pole in pole_intervals(known))


def test_frequencies_beyond_nyquist_are_refused_and_zero_is_the_steady_gain(fits):
    band = response_band(fits[0], [0.0])
    assert band.response[0].real == pytest.approx(fits[0].model.state_space.dc_gain())
    for wrong in ([], [-1.0], [7.0]):
        with pytest.raises(ValueError, match="Nyquist frequency 6"):
            response_band(fits[0], wrong)


def test_zeros_are_those_of_the_textbook_form():
    model = polynomial([1.0, -1.2, 0.27], [0.0, 2.0, -1.0])  # 2 (z - 0.5) / ((z - 0.9)(z - 0.3))
    assert zeros(model, *SEEN, *GIVEN) == pytest.approx([0.5])
    assert zeros(model.state_space, *SEEN, *GIVEN) == pytest.approx([0.5])
    delayed = polynomial([1.0, -0.9], [0.0, 0.0, 0.0, 1.0])
    assert zeros(delayed, *SEEN, *GIVEN).size == 0
    assert sum(pole.delay for pole in pole_intervals(Known(delayed.state_space))) == 2
    deaf = StateSpace([[0.5]], [[0.0]], [[1.0]], GIVEN, SEEN, DT)
    assert zeros(deaf, *SEEN, *GIVEN).size == 0
