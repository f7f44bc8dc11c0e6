"""Tests of sequential tests: their sums, and their rate of false alarms in white noise."""

import numpy as np
import pytest
from scipy.stats import poisson

from identification.monitor.bank import CLIP, LEAST, Bank, bars_for, memories

NONE = np.zeros(0)


def test_sums_are_those_of_their_definition_also_where_readings_are_missing():
    rng, lasting = np.random.default_rng(0), np.array([3.0])
    e, u = rng.standard_normal((40, 2)), rng.standard_normal((40, 1))
    e[5:9, 1] = np.nan
    bank = Bank(lasting, np.array([0]), 2)
    for k in range(40):
        bank.take(e[k], np.ones(2), u[k], NONE)
    weights, decay = np.exp(-np.arange(40)[::-1] / 3.0), np.exp(-1.0 / 3.0)
    means, weight, mean = [], 0.0, 0.0
    for value in u[:, 0]:  # of the past
        means.append(mean)
        weight = decay * weight + 1.0
        mean += (value - mean) / weight
    moved = u[:, 0] - means
    moved[0] = 0.0
    for j, factor in enumerate((np.ones(40), moved)):
        for c in range(2):
            there = np.isfinite(e[:, c])
            total = (weights * factor * np.where(there, e[:, c], 0.0)).sum()
            np.testing.assert_allclose(bank.squares[0, j, c], total**2 / ((weights * factor)[there] ** 2).sum())


def plainly(innovations, signals, lasting, inflation):
    """The squares and what is greatest after each sample, in the order of the sums as they are defined."""
    (count, channels), number = innovations.shape, 1 + signals.shape[1]
    sums, own = np.zeros((len(lasting), number, 2, channels)), np.zeros((len(lasting), 3, channels))
    means, weights = np.zeros((len(lasting), number)), np.zeros(len(lasting))
    for k in range(count):
        there = np.isfinite(innovations[k]).astype(float)
        e = np.clip(np.where(there > 0.0, innovations[k], 0.0), -CLIP, CLIP)
        squares, told = np.zeros((len(lasting), number + 1, channels)), [0.0] * 6
        for s, decay in enumerate(np.exp(-1.0 / lasting)):
            weights[s] = decay * weights[s] + 1.0
            for j in range(number):
                factor = 1.0
                if j > 0:
                    apart = signals[k, j - 1] - means[s, j]
                    means[s, j] += apart / weights[s]
                    factor = apart if weights[s] > 1.0 else 0.0
                sums[s, j, 0] = decay * sums[s, j, 0] + factor * e
                sums[s, j, 1] = decay * decay * sums[s, j, 1] + factor * factor * there
                squares[s, j] = sums[s, j, 0] ** 2 * (1.0 / inflation[s, 0]) / (sums[s, j, 1] + LEAST)
                pooled, single = sum(squares[s, j].tolist()), squares[s, j].max()
                told[:3] = (pooled, s, j) if pooled > told[0] else told[:3]
                told[3:] = (single, s, j) if single > told[3] else told[3:]
            for row, own_share in enumerate((e * e, there, there)):
                own[s, row] = (decay * decay if row == 2 else decay) * own[s, row] + own_share
            above = own[s, 0] > own[s, 1]
            spread = 2.0 * own[s, 2, above] / (9.0 * own[s, 1, above] ** 2)
            z = np.cbrt(own[s, 0, above] / own[s, 1, above]) - 1.0 + spread
            squares[s, number, above] = z * z / spread * (1.0 / inflation[s, 1, above])
            single = squares[s, number].max()
            told[3:] = (single, s, number) if single > told[3] else told[3:]
        yield squares, told


def test_sums_have_every_bit_of_plain_loops():
    """However the compiled loops are nested: alarms must not depend on that."""
    rng, lasting = np.random.default_rng(3), memories(40.0)
    e, u = rng.standard_normal((60, 5)), np.cumsum(rng.standard_normal((60, 3)), axis=0)
    e[rng.random(e.shape) < 0.2], e[20, 1] = np.nan, 9.0
    inflation = rng.uniform(1.0, 1.5, (len(lasting), 2, 5))
    bank = Bank(lasting, np.array([1, 0, 2]), 5, inflation)
    for k, (squares, told) in enumerate(plainly(e, u[:, [1, 0, 2]], lasting, inflation)):
        bank.take(e[k], np.ones(5), u[k, :2], u[k, 2:])
        np.testing.assert_array_equal(bank.squares[:, :-1], squares[:, :-1])
        np.testing.assert_allclose(bank.squares[:, -1], squares[:, -1], rtol=1e-12)  # cube roots differ by a rounding
        np.testing.assert_allclose(bank.told, told, rtol=1e-12)
        assert bank.told[0] == told[0]


@pytest.mark.slow
def test_white_noise_raises_alarms_at_the_stated_rate():
    rng, rate, count = np.random.default_rng(1), 2e-4, 150_000
    signals = np.cumsum(rng.standard_normal((5000, 2)), axis=0)
    bank = Bank(memories(100.0), np.arange(2), 3)
    bars = bars_for(bank, signals, np.ones((5000, 3), bool), rate, np.random.default_rng(2))
    alarms, e, scales = 0, rng.standard_normal((count, 3)), np.ones(3)
    for k in range(count):
        bank.take(e[k], scales, signals[k % 5000], NONE)
        if bank.told[0] > bars.pooled or bank.told[3] > bars.single:
            alarms += 1
            bank.clear()
    low, high = poisson.ppf([0.005, 0.995], rate * count)
    assert low <= alarms <= high


def test_one_outlier_raises_no_alarm_and_a_lasting_offset_does():
    bank = Bank(memories(100.0), np.arange(0), 1)
    signals = np.zeros((100, 0))
    bars = bars_for(bank, signals, np.ones((100, 1), bool), 1e-6, np.random.default_rng(2))
    bank.take(np.array([1e3]), np.ones(1), NONE, NONE)
    assert bank.told[3] < bars.single
    bank.clear()
    for _ in range(200):
        bank.take(np.array([0.7]), np.ones(1), NONE, NONE)
    assert bank.told[3] > bars.single
