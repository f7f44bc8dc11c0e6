"""Tests of which candidates are fitted: their screening, the short list, and the finalists."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from identification.deciding import HOPELESS
from identification.diagnosis.search import trials
from identification.diagnosis.search.candidates import Candidate, Screening
from identification.diagnosis.search.trials import UNSTABLE, trials_of
from tests.identification.diagnosis.stand_ins import state_of
from tests.identification.gliders import QUICK

OFFSET, GAIN, LAG = "effects.rudder.offset", "effects.rudder.gain", "effects.rudder.lag"


def quiet(fraction: float, text: str) -> None:
    pass


@pytest.mark.parametrize("promised, taken", [(11.0, "brief"), (9.0, "weaker")])
def test_what_passes_the_bar_beside_noises_that_suit_is_begun_there_whatever_is_louder(
    offset_log, monkeypatch, promised, taken
):
    """The bar is 10; beside weaker noises, which do not suit, the evidence is 1000."""
    bench, state, candidates = offset_log
    only = [c for c in candidates if OFFSET in c.paths or LAG in c.paths]
    weaker = replace(state, point=replace(state.point), quiet=True, suited=False)
    brief = replace(state, point=replace(state.point), quiet=True)
    of = {id(state.point): 5.0, id(weaker.point): 1000.0, id(brief.point): promised}

    def screened(point, left):
        loud = {False: of[id(point)], True: 900.0 if point is weaker.point else 1.0}
        found = [Screening(c, np.zeros(1), loud[LAG in c.paths], 1.0, np.zeros(1)) for c in left]
        return sorted(found, key=lambda s: -s.evidence)

    monkeypatch.setattr(bench, "with_given", lambda state: ())
    monkeypatch.setattr(bench, "quieted", lambda state: (weaker, brief))
    monkeypatch.setattr(trials, "misjudged", lambda bench, base: 1.0)
    monkeypatch.setattr(trials, "HERE", 1)
    monkeypatch.setattr(trials, "Regression", regression_of(screened))
    made = trials._screened(bench, state, only, 10.0)
    (offset,) = (c for c in only if OFFSET in c.paths)
    assert made.bases[offset] is {"brief": brief, "weaker": weaker}[taken]
    assert made.best[0].candidate is offset  # before what is louder only beside noises that do not suit
    assert made.leading == [offset, offset]


def screened_of(path: str, estimate: float = 0.0, evidence: float = 0.0) -> Screening:
    return Screening(Candidate(path, (path,)), np.array([estimate]), evidence, 1.0, np.zeros(1))


@pytest.mark.parametrize("here, there, taken", [(50.0, 40.0, "here"), (30.0, 40.0, "there"), (1.0, -40.0, "there")])
def test_what_leads_nowhere_from_another_base_begins_where_the_state_is(offset_log, monkeypatch, here, there, taken):
    """This holds if the state's own screening promises enough, and more than a few steps from the other base reach."""
    bench, state, candidates = offset_log
    (offset,) = (c for c in candidates if OFFSET in c.paths)
    base, one = replace(state), screened_of(OFFSET, evidence=here)
    one = replace(one, candidate=offset)
    fitted = []

    def begun(bench, state, at, screening, rival):
        return trials.Begun(screening, at, there if at is base else screening.evidence)

    monkeypatch.setattr(trials, "_screened", lambda *_: trials.Screened([one], {offset: base}, {offset: one}, []))
    monkeypatch.setattr(trials, "_short_list", lambda screened, *_: screened)
    monkeypatch.setattr(trials, "begun_from", begun)
    monkeypatch.setattr(trials, "finalists_of", lambda begun, *_: fitted.extend(begun) or [])
    trials_of(bench, state, [offset], len(candidates), quiet, ())
    assert [b.state for b in fitted] == [state if taken == "here" else base]


def regression_of(screened, regained: float = 0.0):
    """A stand-in for regressions: given screenings, and the evidence that fitted coefficients promise by themselves."""

    class Told:
        def __init__(self, problem, point, fitted, bar):
            self.point, self.regained = point, regained

        def screened(self, left):
            return screened(self.point, left)

    return Told


@pytest.mark.parametrize(
    "poorer, regained, taken", [(0.0, 0.0, "given"), (1.5, 0.0, "given"), (2.5, 0.0, "fitted"), (2.5, 2.0, "given")]
)
def test_signatures_are_taken_with_coefficients_as_given_where_these_promise_more(
    offset_log, monkeypatch, poorer, regained, taken
):
    """9 instead of 5, minus twice the loss of log-likelihood there, plus what the coefficients regain."""
    bench, state, candidates = offset_log
    only = [c for c in candidates if OFFSET in c.paths]
    scores = state.point.scores - poorer / len(bench.problem.rows)
    given = replace(state, point=replace(state.point, scores=scores))
    promised = {id(state.point): 5.0, id(given.point): 9.0}

    def screened(point, left):
        return [Screening(only[0], np.zeros(1), promised[id(point)], 1.0, np.zeros(1))]

    monkeypatch.setattr(bench, "with_given", lambda state: (given,))
    monkeypatch.setattr(bench, "quieted", lambda state: ())
    monkeypatch.setattr(trials, "Regression", regression_of(screened, regained))
    monkeypatch.setattr(bench.problem, "point", lambda vector, logs, near: near)  # the noises are the same
    made = trials._screened(bench, state, only, 10.0)
    assert list(made.here) == only
    assert made.here[only[0]].evidence == 5.0
    assert made.bases[only[0]] is {"given": given, "fitted": state}[taken]


@pytest.mark.parametrize("promised, taken", [(19.0, "fitted"), (21.0, "quieted")])
def test_signatures_are_taken_with_weaker_accelerations_where_these_promise_more(
    offset_log, monkeypatch, promised, taken
):
    """As fitted it is 5; a quarter of the promise with weaker noises counts, since errors are twice too large there.

    Their much lower likelihood does not count: a candidate is fitted with the noises that suit it.
    """
    bench, state, candidates = offset_log
    only = [c for c in candidates if OFFSET in c.paths]
    size = 2.0 * np.sqrt(bench.problem.count / len(bench.problem.rows) / state.point.errors.shape[1])
    loud = replace(state.point, errors=np.full_like(state.point.errors, size), scores=state.point.scores - 1e3)
    quieted = replace(state, point=loud, quiet=True, suited=False)
    of = {id(state.point): (5.0, 0.01), id(loud): (promised, 0.001)}

    def screened(point, left):
        evidence, detectable = of[id(point)]
        return [Screening(only[0], np.zeros(1), evidence, 1.0, np.array([detectable]))]

    monkeypatch.setattr(bench, "with_given", lambda state: ())
    monkeypatch.setattr(bench, "quieted", lambda state: (quieted,))
    monkeypatch.setattr(trials, "Regression", regression_of(screened))
    made = trials._screened(bench, state, only, 10.0)
    (found,) = made.best
    assert made.bases[only[0]] is {"quieted": quieted, "fitted": state}[taken]
    assert found.evidence == pytest.approx(max(promised / 4.0, 5.0))
    assert found.detectable[0] == 0.01  # for the noises as fitted


def test_on_the_short_list_are_the_ten_best_and_whatever_is_near_the_best_or_plain():
    promised = [100.0, *[60.0] * 11, 49.0, 48.0, 1.9]
    screened = [screened_of(f"effects.{k}", evidence=e) for k, e in enumerate(promised)]
    listed = trials._short_list(screened, (), 10.0, ("effects.13", "effects.14"))
    assert [s.evidence for s in listed] == [*promised[:12], 48.0]  # the last is less than a fifth of the bar
    assert trials._short_list(screened[10:], (), 10.0, ()) == screened[10:14]
    here = [screened[12].candidate, screened[14].candidate]
    listed = trials._short_list(screened, here, 10.0, ())
    assert [s.evidence for s in listed] == [*promised[:12], 49.0]


def test_of_a_part_that_shows_nothing_no_candidate_is_listed_but_what_kinematics_shows():
    less, more = (chi2.isf(level, 12) for level in (0.06, 0.04))
    screened = [
        replace(screened_of(f"effects.t{k}.lost", evidence=50.0), together=(e, 12)) for k, e in enumerate((less, more))
    ]
    assert [s.candidate.paths for s in trials._short_list(screened, (), 60.0, ())] == [("effects.t1.lost",)]
    assert trials._short_list(screened, (), 60.0, ("effects.t0.lost",)) == screened
    untested = replace(screened[0], together=(0.0, 0))
    assert trials._short_list([untested], (), 60.0, ()) == [untested]


def test_one_that_passes_the_bar_is_not_lost_in_a_large_part():
    """Thirty absent effects have an evidence of 30 on average, so that 40 for all together is not significant."""
    loud, other = (
        replace(screened_of(f"effects.hull.{k}", evidence=e), together=(40.0, 30)) for k, e in (("a", 25.0), ("b", 5.0))
    )
    assert loud.chance > 0.1
    assert trials._short_list([loud, other], (), 24.0, ()) == [loud, other]
    assert trials._short_list([loud, other], (), 26.0, ()) == []


def test_what_promises_most_from_the_state_as_it_is_is_listed_whatever_weak_accelerations_promise(
    offset_log, monkeypatch
):
    bench, state, candidates = offset_log
    quieted = replace(state, point=replace(state.point, scores=state.point.scores - 1e3), quiet=True, suited=False)

    def screened(point, left):
        size = 30.0 if point is state.point else 1000.0
        order = left if point is state.point else left[::-1]
        return [
            Screening(c, np.zeros(len(c.paths)), size - k, 1.0, np.zeros(len(c.paths))) for k, c in enumerate(order)
        ]

    monkeypatch.setattr(bench, "with_given", lambda state: ())
    monkeypatch.setattr(bench, "quieted", lambda state: (quieted,))
    monkeypatch.setattr(trials, "Regression", regression_of(screened))
    made = trials._screened(bench, state, candidates, 10.0)
    assert made.leading == candidates[: trials.HERE]
    listed = [s.candidate for s in trials._short_list(made.best, made.leading, 10.0, ())]
    assert {*made.leading, *candidates[-trials.SHORT_LIST :]} <= set(listed)


def test_what_promises_more_than_finalists_reached_is_fitted_too():
    """Half of the bar is enough, since whole fits gain more."""
    begun = [
        trials.Begun(screened_of(OFFSET), state_of(QUICK, OFFSET), 60.0),
        trials.Begun(screened_of(LAG), state_of(QUICK, LAG), 40.0, quiet=True),
        trials.Begun(screened_of("effects.yaw.moment"), state_of(QUICK), 7.0),
    ]
    refused = trials.Trial(begun[0].screening.candidate, None, 39.0, 0.0, begun[0].screening, UNSTABLE)
    accepted = replace(refused, train=45.0, objection="")

    def overtaken(trial, bar):
        return [b.screening.candidate.paths[0] for b in trials._overtaken(begun, [trial], bar)]

    assert overtaken(refused, 12.0) == [LAG, "effects.yaw.moment"]
    assert overtaken(refused, 79.0) == [LAG]
    assert overtaken(refused, 81.0) == []
    assert overtaken(accepted, 12.0) == []
    assert overtaken(replace(accepted, train=13.0), 12.0) == [LAG]


def test_one_beside_louder_promises_is_fitted_all_the_same(offset_log, monkeypatch):
    bench, state, candidates = offset_log
    left = [c for c in candidates if c.paths[0] in (OFFSET, LAG)]
    monkeypatch.setattr(
        trials, "finalists_of", lambda begun, plain, least: [b for b in begun if b.screening.candidate != left[0]]
    )
    monkeypatch.setattr(trials, "_short_list", lambda screened, here, bar, plain: screened)
    monkeypatch.setattr(bench, "quieted", lambda state: ())
    left.sort(key=lambda c: OFFSET not in c.paths)
    found = {t.candidate.paths[0]: t for t in trials_of(bench, state, left, len(candidates), quiet, ())}
    assert found[OFFSET].objection == ""
    assert found[LAG].state is not None


def test_finalists_are_the_three_best_and_whatever_is_near_the_best_or_plain():
    paths = (OFFSET, GAIN, LAG, "effects.yaw.moment", "effects.compass.lag", "effects.compass.bias")

    def finalists(reached, plain=()):
        begun = [trials.Begun(screened_of(p), state_of(QUICK, p), r) for p, r in zip(paths, reached, strict=True)]
        return [b.screening.candidate.paths[0] for b in trials.finalists_of(begun, plain, 2.0)]

    assert finalists([79.0, 81.0, 82.0, 83.0, 100.0, 10.0]) == [paths[k] for k in (4, 3, 2, 1)]
    assert finalists([1.0, 2.0, 3.0, 4.0, 100.0, 0.0], (paths[5],)) == [paths[k] for k in (4, 3, 2, 5)]
    assert finalists([1.9, 2.1, -5.0, 0.0, -np.inf, np.nan]) == [paths[1]]  # above the least promise for a fit
    begun = [trials.Begun(screened_of(OFFSET), state_of(QUICK, OFFSET), -5.0, quiet=True)]
    assert trials.finalists_of(begun, (), 2.0) == begun  # its whole fit may gain more
    assert trials.finalists_of([replace(begun[0], promise=-HOPELESS - 1.0)], (), 2.0) == []
    loud = [replace(begun[0], promise=p, quiet=False) for p in (90.0, 80.0, 75.0, 40.0)]
    assert trials.finalists_of([*loud, *begun], (), 2.0) == [*loud[:3], *begun]  # these are not compared with others
