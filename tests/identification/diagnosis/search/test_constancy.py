"""Whether an effect has one size: a rudder offset throughout, and one that begins half-way."""

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from identification.deciding import UNSTEADY
from identification.diagnosis.log.checking import Asked, check_log
from identification.diagnosis.search.constancy import steadiness
from identification.diagnosis.search.remainder import Left, what_is_left
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.heading_control import closed_loop
from identification.fit import filtering
from scripts.blind.changing import ChangingGlider

OFFSET = "effects.rudder.offset"


def fitted(begins, path=OFFSET, size=0.03, also=(OFFSET,)):
    """The bench and the state of a log in which a parameter has another size from a time on, s."""
    plant = load_vehicle("slocum")
    bent = replace_at(plant, path, size)
    moving = ChangingGlider(plant, lambda t: bent if t >= begins else plant)
    record = closed_loop(moving, rng=np.random.default_rng(700), duration=600.0)
    log = check_log(record, plant, Asked(trust=True))
    bench = Workbench(log.plant, log.record, log.parts, 0.1, log.every_window)
    return bench, bench.fit(bench.plant, (*plant.coefficients, *also))


def test_parts_contradict_each_other_where_an_effect_begins_half_way_and_only_there():
    assert steadiness(*fitted(-100.0), [OFFSET]).probability > 0.01
    assert steadiness(*fitted(300.0), [OFFSET]).probability < UNSTEADY


def test_a_coefficient_that_changes_half_way_is_left():
    """Of all coefficients at once: the rudder's, which nothing else may pay for."""
    given = value_at(load_vehicle("slocum"), "hull.n_delta")
    assert what_is_left(*fitted(300.0, "hull.n_delta", 1.5 * given, ()), ()).changes == "hull.n_delta"
    assert what_is_left(*fitted(300.0, "hull.n_delta", given, ()), ()) == Left()


def test_changes_of_coefficients_are_seen_as_well_by_responses(monkeypatch):
    """In the linearised filter, at less cost, where there are enough of them to hold how the vehicle answers."""
    given = value_at(load_vehicle("slocum"), "hull.n_delta")
    bench, state = fitted(300.0, "hull.n_delta", given, ())
    own, work = [p for p in state.paths if p in state.plant.doubted], bench.problem.work
    began = work.done
    itself = steadiness(bench, state, own, quietly=False)
    between = work.done
    monkeypatch.setattr(filtering, "_MANY", 2)
    soon = steadiness(bench, state, own, quietly=False)
    assert itself.probability > UNSTEADY
    assert soon.path == itself.path
    assert soon.probability == pytest.approx(itself.probability, rel=0.05)
    assert 0 < work.done - between < between - began
