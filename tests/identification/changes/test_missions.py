"""Tests of changes between missions: an effect is named for the mission that has it, and not if both have it."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from identification.changes import missions
from identification.changes.forms import Sized
from identification.changes.joined import joined_sides
from identification.changes.missions import (
    Changed,
    Common,
    Comparison,
    Unchanged,
    coefficients_first,
    compare_missions,
    one_or_two,
)
from identification.changes.page import change_figure, write_comparison
from identification.changes.wording import summary, tied_words
from identification.diagnosis.log.checking import Asked, check_log
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.candidates import Candidate
from identification.diagnosis.search.known import Known, fit_known
from identification.diagnosis.search.trials import Trial
from identification.diagnosis.search.workbench import State, Workbench
from identification.experiments.float_dives import depth_control
from identification.experiments.glider_dives import yo_mission
from identification.experiments.heading_control import closed_loop
from identification.fit.changing import ChangingPlant, Course, change, changed

OFFSET = "effects.rudder.offset"


def mission(seed, offset=0.0):
    plant = replace_at(load_vehicle("slocum"), OFFSET, offset)
    return closed_loop(plant, rng=np.random.default_rng(seed), duration=800.0)


@pytest.mark.parametrize("size, scale", [(0.05, "symlog"), (0.0005, "linear")])
def test_a_change_far_beyond_the_others_leaves_them_room_in_the_picture(size, scale):
    small = Sized(1e-4, (-1e-4, 3e-4))
    after = Sized(size, (size - 1e-4, size + 1e-4))
    changed = Changed(OFFSET, "rudder offset", "rad", Sized(0.0, (-1e-4, 1e-4)), after, after, 500.0)
    unchanged = Unchanged("hull.n_r", "yaw damping N_r", "1", -1e-3, small, 1e-3)
    sides = (("spring",), ("autumn",))
    (axes,) = change_figure(Comparison(load_vehicle("slocum"), sides, (changed,), (), (unchanged,), 50, {})).axes
    assert axes.get_xscale() == scale
    assert ("logarithmic beyond 1" in axes.get_xlabel()) == (scale == "symlog")


def test_a_rudder_that_has_begun_to_stick_is_what_changed():
    plant, stiction = load_vehicle("slocum"), "effects.rudder.stiction"
    stuck = closed_loop(replace_at(plant, stiction, 0.15), rng=np.random.default_rng(2), duration=800.0)
    (only,) = compare_missions(mission(1), stuck, plant).changed
    assert only.path == stiction
    assert only.after.ci95[0] <= 0.15 <= only.after.ci95[1]


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


DRAG, CLOCK = "hull.drag_0", "effects.clock.rate"


def dives(seed, drag=1.0):
    """Two dives of a Slocum in steady flight, with so many times its drag."""

    def truth(plant):
        return replace_at(plant, DRAG, drag * value_at(plant, DRAG))

    plant, rng = load_vehicle("slocum_flight"), np.random.default_rng(seed)
    return yo_mission(plant, (250.0, 250.0), rng=rng, dt=10.0, truth=truth)


@pytest.fixture(scope="module")
def fouled():
    """The bench of dives before and after drag has grown by 40 %."""
    plant = load_vehicle("slocum_flight")
    log, edge = joined_sides({"before": dives(1), "after": dives(2, 1.4)}, plant, Asked(trust=True))
    courses = {"before": Course((edge,), (1.0, 0.0)), "after": Course((edge,), (0.0, 1.0))}
    changing = ChangingPlant.of(plant, {"before": [CLOCK], "after": [DRAG, CLOCK]}, courses)
    return Workbench(changing, log.record, log.parts, 0.1, log.every_window)


def in_round(bench, chosen, *others):
    """The nominal state, and a round in which one path was chosen of several that passed the gate."""
    nominal, trials = bench.fit(bench.plant, bench.plant.coefficients), []
    for path in (chosen, *others):
        screening = SimpleNamespace(tried=1)
        candidate = Candidate(path, (path,))
        state = bench.fit(bench.plant, (*nominal.paths, path), nominal)
        trials.append(Trial(candidate, state, bench.gain(nominal, state), 0.0, screening, ""))
    return nominal, Round(tuple(trials), trials[0], tuple(trials[1:]), {})


@pytest.mark.parametrize("tie, leads", [(np.inf, DRAG), (-np.inf, CLOCK)])
def test_a_changed_coefficient_leads_what_is_tied_with_it(fouled, monkeypatch, tie, leads):
    """A clock that was wrong before, or is now, acts as drag does in steady flight, whose true value nobody knows."""
    clock, drag = change("before", CLOCK), change("after", DRAG)
    nominal, made = in_round(fouled, clock, drag)
    monkeypatch.setattr(missions, "TIE", tie)
    state, (found,) = coefficients_first(fouled, nominal, made.chosen.state, [made], 50)
    assert changed(found.chosen.candidate.paths[0])[1] == leads
    assert [t.candidate.paths for t in found.tied] == [(clock,) if leads == DRAG else (drag,)]
    assert set(state.paths) == {*nominal.paths, *found.chosen.candidate.paths}
    if leads == DRAG:
        assert value_at(state.plant, drag) == pytest.approx(0.4 * 0.15, rel=0.1)
        assert value_at(state.plant, clock) == 0.0


def test_an_objection_keeps_a_coefficient_from_leading(fouled, monkeypatch):
    nominal, made = in_round(fouled, change("before", CLOCK), change("after", DRAG))
    monkeypatch.setattr(missions, "TIE", np.inf)
    refused = replace(made, trials=(made.trials[0], replace(made.trials[1], objection="not significant")))
    assert coefficients_first(fouled, nominal, made.chosen.state, [refused], 50)[1] == [refused]


def test_what_is_known_of_a_coefficient_is_not_held_against_its_change(fouled):
    """A hull that was cleaned is as given after, and one that is fouled as given before: neither costs more."""
    clean, more, path = value_at(fouled.plant, DRAG), 0.06, change("after", DRAG)
    deviation = fouled.plant.deviation(DRAG, 0.1)
    point = fouled.fit(fouled.plant, ()).point

    def behind(before, moved):
        plant = replace_at(fouled.plant, {DRAG: before, path: moved})
        return missions._behind(fouled, State(plant, (), point), State(plant, (), point), path)

    assert behind(clean, more) == pytest.approx(0.0)
    assert behind(clean + more, -more) == pytest.approx(-((more / deviation) ** 2))  # which the fit has charged


@pytest.mark.slow
@pytest.mark.parametrize("drag", [(1.0, 1.4), (1.4, 1.0)])
def test_growth_on_a_hull_and_its_cleaning_are_changes_of_drag(drag):
    found = compare_missions(dives(1, drag[0]), dives(2, drag[1]), load_vehicle("slocum_flight"), trust=True)
    (only,) = found.changed
    assert (only.path, only.surely, found.common) == (DRAG, True, ())
    assert only.change.ci95[0] < 0.15 * (drag[1] - drag[0]) < only.change.ci95[1]


def test_what_else_would_explain_a_change_is_told_by_its_title():
    plant = load_vehicle("slocum")
    told = tied_words(("after effects.rudder.offset", "effects.yaw.moment"), plant)
    assert told == "rudder offset (in the later missions only), constant yaw moment"
    assert tied_words(("after hull.n_r",), plant).endswith(" (changed)")
    assert tied_words(("until effects.rudder.offset",), plant) == "rudder offset (until some time)"
    assert tied_words((), plant) == ""
    whole = tied_words(("effects.rudder.offset", "growing effects.rudder.offset"), plant, "from")
    assert whole == "rudder offset (throughout), rudder offset (growing)"
