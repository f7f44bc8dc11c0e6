"""Tests of two times of an effect, from its signatures from each time on."""

import numpy as np
import pytest

from identification.changes.spans import best_spans, spans_of

EDGES, ROWS = 9, 200


@pytest.fixture
def signatures():
    """Of an effect of two components, throughout and from each of nine rows on, (1 + E, 2, n)."""
    own = np.random.default_rng(0).standard_normal((2, ROWS))
    return np.stack([own * (np.arange(ROWS) >= 20 * k) for k in range(EDGES + 1)])


@pytest.mark.parametrize("form", ["between", "outside"])
def test_the_pair_of_most_evidence_is_that_of_a_regression_on_each(signatures, form):
    inside = signatures[3] - signatures[7]
    rng, acting = np.random.default_rng(1), inside if form == "between" else signatures[0] - inside
    left = np.array([0.5, -0.8]) @ acting + rng.standard_normal(ROWS)
    evidence, pair = best_spans(signatures, left, form, one_sided=False)
    assert pair == (3, 7)
    gained = {}
    for first, second in spans_of(range(1, EDGES + 1)):
        own = signatures[first] - signatures[second]
        own = own if form == "between" else signatures[0] - own
        rest = left - own.T @ np.linalg.lstsq(own.T, left, rcond=None)[0]
        gained[first, second] = left @ left - rest @ rest
    assert max(gained, key=gained.__getitem__) == pair
    assert evidence == pytest.approx(gained[pair])


def test_what_works_in_one_direction_only_promises_nothing_in_the_other(signatures):
    one = signatures[:, :1]
    left = (one[2] - one[5])[0]
    assert best_spans(one, left, "between", one_sided=True)[1] == (2, 5)
    assert best_spans(one, -left, "between", one_sided=True)[1] != (2, 5)


def test_a_time_at_which_nothing_shows_promises_nothing(signatures):
    silent = signatures.copy()
    silent[8:] = silent[9]  # between the last two times the effect does nothing
    silent[8] += 1e-9 * np.random.default_rng(2).standard_normal(silent[8].shape)
    evidence, pair = best_spans(silent, silent[8, 0] - silent[9, 0], "between", one_sided=False)
    assert (evidence < 1e-6) or pair != (8, 9)
