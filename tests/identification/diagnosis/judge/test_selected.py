"""Tests of intervals after selection: for effects that passed the bar they contain the truth at the stated rate."""

import numpy as np
import pytest

from identification.diagnosis.judge.selected import conditional_limits, selected_interval

LEAST = 4.47  # standard errors: the root of the bar with a hundred candidates


@pytest.mark.parametrize("mean", [2.0, 3.5, 4.5, 5.5, 8.0])
def test_intervals_of_what_passed_hold_the_truth(mean):
    """The usual intervals contain 0 of the first, 60 % of the second, and 95 % of the last."""
    seen = np.random.default_rng(1).normal(mean, 1.0, 400_000)
    seen = seen[seen > LEAST][:400]
    held = [low <= mean <= high for low, high in (conditional_limits(float(z), LEAST, LEAST) for z in seen)]
    assert np.mean(held) == pytest.approx(0.95, abs=4.0 * np.sqrt(0.95 * 0.05 / len(held)))


def test_they_never_hold_what_the_bar_excludes_and_are_the_usual_ones_far_above_it():
    for size in (4.47, 4.6, 5.0, 6.0):
        assert conditional_limits(size, LEAST, LEAST)[0] >= 0.0
    assert conditional_limits(12.0, LEAST, LEAST) == pytest.approx((12.0 - 1.97, 12.0 + 1.97), abs=0.02)


@pytest.mark.parametrize("mean", [1.0, 2.5, 3.5, 6.0])
def test_intervals_hold_the_truth_where_evidence_says_too_much(mean):
    """The errors are 1.5 times as large as the likelihood says; no interval reaches beyond neutral."""
    seen = np.random.default_rng(2).normal(mean, 1.0, 400_000)
    seen = seen[1.5 * seen > LEAST][:400]
    found = [selected_interval(z, 0.0, (z - 1.96, z + 1.96), (1.5 * z) ** 2, LEAST**2) for z in seen.tolist()]
    held = np.mean([low <= mean <= high for low, high in found])
    assert 0.95 - 4.0 * np.sqrt(0.95 * 0.05 / len(found)) < held < 0.985  # more if the estimate itself is an end
    assert min(low for low, _ in found) > -1e-9


def test_an_interval_keeps_its_shape_its_side_and_its_value():
    bar, above = LEAST**2, 5.0**2
    low, high = selected_interval(3.0, 1.0, (2.2, 4.0), above, bar)
    assert 1.0 < low < 2.2
    assert 3.0 <= high < 4.0
    mirrored = selected_interval(-1.0, 1.0, (-2.0, -0.2), above, bar)
    assert mirrored == pytest.approx((2.0 - high, 2.0 - low))
    low, high = selected_interval(3.0, 1.0, (2.2, 4.0), 20.0**2, bar)
    assert (low, high) == pytest.approx((2.2, 4.0), abs=0.01)
    low, high = selected_interval(3.0, 1.0, (2.2, 4.0), bar + 0.01, bar)
    assert low < 3.0 <= high  # sizes here are more often overestimated than not
