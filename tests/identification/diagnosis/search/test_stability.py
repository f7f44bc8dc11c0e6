"""Tests of stability selection on regressions with a known truth."""

import numpy as np

from identification.diagnosis.search.stability import select


def regression(seed, sizes, count=40, samples=600, twin=0.0):
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(count, samples))
    columns[1] = twin * columns[0] + np.sqrt(1.0 - twin**2) * columns[1]
    residual = rng.normal(size=samples)
    for k, size in sizes.items():
        residual += size * columns[k]
    return columns, np.empty((0, samples)), residual, np.arange(samples) // 25


def test_what_acts_is_chosen_in_nearly_every_half_and_nothing_else():
    found = select(*regression(0, {3: 0.5, 8: -0.4}), np.random.default_rng(0))
    assert set(np.flatnonzero(found.frequency > 0.8)) == {3, 8}
    assert abs(found.estimate[3] - 0.5) < 0.15
    assert found.evidence[3] == found.evidence.max()


def test_noise_alone_is_never_chosen_stably():
    chosen = [select(*regression(seed, {}), np.random.default_rng(seed)).frequency.max() for seed in range(30)]
    assert max(chosen) < 0.8
    assert np.mean(chosen) < 0.2


def test_two_regressors_nearly_the_same_count_for_each_other():
    found = select(*regression(1, {0: 0.4}, twin=0.98), np.random.default_rng(0))
    assert found.cosine[0, 1] > 0.95
    assert found.frequency[0] == found.frequency[1] > 0.8


def test_what_a_nuisance_does_is_not_found_again():
    columns, _, residual, blocks = regression(2, {5: 1.0})
    found = select(columns, columns[5:6], residual, blocks, np.random.default_rng(0))
    assert found.frequency[5] == 0.0
    assert found.evidence[5] == 0.0
    assert found.frequency.max() < 0.8
