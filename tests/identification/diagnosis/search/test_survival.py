"""Tests of the choices of halves of a record, and of the choice without a part of it."""

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from identification.deciding import TIE
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search import survival as module
from identification.diagnosis.search.attribution import Round, selected
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate, candidates_of
from identification.diagnosis.search.survival import Survival, chosen_without, survival
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.missions import run_mission
from tests.identification.diagnosis.stand_ins import state_of, trial_of
from tests.identification.gliders import QUICK

FIRST, SECOND = Candidate("first", ("effects.rudder.offset",)), Candidate("second", ("effects.rudder.lag",))
COUNT = 20


class Told:
    """The evidence of the parts for a state, which is summed; a refit changes nothing."""

    def __init__(self, evidence):
        self.evidence = np.asarray(evidence, dtype=float)

    def refitted(self, counted):
        return np.zeros(0), 0.5 * float(self.evidence[counted].sum())


class Parts:
    """A bench of six parts, each with its evidence for each of two trials."""

    parts = range(6)

    def __init__(self, first, second, tied=False):
        self.before = state_of(QUICK)
        trials = [trial_of(c, state_of(QUICK, *c.paths)) for c in (FIRST, SECOND)]
        self.told = {self.before: Told(np.zeros(6))}
        self.told |= {t.state: Told(e) for t, e in zip(trials, (first, second), strict=True)}
        self.made = Round(tuple(trials), trials[0], tuple(trials[1:]) if tied else (), {}, before=self.before)

    def by_part(self, state, soon=False):
        return self.told[state]

    @property
    def found(self) -> Survival:
        return survival(self, self.made, self.before, COUNT)  # type: ignore[arg-type]


def test_what_every_part_shows_survives():
    found = Parts([20.0] * 6, [1.0] * 6).found
    assert (found.frequency, found.instead) == (1.0, {})
    assert found.holds
    assert found.rivals == ()


def test_a_half_needs_half_of_its_share_of_the_evidence():
    each = 0.5 * threshold(COUNT) / 6.0
    assert Parts([1.01 * each] * 6, [0.0] * 6).found.frequency == 1.0
    none = Parts([0.99 * each] * 6, [0.0] * 6).found
    assert (none.frequency, none.holds) == (0.0, False)


def test_what_one_part_alone_shows_does_not_hold():
    """Ten of twenty halves contain the part and choose the effect; the others choose nothing."""
    found = Parts([100.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0] * 6).found
    assert found.frequency == 0.5
    assert not found.holds


def test_parts_that_show_another_effect_make_it_a_rival():
    found = Parts([40.0, 40.0, 40.0, 40.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 60.0, 60.0]).found
    # 4 of 20 halves contain both last parts: 40 for the first effect, 120 for the second; with one of them, 80 and 60
    assert found.frequency == pytest.approx(0.8)
    assert found.instead == pytest.approx({SECOND.paths[0]: 0.2})
    assert found.rivals == SECOND.paths
    tied = Parts([40.0, 40.0, 40.0, 40.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 60.0, 60.0], tied=True).found
    assert (tied.frequency, tied.instead) == (1.0, {})


def test_parts_that_tell_two_effects_apart_less_well_do_not_contradict():
    """The other effect leads in each half by less than half of the width of a tie."""
    lead = TIE / 6.0
    assert Parts([20.0] * 6, [20.0 + 0.99 * lead] * 6).found.frequency == 1.0
    assert Parts([20.0] * 6, [20.0 + 1.01 * lead] * 6).found.instead == pytest.approx({SECOND.paths[0]: 1.0})


def test_refused_trials_and_those_without_a_fit_are_never_preferred():
    bench = Parts([20.0] * 6, [500.0] * 6)
    lost = trial_of(SECOND, bench.made.trials[1].state, module.LIMITED)
    bench.made = Round(
        (bench.made.trials[0], lost, trial_of(SECOND)), bench.made.trials[0], (), {}, before=bench.before
    )
    assert bench.found.frequency == 1.0


def test_without_a_part_the_others_choose():
    """If all parts see the effect, it stays without any one; without the only part that sees it, the choice changes."""
    state = state_of(QUICK, "effects.rudder.offset")

    def without(bench, part):
        return chosen_without(bench, bench.before, state, [bench.made], COUNT, part)  # type: ignore[arg-type]

    steady, single = Parts([20.0] * 6, [0.0] * 6), Parts([100.0, 0, 0, 0, 0, 0], [0.0] * 6)
    assert without(steady, 0) is state
    assert without(single, 1) is state
    assert without(single, 0) is single.before
    other = Parts([100.0, 0, 0, 0, 0, 0], [10.0] * 6)
    assert without(other, 0) is other.made.trials[1].state


@pytest.mark.parametrize("half", [False, True])
def test_an_effect_of_a_log_survives_and_one_that_begins_in_it_is_seen_in_fewer_halves(half):
    path = "effects.rudder.offset"
    rng, true = np.random.default_rng(2), replace_at(QUICK, path, 0.05)
    record = run_mission(true, rng, duration=1200.0)
    if half:  # the heading drifts in the last sixth only
        plain = run_mission(QUICK, np.random.default_rng(2), duration=1200.0)
        late = record.time > 1000.0
        drift = np.where(late, 0.004 * (record.time - 1000.0), 0.0)
        record = plain.with_channels({"heading_rad": plain["heading_rad"] + drift})
    bench = Workbench(QUICK, record, parts_of(QUICK, record), 0.1)
    nominal = bench.fit(QUICK, QUICK.family.coefficients)
    made = selected(bench, nominal, candidates_of(QUICK, record), COUNT, ())
    if half:
        assert made.chosen is None or survival(bench, made, nominal, COUNT).frequency < 0.8
    else:
        assert made.chosen is not None
        assert survival(bench, made, nominal, COUNT).frequency > 0.9
        plant = bench.unseen(chosen_without(bench, nominal, made.chosen.state, [made], COUNT, 0), 0)
        assert value_at(plant, path) == pytest.approx(0.05, abs=0.01)
