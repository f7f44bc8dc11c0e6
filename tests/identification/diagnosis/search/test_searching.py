"""Tests of a whole search, such as its repetition if the result needs shorter integration steps or further noises."""

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.model import Diverged
from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from identification.diagnosis.log.checking import Asked, check_log
from identification.diagnosis.search import searching, workbench
from identification.diagnosis.search.attribution import FURTHER, attribute
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import candidates_of
from identification.diagnosis.search.known import Known, fit_known
from identification.diagnosis.search.remainder import Left
from identification.diagnosis.search.searching import search_effects
from identification.diagnosis.search.swaps import Reconsidering
from identification.diagnosis.search.workbench import State, Workbench
from identification.experiments.heading_control import closed_loop
from identification.experiments.missions import run_mission
from identification.fit.noises import Noise
from identification.fit.steps import in_steps


@pytest.mark.parametrize("asked_at", [1, 2])
def test_it_is_repeated_in_the_steps_that_suit_what_was_found(monkeypatch, asked_at):
    plant = load_vehicle("slocum")
    log = check_log(closed_loop(plant, rng=np.random.default_rng(3), duration=400.0), plant, Asked())
    known, asked = fit_known(log, lambda fraction, text: None), []
    finer = replace(known)

    def suited(self: Known, state) -> Known:
        asked.append(self)
        return finer if len(asked) == asked_at else self

    monkeypatch.setattr(Known, "in_suited_steps", suited)
    found = search_effects(log, known, lambda fraction, text: None)
    assert found.known is finer
    assert [one is finer for one in asked] == [False] * asked_at + [True] * 2


def test_each_round_ends_with_a_fit_from_the_given_coefficients_however_far_behind_they_are(monkeypatch):
    """Coefficients that have compensated an effect may stay where they are beside it, and others compensate them."""
    plant = load_vehicle("slocum")
    flown = replace_at(plant, "effects.rudder.offset", 0.05)
    log = check_log(closed_loop(flown, rng=np.random.default_rng(3), duration=600.0), plant, Asked(most=1))
    known, asked = fit_known(log, lambda fraction, text: None), []
    fits = Workbench.likelier_from_given

    def likelier(bench, state, hopeless):
        found = fits(bench, state, hopeless)
        if hopeless == np.inf:
            found = replace(found)
            asked.append((state, found))
        return found

    monkeypatch.setattr(Workbench, "likelier_from_given", likelier)
    candidates = candidates_of(known.bench.plant, log.record)
    state, rounds = attribute(known.bench, known.nominal, candidates, 1, [], lambda fraction, text: None, ())
    assert rounds[0].chosen.candidate.paths == ("effects.rudder.offset",)
    ((before, after),) = asked
    assert before is rounds[0].chosen.state
    assert state is after is rounds[1].before


def test_a_fit_that_has_ended_in_a_valley_goes_on_from_a_trial_that_gains_more_than_chance(monkeypatch):
    """From a valley, any fit with one more free parameter gains, so that something would seem to be missing."""
    plant = load_vehicle("slocum")
    log = check_log(closed_loop(plant, rng=np.random.default_rng(3), duration=600.0), plant, Asked())
    known = fit_known(log, lambda fraction, text: None)
    bench, top = known.bench, known.nominal
    far = bench.fit(replace_at(top.plant, "hull.n_r", 1.4 * value_at(top.plant, "hull.n_r")), ())
    stuck = replace(known, nominal=replace(far, paths=top.paths))
    trial = bench.fit(top.plant, (*top.paths, "effects.rudder.offset"), top)
    gained = bench.gain(stuck.nominal, trial)
    bar = threshold(10)
    assert gained > 2.0 * bar
    trials = [SimpleNamespace(state=trial, train=gained), SimpleNamespace(state=None, train=0.0)]
    assert bench.gain(stuck.out_of_valley(trials, bar).nominal, top) == pytest.approx(0.0, abs=0.5)
    assert stuck.out_of_valley(trials[1:], bar) is stuck
    assert stuck.out_of_valley(trials, 1.1 * gained) is stuck  # as much can be gained by chance
    assert known.out_of_valley(trials, bar) is known  # there is nothing to gain
    monkeypatch.setattr(
        searching, "attribute", lambda bench, nominal, *_: (nominal, [SimpleNamespace(trials=trials, chosen=None)])
    )
    monkeypatch.setattr(searching, "settled", lambda bench, nominal, state, rounds, count: (state, []))
    found = search_effects(log, stuck, lambda fraction, text: None)
    assert bench.gain(found.nominal, top) == pytest.approx(0.0, abs=0.5)


@pytest.fixture(scope="module")
def turning():
    """A log with a rudder offset, and the fits before a search."""
    plant = replace_at(load_vehicle("slocum"), "effects.rudder.offset", 0.05)
    log = check_log(closed_loop(plant, rng=np.random.default_rng(3), duration=400.0), load_vehicle("slocum"), Asked())
    return log, fit_known(log, lambda fraction, text: None)


def test_what_is_sought_is_fitted_to_the_end_however_little_it_promises(turning):
    log, known = turning
    candidates = candidates_of(known.bench.plant, log.record)

    def fitted(*sought):
        _, rounds = attribute(known.bench, known.nominal, candidates, 1, [], lambda fraction, text: None, sought)
        return {t.candidate.paths: t for t in rounds[0].trials}

    (behind, *_) = (paths for paths, t in fitted().items() if t.state is None and t.screening.evidence > 20.0)
    assert fitted(behind[0])[behind].state is not None


@pytest.mark.parametrize(
    "ahead, farther, kept", [(0.0, False, False), (5.0, False, False), (50.0, False, True), (0.0, True, True)]
)
def test_a_search_is_repeated_beside_further_noises(monkeypatch, turning, ahead, farther, kept):
    """The first search counts if the second one ends far less likely, or its free runs are farther from the log."""
    (log, known), asked, sought = turning, [], []
    other = replace(known)

    def noisier(self: Known, state: State) -> tuple[Known, State]:
        asked.append(state.paths)
        likelier = replace(state.point, scores=state.point.scores + ahead / state.point.scores.size)
        return (other, replace(state, point=likelier)) if self is known else (self, state)

    nearer = Workbench.nearer

    def selecting(*arguments):
        sought.append(arguments[-1])
        return attribute(*arguments)

    def foretells(bench: Workbench, before: State, after: State) -> float:
        same = before.paths == after.paths
        return 1.0 if farther and same else nearer(bench, before, after)

    monkeypatch.setattr(Known, "with_further_noises", noisier)
    monkeypatch.setattr(Workbench, "nearer", foretells)
    monkeypatch.setattr(searching, "attribute", selecting)
    found = search_effects(log, known, lambda fraction, text: None)
    assert found.known is (known if kept else other)
    assert sum(made.chosen is not None for made in found.rounds) == 1
    assert len(asked) == 2  # once in each search, where no further effect was accepted
    assert all("effects.rudder.offset" in paths or "effects.yaw.moment" in paths for paths in asked)
    assert not sought[0]
    assert set(sought[1]) == {*asked[0]} - {*known.nominal.paths}  # effects found without them are fitted to the end


def test_further_noises_are_looked_for_also_where_there_was_no_time_for_a_further_effect(turning, monkeypatch):
    """The search is repeated once: a search beside further noises without time left ends with its result."""
    (log, known), asked = turning, []
    other = replace(known)

    def noisier(self: Known, state: State) -> tuple[Known, State]:
        asked.append(self)
        return (other, state) if self is known else (self, state)

    monkeypatch.setattr(Known, "with_further_noises", noisier)
    monkeypatch.setattr(Workbench, "goes_on", lambda bench, step: step != FURTHER)
    found = search_effects(log, known, lambda fraction, text: None)
    assert asked == [known]
    assert found.known is other
    assert [made.chosen is None for made in found.rounds] == [False]


def test_a_search_beside_further_noises_that_has_no_time_to_end_does_not_count(turning, monkeypatch):
    """The one without them, which ended, counts."""
    log, known = turning
    bench = copy(known.bench)
    bench._begin()
    other = replace(known, bench=bench)

    def goes_on(self: Workbench, step: str) -> bool:
        if self is bench and step == FURTHER:
            self.unfinished.append(step)
        return self is not bench

    monkeypatch.setattr(Known, "with_further_noises", lambda self, state: (other, state))
    monkeypatch.setattr(Workbench, "goes_on", goes_on)
    found = search_effects(log, known, lambda fraction, text: None)
    assert found.known is known
    assert found.rounds[-1].chosen is None  # it has looked for a further effect


@pytest.mark.parametrize(
    "swell, found_one, left, kept",
    [
        ({}, True, False, False),
        ({6.0: ["w_mps"]}, True, False, False),
        ({6.0: ["v_mps", "w_mps"]}, True, False, True),
        ({6.0: ["v_mps", "w_mps"]}, False, False, False),
        ({6.0: ["v_mps", "w_mps"]}, True, True, False),
    ],
)
def test_waves_that_show_before_a_search_are_there_throughout_unless_it_explains_them(
    turning, monkeypatch, swell, found_one, left, kept
):
    """Then there is one search only, beside them; other causes of oscillation may look like waves at first."""
    (log, known), searched = turning, []
    other = replace(known)
    monkeypatch.setattr(searching, "candidates_of", lambda *given: candidates_of(*given) if found_one else [])
    monkeypatch.setattr(searching, "what_is_left", lambda *_: Left(("heading_rad",)) if left else Left())

    def selecting(bench, *arguments):
        searched.append(bench)
        return attribute(bench, *arguments)

    def noise_at(point):
        return Noise({}, {}, {period: dict.fromkeys(pushed, (0.1, 10.0)) for period, pushed in swell.items()})

    monkeypatch.setattr(Known, "with_waves", lambda self: other)
    monkeypatch.setattr(searching, "attribute", selecting)
    monkeypatch.setattr(known.bench.problem, "noise_at", noise_at)
    found = search_effects(log, known, lambda fraction, text: None)
    assert found.known is (other if kept else known)
    assert len(searched) == (1 if kept else 2)
    assert any(made.chosen is not None for made in found.rounds) is found_one


def test_free_runs_are_nearer_with_what_is_there(turning, monkeypatch):
    (_, known), runs = turning, workbench.free_runs
    bench, nominal = known.bench, known.nominal
    there = replace(nominal, plant=replace_at(nominal.plant, "effects.rudder.offset", 0.05))
    nearer = bench.nearer(nominal, there)
    assert nearer > 0.5
    assert bench.nearer(there, nominal) == pytest.approx(-nearer)

    def diverging(plant, *arguments):
        if plant is there.plant:
            raise Diverged(1.0, "north_m", {})
        return runs(plant, *arguments)

    nominal, there = replace(nominal), replace(there)
    monkeypatch.setattr(workbench, "free_runs", diverging)
    assert bench.nearer(nominal, there) == -1.0
    assert bench.nearer(there, nominal) == 1.0
    assert bench.nearer(there, there) == 0.0


@pytest.mark.slow
def test_what_is_known_is_fitted_in_the_steps_that_suit_it(monkeypatch):
    """For an unstable vehicle without process noise, first guesses of noises allow longer steps than the log does."""
    plant = load_vehicle("remus100")
    log = check_log(
        run_mission(plant, np.random.default_rng(1), duration=60.0), plant, Asked(window=8.0, settle=2.0, doubt=0.0)
    )
    monkeypatch.setattr(workbench, "brisk", lambda problem: in_steps(problem, 0.05))
    known = fit_known(log, lambda fraction, text: None)
    assert known.plant.longest_step < 0.05
    assert known.given.plant.longest_step == known.nominal.plant.longest_step == known.plant.longest_step


@pytest.mark.parametrize("pushed, left, tried", [(True, False, True), (False, True, True), (False, False, False)])
def test_pairs_are_tried_beside_process_noise_which_may_have_taken_their_part(monkeypatch, pushed, left, tried):
    plant, asked = load_vehicle("slocum"), []
    log = check_log(closed_loop(plant, rng=np.random.default_rng(3), duration=400.0), plant, Asked())
    known = fit_known(log, lambda fraction, text: None)
    monkeypatch.setattr(searching, "what_is_left", lambda *_: Left(("heading_rad",)) if left else Left())
    monkeypatch.setattr(known.bench.problem, "is_pushed", lambda point: pushed)

    def paired(self, state, rounds):
        asked.append(state)
        return state, rounds

    monkeypatch.setattr(Reconsidering, "paired", paired)
    search_effects(log, known, lambda fraction, text: None)
    assert bool(asked) is tried


def test_what_is_left_in_averages_is_asked_of_single_readings(monkeypatch, turning):
    (log, known), asked = turning, []
    finer = replace(known)

    def single(known_: Known, state: State, left: Left) -> Known:
        asked.append(left)
        return finer if known_ is known else known_

    monkeypatch.setattr(searching, "_in_single_readings", single)
    found = search_effects(log, known, lambda fraction, text: None)
    assert found.known is finer
    assert asked[-1] is found.left
    assert len(asked) == 2
