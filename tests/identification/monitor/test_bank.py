"""Tests of sequential tests: their sums, and their rate of false alarms in white noise."""

import numpy as np
import pytest
from scipy.stats import poisson

from identification.monitor.bank import Bank, bars_for, memories

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
