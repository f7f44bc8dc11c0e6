"""Tests of the time at which an effect begins within a log."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.changes import onset, promising_times, search_in_time
from identification.changes.onset import _interleaved, _throughout, find_onsets
from identification.changes.wording import timeline_summary
from identification.diagnosis.log.checking import Asked, check_log
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
    bent, promising = replace_at(plant, OFFSET, 0.03), search_in_time.promising
    moving = Changing.glider(plant, lambda t: bent if t >= 400.0 else plant)
    monkeypatch.setattr(promising_times, "FEW_STATES", 0)
    monkeypatch.setattr(promising_times, "TIMED", 2)
    monkeypatch.setattr(search_in_time, "promising", lambda *given: screened.append(len(given[2])) or promising(*given))
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
def test_parts_of_a_log_with_a_gap_end_at_it():
    """Rows go on across a gap in time, and a piece of a part must not."""
    time = np.r_[0.0:157.0, 190.0:333.0]
    log = Record.from_arrays(time, {"heading_rad": np.zeros(300)}).split_gaps(10.0)
    assert len(log.segments) == 2
    checked = SimpleNamespace(record=log, parts=((slice(0, 157),), (slice(157, 300),)))
    parts, edges = _interleaved(checked)  # type: ignore[arg-type]
    pieces = [piece for part in parts for piece in part]
    assert not any(piece.start < 157 < piece.stop for piece in pieces)
    assert sorted(k for piece in pieces for k in range(piece.start, piece.stop)) == list(range(300))
    assert len(edges) == 23


def test_a_clean_log_has_no_time():
    plant = load_vehicle("slocum")
    found = find_onsets(closed_loop(plant, rng=np.random.default_rng(6), duration=800.0), plant)
    assert found.found == ()
    assert timeline_summary(found) == ["The model explains this log: no known effect is missing at any time."]
