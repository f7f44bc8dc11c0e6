"""Tests of pairs: effects that show only together, their screening, and the gate for the best pair."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from identification.diagnosis import diagnose
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search import pairs, trials
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.candidates import Candidate, Screening, candidates_of, screen, screen_pairs
from identification.diagnosis.search.pairs import best_pair
from identification.diagnosis.search.swaps import Reconsidering
from identification.diagnosis.search.trials import Trial
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.missions import run_mission
from tests.identification.diagnosis.stand_ins import PLANT, Table, state_of, trial_of, with_probes
from tests.identification.gliders import QUICK

OFFSET, LAG, MOMENT = "effects.rudder.offset", "effects.compass.lag", "effects.yaw.moment"
A, B, C = (Candidate(path, (path,)) for path in (OFFSET, LAG, MOMENT))
COUNT = 18  # candidates
COEFFICIENTS = PLANT.family.coefficients
TRUE = {"effects.rudder.deadband": 0.12, "effects.rudder.lost_travel": 0.25}


@pytest.fixture(scope="module")
def log():
    """A log of a glider whose rudder has a deadband and saturates early."""
    return run_mission(replace_at(QUICK, TRUE), np.random.default_rng(2), duration=1200.0)


@pytest.fixture(scope="module")
def screened(log):
    bench = Workbench(QUICK, log, parts_of(QUICK, log), 0.1)
    state = bench.fit(QUICK, QUICK.family.coefficients)
    candidates = candidates_of(QUICK, log)
    found = screen_pairs(bench.problem, state.point, state.paths, candidates, 10.0, 10_000, None)
    return bench, state, candidates, found


def test_a_pair_promises_at_least_what_each_of_it_does(screened):
    bench, state, candidates, found = screened
    alone = {s.candidate: s.evidence for s in screen(bench.problem, state.point, state.paths, candidates, 10.0)}
    best = max(alone.values())
    assert found[0][0].evidence >= best
    assert [w.evidence for w, _ in found] == sorted((w.evidence for w, _ in found), reverse=True)
    smooth = [(w, parts) for w, parts in found if not any(s.candidate.kinked for s in parts)]
    assert smooth
    for whole, parts in smooth:
        assert whole.candidate.paths == parts[0].candidate.paths + parts[1].candidate.paths
        assert whole.evidence >= max(alone[s.candidate] for s in parts) - 1e-6


def test_a_pair_in_the_place_of_an_effect_promises_more_than_it(screened):
    bench, state, candidates, _ = screened
    alone = [s for s in screen(bench.problem, state.point, state.paths, candidates, 10.0) if s.evidence > 0.0]
    one = alone[len(alone) // 2]
    left = [c for c in candidates if c is not one.candidate]
    every = screen_pairs(bench.problem, state.point, state.paths, left, 10.0, 10_000, None)
    more = screen_pairs(bench.problem, state.point, state.paths, left, 10.0, 10_000, one.candidate)
    assert 0 < len(more) < len(every)
    assert [w.candidate for w, _ in more] == [w.candidate for w, _ in every if w.evidence > one.evidence]


def test_no_pair_has_an_effect_in_the_direction_that_it_cannot_have(screened):
    *_, found = screened
    kinked = [
        estimate
        for whole, parts in found
        for candidate in (s.candidate for s in parts)
        if candidate.kinked
        for path, estimate in zip(whole.candidate.paths, whole.estimate, strict=True)
        if path in candidate.paths
    ]
    assert kinked
    assert min(kinked) >= 0.0


def test_two_that_act_alike_are_no_pair(screened):
    """A rudder offset and a constant moment turn the vehicle alike; a pair of them would mean neither."""
    *_, found = screened
    sets = [set(whole.candidate.paths) for whole, _ in found]
    assert sets
    assert {OFFSET, MOMENT} not in sets


@pytest.mark.slow
@pytest.mark.parametrize("way", ["paired", "paired_instead"])
def test_two_effects_of_one_rudder_are_both_named(log, monkeypatch, way):
    """Pairs are tried beside the effect found first, and instead of it; each way finds these two."""
    monkeypatch.setattr(Reconsidering, way, lambda self, state, rounds: (state, rounds))
    found = diagnose(log, QUICK)
    assert {e.path for e in found.effects} == set(TRUE)
    for path, size in TRUE.items():
        assert value_at(found.after.plant, path) == pytest.approx(size, rel=0.15)


@pytest.mark.parametrize(
    "likely, found",
    [
        ({}, {OFFSET, LAG}),
        ({"together": (200.0, 52.4)}, set()),  # beside the second, the first has -27.6 from parts
        ({"together": (95.0, 84.0), "second": (90.0, 80.0)}, set()),  # the second alone does nearly as well
        ({"together": (200.0, 0.0), "second": (20.0, -20.0)}, set()),  # the pair as a whole does not hold
    ],
)
def test_a_pair_is_taken_up_only_if_it_passes_as_one_change_and_by_members(monkeypatch, likely, found):
    bench, both = promising(monkeypatch, **likely)
    pair = best_pair(bench, state_of(PLANT, *COEFFICIENTS), (A, B), COUNT, None)
    assert {p for t in pair or () for p in t.candidate.paths} == found
    assert all(t.state is both for t in pair or ())


def test_a_pair_is_for_the_search_that_has_room_for_two(monkeypatch):
    bench, both = promising(monkeypatch)
    start, last = state_of(PLANT, *COEFFICIENTS), Round((), None, (), {})
    monkeypatch.setattr(Reconsidering, "swapped", lambda self, state, rounds, new: (state, rounds))
    after, rounds = Reconsidering(bench, (A, B, C), 2, ()).paired(start, [last])
    assert {p for p in after.paths if p.startswith("effects.")} == {OFFSET, LAG}
    assert [r.chosen.candidate for r in rounds] == [A, B]
    before = Round((), trial_of(C, start), (), {})
    assert Reconsidering(bench, (A, B, C), 2, ()).paired(start, [before, last]) == (start, [before, last])


@pytest.mark.parametrize("alone, room, better", [(150.0, 2, True), (190.0, 2, False), (150.0, 1, False)])
def test_a_pair_takes_an_effects_place_where_it_is_likelier_by_more_than_chance(monkeypatch, alone, room, better):
    """Three candidates have three pairs: by chance, an evidence of 9.9 occurs once in 200 times."""
    bench, _ = promising(monkeypatch)
    bench.likely[frozenset({MOMENT})] = (alone, alone)
    single = with_probes({MOMENT: 5.0}, *COEFFICIENTS)
    monkeypatch.setattr(Reconsidering, "swapped", lambda self, state, rounds, new: (state, rounds))
    rounds = [Round((), trial_of(C, single), (), {}), Round((), None, (), {})]
    after, found = Reconsidering(bench, (A, B, C), room, ()).paired_instead(single, rounds)
    assert {p for p in after.paths if p.startswith("effects.")} == ({OFFSET, LAG} if better else {MOMENT})
    assert [r.chosen.candidate for r in found if r.chosen] == ([A, B] if better else [C])


def test_of_a_pair_each_is_compared_with_all_others_in_its_place(monkeypatch):
    """The comparison finds effects tied with a member, and better ones beside the other member."""
    bench, both = promising(monkeypatch)
    asked = []

    def selected(self, state, chosen):
        asked.append((set(state.paths), [t.candidate for t in chosen]))
        (own,) = {A, B} - {t.candidate for t in chosen}
        trial = Trial(own, both, 100.0, 90.0, trial_of(own).screening, "")
        return Round((trial,), trial, (trial_of(C, both),), {})

    monkeypatch.setattr(Reconsidering, "_selected", selected)
    last = Round((), None, (), {})
    _, rounds = Reconsidering(bench, (A, B, C), 3, ()).paired(state_of(PLANT, *COEFFICIENTS), [last])
    assert asked == [({*COEFFICIENTS, LAG}, [B]), ({*COEFFICIENTS, OFFSET}, [A])]
    assert [[t.candidate for t in r.tied] for r in rounds] == [[C], [C]]


def promising(monkeypatch, together=(200.0, 100.0), first=(20.0, 1.0), second=(90.0, 80.0)):
    """A table of two effects whose pair is the only result of the screening, and the state with both."""
    likely = {frozenset(): (0.0, 0.0), frozenset({OFFSET}): first, frozenset({LAG}): second}
    bench = Table(likely | {frozenset({OFFSET, LAG}): together})
    both = with_probes({OFFSET: 5.0, LAG: 5.0}, *COEFFICIENTS)
    whole = Screening(Candidate("both", (OFFSET, LAG)), np.ones(2), 50.0, 1.0, np.ones(2))
    parts = tuple(replace(whole, candidate=c) for c in (A, B))
    bench.quieted = lambda state: ()
    monkeypatch.setattr(pairs, "screen_pairs", lambda *_: [(whole, parts)])

    def finished(bench, state, begun, count):
        said = pairs.gate(bench, state, both, [(whole.candidate, whole)], count)
        return [Trial(whole.candidate, both, said.train, said.held, whole, said.objection)]

    monkeypatch.setattr(pairs, "begun_from", lambda bench, state, *_: trials.Begun(whole, both, 50.0))
    monkeypatch.setattr(pairs, "all_finished", finished)
    return bench, both


def test_a_pair_that_promises_next_to_nothing_after_a_few_steps_is_not_fitted(screened, monkeypatch):
    """If a pair is begun from several bases, the one that promises most is fitted."""
    bench, state, candidates, found = screened
    pair, count = found[0], len(candidates)
    bar = trials.threshold(count * (count - 1) // 2, 2)
    bases = [state, state]
    bench = SimpleNamespace(problem=bench.problem, with_given=lambda s: bases[1:], quieted=lambda s: ())
    monkeypatch.setattr(pairs, "screen_pairs", lambda *_: [pair])
    monkeypatch.setattr(pairs, "rival_of", lambda *_: state)
    fitted = []
    monkeypatch.setattr(pairs, "all_finished", lambda bench, state, begun, count: fitted.append(list(begun)) or [])
    for promises, kept in (((0.19, 0.1), []), ((0.21, 0.3), [0.3]), ((0.4, 0.3), [0.4]), ((np.nan, 0.1), [])):
        left = list(promises)
        begun = lambda *_, left=left: trials.Begun(pair[0], state, left.pop(0) * bar)  # noqa: E731
        monkeypatch.setattr(pairs, "begun_from", begun)
        assert pairs.best_pair(bench, state, candidates, count, None) is None
        assert [one.promise / bar for one in fitted.pop()] == pytest.approx(kept)
