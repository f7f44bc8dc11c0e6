"""Tests of the time at which an effect begins within a log."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from identification.changes import onset
from identification.changes.onset import _throughout, find_onsets
from identification.changes.wording import timeline_summary
from identification.diagnosis.log.checking import Asked, check_log
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.candidates import Candidate
from identification.diagnosis.search.known import Known, fit_known
from identification.experiments.heading_control import closed_loop
from scripts.blind.changing import Changing

OFFSET = "effects.rudder.offset"


def near(size, truth):
    """Whether a size is within 3.3 standard errors of the truth, as 999 of 1000 are: a 95 % interval misses in 5 %."""
    return abs(size.value - truth) < 3.3 / 1.96 * 0.5 * (size.ci95[1] - size.ci95[0])


def test_what_acts_throughout_is_not_told_from_itself_with_a_time():
    tied = ("until effects.rudder.gain", "effects.yaw.moment", "from effects.yaw.moment", "from effects.compass.bias")
    left = ("effects.yaw.moment", "from effects.compass.bias")
    assert _throughout("effects.rudder.gain", tied) == left


@pytest.mark.parametrize("astray", [False, True])
def test_the_search_is_repeated_beside_waves_unless_that_leads_astray(monkeypatch, astray):
    plant, searched = load_vehicle("slocum"), []
    record = closed_loop(plant, rng=np.random.default_rng(5), duration=800.0)
    known = fit_known(check_log(record, plant, Asked(trust=True)), lambda fraction, text: None)
    other = replace(known, coefficients=())

    def searching(given, *rest):
        searched.append(given)
        return given.bench, given.nominal, [], {}

    def noisier(self, state):
        return (self, state) if len(searched) == 2 else (other, state)

    monkeypatch.setattr(Known, "with_further_noises", noisier)
    monkeypatch.setattr(Known, "led_astray", lambda self, state, again, there, count: astray)
    monkeypatch.setattr(onset, "searched_in_time", searching)
    monkeypatch.setattr(onset, "placed", lambda bench, state, edges: (bench, state))
    found, *_ = onset._beside_noises(known, (), 1, 1, lambda fraction, text: None)
    assert searched == [known, other]
    assert found.coefficients == (known.coefficients if astray else ())


@pytest.mark.slow
def test_a_rudder_that_goes_off_is_named_with_the_time():
    plant = load_vehicle("slocum")
    bent = replace_at(plant, OFFSET, 0.03)
    moving = Changing.glider(plant, lambda t: bent if t >= 400.0 else plant)
    record = closed_loop(moving, rng=np.random.default_rng(5), duration=800.0)
    found = find_onsets(record, plant)
    (only,) = found.found
    assert (only.path, only.form) == (OFFSET, "from")
    assert only.time.ci95[0] <= 400.0 <= only.time.ci95[1]
    assert only.time.ci95[1] - only.time.ci95[0] < 80.0
    assert near(only.size, 0.03)
    assert timeline_summary(found)[0].startswith("Rudder offset, 1.7")


def test_a_rudder_that_begins_to_stick_is_named_with_the_time():
    plant, stiction = load_vehicle("slocum"), "effects.rudder.stiction"
    stuck = replace_at(plant, stiction, 0.15)
    moving = Changing.glider(plant, lambda t: stuck if t >= 300.0 else plant)
    (only,) = find_onsets(closed_loop(moving, rng=np.random.default_rng(5), duration=800.0), plant, most=1).found
    assert (only.path, only.form) == (stiction, "from")
    assert only.time.ci95[0] <= 300.0 <= only.time.ci95[1]
    assert only.size.ci95[0] <= 0.15 <= only.size.ci95[1]  # by its profile: slopes would say a hundredth of its width


@pytest.mark.parametrize(
    "ahead, chosen, tied",
    [(5.0, "b", ("a",)), (20.0, "b", ()), (-5.0, "a", ("b",)), (-20.0, "a", ())],
)
def test_rivals_are_compared_at_times_of_their_own(monkeypatch, ahead, chosen, tied):
    """Behind at the times of the chosen one; at its own, so far ahead of it."""

    def trial(name, total, objection=""):
        return SimpleNamespace(candidate=name, total=total, state=name, objection=objection)

    first, second = trial("a", 60.0), trial("b", 50.0)
    others = [trial("c", -20.0), trial("d", 55.0, "not significant")]  # hopeless, and refused
    made = Round((first, second, *others), first, (), {})  # type: ignore[arg-type]
    bench = SimpleNamespace(gain=lambda one, other: ahead)
    monkeypatch.setattr(onset, "_at_best_times", lambda bench, trial: SimpleNamespace(state=trial.state))
    found, reached = onset._each_at_its_times(bench, made, SimpleNamespace(state="a"))  # type: ignore[arg-type]
    assert (found.chosen.candidate, tuple(t.candidate for t in found.tied)) == (chosen, tied)
    assert reached.state == chosen


def test_what_comes_near_the_first_is_compared_at_times_of_its_own_too(monkeypatch):
    """Half of the evidence at coarse times is near; an effect throughout has no times to be moved."""

    def trial(path, train):
        return SimpleNamespace(candidate=Candidate(path, (path,)), train=train, state=path, total=train)

    first, near, far = (
        trial("changes.from1.a", 60.0),
        trial("changes.between0.b", 31.0),
        trial("changes.until2.c", 29.0),
    )
    whole, gained = trial("effects.d", 60.0), {first.state: 0.0, near.state: 20.0, far.state: 40.0, "effects.d": 0.0}
    bench = SimpleNamespace(gain=lambda one, other: gained[other] - gained[one])
    monkeypatch.setattr(onset, "_at_best_times", lambda bench, t: SimpleNamespace(bench=bench, state=t.state))
    made = Round((first, near, far, whole), first, (), {})  # type: ignore[arg-type]
    assert onset._best_at_its_times(bench, made, first)[0] is near  # type: ignore[arg-type]
    assert onset._best_at_its_times(bench, made, whole)[0] is whole  # type: ignore[arg-type]
    gained[near.state] = -1.0
    assert onset._best_at_its_times(bench, made, first)[0] is first  # type: ignore[arg-type]


@pytest.mark.parametrize("ahead, form", [(16.0, "from"), (17.5, "between"), (None, "between")])
def test_a_second_time_must_pass_the_bar_for_it(monkeypatch, ahead, form):
    """It is 16.7 for 23 times; None: one time alone explains nothing."""
    span, groups = Candidate("a", ("changes.between0.a",)), []
    for kind in ("from", "until"):
        groups.append(tuple(Candidate("a", (f"changes.{kind}{k}.a",)) for k in range(1, 24)))
    forms = [onset.Forms(Candidate("a", ("a",)), (*groups, (Candidate("a", ("changes.growing.a",)),)), (span,))]
    one_time = None if ahead is None else SimpleNamespace(candidate=groups[0][3], state="from")
    made = Round((), SimpleNamespace(candidate=span, state="between"), (), {})  # type: ignore[arg-type]
    bench = SimpleNamespace(gain=lambda before, after: ahead)
    monkeypatch.setattr(onset, "placed", lambda bench, state, rows: (bench, state))
    monkeypatch.setattr(onset, "_promising", lambda bench, state, asked, bar: (list(asked[0].groups[0][3:4]), {}))
    monkeypatch.setattr(onset, "selected", lambda *given: Round((), one_time, (), {}))  # type: ignore[arg-type]
    monkeypatch.setattr(onset, "_at_best_times", lambda bench, trial: SimpleNamespace(bench=bench, state=trial.state))
    reached = SimpleNamespace(bench=bench, state="between")
    made, there = onset._unless_at_one_time(None, forms, made, reached, 1000)  # type: ignore[arg-type]
    assert (there.state, onset.kind_of(made.chosen.candidate.paths[0].split(".")[1])) == (form, form)


@pytest.mark.parametrize(
    "form, row, gained, kind",
    [
        ("from1", 70, 20.0, "between"),
        ("from1", 20, 20.0, "outside"),
        ("until1", 20, 20.0, "between"),
        ("until1", 70, 20.0, "outside"),
        ("from1", 70, 16.0, "from"),
        ("from1", 50, 20.0, "from"),
    ],
)
def test_a_second_time_is_tried_beside_the_first_where_that_is_right_by_now(monkeypatch, form, row, gained, kind):
    """The first time is row 50; 16.7 are needed for another one."""
    groups = [tuple(Candidate("a", (f"changes.{f}{k}.a",)) for k in range(1, 24)) for f in ("from", "until")]
    spans = tuple(Candidate("a", (f"changes.{k}0.a",)) for k in ("between", "outside"))
    forms, chosen = [onset.Forms(Candidate("a", ("a",)), tuple(groups), spans)], groups[form == "until1"][0]
    bench = SimpleNamespace(problem=None, gain=lambda before, after: gained)
    reached = SimpleNamespace(bench=bench, state=SimpleNamespace(point=None, paths=()), edges=lambda form: (50,))
    placed = []
    monkeypatch.setattr(onset, "screen", lambda *given: [SimpleNamespace(evidence=1.0, candidate=groups[0][4])])
    monkeypatch.setattr(onset, "finer_rows", lambda *given: {"from5": (9.0, row)})
    monkeypatch.setattr(onset, "placed", lambda bench, state, rows: placed.append(rows) or (bench, state))
    monkeypatch.setattr(onset, "selected", lambda *given: Round((), trial_of(given[2][0]), (), {}))  # type: ignore[arg-type]
    monkeypatch.setattr(onset, "_at_best_times", lambda bench, trial: SimpleNamespace(bench=bench, state=None))
    made = Round((), SimpleNamespace(candidate=chosen), (), {})  # type: ignore[arg-type]
    made, _ = onset._if_at_two_times(None, forms, made, reached, 1000)  # type: ignore[arg-type]
    assert onset.kind_of(made.chosen.candidate.paths[0].split(".")[1]) == kind
    if kind in ("between", "outside"):
        assert placed == [{f"{kind}0": (min(row, 50), max(row, 50))}]


def trial_of(candidate):
    return SimpleNamespace(candidate=candidate, state=None)


@pytest.mark.slow
def test_an_onset_is_that_of_the_rudder_and_not_of_a_moment_at_another_time():
    plant = load_vehicle("slocum")
    bent = replace_at(plant, OFFSET, 0.03)
    moving = Changing.glider(plant, lambda t: bent if t >= 800.0 else plant)
    record = closed_loop(moving, rng=np.random.default_rng(5), duration=1400.0)
    (found,) = find_onsets(record.between(124.0, 1208.0), plant, doubt=0.0).found
    assert (found.path, found.form) == (OFFSET, "from")
    assert found.time.ci95[0] <= 800.0 <= found.time.ci95[1]


def test_of_a_vehicle_with_many_states_the_times_of_the_likeliest_are_sought(monkeypatch):
    plant, screened = load_vehicle("slocum"), []
    bent, promising = replace_at(plant, OFFSET, 0.03), onset._promising
    moving = Changing.glider(plant, lambda t: bent if t >= 400.0 else plant)
    monkeypatch.setattr(onset, "FEW_STATES", 0)
    monkeypatch.setattr(onset, "TIMED", 2)
    monkeypatch.setattr(onset, "_promising", lambda *given: screened.append(len(given[2])) or promising(*given))
    found = find_onsets(closed_loop(moving, rng=np.random.default_rng(5), duration=600.0), plant, most=1)
    assert [(one.form, OFFSET in (one.path, *(t.rpartition(" ")[2] for t in one.tied))) for one in found.found] == [
        ("from", True)
    ]
    assert screened == [4]  # two by the noises as they are, two by weaker ones


@pytest.mark.slow
@pytest.mark.parametrize("form", ["between", "outside"])
def test_an_effect_of_two_times_is_named_with_both(form):
    plant = load_vehicle("slocum")
    bent = replace_at(plant, OFFSET, 0.03)
    moving = Changing.glider(plant, lambda t: bent if (252.0 <= t < 520.0) == (form == "between") else plant)
    found = find_onsets(closed_loop(moving, rng=np.random.default_rng(5), duration=800.0), plant)
    (only,) = found.found
    assert (only.path, only.form, only.steady) == (OFFSET, form, True)
    assert only.time.ci95[0] <= 252.0 <= only.time.ci95[1]
    assert only.second.ci95[0] <= 520.0 <= only.second.ci95[1]
    assert near(only.size, 0.03)
    told = timeline_summary(found)[0]
    assert f", {'except ' if form == 'outside' else ''}between 2" in told


@pytest.mark.slow
def test_an_effect_that_has_two_sizes_has_no_form():
    plant = load_vehicle("slocum")
    sides = [replace_at(plant, OFFSET, size) for size in (0.07, 0.04)]
    moving = Changing.glider(plant, lambda t: sides[int(t >= 500.0)] if t >= 200.0 else plant)
    found = find_onsets(closed_loop(moving, rng=np.random.default_rng(5), duration=800.0), plant, most=1)
    (only,) = found.found
    assert (only.path, only.form, only.time, only.steady) == (OFFSET, "", None, False)
    assert "parts of the log contradict each other" in timeline_summary(found)[0]


@pytest.mark.slow
@pytest.mark.parametrize("size, seed", [(0.05, 3), (0.03, 13)])
def test_a_constant_effect_acts_throughout_and_keeps_its_ties(size, seed):
    """In both logs a time near an end fits better by chance, and in one a moment nearly as well as the offset."""
    plant = load_vehicle("slocum")
    record = closed_loop(replace_at(plant, OFFSET, size), rng=np.random.default_rng(seed), duration=600.0)
    (only,) = find_onsets(record, plant).found
    assert (only.form, only.time, only.steady) == ("", None, True)
    assert OFFSET in (only.path, *only.tied)


@pytest.mark.slow
def test_a_clean_log_has_no_time():
    plant = load_vehicle("slocum")
    found = find_onsets(closed_loop(plant, rng=np.random.default_rng(6), duration=800.0), plant)
    assert found.found == ()
    assert timeline_summary(found) == ["The model explains this log: no known effect is missing at any time."]
