"""Tests of all sets of effects that explain a record, and of their probabilities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.param import replace_at, spec_at, value_at
from identification.deciding import FEW_STATES, LEAST_PROBABLE, PRICE, TIE
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search import explanations as module, trials
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.candidates import Candidate
from identification.diagnosis.search.explanations import (
    STOPPED,
    Explanation,
    Explanations,
    explanation,
    explanations,
    likeliest,
    tied_rounds,
)
from identification.diagnosis.search.survival import Survival
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.missions import run_mission
from tests.identification.diagnosis.stand_ins import state_of, trial_of, with_probes
from tests.identification.gliders import QUICK

A, B, C, D, E = (
    f"effects.{name}"
    for name in ("rudder.offset", "rudder.deadband", "yaw.moment", "yaw.roll_moment", "rudder.backlash")
)
PLANT = with_probes(dict.fromkeys((A, B, C, D, E), 3.0)).plant  # none of them is idle
SURVIVED = Survival(1.0, {})


class Told:
    """The evidence of parts; a refit changes nothing."""

    known_score = 0.0

    def __init__(self, evidence):
        self.evidence = evidence

    def refitted(self, counted):
        return np.zeros(0), 0.5 * float(self.evidence[counted].sum())


class Sets:
    """A workbench of six parts in which twice the log-likelihood depends only on the effects of a model.

    likely: one number, shared equally by the parts, or six numbers.
    """

    parts = range(6)
    followed = 2

    def __init__(self, likely: Mapping[str, object]):
        told = {names: np.asarray(v, dtype=float) for names, v in likely.items()}
        self.likely = {frozenset(names): v if v.ndim else np.full(6, v / 6.0) for names, v in told.items()}

    def _of(self, state):
        return self.likely.get(frozenset(state.paths), np.full(6, -1e4))

    def costs(self, state):
        return -self._of(state)

    def by_part(self, state, soon=False):
        return Told(self._of(state))

    def fit_from(self, starts, paths, rival, hopeless):
        return state_of(starts[0][0], *paths)

    def without(self, state, paths):
        return state_of(state.plant, *(p for p in state.paths if p not in paths))

    def worth(self, state, paths):
        return float(self._of(state).sum() - self._of(self.without(state, paths)).sum())


@pytest.fixture(autouse=True)
def no_slopes(monkeypatch):
    monkeypatch.setattr(module, "likenesses", lambda bench, chosen, others: {t.candidate: [] for t in others})


def round_of(path, *tied, before=()):
    """A round that chose an effect beside those before, with the effects tied with it."""
    chosen, *others = (trial_of(Candidate(p, (p,)), state_of(PLANT, *before, p)) for p in (path, *tied))
    return Round((chosen, *others), chosen, tuple(others), {}, before=state_of(PLANT, *before))


def weighed(likely, *rounds, search=lambda state, beside: None, most=3) -> Explanations:
    """The explanations of a record; likely: twice the log-likelihood by the paths of the effects."""
    paths = tuple(r.chosen.candidate.paths[0] for r in rounds)
    return explanations(Sets(likely), state_of(PLANT, *paths), rounds, [SURVIVED] * len(rounds), most, search)  # type: ignore[arg-type]


def odds(found: Explanations, *paths):
    assert found.weights.sum() == pytest.approx(1.0)
    return [found.probability(p) for p in paths]


def test_two_that_do_the_same_are_equally_probable():
    assert odds(weighed({(A,): 100.0, (C,): 100.0}, round_of(A, C)), A, C) == pytest.approx([0.5, 0.5])


def test_three_members_share_the_probability():
    found = weighed({(A,): 100.0, (C,): 100.0, (D,): 100.0}, round_of(A, C, D))
    assert odds(found, A, C, D) == pytest.approx([1 / 3] * 3)
    assert {t.candidate.paths[0] for t in tied_rounds(found, [round_of(A, C, D)], [SURVIVED])[0].tied} == {C, D}


def test_the_weight_is_that_of_the_evidence():
    one, other = odds(weighed({(A,): 100.0, (C,): 96.0}, round_of(A, C)), A, C)
    assert other / one == pytest.approx(np.exp(-2.0))


def test_a_record_that_tells_them_apart_leaves_one():
    made = round_of(A, C)
    found = weighed({(A,): 100.0, (C,): 75.0}, made)
    assert odds(found, A)[0] > 0.999
    assert tied_rounds(found, [made], [SURVIVED])[0].tied == ()


def test_each_of_two_effects_may_be_in_a_tie():
    """All four sets exist, including the one with both effects replaced."""
    likely = {(A, B): 100.0, (C, B): 100.0, (A, E): 100.0, (C, E): 100.0}
    found = weighed(likely, round_of(A, C), round_of(B, E, before=(A,)))
    assert len(found.sets) == 4
    assert found.weights == pytest.approx([0.25] * 4)
    assert odds(found, A, B, C, E) == pytest.approx([0.5] * 4)


def ahead_beside_another():
    """A leads C by more than a tie in the first round, but C explains more beside B, which comes later."""
    made = round_of(A, C)
    return replace(made, tied=()), {(A, B): 100.0, (C, B): 112.0, (C,): 50.0}


@pytest.mark.parametrize("bounds, members", [((-1.0, 1.0), [(C,)]), ((0.5, 1.0), [])])
def test_what_only_a_limit_spoke_against_is_asked_again_beside_what_came_later(bounds, members, monkeypatch):
    """Without B, C was at its limit; beside B, depending on the bounds, it is within them or not."""
    first, later = round_of(A, C), round_of(B, before=(A,))
    chosen, other = first.trials
    first = replace(first, trials=(chosen, replace(other, objection=module.LIMITED)), tied=())
    monkeypatch.setattr(Sets, "problem", SimpleNamespace(bounds=lambda path: bounds), raising=False)
    monkeypatch.setattr(trials, "_held_back", lambda bench, state, path: True)
    found = weighed({(A, B): 100.0, (C, B): 100.0, (C,): 50.0}, first, later)
    (told, _) = tied_rounds(found, [first, later], [SURVIVED] * 2)
    assert [t.candidate.paths for t in told.tied] == members


def test_what_was_behind_in_its_round_may_be_ahead_beside_what_came_later():
    first, likely = ahead_beside_another()
    later = round_of(B, before=(A,))
    found = weighed(likely, first, later)
    assert frozenset(p for c in found.sets[0].candidates for p in c.paths) == {B, C}
    likely = {**likely, (C, B): 99.0}
    (told, _) = tied_rounds(weighed(likely, first, later), [first, later], [SURVIVED] * 2)
    assert [t.candidate.paths for t in told.tied] == [(C,)]


def test_what_was_refused_in_its_round_takes_no_place_later():
    first, likely = ahead_beside_another()
    chosen, other = first.trials
    first = replace(first, trials=(chosen, replace(other, objection="does not hold")))
    assert len(weighed(likely, first, round_of(B, before=(A,))).sets) == 1


def test_in_the_last_round_what_was_behind_stays_behind():
    first, likely = ahead_beside_another()
    assert len(weighed({(A,): 100.0, **likely}, first).sets) == 1


def test_of_a_vehicle_with_many_states_only_ties_take_a_place(monkeypatch):
    monkeypatch.setattr(Sets, "followed", FEW_STATES + 1)
    first, likely = ahead_beside_another()
    assert len(weighed(likely, first, round_of(B, before=(A,))).sets) == 1


def test_effects_that_a_member_makes_needless_are_left_out():
    found = weighed({(A, B): 100.0, (C, B): 101.0, (C,): 100.5}, round_of(A, C), round_of(B, before=(A,)))
    assert frozenset(p for c in found.sets[0].candidates for p in c.paths) == {C}
    assert found.sets[0].cost == pytest.approx(PRICE - 100.5)
    assert odds(found, B)[0] < 0.7


def test_a_member_is_not_lost_because_nothing_was_searched_beside_it():
    """The search found the deadband beside the offset; beside the yaw moment, the backlash is needed instead."""
    likely = {(A, B): 100.0, (C, B): 60.0, (C, E): 100.0}
    rounds = round_of(A, C), round_of(B, before=(A,))
    assert odds(weighed(likely, *rounds), C)[0] < 1e-6
    asked = []

    def search(state, beside):
        asked.append((state.paths, [t.candidate.paths[0] for t in beside]))
        return round_of(E, before=(C,))

    found = weighed(likely, *rounds, search=search)
    assert asked == [((C,), [C])]
    assert odds(found, A, C, E) == pytest.approx([0.5, 0.5, 0.5])


def test_later_effects_are_added_to_what_was_searched_up_to_the_most():
    likely = {(A, B, D): 100.0, (C, B, D): 40.0, (C, E): 80.0, (C, E, D): 110.0}
    rounds = round_of(A, C), round_of(B, before=(A,)), round_of(D, before=(A, B))
    found = weighed(likely, *rounds, search=lambda state, beside: round_of(E, before=(C,)))
    assert found.sets[0].cost == pytest.approx(3 * PRICE - 110.0)
    fewer = weighed(likely, *rounds, search=lambda state, beside: round_of(E, before=(C,)), most=2)
    assert fewer.best_with(E).cost == pytest.approx(2 * PRICE - 80.0)


def test_halves_that_disagree_leave_a_tie_whatever_the_sum_says():
    """One part favours the first by 60, each other part the second by 4: 40 in sum, but half of the halves disagree."""
    made = round_of(A, C)
    found = weighed({(A,): [60.0, 0, 0, 0, 0, 0], (C,): [0.0, 4, 4, 4, 4, 4]}, made)
    assert odds(found, A, C) == pytest.approx([0.5, 0.5], abs=0.01)
    assert tied_rounds(found, [made], [SURVIVED])[0].tied == made.tied


def test_what_halves_choose_instead_is_weighed_too():
    made = replace(round_of(A, C), tied=())
    likely = Sets({(A,): 100.0, (C,): 99.0})
    told = [Survival(0.8, {C: 0.2})]
    found = explanations(likely, made.chosen.state, [made], told, 3, lambda state, beside: None)  # type: ignore[arg-type]
    assert odds(found, C)[0] > 0.3
    assert tied_rounds(found, [made], told)[0].tied == made.trials[1:]


def test_the_least_probability_is_that_of_halves_that_prefer_the_worse_of_two_by_a_tie():
    """The evidence of parts scatters by twice its root, as for a correct model; the sum is the width of a tie."""
    parts = np.random.default_rng(0).normal(0.0, np.sqrt(4.0 * TIE / 6.0), (20000, 6))
    parts += (TIE - parts.sum(axis=1, keepdims=True)) / 6.0
    assert (parts[:, :3].sum(axis=1) < 0.0).mean() == pytest.approx(LEAST_PROBABLE, abs=0.005)


def passing(*refused):
    """A gate that refuses sets with any of these effects."""

    def passes(made: Explanation) -> Explanation | None:
        return None if any(not set(refused).isdisjoint(c.paths) for c in made.candidates) else made

    return passes


def test_the_set_that_explains_more_than_the_chosen_one_is_reported_if_it_passes_the_gate():
    rounds = [round_of(A, C, D), round_of(B, before=(A,))]
    found = weighed({(A, B): 100.0, (C, B): 106.0, (D, B): 103.0}, *rounds)
    reported, left = likeliest(found, rounds, passing())
    assert reported.state.paths == (B, C)
    assert left.sets[0] is reported
    reported, left = likeliest(found, rounds, passing(C))
    assert reported.state.paths == (B, D)
    assert odds(left, C) == [0.0]
    reported, left = likeliest(found, rounds, passing(C, D))
    assert reported.state.paths == (A, B)
    assert odds(left, A) == [1.0]


def test_a_set_is_reported_without_what_is_idle_in_it_if_that_is_likelier_than_the_chosen_one():
    """One fit stopped in a valley and a fit with another effect did not, but neither effect is present."""
    rounds = [round_of(A), round_of(B, C, before=(A,))]
    for alone, paths in ((130.0, (A,)), (90.0, (A, B))):
        likely = {(A, B): 100.0, (A, C): 130.0, (A,): alone}

        def passes(made: Explanation, likely=likely) -> Explanation:
            return explanation(Sets(likely), state_of(PLANT, A), made.rounds[:1])  # type: ignore[arg-type]

        reported, left = likeliest(weighed(likely, *rounds), rounds, passes)
        assert reported.state.paths == paths
        assert len({s.candidates for s in left.sets}) == len(left.sets)


def test_what_stopped_fits_may_make_is_no_reason_to_report_another_set():
    rounds = [round_of(A, C), round_of(B, before=(A,))]
    for more, paths in ((0.9 * STOPPED, (A, B)), (1.1 * STOPPED, (B, C))):
        found = weighed({(A, B): 100.0, (C, B): 100.0 + more}, *rounds)
        assert likeliest(found, rounds, passing())[0].state.paths == paths


def test_a_lost_filter_is_no_explanation():
    lost = state_of(PLANT, C)
    lost.point.scores[:] = -np.inf
    made = round_of(A, C)
    found = weighed({(A,): 100.0, (C,): 100.0}, replace(made, tied=(trial_of(Candidate(C, (C,)), lost),)))
    assert odds(found, A, C) == [1.0, 0.0]


@pytest.fixture(scope="module")
def glider():
    record = run_mission(replace_at(QUICK, {A: 0.05, B: 0.03}), np.random.default_rng(5), duration=900.0)
    bench = Workbench(QUICK, record, parts_of(QUICK, record), 0.1)
    plant = replace_at(bench.plant, {A: 0.05, B: 0.03})
    return bench, bench.fit(plant, (*QUICK.family.coefficients, A, B))


def test_what_an_effect_is_worth_is_the_square_of_its_size_in_standard_errors(glider):
    bench, state = glider
    without = bench.without(state, [A])
    assert bench.worth(state, [A]) > bench.gain(without, state)  # accelerations may absorb the effect
    assert bench.worth(state, [A, B]) > bench.worth(state, [A]) > bench.worth(without, []) == 0.0
    own = bench.by_part(state)
    spread = np.linalg.inv(own.known + own.normals.sum(axis=0))
    row = state.paths.index(A)
    size = (value_at(state.plant, A) - spec_at(state.plant, A).neutral) / bench.problem.scale(A)
    assert bench.worth(state, [A]) == pytest.approx(size**2 / spread[row, row], rel=1e-6)


def test_a_fit_begins_at_the_likeliest_start_and_is_not_finished_where_it_is_hopeless(glider):
    bench, state = glider
    far = replace_at(state.plant, {A: -0.3})
    again = bench.fit_from([(far, state), (state.plant, state)], state.paths, state, 60.0)
    assert bench.gain(state, again) == pytest.approx(0.0, abs=0.5)
    only = tuple(p for p in state.paths if p != A)
    start = [(replace_at(state.plant, A, 0.0), state)]
    settled, fitted = (bench.fit_from(start, only, state, hopeless) for hopeless in (1.0, np.inf))
    assert np.array_equal(settled.point.logs, state.point.logs)
    assert not np.array_equal(fitted.point.logs, state.point.logs)
    assert bench.gain(settled, fitted) > 0.0


def test_a_rival_of_which_nothing_is_left_is_no_member_and_makes_the_effect_needless():
    made = round_of(A, C)
    idle = trial_of(Candidate(C, (C,)), state_of(replace_at(PLANT, C, spec_at(PLANT, C).neutral), C))
    without = replace(made, tied=(idle,), trials=(*made.trials[:1], idle))
    likely = {(A,): 100.0, (C,): 104.0}
    found = weighed(likely, without)
    effect = made.chosen.candidate
    assert found.needless(effect) == pytest.approx(found.probability(C))
    assert found.probability(C) > 0.8
    assert tied_rounds(found, [without], [SURVIVED])[0].tied == ()
    moved = weighed(likely, made)
    assert moved.needless(effect) == 0.0
    assert [t.candidate.paths for t in tied_rounds(moved, [made], [SURVIVED])[0].tied] == [(C,)]
