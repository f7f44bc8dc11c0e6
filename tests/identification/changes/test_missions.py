"""What has changed between missions: named on the side where it is, and not where it is on both."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from identification.changes import missions
from identification.changes.joined import joined_sides
from identification.changes.missions import Changed, Common, compare_missions, one_or_two
from identification.changes.page import write_comparison
from identification.changes.wording import summary, tied_words
from identification.diagnosis.log.checking import Asked, check_log
from identification.diagnosis.search.known import Known, fit_known
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.float_dives import depth_control
from identification.experiments.heading_control import closed_loop
from identification.fit.changing import ChangingPlant, Course, change

OFFSET = "effects.rudder.offset"


def mission(seed, offset=0.0):
    plant = replace_at(load_vehicle("slocum"), OFFSET, offset)
    return closed_loop(plant, rng=np.random.default_rng(seed), duration=800.0)


@pytest.mark.slow
def test_an_effect_that_is_new_is_named_with_its_size_on_either_side(tmp_path):
    plant = load_vehicle("slocum")
    found = compare_missions(mission(1), mission(2, 0.05), plant, names=(("spring",), ("autumn",)))
    (only,) = found.changed
    assert (only.path, only.surely, found.common) == (OFFSET, True, ())
    assert only.before.ci95[0] - 0.001 < 0.0 < only.before.ci95[1] + 0.001
    assert only.after.ci95[0] < 0.05 < only.after.ci95[1]
    assert only.change.ci95[0] < 0.05 < only.change.ci95[1]
    damping = next(u for u in found.unchanged if u.path == "hull.n_r")
    assert abs(damping.change.value) < damping.detectable < 0.1 * abs(damping.value)
    assert "The rudder offset" not in summary(found)[0]
    assert summary(found)[0].startswith("Rudder offset changed from ")
    written = write_comparison(found, tmp_path)
    told = json.loads(written["changes.json"].read_text())
    assert told["changed"][0]["path"] == OFFSET
    assert "spring" in written["report.html"].read_text()


@pytest.mark.slow
def test_an_effect_on_both_sides_has_not_changed():
    found = compare_missions(mission(1, 0.05), mission(2, 0.05), load_vehicle("slocum"))
    assert found.changed == ()
    assert [c.path for c in found.common] == [OFFSET]


def test_effects_are_sought_again_in_the_steps_that_suit_them(monkeypatch):
    plant, asked, sought = load_vehicle("slocum"), [], []
    sides = [closed_loop(plant, rng=np.random.default_rng(k), duration=300.0) for k in (1, 2)]

    def suited(self, state):
        asked.append(self)
        return replace(self) if len(asked) == 2 else self  # asked first of what is known before the search

    def attributed(bench, nominal, *given):
        sought.append(nominal)
        return nominal, []

    monkeypatch.setattr(Known, "in_suited_steps", suited)
    monkeypatch.setattr(missions, "attribute", attributed)
    assert compare_missions(*sides, plant).changed == ()
    assert len(sought) == 2


@pytest.mark.parametrize("astray", [False, True])
def test_the_search_is_repeated_beside_waves_unless_that_leads_astray(monkeypatch, astray):
    plant, asked, sought = load_vehicle("slocum"), [], []
    known = fit_known(check_log(mission(1), plant, Asked(trust=True)), lambda fraction, text: None)
    other = replace(known)

    def noisier(self, state):
        asked.append(self)
        return (other, state) if self is known else (self, state)

    def attributed(bench, nominal, candidates, most, sensors, progress, paths):
        sought.append(tuple(paths))
        chosen = SimpleNamespace(candidate=SimpleNamespace(paths=(OFFSET,)))
        return nominal, [SimpleNamespace(chosen=chosen), SimpleNamespace(chosen=None)]

    monkeypatch.setattr(Known, "with_further_noises", noisier)
    monkeypatch.setattr(Known, "led_astray", lambda self, state, again, there, count: astray)
    monkeypatch.setattr(missions, "attribute", attributed)
    found = missions._attributed(known, (), 1, lambda fraction, text: None)
    assert found[0] is (known if astray else other)
    assert asked == [known, other]
    assert sought == [(), (OFFSET,)]  # what was found without them is tried to the end


def test_time_that_a_float_counts_starts_again_with_the_side_after():
    plant = load_vehicle("qiandao_float")
    before, after = (depth_control(plant, (10.0, 30.0, 15.0), rng=np.random.default_rng(k)) for k in (1, 2))
    cut = after.later(5000.0).select((after.time < 700.0) | (after.time > 750.0))
    log, edge = joined_sides({"before": before, "after": cut}, plant, Asked(trust=True))
    elapsed = log.record["elapsed_s"]
    assert np.array_equal(elapsed, np.r_[before.time - before.time[0], cut.time - cut.time[0]])
    assert elapsed[edge] == 0.0
    assert "Only one side has" not in " ".join(log.record.notes)


def test_a_side_that_cannot_be_used_is_named():
    log = mission(1)
    with pytest.raises(ValueError, match="The log after: A diagnosis needs at least 4 windows"):
        compare_missions(log, log.between(0.0, 200.0), load_vehicle("slocum"))


def test_two_values_where_one_would_do_are_one(monkeypatch):
    """A search may choose `after` where the effect is common: what is said of it does not follow from that.

    Nor from an interval, however narrow: changes are many, and evidence must be more than chance has with all of them.
    """
    plant = load_vehicle("slocum")
    sides = {"before": mission(1, 0.05), "after": mission(2, 0.05)}
    log, edge = joined_sides(sides, plant, Asked(trust=True))
    courses = {"before": Course((edge,), (1.0, 0.0)), "after": Course((edge,), (0.0, 1.0))}
    changing = ChangingPlant.of(plant, {form: [OFFSET] for form in courses}, courses)
    bench = Workbench(changing, log.record, log.parts, 0.1, log.every_window)
    state = bench.fit(bench.plant, (*plant.coefficients, change("before", OFFSET), change("after", OFFSET)))
    monkeypatch.setattr(bench, "half_width_of", lambda state, shares: 1e-9)
    found = one_or_two(bench, state, OFFSET, [], 50)
    assert isinstance(found, Common)
    assert found.size.value == pytest.approx(0.05, abs=0.001)  # over ten standard errors


def test_a_change_whose_interval_contains_zero_is_none(monkeypatch):
    """However likely the likelihood alone has it: colour that is misjudged makes that too certain."""
    plant = load_vehicle("slocum")
    sides = {"before": mission(1), "after": mission(2, 0.05)}
    log, edge = joined_sides(sides, plant, Asked(trust=True))
    courses = {"before": Course((edge,), (1.0, 0.0)), "after": Course((edge,), (0.0, 1.0))}
    changing = ChangingPlant.of(plant, {form: [OFFSET] for form in courses}, courses)
    bench = Workbench(changing, log.record, log.parts, 0.1, log.every_window)
    state = bench.fit(bench.plant, (*plant.coefficients, change("before", OFFSET), change("after", OFFSET)))
    assert isinstance(one_or_two(bench, state, OFFSET, [], 50), Changed)
    monkeypatch.setattr(bench, "half_width_of", lambda state, shares: 0.1)
    assert isinstance(one_or_two(bench, state, OFFSET, [], 50), Common)


def test_what_else_would_explain_a_change_is_told_by_its_title():
    plant = load_vehicle("slocum")
    told = tied_words(("after effects.rudder.offset", "effects.yaw.moment"), plant)
    assert told == "rudder offset (in the later missions only), constant yaw moment"
    assert tied_words(("after hull.n_r",), plant).endswith(" (changed)")
    assert tied_words(("until effects.rudder.offset",), plant) == "rudder offset (until some time)"
    assert tied_words((), plant) == ""
