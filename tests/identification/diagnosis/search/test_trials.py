"""Why a candidate is not even fitted to the end, or refused when it is: each reason on a glider's log."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from identification.diagnosis.search import trials
from identification.diagnosis.search.candidates import candidates_of
from identification.diagnosis.search.trials import FAR_LESS, NO_TRACE, UNSEEN, UNSTABLE, trials_of
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.missions import run_mission
from identification.fit.windows import free_run_windows, held_out
from tests.identification.gliders import QUICK

OFFSET, GAIN = "effects.rudder.offset", "effects.rudder.gain"


def quiet(fraction: float, text: str) -> None:
    pass


@pytest.fixture(scope="module")
def start():
    """A glider's log with a rudder offset: its bench, the refitted vehicle, and all candidates."""
    plant = QUICK
    record = run_mission(replace_at(plant, OFFSET, 0.05), np.random.default_rng(1), duration=600.0)
    bench = Workbench(plant, record, *held_out(plant, record, free_run_windows(plant, record, plant.window)), 20.0, 0.1)
    return bench, bench.fit(plant, plant.family.coefficients), candidates_of(plant, record)


@pytest.fixture(scope="module")
def tried(start):
    bench, state, candidates = start
    return {t.candidate.paths[0]: t for t in trials_of(bench, state, candidates, len(candidates), quiet)}


def test_the_right_one_is_accepted_and_leads(tried):
    assert tried[OFFSET].objection == ""
    assert max(tried.values(), key=lambda t: t.total) is tried[OFFSET]
    assert value_at(tried[OFFSET].state.plant, OFFSET) == pytest.approx(0.05, abs=0.01)


def test_one_whose_step_promises_nothing_is_not_fitted(start):
    bench, _, candidates = start
    explained = bench.fit(bench.plant, (*bench.plant.family.coefficients, OFFSET))
    (found,) = trials_of(bench, explained, [c for c in candidates if GAIN in c.paths], len(candidates), quiet)
    assert found.objection == NO_TRACE
    assert found.state is None
    assert 0.0 < found.train < 3.0  # less than a fifth of the bar


def test_one_that_gains_far_less_after_a_few_steps_is_not_fitted_to_the_end(tried):
    refused = [t for t in tried.values() if t.objection == FAR_LESS]
    assert refused
    assert all(t.state is None and t.total < 0.1 * tried[OFFSET].total for t in refused)
    assert sum(t.state is not None for t in tried.values()) < 7


def test_one_that_was_fitted_and_gains_little_is_not_significant(tried):
    assert tried["effects.yaw.roll_moment"].objection == "not significant"
    assert tried["effects.yaw.roll_moment"].state is not None


def test_one_that_the_record_cannot_show_is_not_fitted(start):
    """At no roll and one speed, nothing turns with roll, and what grows with the speed is a moment."""
    bench, _, candidates = start
    record = bench.train.record
    flat = record.with_channels({"roll_rad": np.zeros(len(record)), "u_mps": np.full(len(record), 0.4)})
    bench = Workbench(bench.plant, flat, bench.train.windows, bench.held.windows, 20.0, 0.1)
    state = bench.fit(bench.plant, (*bench.plant.family.coefficients, "effects.yaw.moment"))
    paths = ("effects.yaw.roll_moment", "effects.yaw.speed_squared")
    left = [c for c in candidates if c.paths[0] in paths]
    found = {t.candidate.paths[0]: t for t in trials_of(bench, state, left, len(candidates), quiet)}
    assert found[paths[0]].objection == f"{UNSEEN}: changes nothing that was measured"
    assert found[paths[1]].objection.startswith(UNSEEN)
    assert found[paths[1]].objection.endswith("does the same")
    assert all(t.state is None for t in found.values())


def test_one_without_a_stable_run_is_refused(start, monkeypatch):
    bench, state, candidates = start

    def diverged(bench, state, promise):
        return promise, replace(promise.points[0], cost=np.inf)

    monkeypatch.setattr(trials, "_begun", diverged)
    only = [c for c in candidates if OFFSET in c.paths]
    (found,) = trials_of(bench, state, only, len(candidates), quiet)
    assert found.objection == UNSTABLE
    assert found.train == 0.0


def test_a_free_run_that_diverges_is_no_gain_and_the_end_of_one_is(start, monkeypatch):
    bench, state, _ = start
    other, real = replace(state, plant=replace_at(state.plant, GAIN, 0.5)), bench.held.point

    def diverging(vector, starts, paths=()):
        point = real(vector, starts, paths)
        if vector[bench.held.index[GAIN]] == 0.5:
            point.residual[bench.held.offsets[1] :] = np.nan
        return point

    monkeypatch.setattr(bench.held, "point", diverging)
    assert np.isnan(bench.improvements(state, other)[1])
    assert bench.improvements(other, state)[1] == np.inf


def test_evidence_for_a_refit_is_less_what_the_coefficients_had_to_move(start):
    bench, state, _ = start
    given = bench.plant
    moved = replace_at(given, {p: 1.2 * value_at(given, p) for p in given.family.coefficients})
    after = replace(state, plant=moved, train=replace(state.train, vector=moved.vector), colour=np.zeros(3))
    before = replace(after, train=replace(after.train, vector=given.vector))
    assert bench.gains(before, after) == pytest.approx((-2 * 2.0**2, 0.0))  # two coefficients, two deviations each
