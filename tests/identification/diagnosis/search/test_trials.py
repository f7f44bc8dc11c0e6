"""Tests of trials on a glider's log: each reason why a candidate is not fitted to the end, or refused after it."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import load_vehicle
from identification.deciding import HOPELESS
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search import trials
from identification.diagnosis.search.acceptance import LIMITED, UNSURE
from identification.diagnosis.search.attribution import selected
from identification.diagnosis.search.candidates import Candidate, candidates_of
from identification.diagnosis.search.trials import FAR_LESS, NO_TRACE, UNSEEN, UNSTABLE, trials_of
from identification.diagnosis.search.workbench import State, Workbench
from identification.experiments.missions import run_mission
from tests.identification.gliders import QUICK

OFFSET, GAIN, LAG = "effects.rudder.offset", "effects.rudder.gain", "effects.rudder.lag"


def quiet(fraction: float, text: str) -> None:
    pass


@pytest.fixture(scope="module")
def tried(offset_log):
    bench, state, candidates = offset_log
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


def test_a_candidate_that_acts_like_the_first_begins_where_its_fit_has_ended(offset_log, monkeypatch):
    bench, state, candidates = offset_log
    begun, nears = [], []
    monkeypatch.setattr(trials, "all_finished", lambda bench, state, found, count: begun.extend(found) or [])
    trials_of(bench, state, candidates, len(candidates), quiet, ())
    monkeypatch.undo()
    first = next(b for b in begun if b.screening.candidate.paths == (OFFSET,))
    other = next(b for b in begun if b is not first)
    twin = replace(first, screening=replace(first.screening, candidate=Candidate("twin", (OFFSET,))))

    def judged(bench, state, candidate, screening, near, count, settled=False):
        nears.append((near, settled))
        return own(bench, state, candidate, screening, near, count, settled)

    own = trials.judged
    monkeypatch.setattr(trials, "judged", judged)
    led, *_ = trials.all_finished(bench, state, [first, twin, other], len(candidates))
    near, settled = next(n for n in nears[1:] if n[0].paths == first.state.paths)
    assert near.plant.vector == pytest.approx(led.state.plant.vector, rel=1e-12)
    assert settled
    unlike, settled = next(n for n in nears[1:] if n[0].paths != first.state.paths)
    assert value_at(unlike.plant, "hull.n_r") != value_at(led.state.plant, "hull.n_r")
    assert not settled


def test_what_is_chosen_passes_all_that_the_gate_asks(offset_log, tried, monkeypatch):
    """A first judgement assumes white errors; the wider intervals of the complete gate may refuse what it accepts."""
    bench, state, candidates = offset_log
    assert trials.sure(bench, state, tried[OFFSET], len(candidates)).objection == ""
    monkeypatch.setattr(Workbench, "intervals", lambda self, of: dict.fromkeys(of.paths, (0.0, 1.0, 1000.0)))
    assert trials.sure(bench, state, tried[OFFSET], len(candidates)).objection == UNSURE
    refused = replace(tried[OFFSET], objection=FAR_LESS)
    assert trials.sure(bench, state, refused, len(candidates)) is refused
    made = selected(bench, state, candidates, len(candidates), ())
    assert made.chosen is None
    assert next(t for t in made.trials if t.candidate.paths[0] == OFFSET).objection == UNSURE


def test_a_trial_is_what_is_likelier_from_the_given_coefficients(offset_log, monkeypatch):
    bench, state, candidates = offset_log
    asked, better = [], []

    def likelier(self: Workbench, reached: State, hopeless: float) -> State:
        asked.append(hopeless)
        better.append(replace(reached))
        return better[-1]

    monkeypatch.setattr(Workbench, "likelier_from_given", likelier)
    (found,) = trials_of(bench, state, [c for c in candidates if OFFSET in c.paths], len(candidates), quiet, ())
    assert asked == [HOPELESS]
    assert found.state is better[0]


def test_one_whose_step_promises_nothing_is_not_fitted(offset_log):
    bench, _, candidates = offset_log
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


def test_one_that_was_fitted_and_gains_little_is_not_significant(tried):
    little = [t for t in tried.values() if t.objection == "not significant"]
    assert little
    assert all(t.state is not None for t in little)


def test_one_that_the_record_cannot_show_is_not_fitted(offset_log):
    """Without roll, nothing depends on it; at a constant speed, a growth with speed acts like a coefficient."""
    bench, _, candidates = offset_log
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


def test_one_without_a_stable_run_is_refused(offset_log, monkeypatch):
    bench, state, candidates = offset_log

    def diverged(bench, state, base, screening, rival):
        lost = replace(state.point, scores=np.full_like(state.point.scores, -np.inf))
        return trials.Begun(screening, State(state.plant, (*state.paths, *screening.candidate.free), lost), -np.inf)

    monkeypatch.setattr(trials, "begun_from", diverged)
    only = [c for c in candidates if OFFSET in c.paths]
    (found,) = trials_of(bench, state, only, len(candidates), quiet, ())
    assert found.objection == UNSTABLE
    assert found.train == 0.0
