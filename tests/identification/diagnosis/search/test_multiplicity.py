"""Tests of the level of each of many correlated tests, by independent simulation."""

import numpy as np
import pytest
from scipy.stats import chi2

from identification.diagnosis.search.multiplicity import level_of_each, summed_up


def correlated(rng, rows=60):
    """Steps at neighbouring places, which are nearly the same, and some unrelated signatures."""
    steps = (np.arange(200)[None] > np.linspace(20, 180, rows)[:, None]).astype(float)
    return np.vstack([steps, rng.standard_normal((5, 200))])


@pytest.mark.parametrize("level", [0.01, 0.05])
def test_all_together_are_wrong_as_often_as_is_asked(level):
    rng = np.random.default_rng(7)
    signatures = correlated(rng)
    each = level_of_each(signatures, level)
    assert each > 1.5 * level / len(signatures)  # that of Bonferroni assumes unrelated tests
    units = signatures / np.linalg.norm(signatures, axis=1)[:, None]
    squares = (units @ rng.standard_normal((200, 20000))) ** 2
    wrong = float((chi2.sf(squares.max(axis=0), 1) < each).mean())
    assert wrong == pytest.approx(level, rel=0.4)


def test_what_is_tried_twice_counts_once_and_what_is_unrelated_each_time():
    rng = np.random.default_rng(8)
    same = np.repeat(rng.standard_normal((1, 50)), 40, axis=0)
    assert level_of_each(same, 0.05) == pytest.approx(0.05, rel=0.2)
    assert level_of_each(np.eye(40), 0.05) == pytest.approx(0.05 / 40, rel=0.25)
    assert level_of_each(np.zeros((0, 5)), 0.05) == 0.05


def test_long_signatures_are_summed_up_with_nearly_the_same_products():
    signatures = correlated(np.random.default_rng(9))
    assert summed_up(signatures) is signatures
    long = np.repeat(signatures, 50, axis=1)
    short = summed_up(long)
    assert short.shape == (len(long), 400)
    assert level_of_each(short, 0.05) == pytest.approx(level_of_each(signatures, 0.05), rel=0.3)
    units = short / np.linalg.norm(short, axis=1)[:, None]
    exact = signatures / np.linalg.norm(signatures, axis=1)[:, None]
    assert np.abs(units @ units.T - exact @ exact.T).max() < 0.25
