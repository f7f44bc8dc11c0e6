import numpy as np
import pytest

from identification.experiments.excitation import SIGNALS, make_signal, prbs, set_point_steps, slow_variation


def test_prbs_has_two_levels_and_holds_them():
    signal = prbs(1000, 4, 0.3, np.random.default_rng(0))
    edges = np.flatnonzero(np.diff(signal))
    assert signal.shape == (1000,)
    assert set(signal) == {-0.3, 0.3}
    assert (np.diff(edges) % 4 == 0).all()
    assert np.diff(edges).min() == 4


def test_prbs_of_a_whole_period_is_white():
    """The circular correlation of a maximum-length sequence is -1 at every lag but zero."""
    signal = prbs(63, 1, 1.0, np.random.default_rng(3))
    correlation = [float(signal @ np.roll(signal, lag)) for lag in range(63)]
    assert correlation == [63.0] + [-1.0] * 62


@pytest.mark.parametrize("n", [1, 2, 3, 7, 8, 100])
@pytest.mark.parametrize("hold", [1, 3, 50])
def test_prbs_has_the_length_asked_for_from_any_phase(n, hold):
    signals = [prbs(n, hold, 1.0, np.random.default_rng(seed)) for seed in range(30)]
    assert all(signal.shape == (n,) and set(signal) <= {-1.0, 1.0} for signal in signals)
    assert len({signal.tobytes() for signal in signals}) > 1


def test_prbs_depends_on_the_generator_only():
    one, two = (prbs(50, 2, 1.0, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("n, hold", [(0, 1), (5, 0)])
def test_prbs_refuses_what_it_cannot_make(n, hold):
    with pytest.raises(ValueError, match="needs a whole number of at least 1"):
        prbs(n, hold, 1.0, np.random.default_rng(0))


def test_set_points_step_by_the_stated_sizes_at_the_stated_times():
    time = np.arange(0.0, 50_000.0, 1.0)
    values = set_point_steps(time, np.random.default_rng(1), start=0.5, hold=(40.0, 90.0), step=(0.3, 1.2))
    changes = np.flatnonzero(np.diff(values))
    sizes, holds = np.abs(np.diff(values)[changes]), np.diff(time[changes])
    assert values[0] == 0.5
    assert 0.3 - 1e-9 <= sizes.min() < 0.32
    assert 1.18 < sizes.max() <= 1.2 + 1e-9
    assert holds.min() >= 39.0
    assert holds.max() <= 91.0
    assert 0.4 < np.mean(np.diff(values)[changes] > 0.0) < 0.6
    with pytest.raises(ValueError, match="hold"):
        set_point_steps(time, np.random.default_rng(1), hold=(0.0, 10.0))


def test_slow_variation_keeps_its_bound_and_its_pace():
    time = np.arange(0.0, 2000.0, 1.0)
    signal = slow_variation(time, np.random.default_rng(2), amplitude=0.09, periods=(60.0, 200.0))
    assert np.abs(signal).max() == pytest.approx(0.09)
    assert abs(signal.mean()) < 0.02
    assert np.abs(np.diff(signal)).max() < 3.0 * 0.09 * 2.0 * np.pi / 60.0  # peaks are scaled up by less than three


# Signals by name


def signal(kind, n=600, dt=1.0, seed=0, **settings):
    return make_signal(kind, n, dt, np.random.default_rng(seed), **{"amplitude": 0.1, **settings})


EXAMPLES = {
    "prbs": {"clock_s": 8.0},
    "multisine": {"lines": 10},
    "chirp": {"band_Hz": [0.01, 0.1]},
    "doublet": {"width_s": 20.0},
    "bang_bang": {"hold_s": [10.0, 30.0]},
    "telegraph": {"dwell_s": 10.0},
    "steps": {"hold_s": [10.0, 30.0]},
}


def test_every_kind_has_an_example():
    assert set(EXAMPLES) == set(SIGNALS)


@pytest.mark.parametrize("kind", SIGNALS)
def test_a_signal_keeps_its_amplitude_its_length_and_its_seed(kind):
    one = signal(kind, dt=2.0, **EXAMPLES[kind])
    assert one.shape == (600,)
    assert one.dtype == np.float64
    assert np.abs(one).max() <= 0.1 * (1.0 + 1e-12)
    assert np.abs(one).max() > 0.09
    np.testing.assert_array_equal(one, signal(kind, dt=2.0, **EXAMPLES[kind]))
    np.testing.assert_allclose(signal(kind, dt=2.0, **EXAMPLES[kind], amplitude=0.3), 3.0 * one)


@pytest.mark.parametrize("kind", SIGNALS)
def test_a_signal_begins_and_ends_when_told(kind):
    part = signal(kind, **EXAMPLES[kind], start_s=100.0, duration_s=300.0)
    assert not part[:100].any()
    assert not part[400:].any()
    np.testing.assert_array_equal(part[100:400], signal(kind, 300, **EXAMPLES[kind]))


@pytest.mark.parametrize("kind", ["prbs", "multisine", "bang_bang", "telegraph", "steps"])
def test_another_seed_is_another_signal(kind):
    assert not np.array_equal(signal(kind, **EXAMPLES[kind]), signal(kind, seed=1, **EXAMPLES[kind]))


def test_a_telegraph_signal_dwells_without_memory():
    n, dt, dwell = 400_000, 0.5, 4.0
    values = signal("telegraph", n, dt, amplitude=1.0, dwell_s=dwell)
    assert set(values) == {-1.0, 1.0}
    for k in (1, 3, 8):
        # a mean of n products, correlated over some dwells: standard error below sqrt(dwell / dt / n) = 0.0045
        assert np.mean(values[k:] * values[:-k]) == pytest.approx((1.0 - 2.0 * dt / dwell) ** k, abs=0.018)
    holds = dt * np.diff(np.flatnonzero(np.diff(values)))
    assert holds.mean() == pytest.approx(dwell, rel=0.02)  # 50 000 holds: standard error 0.4 %
    assert np.mean(holds > 2.0 * dwell) == pytest.approx((1.0 - dt / dwell) ** 16, abs=0.01)
    with pytest.raises(ValueError, match="dwell_s above one sample"):
        signal("telegraph", dwell_s=0.5)


@pytest.mark.parametrize("register", [3, 5, 8])
@pytest.mark.parametrize("hold", [1, 4])
def test_prbs_autocorrelation_over_a_period_is_that_of_theory(register, hold):
    """A triangle of one clock to either side, and -A^2/N beyond."""
    bits, dt = 2**register - 1, 0.5
    values = signal("prbs", bits * hold, dt, clock_s=hold * dt, register=register, seed=register)
    found = [values @ np.roll(values, lag) / values.size for lag in range(values.size)]
    lags = np.minimum(np.arange(values.size), values.size - np.arange(values.size)) / hold
    theory = np.where(lags < 1.0, 1.0 - lags * (bits + 1.0) / bits, -1.0 / bits) * 0.1**2
    np.testing.assert_allclose(found, theory, atol=1e-15)


@pytest.mark.parametrize("register", [4, 7])
def test_prbs_spectrum_over_a_period_is_that_of_theory(register):
    """Lines under the squared sinc of the clock: A^2 (N + 1) / N^2 sinc^2(k / N), and A^2 / N^2 at zero."""
    bits, hold = 2**register - 1, 64
    values = signal("prbs", bits * hold, 0.25, clock_s=0.25 * hold, register=register)
    power = np.abs(np.fft.fft(values) / values.size) ** 2
    k = np.arange(1, 2 * bits)
    # so many samples a bit that the sum is an integral up to (pi k / (N hold))^2 / 3, 0.3 % at the last line
    theory = 0.1**2 * (bits + 1.0) / bits**2 * np.sinc(k / bits) ** 2
    np.testing.assert_allclose(power[k], theory, rtol=4e-3, atol=1e-18)
    assert power[0] == pytest.approx(0.1**2 / bits**2)


def test_prbs_repeats_after_its_period_and_not_before():
    values = signal("prbs", 1000, register=5)
    np.testing.assert_array_equal(values[31:], values[:-31])
    assert not any(np.array_equal(values[k:], values[:-k]) for k in range(1, 31))
    longest = signal("prbs", 1000)
    assert not any(np.array_equal(longest[k:], longest[:-k]) for k in range(1, 500))


def test_prbs_begins_with_every_bit_of_its_period():
    starts = {signal("prbs", 7, register=3, seed=seed).tobytes() for seed in range(100)}
    assert len(starts) == 7


@pytest.mark.parametrize("law", ["linear", "log"])
@pytest.mark.parametrize("band", [(0.01, 0.2), (0.2, 0.01)])
def test_chirp_passes_its_frequencies_at_its_own_pace(law, band):
    n, dt = 40_000, 0.05
    values = signal("chirp", n, dt, band_Hz=band, law=law)
    rising = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    middle, frequency = 0.5 * (rising[1:] + rising[:-1]) / n, 1.0 / (dt * np.diff(rising))
    first, last = band
    theory = first + (last - first) * middle if law == "linear" else first * (last / first) ** middle
    # the mean over a cycle, in which the slow end of a chirp changes by some per cent
    np.testing.assert_allclose(frequency, theory, rtol=0.08)
    assert values[0] == pytest.approx(0.0, abs=1e-12)


def test_doublet_by_hand():
    np.testing.assert_allclose(signal("doublet", 8, 2.0, width_s=4.0), [0.1, 0.1, -0.1, -0.1, 0, 0, 0, 0])
    values = signal("doublet", 20, 1.0, width_s=1.0, widths=[3, 2, 1, 1], repeat_s=10.0)
    once = [0.1, 0.1, 0.1, -0.1, -0.1, 0.1, -0.1, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(values, [*once, *once])


def test_bang_bang_by_the_clock_is_a_square_wave():
    np.testing.assert_allclose(signal("bang_bang", 7, 2.0, hold_s=4.0), [0.1, 0.1, -0.1, -0.1, 0.1, 0.1, -0.1])
    decimal = signal("bang_bang", 600, 0.1, hold_s=0.3)  # 0.3 is no sum of three 0.1
    assert (np.diff(np.flatnonzero(np.diff(decimal))) == 3).all()


def test_bang_bang_and_steps_hold_for_the_drawn_times():
    for kind in ("bang_bang", "steps"):
        changes = np.flatnonzero(np.diff(signal(kind, 50_000, 0.1, hold_s=[5.0, 20.0]))) * 0.1
        assert 4.9 < np.diff(changes).min() < 5.5
        assert 19.5 < np.diff(changes).max() < 20.1
    assert set(signal("bang_bang", hold_s=[5.0, 20.0])) == {-0.1, 0.1}
    assert {float(signal("bang_bang", hold_s=[5.0, 20.0], seed=seed)[0]) for seed in range(20)} == {-0.1, 0.1}
    levels = np.unique(signal("steps", 50_000, 0.1, hold_s=5.0))
    assert levels.size == 1000
    assert abs(levels.mean()) < 0.01


@pytest.mark.parametrize(
    "kind, settings, words",
    [
        ("prbz", {}, "No signal 'prbz'. Did you mean 'prbs'"),
        ("prbs", {"clock": 8.0}, r"no setting 'clock'. Did you mean 'clock_s'\? prbs takes amplitude, clock_s, regi"),
        ("prbs", {"clock_s": 2.5}, "clock_s as a whole number of samples of 1 s, got 2.5"),
        ("prbs", {"clock_s": "8"}, "got '8'"),
        ("prbs", {"register": 1}, "2 to 31 bits, got 1"),
        ("prbs", {"register": "x"}, "'prbs' cannot be made of"),
        ("chirp", {}, "'chirp' needs band_Hz: chirp takes amplitude, band_Hz, law"),
        ("chirp", {"band_Hz": [0.0, 0.1]}, "above 0 and up to 0.5"),
        ("chirp", {"band_Hz": [0.1, 0.6]}, "above 0 and up to 0.5"),
        ("chirp", {"band_Hz": 0.1}, "'chirp' cannot be made of"),
        ("chirp", {"band_Hz": [0.01, 0.1], "law": "cubic"}, "'linear' and 'log', got 'cubic'"),
        ("doublet", {"width_s": 5.0, "repeat_s": 9.0}, "takes 10 s, got repeat_s 9"),
        ("doublet", {"width_s": 1.0, "widths": [0.1]}, "widths of at least a sample"),
        ("bang_bang", {"hold_s": [20.0, 5.0]}, "low before high"),
        ("steps", {"hold_s": [0.5, 5.0]}, "from one sample"),
        ("steps", {"hold_s": 5.0, "amplitude": 0.0}, "amplitude > 0"),
        ("steps", {"hold_s": 5.0, "start_s": 600.0}, "after the end at 600 s"),
        ("steps", {"hold_s": 5.0, "start_s": -1.0}, "start_s as a whole number"),
    ],
)
def test_settings_that_do_not_fit_are_refused_by_name(kind, settings, words):
    with pytest.raises(ValueError, match=words):
        signal(kind, **settings)


def test_a_signal_without_an_amplitude_is_refused():
    with pytest.raises(ValueError, match="'prbs' needs amplitude"):
        make_signal("prbs", 10, 1.0, np.random.default_rng(0))
    with pytest.raises(ValueError, match="n >= 1 samples and dt > 0"):
        make_signal("prbs", 0, 1.0, np.random.default_rng(0), amplitude=1.0)
