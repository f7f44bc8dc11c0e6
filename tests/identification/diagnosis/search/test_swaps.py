"""Tests of second thoughts: a wrong effect is replaced by the right one, and a right one stays."""

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from identification.diagnosis import diagnose
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search.attribution import Round, selected
from identification.diagnosis.search.candidates import candidates_of
from identification.diagnosis.search.swaps import Reconsidering
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.missions import run_mission

TRUE, WRONG = "effects.rudder.dead_time", "effects.rudder.deadband"


@pytest.fixture(scope="module")
def search():
    """The search over all candidates for a glider with a late rudder, and the state before any is chosen."""
    plant = load_vehicle("ganeshblue")
    record = run_mission(replace_at(plant, TRUE, 4.0), np.random.default_rng(3))
    bench = Workbench(plant, record, parts_of(plant, record), 0.1)
    return Reconsidering(bench, candidates_of(plant, record), 3, ()), bench.fit(plant, plant.family.coefficients)


def begun(search, start, path):
    """A round whose only candidate was one effect."""
    only = [c for c in search.candidates if path in c.paths]
    made = selected(search.bench, start, only, len(search.candidates), ())
    return Round(made.trials, made.trials[0], (), {})


@pytest.mark.slow
def test_a_wrong_effect_gives_way(search):
    reconsidering, start = search
    first = begun(reconsidering, start, WRONG)
    assert first.chosen.state is not None
    state, rounds = reconsidering.swapped(first.chosen.state, [first])
    assert [r.chosen.candidate.paths for r in rounds] == [(TRUE,)]
    assert WRONG not in state.paths
    assert value_at(state.plant, WRONG) == 0.0
    assert value_at(state.plant, TRUE) == pytest.approx(4.0, abs=0.3)  # three standard errors


@pytest.mark.slow
def test_a_right_effect_stays_as_it_is(search):
    reconsidering, start = search
    first = begun(reconsidering, start, TRUE)
    state, rounds = reconsidering.swapped(first.chosen.state, [first])
    assert state is first.chosen.state
    assert rounds == [first]


@pytest.mark.slow
def test_a_pair_that_works_only_together_is_found():
    plant = load_vehicle("qiandao_float")
    true = {"effects.piston.slowness": 207.0, "effects.tether.drag": 0.306}
    depths = [50.0, 5.0, 40.0, 15.0, 36.0, 8.0, 48.0, 12.0, 28.0, 0.0]
    record = run_mission(replace_at(plant, true), np.random.default_rng(1), target_depths=depths, duration=2400.0)
    found = diagnose(record, plant)
    assert found.verdict in ("named", "tied")
    assert {effect.path for effect in found.effects} == set(true)
