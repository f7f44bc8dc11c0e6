"""Effects with their intervals: by the profile of the likelihood at corners, all else refitted."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at
from identification.diagnosis.judge.findings import effects_of
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search.candidates import Candidate
from identification.diagnosis.search.survival import Survival
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.missions import run_mission
from identification.fit.intervals import information_of
from tests.identification.diagnosis.stand_ins import round_of, trial_of
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
