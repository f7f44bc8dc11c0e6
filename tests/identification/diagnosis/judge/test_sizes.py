"""Tests of effects with their intervals: at corners from the likelihood profile, with all else refitted."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from identification.diagnosis.judge.effects import Coefficient
from identification.diagnosis.judge.sizes import coefficient_of, effects_of, turned_gains
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search.candidates import Candidate
from identification.diagnosis.search.constancy import Steadiness
from identification.diagnosis.search.survival import Survival
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.missions import run_mission
from identification.fit.intervals import information_of
from tests.identification.diagnosis.stand_ins import PLANT, round_of, state_of, trial_of
from tests.identification.gliders import QUICK


@pytest.mark.parametrize("path, value", [("effects.rudder.deadband", 0.04), ("effects.compass.lag", 3.0)])
def test_at_the_ends_of_a_profile_the_log_likelihood_has_fallen_by_the_quantile(path, value):
    record = run_mission(replace_at(QUICK, path, value), np.random.default_rng(8), duration=900.0)
    bench = Workbench(QUICK, record, parts_of(QUICK, record), 0.1)
    paths = (*QUICK.family.coefficients, path)
    state = bench.fit(replace_at(bench.plant, path, value), paths)
    rounds = [
        replace(round_of(trial_of(Candidate(path, (path,)), state)), evidence=(1000.0, 900.0))
    ]  # far above the bar
    ((effect,), _) = effects_of(bench, state, rounds, bench.intervals(state), [Survival(0.9, {})], 18)
    low, high = effect.ci95
    assert low < effect.value < high
    assert high - low < value
    best = bench.problem.objective(state.point, paths)
    reach = information_of(bench.problem, state.point, paths).reach[-1]
    assert 1.96 <= reach < 4.0
    for end in (low, high):
        plant = replace_at(state.plant, path, end)
        there = bench.problem.solve(plant, paths[:-1], state.point, noise=False)
        fallen = 2.0 * (best - bench.problem.objective(there, paths[:-1]))
        assert fallen == pytest.approx(reach**2, rel=0.25)  # interpolated


def test_a_member_of_a_tie_says_which_other_effects_its_likeliest_set_does_without(monkeypatch):
    monkeypatch.setattr("identification.diagnosis.judge.sizes.steadiness", lambda *given: Steadiness("", 1.0))
    width, play, offset, moment = (
        f"effects.{name}" for name in ("rudder.deadband", "rudder.backlash", "rudder.offset", "yaw.moment")
    )
    trials = {p: trial_of(Candidate(p, (p,)), state_of(PLANT, width, offset, moment)) for p in (width, offset, moment)}
    tied = trial_of(Candidate(play, (play,)), state_of(PLANT, play, moment))
    rounds = [replace(round_of(t), evidence=(90.0, 80.0)) for t in trials.values()]
    rounds[0] = replace(rounds[0], tied=(tied,))
    sizes = dict.fromkeys((width, play, offset, moment), (0.1, 0.01, 0.02))
    bench = SimpleNamespace(intervals=lambda state: sizes, interval=lambda state, path: (0.08, 0.12))
    found = SimpleNamespace(
        sets=(None,), best_with=lambda path: SimpleNamespace(state=tied.state), probability=lambda path: 0.5
    )
    survived = [Survival(1.0, {})] * 3
    effects, groups = effects_of(bench, trials[width].state, rounds, sizes, survived, 18, found)  # type: ignore[arg-type]
    assert groups == [(width, play)]
    assert [m.spared for e in effects for m in e.members] == [(offset,)]


@pytest.mark.parametrize(
    "path, ci95, turned",
    [
        ("hull.n_delta", (-0.0003, -0.0002), True),
        ("hull.n_delta", (-0.0003, 0.0001), False),  # uncertain
        ("hull.n_r", (-0.0003, -0.0002), False),  # no actuator
    ],
)
def test_an_actuator_that_surely_acts_the_other_way_is_told(path, ci95, turned):
    own = Coefficient(path, path, "", 0.0002, -0.00025, ci95)
    other = Coefficient("hull.n_v", "N_v", "", 0.1, 0.1, (0.09, 0.11))
    assert turned_gains(PLANT, [own, other]) == ([own] if turned else [])


@pytest.mark.parametrize(
    "share, error, stated, moved, wrong",
    [
        (0.2, 0.01, 0.0, True, True),
        (0.2, 0.01, 0.3, True, False),  # within the vehicle's stated deviation
        (0.2, 0.1, 0.3, False, False),  # uncertain
        (0.01, 0.001, 0.0, False, False),  # too little
    ],
)
def test_a_coefficient_that_surely_moved_is_wrong_only_beyond_what_is_stated(share, error, stated, moved, wrong):
    given = value_at(PLANT, "hull.n_delta")
    plant = replace(PLANT, deviations={"hull.n_delta": stated * abs(given)} if stated else {})
    size = ((1.0 + share) * given, error * abs(given), 2.0 * error * abs(given))
    c = coefficient_of(plant, "hull.n_delta", size, 18, plant.deviation("hull.n_delta", 0.1))
    assert (c.moved, c.wrong) == (moved, wrong)
