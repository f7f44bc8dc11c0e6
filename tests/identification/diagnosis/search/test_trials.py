"""Tests of trials on a glider's log: each reason why a candidate is not fitted to the end, or refused after it."""

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import load_vehicle
from identification.deciding import HOPELESS
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search import trials
from identification.diagnosis.search.acceptance import LIMITED, UNSURE
from identification.diagnosis.search.attribution import selected
from identification.diagnosis.search.begun import _first_values
from identification.diagnosis.search.candidates import Candidate, Screening, candidates_of, screen
from identification.diagnosis.search.trials import FAR_LESS, NO_TRACE, UNSEEN, UNSTABLE, trials_of
from identification.diagnosis.search.workbench import State, Workbench
from identification.experiments.missions import run_mission
from tests.identification.diagnosis.stand_ins import PLANT, state_of
from tests.identification.gliders import QUICK

OFFSET, GAIN, LAG = "effects.rudder.offset", "effects.rudder.gain", "effects.rudder.lag"


def quiet(fraction: float, text: str) -> None:
    pass


@pytest.fixture(scope="module")
def start():
    """A glider's log with a rudder offset: its bench, the refitted vehicle, and all candidates."""
    plant = QUICK
    record = run_mission(replace_at(plant, OFFSET, 0.05), np.random.default_rng(1), duration=1200.0)
    bench = Workbench(plant, record, parts_of(plant, record), 0.1)
    return bench, bench.fit(plant, plant.family.coefficients), candidates_of(plant, record)


@pytest.fixture(scope="module")
def tried(start):
    bench, state, candidates = start
    return {t.candidate.paths[0]: t for t in trials_of(bench, state, candidates, len(candidates), quiet, ())}


def test_the_right_one_is_accepted_and_leads(tried):
    assert tried[OFFSET].objection == ""
    assert max(tried.values(), key=lambda t: t.total) is tried[OFFSET]
    assert value_at(tried[OFFSET].state.plant, OFFSET) == pytest.approx(0.05, abs=0.01)


@pytest.mark.parametrize("turned, objection", [(False, ""), (True, LIMITED)])
def test_an_effect_may_be_at_the_limit_of_its_size_if_the_log_asks_for_no_more(turned, objection):
    """A rudder with the least gain is at the limit; so is one whose angles are logged with the wrong sign."""
    plant, least = QUICK, spec_at(QUICK, GAIN).bounds[0]
    record = run_mission(plant if turned else replace_at(plant, GAIN, least), np.random.default_rng(1), duration=1200.0)
    if turned:
        record = record.with_channels({"rudder_rad": -record["rudder_rad"]})
    bench = Workbench(plant, record, parts_of(plant, record), 0.1)
    (found,) = selected(bench, bench.fit(plant, ()), [Candidate("", (GAIN,))], 1, ()).trials
    assert value_at(found.state.plant, GAIN) == pytest.approx(least, abs=1e-3)
    assert found.objection == objection


def test_a_rudder_without_any_travel_is_found_though_its_slope_says_nothing(monkeypatch):
    """Beyond the travel that the log has used, nothing changes: the size is at least that, and at most all.

    Its slope is zero or, in some logs, rounding error: then an interval by slopes is as wide as can be.
    """
    lost = "effects.rudder.lost_travel"
    record = run_mission(replace_at(QUICK, lost, 1.0), np.random.default_rng(1), duration=1200.0)
    bench = Workbench(QUICK, record, parts_of(QUICK, record), 0.1)
    (found,) = selected(bench, bench.fit(QUICK, ()), [Candidate("", (lost,))], 1, ()).trials
    assert found.objection == ""
    assert value_at(found.state.plant, lost) > 0.5
    low, high = bench.interval(found.state, lost)
    assert 0.1 < low < 0.95
    assert high == 1.0
    whole = bench.fit(replace_at(QUICK, lost, 1.0), (lost,))
    monkeypatch.setattr(Workbench, "half_widths_if_white", lambda self, state, paths: [1e17])
    weighed = trials.gate(bench, bench.fit(QUICK, ()), whole, [(found.candidate, found.screening)], 1, soon=True)
    assert weighed.objection == ""


def test_a_rudder_that_is_stuck_is_found_with_where_it_is():
    plant, stuck = load_vehicle("npsauv"), "effects.rudder.stuck"
    true = replace_at(plant, {stuck: 1.0, f"{stuck}_at": 0.1})
    record = run_mission(true, np.random.default_rng(3), duration=60.0)
    bench = Workbench(plant, record, parts_of(plant, record, 4), 0.1)
    (own,) = (c for c in candidates_of(plant, record) if c.paths == (stuck,))
    (found,) = selected(bench, bench.fit(plant, ()), [own], 1, ()).trials
    assert found.objection == ""
    assert value_at(found.state.plant, stuck) == pytest.approx(1.0, abs=0.02)
    assert value_at(found.state.plant, f"{stuck}_at") == pytest.approx(0.1, abs=0.005)


def test_a_candidate_that_acts_like_the_first_begins_where_its_fit_has_ended(start, monkeypatch):
    bench, state, candidates = start
    begun, nears = [], []
    monkeypatch.setattr(trials, "all_finished", lambda bench, state, found, count: begun.extend(found) or [])
    trials_of(bench, state, candidates, len(candidates), quiet, ())
    monkeypatch.undo()
    first = next(b for b in begun if b.screening.candidate.paths == (OFFSET,))
    other = next(b for b in begun if b is not first)
    twin = replace(first, screening=replace(first.screening, candidate=Candidate("twin", (OFFSET,))))

    def judged(bench, state, candidate, screening, near, count):
        nears.append(near)
        return own(bench, state, candidate, screening, near, count)

    own = trials.judged
    monkeypatch.setattr(trials, "judged", judged)
    led, *_ = trials.all_finished(bench, state, [first, twin, other], len(candidates))
    near = next(n for n in nears[1:] if n.paths == first.state.paths)
    assert near.plant.vector == pytest.approx(led.state.plant.vector, rel=1e-12)
    unlike = next(n for n in nears[1:] if n.paths != first.state.paths)
    assert value_at(unlike.plant, "hull.n_r") != value_at(led.state.plant, "hull.n_r")


def test_what_is_chosen_passes_all_that_the_gate_asks(start, tried, monkeypatch):
    """A first judgement assumes white errors; the wider intervals of the complete gate may refuse what it accepts."""
    bench, state, candidates = start
    assert trials.sure(bench, state, tried[OFFSET], len(candidates)).objection == ""
    monkeypatch.setattr(Workbench, "intervals", lambda self, of: dict.fromkeys(of.paths, (0.0, 1.0, 1000.0)))
    assert trials.sure(bench, state, tried[OFFSET], len(candidates)).objection == UNSURE
    refused = replace(tried[OFFSET], objection=FAR_LESS)
    assert trials.sure(bench, state, refused, len(candidates)) is refused
    made = selected(bench, state, candidates, len(candidates), ())
    assert made.chosen is None
    assert next(t for t in made.trials if t.candidate.paths[0] == OFFSET).objection == UNSURE


def test_a_trial_is_what_is_likelier_from_the_given_coefficients(start, monkeypatch):
    bench, state, candidates = start
    asked, better = [], []

    def likelier(self: Workbench, reached: State, hopeless: float) -> State:
        asked.append(hopeless)
        better.append(replace(reached))
        return better[-1]

    monkeypatch.setattr(Workbench, "likelier_from_given", likelier)
    (found,) = trials_of(bench, state, [c for c in candidates if OFFSET in c.paths], len(candidates), quiet, ())
    assert asked == [HOPELESS]
    assert found.state is better[0]


def test_one_whose_step_promises_nothing_is_not_fitted(start):
    bench, _, candidates = start
    explained = bench.fit(bench.plant, (*bench.plant.family.coefficients, OFFSET))
    (found,) = trials_of(bench, explained, [c for c in candidates if LAG in c.paths], len(candidates), quiet, ())
    assert found.objection == NO_TRACE
    assert found.state is None
    assert 0.0 < found.train < 3.0  # less than a fifth of the bar


def test_one_that_gains_far_less_after_a_few_steps_is_not_fitted_to_the_end(tried):
    refused = [t for t in tried.values() if t.objection == FAR_LESS]
    assert refused
    assert all(t.state is None and t.total < 0.1 * tried[OFFSET].total for t in refused)
    assert sum(t.state is not None for t in tried.values()) < 7


def test_finalists_from_a_quieted_state_get_the_noises_that_suit_them(start, monkeypatch):
    bench, state, candidates = start
    begun, nears = {}, {}

    def begin(*args):
        begun[args[3].candidate] = own(*args)
        return begun[args[3].candidate]

    def kept(bench, state, candidate, screening, near, count):
        nears[candidate] = near
        return trials.Trial(candidate, near, 1.0, 1.0, screening, "")

    own = trials.begun_from
    monkeypatch.setattr(trials, "begun_from", begin)
    monkeypatch.setattr(trials, "judged", kept)
    trials_of(bench, state, candidates, len(candidates), quiet, ())
    renewed = [c for c in nears if begun[c].state.quiet]
    assert renewed
    for candidate in renewed:
        assert bench.gain(begun[candidate].state, nears[candidate]) > 10.0


@pytest.mark.parametrize(
    "there, lasts, swells, asked",
    [
        ((1, 1), (0, 1), (0, 0), [None, (0, 1)]),
        ((1, 1), (0, 0), (0, 0), [None]),
        ((0, 1), (0, 1), (0, 0), [None]),
        ((1, 1), (1, 1), (0, 0), [None]),
        ((1, 0), (0, 0), (0, 1), [None, (0, 1)]),
    ],
)
def test_what_lasts_and_a_swell_are_taken_for_weaker_by_themselves_beside_what_is_brief(there, lasts, swells, asked):
    found = []

    def quieted(point, which=None):
        found.append(None if which is None else tuple(which.astype(int)))
        return point

    masks = [np.array(m, dtype=bool) for m in (there, lasts, swells)]
    problem = SimpleNamespace(
        pushed=("u", "w"),
        pushes=lambda point: masks[0],
        lasting=lambda point: masks[1],
        swelling=lambda point: masks[2],
        quieted=quieted,
    )
    bench = SimpleNamespace(problem=problem, once=lambda state, question, work: work())
    bases = Workbench.quieted(bench, state_of(PLANT))
    assert found == asked
    assert len(bases) == len(asked)
    assert all(base.quiet for base in bases)


def test_starts_move_with_a_candidate_and_the_coefficients_that_it_moves():
    """The pump errs by 7 % and the drag by 9 %, so that the unknown volume of each dive moves far with them."""
    plant, pump = replace(load_vehicle("mermaid"), deviations={}), "effects.oil.pump_gain"
    drags = {p: 0.91 * value_at(plant, p) for p in ("hull.drag_quadratic", "hull.drag_linear")}
    record = run_mission(replace_at(plant, {pump: 0.07, **drags}), np.random.default_rng(3))
    bench = Workbench(plant, record, parts_of(plant, record), 0.1)
    state = bench.fit(bench.plant, bench.plant.coefficients)
    (one,) = screen(bench.problem, state.point, state.paths, [Candidate(pump, (pump,))], 10.0)
    assert one.evidence > 30.0
    assert trials.begun_from(bench, state, state, one, state).promise == pytest.approx(one.evidence, rel=0.1)


@pytest.mark.parametrize("here, there, taken", [(50.0, 40.0, "here"), (30.0, 40.0, "there"), (1.0, -40.0, "there")])
def test_what_leads_nowhere_from_another_base_begins_where_the_state_is(start, monkeypatch, here, there, taken):
    """This holds if the state's own screening promises enough, and more than a few steps from the other base reach."""
    bench, state, candidates = start
    (offset,) = (c for c in candidates if OFFSET in c.paths)
    base, one = replace(state), screened_of(OFFSET, evidence=here)
    one = replace(one, candidate=offset)
    fitted = []

    def begun(bench, state, at, screening, rival):
        return trials.Begun(screening, at, there if at is base else screening.evidence)

    monkeypatch.setattr(trials, "_screened", lambda *_: ([one], {offset: base}, {offset: one}))
    monkeypatch.setattr(trials, "_short_list", lambda screened, *_: screened)
    monkeypatch.setattr(trials, "begun_from", begun)
    monkeypatch.setattr(trials, "finalists_of", lambda begun, *_: fitted.extend(begun) or [])
    trials_of(bench, state, [offset], len(candidates), quiet, ())
    assert [b.state for b in fitted] == [state if taken == "here" else base]


def test_a_base_with_other_noises_is_compared_with_the_state_at_these(start):
    bench, state, _ = start
    logs = state.point.logs.copy()
    logs[0] += 0.7  # twice the heading's noise
    loud = replace(state, point=bench.problem.point(state.point.vector, logs, state.point))
    rival = trials.rival_of(bench, state, loud)
    assert np.array_equal(rival.point.logs, logs)
    assert 0.0 <= bench.gain(loud, rival) < 5.0
    assert bench.gain(state, rival) < -50.0
    assert trials.rival_of(bench, state, state) is state


@pytest.mark.parametrize("seed", [3, 4])
def test_beside_coefficients_as_given_what_is_idle_promises_nothing(seed):
    """A few steps from there bring the coefficients closer to the truth, whichever candidate is added."""
    path, *_ = paths = QUICK.family.coefficients
    true = replace_at(QUICK, path, 0.6 * value_at(QUICK, path))
    record = run_mission(true, np.random.default_rng(seed), duration=500.0)
    bench, idle = Workbench(QUICK, record, parts_of(QUICK, record), 0.1), "effects.yaw.roll_moment"
    state = bench.fit(QUICK, paths)
    (base,) = bench.with_given(state)
    (one,) = screen(bench.problem, base.point, paths, [Candidate(idle, (idle,))], 10.0)
    promised = trials.begun_from(bench, state, base, one, trials.rival_of(bench, state, base)).promise
    assert promised < 1.0
    fixed = replace(state, point=bench.problem.point(state.point.vector, base.point.logs, state.point))
    assert trials.begun_from(bench, state, base, one, fixed).promise > 10.0  # enough for a finalist


def test_begun_with_too_little_process_noise_promises_are_no_more_than_whole_fits_gain(start):
    """With less noise nearly everything promises much; what the state's own noise leaves of it is compared instead."""
    bench, state, candidates = start
    base, *_ = bench.quieted(state)
    assert trials.rival_of(bench, state, base) is state
    ends, loud, least = {}, {}, {}
    for path in (OFFSET, LAG, "effects.compass.bias"):
        (own,) = (c for c in candidates if path in c.paths)
        (screening,) = screen(bench.problem, base.point, state.paths, [own], 10.0)
        begun = trials.begun_from(bench, state, base, screening, trials.rival_of(bench, state, base))
        whole = trials.judged(bench, state, own, screening, replace(begun.state, quiet=False), len(candidates))
        ends[path], loud[path] = (begun.promise, whole.train), screening.evidence
        least[path] = bench.gain(state, begun.state)  # with the weaker noise
    assert all(promise <= max(train, 0.0) + 1.0 for promise, train in ends.values())
    assert ends[OFFSET][0] > 0.5 * ends[OFFSET][1]
    assert ends[LAG][0] > least[LAG] + 10.0
    assert max(v for p, v in loud.items() if p != OFFSET) > 10.0 * max(v for p, (v, _) in ends.items() if p != OFFSET)


def test_one_that_was_fitted_and_gains_little_is_not_significant(tried):
    little = [t for t in tried.values() if t.objection == "not significant"]
    assert little
    assert all(t.state is not None for t in little)


def test_one_that_the_record_cannot_show_is_not_fitted(start):
    """Without roll, nothing depends on it; at a constant speed, a growth with speed acts like a coefficient."""
    bench, _, candidates = start
    record = bench.record
    flat = record.with_channels({"roll_rad": np.zeros(len(record)), "u_mps": np.full(len(record), 0.4)})
    bench = Workbench(bench.plant, flat, bench.parts, np.inf)
    state = bench.fit(bench.plant, bench.plant.family.coefficients)
    paths = ("effects.yaw.roll_moment", "effects.yaw.speed_squared")
    left = [c for c in candidates if c.paths[0] in paths]
    found = {t.candidate.paths[0]: t for t in trials_of(bench, state, left, len(candidates), quiet, ())}
    assert found[paths[0]].objection == f"{UNSEEN}: changes nothing that was measured"
    assert found[paths[1]].objection.startswith(UNSEEN)
    assert found[paths[1]].objection.endswith("has the same effect")
    assert all(t.state is None for t in found.values())


def test_one_without_a_stable_run_is_refused(start, monkeypatch):
    bench, state, candidates = start

    def diverged(bench, state, base, screening, rival):
        lost = replace(state.point, scores=np.full_like(state.point.scores, -np.inf))
        return trials.Begun(screening, State(state.plant, (*state.paths, *screening.candidate.free), lost), -np.inf)

    monkeypatch.setattr(trials, "begun_from", diverged)
    only = [c for c in candidates if OFFSET in c.paths]
    (found,) = trials_of(bench, state, only, len(candidates), quiet, ())
    assert found.objection == UNSTABLE
    assert found.train == 0.0


def test_a_first_value_whose_run_is_lost_gives_way_to_the_others(start):
    bench, state, candidates = start
    (offset,) = (c for c in candidates if OFFSET in c.paths)
    problem, screening = bench.problem, screen(bench.problem, state.point, state.paths, [offset], 10.0)[0]
    whole, lost = trials.begun_from(bench, state, state, screening, state), []

    class Losing:
        """The problem, except that its first run is lost as in the filter, with NaN scores."""

        def __getattr__(self, name):
            return getattr(problem, name)

        def with_gains(self, point, vector):
            lost.append(vector[problem.index[OFFSET]])
            made = problem.with_gains(point, vector)
            return made if len(lost) > 1 else replace(made, scores=np.full_like(made.scores, np.nan))

    other = copy(bench)
    other.problem = Losing()
    begun = trials.begun_from(other, state, state, screening, state)
    assert len(lost) > 1
    assert begun.state.finite
    assert value_at(begun.state.plant, OFFSET) == pytest.approx(value_at(whole.state.plant, OFFSET), rel=0.2)


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
    start, monkeypatch, poorer, regained, taken
):
    """9 instead of 5, minus twice the loss of log-likelihood there, plus what the coefficients regain."""
    bench, state, candidates = start
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
    _, bases, here = trials._screened(bench, state, only, 10.0)
    assert list(here) == only
    assert here[only[0]].evidence == 5.0
    assert bases[only[0]] is {"given": given, "fitted": state}[taken]


@pytest.mark.parametrize("promised, taken", [(19.0, "fitted"), (21.0, "quieted")])
def test_signatures_are_taken_with_weaker_accelerations_where_these_promise_more(start, monkeypatch, promised, taken):
    """As fitted it is 5; a quarter of the promise with weaker noises counts, since errors are twice too large there.

    Their much lower likelihood does not count: a candidate is fitted with the noises that suit it.
    """
    bench, state, candidates = start
    only = [c for c in candidates if OFFSET in c.paths]
    size = 2.0 * np.sqrt(bench.problem.count / len(bench.problem.rows) / state.point.errors.shape[1])
    loud = replace(state.point, errors=np.full_like(state.point.errors, size), scores=state.point.scores - 1e3)
    quieted = replace(state, point=loud, quiet=True)
    of = {id(state.point): (5.0, 0.01), id(loud): (promised, 0.001)}

    def screened(point, left):
        evidence, detectable = of[id(point)]
        return [Screening(only[0], np.zeros(1), evidence, 1.0, np.array([detectable]))]

    monkeypatch.setattr(bench, "with_given", lambda state: ())
    monkeypatch.setattr(bench, "quieted", lambda state: (quieted,))
    monkeypatch.setattr(trials, "Regression", regression_of(screened))
    (found,), bases, _ = trials._screened(bench, state, only, 10.0)
    assert bases[only[0]] is {"quieted": quieted, "fitted": state}[taken]
    assert found.evidence == pytest.approx(max(promised / 4.0, 5.0))
    assert found.detectable[0] == 0.01  # for the noises as fitted


def screened_of(path: str, estimate: float = 0.0, evidence: float = 0.0) -> Screening:
    return Screening(Candidate(path, (path,)), np.array([estimate]), evidence, 1.0, np.zeros(1))


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


def test_what_promises_most_from_the_state_as_it_is_is_listed_whatever_weak_accelerations_promise(start, monkeypatch):
    bench, state, candidates = start
    quieted = replace(state, point=replace(state.point, scores=state.point.scores - 1e3), quiet=True)

    def screened(point, left):
        size = 30.0 if point is state.point else 1000.0
        order = left if point is state.point else left[::-1]
        return [
            Screening(c, np.zeros(len(c.paths)), size - k, 1.0, np.zeros(len(c.paths))) for k, c in enumerate(order)
        ]

    monkeypatch.setattr(bench, "with_given", lambda state: ())
    monkeypatch.setattr(bench, "quieted", lambda state: (quieted,))
    monkeypatch.setattr(trials, "Regression", regression_of(screened))
    found, _, here = trials._screened(bench, state, candidates, 10.0)
    here = list(here)[: trials.HERE]
    assert here == candidates[: trials.HERE]
    listed = [s.candidate for s in trials._short_list(found, here, 10.0, ())]
    assert {*here, *candidates[-trials.SHORT_LIST :]} <= set(listed)


def test_what_promises_more_than_finalists_reached_is_fitted_too():
    """Half of the bar is enough, since whole fits gain more."""
    begun = [
        trials.Begun(screened_of(OFFSET), state_of(QUICK, OFFSET), 60.0),
        trials.Begun(screened_of(LAG), replace(state_of(QUICK, LAG), quiet=True), 40.0),
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


def test_one_beside_louder_promises_is_fitted_all_the_same(start, monkeypatch):
    bench, state, candidates = start
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
    begun = [trials.Begun(screened_of(OFFSET), replace(state_of(QUICK, OFFSET), quiet=True), -5.0)]
    assert trials.finalists_of(begun, (), 2.0) == begun  # its fit, with other noises, gains more
    loud = [replace(begun[0], promise=-90.0, beside=b) for b in (400.0, 300.0, 200.0, 100.0)]
    likely = [replace(begun[0], promise=p, beside=1.0) for p in (30.0, 29.0, 28.0)]
    assert trials.finalists_of([*loud, *likely], (), 2.0) == [*likely, *loud[:3]]


@pytest.mark.parametrize(
    "path, estimate, probes",
    [
        (OFFSET, 3.0, [1.0, 3.0, -1.0]),
        (OFFSET, -0.2, [-1.0, 1.0, -0.2]),  # a probe may be too large for the record
        (OFFSET, 90.0, [1.0, 12.0, -1.0]),
        (LAG, -3.0, [1.0, 3.0, 6.0]),  # one-sided: never negative; larger sizes may show what small ones do not
    ],
)
def test_a_fit_starts_on_both_sides_of_neutral_or_beyond_a_corner(path, estimate, probes):
    starts = _first_values(QUICK, screened_of(path, estimate))
    probe = spec_at(QUICK, path).probe
    assert [value / probe for (value,) in starts] == pytest.approx(probes)
