"""Tests of the gate: each reason to refuse a change, each route to the gate, and effects that fail beside others."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import load_vehicle
from identification.diagnosis import diagnose
from identification.diagnosis.judge import holding, remaining, reporting, scoring
from identification.diagnosis.judge.result import LEANS, RARE, WORSE
from identification.diagnosis.judge.sizes import coefficient_of, size_as_effect, twin_effects
from identification.diagnosis.search import acceptance, searching, trials
from identification.diagnosis.search.acceptance import EFFECT, TERM, Claim, Size, at_limit, objection
from identification.diagnosis.search.attribution import Round, attribute, confirmed, without_idle_parts
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate, Screening
from identification.diagnosis.search.discovery import Discovery
from identification.diagnosis.search.remainder import Left
from identification.diagnosis.search.survival import Survival
from identification.diagnosis.search.swaps import Reconsidering
from identification.diagnosis.search.trials import Trial, gate
from identification.diagnosis.search.workbench import State
from identification.experiments.missions import run_mission
from tests.identification.diagnosis.stand_ins import (
    PLANT,
    Table,
    point_of,
    round_of,
    state_of,
    trial_of,
    with_probes,
)

OFFSET, LAG, MOMENT = "effects.rudder.offset", "effects.compass.lag", "effects.yaw.moment"
A, B, C = (Candidate(path, (path,)) for path in (OFFSET, LAG, MOMENT))
COUNT = 18  # candidates
COEFFICIENTS = PLANT.family.coefficients


def sure(**changes) -> Claim:
    """A claim without objections, except for these changes."""
    good = Claim(
        train=100.0,
        held=50.0,
        bar=20.0,
        sizes=[Size(5.0, False)],
        reach=lambda: [1.0],
        flies=lambda: True,
    )
    return replace(good, **changes)


@pytest.mark.parametrize(
    "changes, reason",
    [
        ({}, ""),
        ({"bar": 150.1}, "not significant"),
        ({"train": 10.0, "held": 9.9}, "not significant"),
        ({"train": float("nan")}, "not significant"),
        ({"held": -27.6}, "does not hold from one part of the log to the others"),
        ({"held": 2.6}, "does not hold from one part of the log to the others"),
        ({"train": 1000.0, "held": 19.9}, "does not hold from one part of the log to the others"),
        ({"train": 1000.0, "held": 20.1}, ""),
        ({"known": 20.1, "held": -2.6}, ""),  # the priors of coefficients suffice, and no part contradicts them
        ({"known": 20.1, "held": -2.8}, "does not hold from one part of the log to the others"),
        ({"known": 19.9, "held": 1.9}, "does not hold from one part of the log to the others"),
        ({"flies": lambda: False}, "free runs diverge with it"),
        ({"sizes": [Size(5.0, True)]}, "helps only at the limit of its physical or known range"),
        ({"reach": lambda: [1.96 * 5.0 / 3.01]}, ""),  # three standard errors
        ({"reach": lambda: [1.96 * 5.0 / 2.99]}, "its size is too uncertain"),
    ],
)
def test_every_reason_to_refuse_is_given_when_it_is_the_only_one(changes, reason):
    found = objection(sure(**changes))
    assert found.startswith(reason)
    assert bool(found) == bool(reason)


def test_one_component_of_two_is_enough_but_none_may_be_at_a_limit():
    small, large = Size(0.1, False), Size(5.0, False)
    assert objection(sure(sizes=[small, large], reach=lambda: [1.0, 1.0])) == ""
    assert objection(sure(sizes=[large, replace(small, limited=True)], reach=lambda: [1.0, 1.0])) == acceptance.LIMITED
    assert objection(sure(sizes=[small, small], reach=lambda: [1.0, 1.0])) == acceptance.UNSURE


def test_a_term_needs_more_in_the_held_out_windows():
    assert objection(sure(held=9.0, train=40.0), EFFECT) == objection(sure(held=9.0, train=40.0), TERM) == ""
    assert objection(sure(held=6.5, train=40.0), EFFECT) == ""
    assert objection(sure(held=6.5, train=40.0), TERM) == acceptance.UNREPEATED
    assert objection(sure(held=9.0, train=100.0), TERM) == acceptance.UNREPEATED


def test_what_is_costly_is_asked_only_of_what_passed_all_else():
    def never():
        raise AssertionError("asked in vain")

    assert objection(sure(held=-1.0, reach=never, flies=never)) == acceptance.UNREPEATED
    assert objection(sure(sizes=[Size(0.5, True)], reach=never, flies=never)) == acceptance.LIMITED
    assert objection(sure(reach=lambda: [10.0], flies=never)) == acceptance.UNSURE


def test_a_filter_that_never_came_to_an_end_is_no_evidence():
    lost = State(PLANT, (OFFSET,), point_of([0.0, -np.inf]))
    bench = Table({frozenset(): (0.0, 0.0), frozenset({OFFSET}): (100.0, 100.0)})
    found = acceptance.weighed(bench, state_of(PLANT), lost, [Size(5.0, False)], lambda: [1.0], 20.0)
    assert not lost.finite
    assert (found.total, found.objection) == (0.0, acceptance.DIVERGES)


def test_a_limit_is_a_bound_that_is_not_neutral():
    assert at_limit(1.0, (0.0, 1.0), 0.0)
    assert at_limit(1.2, (0.0, 1.0), 0.0)
    assert at_limit(-3.0, (-3.0, 3.0), 0.0)
    assert not at_limit(0.0, (0.0, 1.0), 0.0)
    assert at_limit(0.99995, (0.0, 1.0), 0.0)  # a fit may stop a little early
    assert not at_limit(0.9998, (0.0, 1.0), 0.0)
    assert not at_limit(0.5, (0.0, np.inf), 1.0)
    assert at_limit(0.0, (0.0, np.inf), 1.0)
    assert not at_limit(1e9, (-np.inf, np.inf), 0.0)


def test_the_bar_is_that_of_a_chi_squared_shared_among_all_candidates():
    assert threshold(1) == pytest.approx(3.2905**2, rel=1e-4)  # the two-sided 0.1 % point of a normal, from tables
    assert threshold(40) == pytest.approx(stats.norm.isf(0.5e-3 / 40) ** 2)
    assert threshold(40, 2) == pytest.approx(-2.0 * np.log(1e-3 / 40))  # chi-squared of two: exponential


def test_the_gate_counts_free_components_and_tried_periods_and_asks_the_sizes_of_the_state(monkeypatch):
    both = Candidate("current", ("effects.current.north", "effects.current.east"))
    start, after = state_of(PLANT), with_probes(dict.fromkeys(both.paths, 5.0))
    screening = trial_of(both).screening

    def asked(evidence: float, found=screening, **settings) -> str:
        bench = Table({frozenset(): (0.0, 0.0), frozenset(both.paths): (evidence, evidence)}, **settings)
        return gate(bench, start, after, [(both, found)], COUNT).objection

    assert asked(threshold(COUNT, 2) + 0.1) == ""
    assert asked(threshold(COUNT, 2) - 0.1) == acceptance.INSIGNIFICANT
    assert asked(threshold(COUNT, 2) + 0.1, replace(screening, tried=50)) == acceptance.INSIGNIFICANT
    assert asked(threshold(COUNT + 49, 2) + 0.1, replace(screening, tried=50)) == ""
    assert asked(100.0, error=2.0) == acceptance.UNSURE
    monkeypatch.setattr(trials, "_held_back", lambda bench, state, path: True)
    assert asked(100.0, known=5.0) == acceptance.LIMITED  # at the bound that prior knowledge sets
    assert asked(100.0, known=5.1) == ""
    assert asked(100.0, stable=False) == acceptance.DIVERGES
    after = with_probes(dict.fromkeys(both.paths, 0.5))  # a small size is no objection
    assert asked(100.0) == ""


def pair(together=(200.0, 100.0), first=(20.0, 1.0), second=(90.0, 80.0)):
    """A table of two effects, the state with both, and the nominal state."""
    likely = {frozenset(): (0.0, 0.0), frozenset({OFFSET}): first, frozenset({LAG}): second}
    bench = Table(likely | {frozenset({OFFSET, LAG}): together})
    state = with_probes({OFFSET: 5.0, LAG: 5.0}, *COEFFICIENTS)
    return bench, state, state_of(PLANT, *COEFFICIENTS)


def test_what_passes_beside_the_others_stays_with_the_evidence_that_it_has_there():
    bench, state, nominal = pair()
    last = Round((), None, (), {})
    after, rounds = confirmed(bench, nominal, state, [round_of(trial_of(A)), round_of(trial_of(B)), last], COUNT)
    assert after is state
    assert [r.chosen and r.chosen.candidate for r in rounds] == [A, B, None]
    assert [r.evidence for r in rounds] == [(110.0, 20.0), (180.0, 99.0), (0.0, 0.0)]


@pytest.mark.parametrize(
    "known, near, instead",
    [(95.0, 1.0, COEFFICIENTS[:1]), (80.0, 1.0, ()), (95.0, 1.6, ()), (0.0, 1.0, ())],
)
def test_coefficients_take_an_effects_place_where_little_but_their_stated_deviations_speaks_for_it(
    monkeypatch, known, near, instead
):
    """The evidence is 100; without the effect, the first coefficient is 3 deviations off and the second one 1.9."""
    bench, nominal = (
        Table({frozenset(): (0.0, 0.0), frozenset({OFFSET}): (100.0, 80.0)}),
        state_of(PLANT, *COEFFICIENTS),
    )
    state = with_probes({OFFSET: 5.0}, *COEFFICIENTS)
    state = replace(state, point=point_of(vector=[near, 0.0]))
    nominal = replace(nominal, point=point_of(vector=[-3.0, 1.9]))
    pulls = SimpleNamespace(bounds=bench.problem.bounds, pulls=lambda vector, paths: (vector[: len(paths)], None))
    monkeypatch.setattr(Table, "problem", property(lambda self: pulls))
    monkeypatch.setattr(Table, "known_gain", lambda self, before, after: known)
    _, (made,) = confirmed(bench, nominal, state, [round_of(trial_of(A))], COUNT)
    assert made.instead == tuple(instead)


def test_what_the_held_out_windows_refute_beside_the_others_is_not_named():
    bench, state, nominal = pair(together=(200.0, 52.4))  # the first one has -27.6 beside the second
    after, rounds = confirmed(bench, nominal, state, [round_of(trial_of(A)), round_of(trial_of(B))], COUNT)
    assert [r.chosen.candidate for r in rounds] == [B]
    assert OFFSET not in after.paths
    assert value_at(after.plant, OFFSET) == 0.0
    assert rounds[0].evidence == (90.0, 80.0)


def test_the_weakest_goes_first_and_the_other_one_may_then_stay():
    bench, state, nominal = pair((100.0, 90.0), (96.0, 88.0), (94.0, 84.0))  # either one alone explains nearly all
    after, rounds = confirmed(bench, nominal, state, [round_of(trial_of(A)), round_of(trial_of(B))], COUNT)
    assert [r.chosen.candidate for r in rounds] == [A]
    assert after.paths == (*COEFFICIENTS, OFFSET)
    bench, state, nominal = pair(together=(4.0, 3.0), first=(3.0, 2.0), second=(2.0, 1.0))
    after, rounds = confirmed(bench, nominal, state, [round_of(trial_of(A)), round_of(trial_of(B))], COUNT)
    assert rounds == []
    assert after is nominal


def test_an_effect_without_a_component_left_is_not_named():
    bench, state, nominal = pair()
    both = Candidate("current", ("effects.current.north", "effects.current.east"))
    _, rounds = confirmed(bench, nominal, state, [round_of(trial_of(c)) for c in (both, A, B)], COUNT)
    assert [r.chosen.candidate for r in rounds] == [A, B]


def test_a_component_within_two_errors_is_dropped():
    north, east = "effects.current.north", "effects.current.east"
    state = with_probes({north: 5.0, east: 0.19, OFFSET: 0.1})
    kept = without_idle_parts(Table({}), state, [(north, east), (OFFSET,)])
    assert set(kept.paths) == {north, OFFSET}
    small = without_idle_parts(Table({}), with_probes({north: 5.0, east: 0.21}), [(north, east)])
    assert set(small.paths) == {north, east}
    loose = without_idle_parts(Table({}, error=2.0), with_probes({north: 5.0, east: 3.9}), [(north, east)])
    assert loose.paths == (north,)


@pytest.mark.parametrize("held, named", [(40.0, True), (-27.6, False)])
def test_an_effect_told_from_a_coefficient_passes_the_gate_too(held, named):
    gain, path = "effects.rudder.gain", "hull.n_delta"
    given = value_at(PLANT, path)
    state = state_of(replace_at(PLANT, path, 1.5 * given), *COEFFICIENTS)

    class Coefficients(Table):
        plant = PLANT

        def gains(self, before, after):
            assert path not in before.paths
            assert value_at(before.plant, path) == given
            return 100.0, held

    found = coefficient_of(PLANT, path, (1.5 * given, 0.02 * given, 0.04 * given), COUNT, 0.1)
    effects = twin_effects([(gain, path)], [], [found], Coefficients({}), state, COUNT)
    assert [e.path for e in effects] == [gain] * named
    if named:
        assert effects[0].value == pytest.approx(1.5)
        assert effects[0].ci95 == pytest.approx((1.46, 1.54))
        assert (effects[0].evidence_train, effects[0].evidence_held) == (100.0, held)


def test_what_a_coefficient_comes_to_is_a_size_of_the_effect_that_acts_as_it_does():
    torpedo = load_vehicle("npsauv")
    assert size_as_effect(PLANT, "effects.rudder.gain", 2.0, 3.0) == pytest.approx(1.5)  # its neutral value is 1
    assert size_as_effect(torpedo, "effects.hull.damping_surge", -2.0, -2.4) == pytest.approx(0.2)
    assert size_as_effect(torpedo, "effects.hull.added_mass_yaw", -10.0, -7.0) == pytest.approx(-0.3)
    assert size_as_effect(torpedo, "effects.propeller.torque", 0.01, 0.04) == pytest.approx(0.03)


@pytest.fixture(scope="module")
def offset_log():
    return run_mission(replace_at(load_vehicle("slocum"), OFFSET, 0.05), np.random.default_rng(1), duration=600.0)


def with_idle(bench, state, rounds, path="effects.yaw.roll_moment"):
    """A state and its rounds with one more effect that explains nothing, as a search might leave them."""
    start = replace_at(state.plant, path, 2.0 * spec_at(state.plant, path).probe)
    after, candidate = bench.fit(start, (*state.paths, path), state), Candidate("idle", (path,))
    screening = Screening(candidate, np.zeros(1), 0.0, 1.0, np.zeros(1))
    return after, [*rounds, round_of(Trial(candidate, after, 100.0, -27.6, screening, ""))]


@pytest.mark.slow
def test_nothing_idle_is_named_whatever_the_search_brings(offset_log, monkeypatch):
    def overdone(bench, *given):
        return with_idle(bench, *attribute(bench, *given))

    monkeypatch.setattr(searching, "attribute", overdone)
    found = diagnose(offset_log, load_vehicle("slocum"))
    assert [e.path for e in found.effects] == [OFFSET]
    assert "effects.yaw.roll_moment" not in found.state.paths
    assert value_at(found.after.plant, "effects.yaw.roll_moment") == 0.0


@pytest.mark.slow
def test_what_is_certain_only_beside_an_effect_that_is_not_named_is_not_named(offset_log, monkeypatch):
    """The search accepts a lag beside the offset, but most halves of the log do not choose the offset."""
    as_found = lambda bench, nominal, state, rounds, count: (state, rounds)  # noqa: E731
    monkeypatch.setattr(searching, "attribute", lambda *given: with_idle(given[0], *attribute(*given), LAG))
    monkeypatch.setattr(searching, "settled", as_found)
    monkeypatch.setattr(searching, "confirmed", as_found)
    monkeypatch.setattr(Reconsidering, "paired", lambda self, state, rounds: (state, rounds))
    monkeypatch.setattr(Reconsidering, "swapped", lambda self, state, rounds: (state, rounds))
    often = {OFFSET: 0.1, LAG: 1.0}
    monkeypatch.setattr(
        holding, "survival", lambda bench, made, *_: Survival(often[made.chosen.candidate.paths[0]], {})
    )
    found = diagnose(offset_log, load_vehicle("slocum"))
    assert (found.effects, found.dropped) == ((), {OFFSET: RARE, LAG: LEANS})
    assert value_at(found.after.plant, LAG) == 0.0
    assert "no certain size for it without the effects that are not named" in " ".join(found.summary().split())


@pytest.mark.slow
def test_effects_with_which_unseen_parts_are_followed_less_well_are_not_named(offset_log, monkeypatch):
    """This holds if something is left; otherwise the likelihood of the whole log decides."""
    monkeypatch.setattr(scoring, "explained_share", lambda *_: -0.1)
    monkeypatch.setattr(remaining, "discover", lambda bench, state, *_: Discovery(state.plant, state.paths, state))
    plant = load_vehicle("slocum")
    assert [e.path for e in diagnose(offset_log, plant).effects] == [OFFSET]
    monkeypatch.setattr(searching, "what_is_left", lambda *_: Left(("heading_rad",)))
    monkeypatch.setattr(reporting, "what_is_left", lambda *_: Left(("heading_rad",)))
    found = diagnose(offset_log, plant)
    assert (found.verdict, found.effects, found.dropped) == ("unexplained", (), {OFFSET: WORSE})
    assert value_at(found.after.plant, OFFSET) == 0.0
    assert "are worse with it than without" in found.summary()


@pytest.mark.slow
def test_nothing_idle_is_named_whatever_second_thoughts_bring(offset_log, monkeypatch):
    monkeypatch.setattr(searching, "what_is_left", lambda *_: Left(("heading_rad",)))
    monkeypatch.setattr(remaining, "discover", lambda bench, state, *_: Discovery(state.plant, state.paths, state))
    asked = []

    def swapped(self, state, rounds):
        asked.append(state)
        return with_idle(self.bench, state, rounds)

    monkeypatch.setattr(Reconsidering, "swapped", swapped)
    monkeypatch.setattr(Reconsidering, "paired", lambda self, state, rounds: (state, rounds))
    heading = offset_log.without(["north_m", "east_m"])  # second thoughts are for filters of few states only
    found = diagnose(heading, load_vehicle("slocum"))
    assert len(asked) == 1
    assert [e.path for e in found.effects] == [OFFSET]
    assert "effects.yaw.roll_moment" not in found.state.paths
