"""Tests of whether an effect has one size: a rudder offset throughout or from half-way on, trapped air in dives."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import concat
from identification.deciding import LEFT, UNSTEADY
from identification.diagnosis import as_json, diagnose
from identification.diagnosis.judge import holding, remaining, sizes
from identification.diagnosis.judge.result import VARIES
from identification.diagnosis.judge.scoring import Scoring
from identification.diagnosis.log.checking import Asked, check_log
from identification.diagnosis.log.plausibility import Doubt
from identification.diagnosis.search import constancy, remainder
from identification.diagnosis.search.candidates import candidates_of
from identification.diagnosis.search.constancy import Steadiness, dives_of, sizes_by_dive, steadiness
from identification.diagnosis.search.discovery import Discovery
from identification.diagnosis.search.remainder import Left, what_is_left
from identification.diagnosis.search.workbench import Workbench
from identification.experiments.glider_dives import yo_mission
from identification.experiments.heading_control import closed_loop
from identification.fit import sensitivities
from identification.fit.followed import Followed
from scripts.blind.changing import Changing

OFFSET, DEADBAND, AIR = "effects.rudder.offset", "effects.rudder.deadband", "effects.volume.air"
MOMENT = "effects.yaw.moment"


def log_of(begins, path=OFFSET, size=0.03, ends=np.inf):
    """A log in which a parameter has another size from one time, s, to another."""
    plant = load_vehicle("slocum")
    bent = replace_at(plant, path, size)
    moving = Changing.glider(plant, lambda t: bent if begins <= t < ends else plant)
    return closed_loop(moving, rng=np.random.default_rng(700), duration=600.0)


def fitted(begins, path=OFFSET, size=0.03, also=(OFFSET,), ends=np.inf):
    """The bench and the state of such a log."""
    plant, record = load_vehicle("slocum"), log_of(begins, path, size, ends)
    log = check_log(record, plant, Asked(trust=True))
    bench = Workbench(log.plant, log.record, log.parts, 0.1, log.every_window)
    return bench, bench.fit(bench.plant, (*plant.coefficients, *also))


def test_parts_contradict_each_other_where_an_effect_begins_half_way_and_only_there():
    assert steadiness(*fitted(-100.0), [OFFSET]).probability > 0.01
    assert steadiness(*fitted(300.0), [OFFSET]).probability < UNSTEADY


@pytest.mark.parametrize("begins, ends", [(300.0, np.inf), (-100.0, 300.0)])
def test_what_acts_from_or_until_half_way_shows_where_it_was_not_fitted(begins, ends):
    assert steadiness(*fitted(begins, size=0.05, also=(), ends=ends), [OFFSET], level=LEFT).probability < LEFT


@pytest.mark.parametrize("size", [0.01, 0.015])
def test_what_grows_shows_beside_slow_noise_that_hides_it_from_the_sixths(size, monkeypatch):
    plant = load_vehicle("slocum")
    growing = Changing.glider(plant, lambda t: replace_at(plant, OFFSET, size * float(np.clip(t / 600.0, 0.0, 1.0))))
    record = closed_loop(growing, rng=np.random.default_rng(701), duration=600.0)
    log = check_log(record, plant, Asked(trust=True))
    bench = Workbench(log.plant, log.record, log.parts, 0.1, log.every_window)
    state = bench.fit(bench.plant, plant.coefficients)
    assert steadiness(bench, state, [OFFSET], level=LEFT).probability < 1e-3
    courses, forms = constancy._divisions(bench, [OFFSET], fitted=False)
    monkeypatch.setattr(constancy, "_divisions", lambda *_: (courses, {OFFSET: forms[OFFSET][:1]}))
    assert steadiness(bench, replace(state), [OFFSET], level=LEFT).probability > LEFT


def test_what_acts_nowhere_does_not_show_where_it_was_not_fitted():
    assert steadiness(*fitted(np.inf, also=()), [OFFSET], level=LEFT).probability > LEFT


def test_a_size_that_surely_differs_but_hardly_does_not_vary():
    """The offset grows by a tenth half-way through the log."""
    plant = load_vehicle("slocum")
    first, second = (replace_at(plant, OFFSET, size) for size in (0.30, 0.33))
    moving = Changing.glider(first, lambda t: second if t >= 600.0 else first)
    log = check_log(closed_loop(moving, rng=np.random.default_rng(700), duration=1200.0), plant, Asked(trust=True))
    bench = Workbench(log.plant, log.record, log.parts, 0.1, log.every_window)
    found = steadiness(bench, bench.fit(bench.plant, (*plant.coefficients, OFFSET)), [OFFSET], level=1.0)
    assert 0.02 < found.apart < 0.15
    assert not constancy.varies(0.1 * UNSTEADY, found.apart)
    assert constancy.varies(0.1 * UNSTEADY, steadiness(*fitted(300.0), [OFFSET]).apart)
    assert not constancy.varies(2.0 * UNSTEADY, np.inf)


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.045, 0.06])
def test_what_begins_half_way_and_random_accelerations_would_explain_is_said(size):
    plant = load_vehicle("slocum")
    found = diagnose(log_of(300.0, size=size), plant)
    assert (found.verdict, found.effects) == ("unexplained", ())
    assert found.left == Left(passing=found.left.passing)
    title = spec_at(plant, found.left.passing).title
    assert f"Something began, ended or changed during the log that acts like this effect: {title}." in found.summary()
    assert not diagnose(log_of(-100.0, size=size), plant).left


@pytest.mark.parametrize("path", [OFFSET, "effects.yaw.quadratic_damping"])
def test_of_many_effects_the_likeliest_are_asked_for_and_all_count(monkeypatch, path):
    """This is for vehicles with many states, for which testing all changes of all effects takes too long."""
    monkeypatch.setattr(remainder, "FEW_STATES", 0)
    monkeypatch.setattr(remainder, "CONTENDERS", 1)
    bench, state = fitted(300.0, path, 200.0 if path != OFFSET else 0.03, also=())
    candidates = candidates_of(state.plant, bench.record)
    assert remainder.passing_effect(bench, state, candidates) in (path, "effects.yaw.moment")
    calm, still = fitted(-100.0, also=(OFFSET,))
    assert remainder.passing_effect(calm, still, candidates) == ""
    one = steadiness(calm, still, [OFFSET]).probability
    assert steadiness(calm, still, [OFFSET], tried=2).probability == pytest.approx(min(2.0 * one, 1.0))
    assert one < 1.0


def test_a_change_has_no_evidence_by_noises_that_would_suit_the_vehicle_without_it(monkeypatch):
    """An example is a fit without a change that has stopped at noises far from the likeliest."""
    bench, state = fitted(-100.0)
    poor = state.point.logs - np.r_[1.2 * np.ones(len(bench.problem.channels)), np.zeros(2 * len(bench.problem.pushed))]
    left = replace(state, point=bench.problem.point(state.point.vector, poor, state.point))
    assert bench.problem.objective(left.point, left.paths) < bench.problem.objective(state.point, state.paths) - 20.0
    assert steadiness(bench, left, [OFFSET]).probability > 0.01


def test_what_is_asked_twice_of_a_state_is_worked_out_once():
    """The verdict and the report ask the same; another question or another state is computed separately."""
    bench, state = fitted(300.0)
    first, work = steadiness(bench, state, [OFFSET]), bench.problem.work.done
    assert steadiness(bench, state, [OFFSET]) == first
    assert bench.problem.work.done == work
    assert steadiness(bench, state, [OFFSET], tried=2).probability != first.probability
    assert steadiness(bench, replace(state), [OFFSET]) == first
    assert bench.problem.work.done > work


def moved_slowly(seed, size=1.0, time=100.0):
    """The bench and the state of a log with a random yaw moment; size: in probes.  time: correlation time, s."""
    plant, rng, times = load_vehicle("slocum"), np.random.default_rng(seed), np.arange(0.0, 700.0, 4.0)
    kept, moments = np.exp(-4.0 / time), [rng.normal()]
    for _ in times[1:]:
        moments.append(kept * moments[-1] + np.sqrt(1.0 - kept**2) * rng.normal())
    probe = size * spec_at(plant, MOMENT).probe
    moving = Changing.glider(plant, lambda t: replace_at(plant, MOMENT, probe * np.interp(t, times, moments)))
    log = check_log(closed_loop(moving, rng=rng, duration=600.0), plant, Asked(trust=True))
    bench = Workbench(log.plant, log.record, log.parts, 0.1, log.every_window)
    return bench, bench.fit(bench.plant, (*plant.coefficients, MOMENT))


def test_slow_random_moments_are_no_contradiction_between_parts(monkeypatch):
    """Six correlation times of a moment hardly determine its noise, which a chi-square test assumes known."""
    bench, state = moved_slowly(3)
    assert steadiness(bench, state, [MOMENT]).probability > UNSTEADY
    monkeypatch.setattr(constancy, "freedom_of", lambda *_: np.inf)
    assert steadiness(bench, replace(state), [MOMENT]).probability < 2.0 * UNSTEADY  # two forms are tried


def test_what_accelerations_cost_is_no_evidence_for_a_change(monkeypatch):
    """A change of any kind may make them needless, and then saves their cost."""
    bench, state = moved_slowly(3)
    cost = lambda self, logs: 50.0 * np.array_equal(logs, state.point.logs)  # noqa: E731
    monkeypatch.setattr(Followed, "_cost", cost)
    assert steadiness(bench, state, [MOMENT]).probability > UNSTEADY


@pytest.mark.slow
def test_nothing_constant_is_named_where_parts_contradict_each_other(monkeypatch):
    """This holds even if the effect is certain, leaves nothing, and makes unseen parts of the log more likely."""
    record, plant = log_of(-100.0), load_vehicle("slocum")
    constant = diagnose(record, plant)
    assert [e.path for e in constant.effects] == [OFFSET]
    assert constant.alike == ()
    monkeypatch.setattr(sizes, "steadiness", lambda bench, state, paths: Steadiness(paths[0], 0.5 * UNSTEADY))
    monkeypatch.setattr(remaining, "discover", lambda bench, state, *_: Discovery(state.plant, state.paths, state))
    found = diagnose(record, plant)
    assert (found.verdict, found.effects, found.tied, found.common) == ("unexplained", (), (), ())
    (alike,) = found.alike
    assert (alike.path, found.left) == (OFFSET, Left(changes=OFFSET))
    assert value_at(found.after.plant, OFFSET) == alike.value == constant.effects[0].value  # the fitted vehicle has it
    said = found.summary()
    assert f"no constant effect explains the difference. Part of the difference acts like {alike.told}." in said
    assert said.count("differs between parts of the log") == 1
    assert "Its size differs between parts of the log: auv-gym onset" in said
    told = as_json(found)
    assert told["effects"] == told["tied"] == []
    assert [e["path"] for e in told["acts_like"]] == [OFFSET]


@pytest.mark.slow
def test_a_weaker_effect_of_which_parts_contradict_each_other_is_not_named_and_takes_no_other_name_away(monkeypatch):
    plant = load_vehicle("slocum")
    truth = replace_at(plant, {OFFSET: 0.006, DEADBAND: 0.08})
    record = closed_loop(truth, rng=np.random.default_rng(701), duration=900.0)
    both = diagnose(record, plant)
    assert [e.path for e in both.effects] == [DEADBAND, OFFSET]
    unlike = lambda bench, state, paths: Steadiness(paths[0], 0.5 * UNSTEADY)  # noqa: E731
    monkeypatch.setattr(holding, "steadiness", unlike)
    found = diagnose(record, plant)
    assert found.verdict in ("named", "tied")
    assert [e.path for e in found.effects] == [DEADBAND]
    assert found.dropped == {OFFSET: VARIES}
    assert found.left  # the log is not explained
    assert "but parts of the log contradict each other in the size of it" in " ".join(found.summary().split())


@pytest.mark.slow
@pytest.mark.parametrize("explained, verdict", [(0.9, "unexplained"), (0.3, "doubted")])
def test_an_effect_that_varies_stays_where_the_others_foretell_nothing_without_it(monkeypatch, explained, verdict):
    """No constant effect is named then.  If most is explained, log and vehicle are not too far apart."""
    plant = load_vehicle("slocum")
    truth = replace_at(plant, {OFFSET: 0.006, DEADBAND: 0.08})
    record = closed_loop(truth, rng=np.random.default_rng(701), duration=900.0)
    unlike = lambda bench, state, paths: Steadiness(paths[0], 0.5 * UNSTEADY)  # noqa: E731
    for module in (holding, sizes):
        monkeypatch.setattr(module, "steadiness", unlike)
    share = lambda self, before, after: explained if value_at(after.plant, OFFSET) else -0.1  # noqa: E731
    monkeypatch.setattr(Scoring, "explained", share)
    monkeypatch.setattr(remaining, "discover", lambda bench, state, *_: Discovery(state.plant, state.paths, state))
    doubt = Doubt("the log and the vehicle are far apart", ("heading_rad",), 1.0, "check the log")
    doubting = lambda *a: replace(check_log(*a), doubts=(doubt,))  # noqa: E731
    monkeypatch.setattr(import_module("identification.diagnosis.diagnose"), "check_log", doubting)
    found = diagnose(record, plant)
    assert found.verdict == verdict
    assert {e.path for e in found.alike} == {OFFSET, DEADBAND}
    assert (found.effects, found.dropped) == ((), {})


def test_a_coefficient_that_changes_half_way_is_left():
    """All coefficients are tested at once; only the rudder effectiveness changes, and nothing else can absorb it."""
    given = value_at(load_vehicle("slocum"), "hull.n_delta")
    assert what_is_left(*fitted(300.0, "hull.n_delta", 1.5 * given, ())).changes == "hull.n_delta"
    assert what_is_left(*fitted(300.0, "hull.n_delta", given, ())) == Left()


def dived(airs, also=(AIR,)):
    """The bench and the state of dives with these volumes of trapped air, m^3; one common size is fitted."""
    plant, rng, logs, begun = load_vehicle("seaglider"), np.random.default_rng(2), [], 0.0
    for number, air in enumerate(airs, 1):
        one = yo_mission(plant, (180.0,), rng=rng, dt=20.0, truth=lambda p, air=air: replace_at(p, AIR, air))
        one = one.with_channels({"elapsed_s": one["elapsed_s"] + begun}).with_labels([f"dive {number}"])
        logs, begun = [*logs, one], float(one["elapsed_s"][-1]) + 600.0
    log = check_log(concat(logs), plant, Asked(trust=True))
    bench = Workbench(log.plant, log.record, log.parts, 0.1, log.every_window)
    return bench, bench.fit(bench.plant, (*plant.coefficients, *also))


@pytest.mark.slow
def test_dives_with_another_trapped_air_each_get_their_own_and_dives_alike_do_not():
    airs = (2e-5, 9e-5, 5e-5)
    bench, state = dived(airs)
    assert [dive for dive, _ in dives_of(bench.record, bench.problem.rows)] == ["dive 1", "dive 2", "dive 3"]
    assert len(bench.record.segments) > 3  # rows that are left out divide dives
    found = sizes_by_dive(bench, state, AIR)
    assert found is not None
    for size, true in zip(found.sizes, airs, strict=True):
        assert size.value == pytest.approx(true, abs=3e-6)  # a probe is 1e-5
        assert size.ci95[0] < size.value < size.ci95[1]
    assert not what_is_left(found.bench, found.state)
    assert sizes_by_dive(*dived((5e-5, 5e-5, 5e-5)), AIR) is None


def test_air_in_one_dive_alone_shows_where_no_air_was_fitted():
    bench, state = dived((0.0, 1.2e-4, 0.0), ())
    found = sizes_by_dive(bench, state, AIR)
    assert found is not None
    assert [size.value for size in found.sizes] == pytest.approx([0.0, 1.2e-4, 0.0], abs=3e-6)


def test_changes_of_coefficients_are_seen_as_well_by_responses(monkeypatch):
    """The linearised filter is cheaper, if there are enough coefficients to keep responses."""
    given = value_at(load_vehicle("slocum"), "hull.n_delta")
    bench, state = fitted(300.0, "hull.n_delta", given, ())
    own, work = [p for p in state.paths if p in state.plant.doubted], bench.problem.work
    began = work.done
    itself = steadiness(bench, state, own, quietly=False)
    between = work.done
    monkeypatch.setattr(sensitivities, "_MANY", 2)
    soon = steadiness(bench, replace(state), own, quietly=False)
    assert itself.probability > UNSTEADY
    assert soon.path == itself.path
    assert soon.probability == pytest.approx(itself.probability, rel=0.05)
    assert 0 < work.done - between < between - began
