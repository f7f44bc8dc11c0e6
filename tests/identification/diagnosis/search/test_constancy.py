"""Whether an effect has one size: a rudder offset throughout, and one that begins half-way."""

import numpy as np

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from identification.deciding import UNSTEADY
from identification.diagnosis import as_json, diagnose
from identification.diagnosis.judge import findings, judging
from identification.diagnosis.log.checking import Asked, check_log
from identification.diagnosis.search.constancy import Steadiness, steadiness
from identification.diagnosis.search.discovery import Discovery
from identification.diagnosis.search.remainder import Left, what_is_left
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.heading_control import closed_loop
from scripts.blind.changing import ChangingGlider

OFFSET = "effects.rudder.offset"


def log_of(begins, path=OFFSET, size=0.03):
    """A log in which a parameter has another size from a time on, s."""
    plant = load_vehicle("slocum")
    bent = replace_at(plant, path, size)
    moving = ChangingGlider(plant, lambda t: bent if t >= begins else plant)
    return closed_loop(moving, rng=np.random.default_rng(700), duration=600.0)


def fitted(begins, path=OFFSET, size=0.03, also=(OFFSET,)):
    """The bench and the state of such a log."""
    plant, record = load_vehicle("slocum"), log_of(begins, path, size)
    log = check_log(record, plant, Asked(trust=True))
    bench = Workbench(log.plant, log.record, log.parts, 0.1, log.every_window)
    return bench, bench.fit(bench.plant, (*plant.coefficients, *also))


def test_parts_contradict_each_other_where_an_effect_begins_half_way_and_only_there():
    assert steadiness(*fitted(-100.0), [OFFSET]).probability > 0.01
    assert steadiness(*fitted(300.0), [OFFSET]).probability < UNSTEADY


def test_nothing_constant_is_named_where_parts_contradict_each_other(monkeypatch):
    """Although the effect is sure, leaves nothing, and makes unseen parts of the log likelier."""
    record, plant = log_of(-100.0), load_vehicle("slocum")
    constant = diagnose(record, plant)
    assert [e.path for e in constant.effects] == [OFFSET]
    assert constant.alike == ()
    monkeypatch.setattr(findings, "steadiness", lambda bench, state, paths: Steadiness(paths[0], 0.5 * UNSTEADY))
    monkeypatch.setattr(judging, "discover", lambda bench, state, *_: Discovery(state.plant, state.paths, state))
    found = diagnose(record, plant)
    assert (found.verdict, found.effects, found.tied, found.common) == ("unexplained", (), (), ())
    (alike,) = found.alike
    assert (alike.path, found.left) == (OFFSET, Left(changes=OFFSET))
    assert value_at(found.after.plant, OFFSET) == alike.value == constant.effects[0].value  # the fitted vehicle has it
    said = found.summary()
    assert "no constant effect explains it. Part of the difference acts like " + alike.told in said
    assert said.count("Parts of the log contradict each other") == 1
    assert "contradict each other in its size: `auv-gym onset` looks for when it begins or ends." in said
    told = as_json(found)
    assert told["effects"] == told["tied"] == []
    assert [e["path"] for e in told["acts_like"]] == [OFFSET]


def test_a_coefficient_that_changes_half_way_is_left():
    """Of all coefficients at once: the rudder's, which nothing else may pay for."""
    given = value_at(load_vehicle("slocum"), "hull.n_delta")
    assert what_is_left(*fitted(300.0, "hull.n_delta", 1.5 * given, ()), ()).changes == "hull.n_delta"
    assert what_is_left(*fitted(300.0, "hull.n_delta", given, ()), ()) == Left()
