"""Tests of what counts as a tie, on both sides of each bar."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from identification.diagnosis.search import acceptance
from identification.diagnosis.search.candidates import Candidate
from identification.diagnosis.search.ties import Likeness, cheaper_rival, least_cost_trial, tied
from tests.identification.diagnosis.stand_ins import PLANT, state_of, trial_of

FIRST, SECOND = (Candidate(p, (p,)) for p in ("effects.rudder.offset", "effects.yaw.moment"))
APART = Likeness(0.5, (1.0,), 100.0, {})


@dataclass
class Costs:
    """A workbench with a given cost of each state in each window."""

    of: dict = field(default_factory=dict)

    def trial(self, candidate, costs, objection=""):
        state = state_of(PLANT, *candidate.paths)
        self.of[state] = np.asarray(costs, dtype=float)
        return trial_of(candidate, state, objection)

    def costs(self, state):
        return self.of[state]

    @property
    def problem(self):
        class Problem:
            index = {p: i for i, p in enumerate((*FIRST.paths, *SECOND.paths))}

        return Problem


@pytest.mark.parametrize(
    "extra, objection, is_tied",
    [
        (8.9, "", True),
        (9.1, "", False),
        (6.0, acceptance.UNREPEATED, False),
        (-0.1, acceptance.UNREPEATED, True),
        (6.0, acceptance.INSIGNIFICANT, False),
        (-0.1, acceptance.UNSURE, False),
    ],
)
def test_a_few_windows_tie_by_evidence_and_by_why_the_other_one_was_refused(extra, objection, is_tied):
    bench = Costs()
    best, other = bench.trial(FIRST, [10.0] * 4), bench.trial(SECOND, [10.0 + extra / 4] * 4, objection)
    assert bool(tied(bench, best, other, [APART])) is is_tied


@pytest.mark.parametrize(
    "likeness, is_tied",
    [
        (Likeness(0.95, (1.0,), 8.9, {}), True),
        (Likeness(0.95, (1.0,), 9.1, {}), False),
        (Likeness(1.0 - 1e-6, (1.0,), 1e4, {}), True),
        (Likeness(1.0 - 3e-6, (1.0,), 1e4, {}), False),
    ],
)
def test_signatures_that_hardly_differ_tie_whatever_the_fits_reached(likeness, is_tied):
    bench = Costs()
    best, other = bench.trial(FIRST, [0.0] * 4), bench.trial(SECOND, [100.0] * 4)
    assert bool(tied(bench, best, other, [APART, likeness])) is is_tied


def test_what_was_never_fitted_ties_with_nothing():
    bench = Costs()
    assert not tied(bench, bench.trial(FIRST, [0.0] * 4), trial_of(SECOND), [Likeness(1.0, (1.0,), 0.0, {})])


def test_a_rival_takes_the_lead_only_by_more_than_a_tie():
    bench = Costs()
    chosen, rival = bench.trial(FIRST, [10.0] * 4), bench.trial(SECOND, [10.0 - 8.9 / 4] * 4)
    assert cheaper_rival(bench, chosen, [rival]) is chosen
    better = bench.trial(SECOND, [10.0 - 9.1 / 4] * 4)
    assert cheaper_rival(bench, chosen, [rival, better]) is better
    assert cheaper_rival(bench, chosen, []) is chosen


def test_of_equals_the_first_in_the_vehicles_order_is_the_best():
    bench = Costs()
    second, first = bench.trial(SECOND, [1.0] * 4), bench.trial(FIRST, [1.002] * 4)
    assert least_cost_trial(bench, [second, first]) is first
    first = bench.trial(FIRST, [1.003] * 4)
    assert least_cost_trial(bench, [second, first]) is second
