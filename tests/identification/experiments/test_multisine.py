import numpy as np
import pytest

from identification.experiments.multisine import crest_factor, low_crest_phases, multisine


def sample(n=600, dt=1.0, seed=0, **settings):
    return multisine(n, dt, np.random.default_rng(seed), **{"amplitude": 0.2, **settings})


def power_by_line(signal):
    return 2.0 * np.abs(np.fft.rfft(signal) / signal.size) ** 2


@pytest.mark.parametrize("lines", [3, 5, 8, 12, 20, 35])
@pytest.mark.parametrize("n", [600, 6000])
def test_crest_factor_of_many_lines(lines, n):
    """Drawn phases have 2.5 to 3.3, Schroeder's 1.7 to 2.1; two lines cannot do better than 1.7."""
    assert crest_factor(sample(n, lines=lines)) < 1.7


def test_twenty_lines_have_a_low_crest_factor_wherever_they_are():
    for lines in (range(1, 21), range(1, 40, 2), range(31, 51), [*range(1, 11), *range(40, 60, 2)]):
        assert crest_factor(sample(4000, lines=list(lines))) < 1.7


def test_one_and_two_lines_reach_their_least_crest_factor():
    assert crest_factor(sample(lines=1)) == pytest.approx(np.sqrt(2.0), rel=1e-3)
    time = np.linspace(0.0, 2.0 * np.pi, 2000)
    waves = [np.cos(time) + np.cos(2.0 * time + phase) for phase in np.linspace(0.0, np.pi, 500)]
    assert crest_factor(sample(4000, lines=2)) == pytest.approx(min(map(crest_factor, waves)), abs=0.01)


def test_power_is_equal_on_the_chosen_lines_and_nowhere_else():
    power = power_by_line(sample(lines=[2, 3, 7, 11]))
    chosen = power[[2, 3, 7, 11]]
    np.testing.assert_allclose(chosen, chosen[0])
    assert chosen.sum() == pytest.approx(power.sum())


def test_shares_are_the_ratios_of_the_sines():
    amplitudes = np.sqrt(power_by_line(sample(lines=[1, 4, 5], shares=[1.0, 2.0, 0.5])))
    np.testing.assert_allclose(amplitudes[[1, 4, 5]] / amplitudes[1], [1.0, 2.0, 0.5])


def test_lines_of_a_band_are_within_it_and_reach_its_ends():
    power = power_by_line(sample(800, 4.0, lines=10, band_Hz=(0.01, 0.05)))
    lines = np.flatnonzero(power > 1e-12)
    assert lines.size == 10
    assert lines[0] / 3200.0 == pytest.approx(0.01)
    assert lines[-1] / 3200.0 == pytest.approx(0.05)


def test_a_shorter_period_repeats():
    signal = sample(650, 0.5, lines=5, period_s=100.0)
    np.testing.assert_array_equal(signal[:450], signal[200:])
    assert np.abs(signal).max() == pytest.approx(0.2)


def test_signals_on_odd_and_even_lines_are_uncorrelated():
    odd, even = sample(lines=list(range(1, 20, 2)), seed=1), sample(lines=list(range(2, 21, 2)), seed=2)
    assert abs(odd @ even) < 1e-10 * np.sqrt((odd @ odd) * (even @ even))


def test_another_draw_is_the_same_waveform_from_another_sample_on():
    one, two = sample(seed=0), sample(seed=1)
    assert not np.array_equal(one, two)
    shift = next(k for k in range(one.size) if np.allclose(np.roll(one, k), two))
    assert shift > 0
    np.testing.assert_array_equal(one, sample(seed=0))


def test_phases_are_shared_and_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        low_crest_phases((1, 2, 3), (1.0, 1.0, 1.0), 64)[0] = 1.0


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"lines": 300}, "lines below 300"),
        ({"lines": 0}, "1 line or more"),
        ({"lines": [1, 1, 2]}, "different whole numbers"),
        ({"lines": [0, 2]}, "from 1 on"),
        ({"lines": [1.5]}, "whole numbers"),
        ({"lines": [1, 2], "band_Hz": (0.01, 0.1)}, "without band_Hz"),
        ({"lines": 20, "band_Hz": (0.01, 0.02)}, "of which 7 lie within"),
        ({"lines": 2, "shares": [1.0]}, "share above 0 for each of 2 lines"),
        ({"lines": 2, "shares": [1.0, 0.0]}, "share above 0"),
        ({"period_s": 700.0}, "no longer than 600 s"),
        ({"period_s": 99.5}, "whole number of samples"),
    ],
)
def test_what_cannot_be_made_is_refused(settings, words):
    with pytest.raises(ValueError, match=words):
        sample(**settings)


def test_a_signal_without_power_has_no_crest_factor():
    with pytest.raises(ValueError, match="not zero throughout"):
        crest_factor(np.zeros(5))
