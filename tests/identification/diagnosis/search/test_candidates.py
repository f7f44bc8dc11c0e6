"""Tests of the evidence that a regression of the filter's errors on signatures promises before any fit."""

import numpy as np
import pytest

from auv_gym.model import simulate
from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.deciding import SEEN
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search import candidates
from identification.diagnosis.search.candidates import (
    COMMON_DELAY,
    Candidate,
    candidates_of,
    periods_of,
    screen,
    settings_of,
)
from identification.diagnosis.search.trials import trials_of
from identification.diagnosis.search.workbench import State, Workbench
from identification.experiments.missions import run_mission
from tests.identification.gliders import QUICK

DEADBAND, LAG, OFFSET = "effects.rudder.deadband", "effects.compass.lag", "effects.rudder.offset"
GAIN, STICTION = "effects.rudder.gain", "effects.rudder.stiction"
COEFFICIENTS = QUICK.family.coefficients
BAR = 16.0


def candidate(*paths: str) -> Candidate:
    return Candidate(paths[0], paths)


def bench_of(record, doubt: float = 0.1) -> Workbench:
    return Workbench(QUICK, record, parts_of(QUICK, record), doubt)


@pytest.fixture(scope="module")
def clean():
    bench = bench_of(run_mission(QUICK, np.random.default_rng(5), duration=900.0))
    return bench, bench.fit(QUICK, COEFFICIENTS)


def test_a_change_too_small_for_the_noises_gains_what_it_promises(clean):
    """This holds for the noises found without it; a fit may find other noises, and gain more."""
    bench, state = clean
    (found,) = screen(bench.problem, state.point, state.paths, [candidate(OFFSET)], BAR)
    paths = (*state.paths, OFFSET)
    beside = bench.problem.solve(state.plant, paths, state.point, noise=False)
    gained = 2.0 * (bench.problem.objective(beside, paths) - bench.problem.objective(state.point, state.paths))
    # the fit recomputes the gains, and stops when an iteration gains less than 0.04
    assert found.evidence == pytest.approx(gained, rel=0.1)
    assert gained > 1.0
    moved = beside.vector[bench.problem.index[OFFSET]] / spec_at(QUICK, OFFSET).probe
    assert found.estimate[0] == pytest.approx(moved, rel=0.1)


def test_a_part_is_tested_by_all_its_candidates_together(clean, monkeypatch):
    """The logs are a clean one, and one with a rudder offset of five detectable sizes."""
    bench, state = clean
    (found,) = screen(bench.problem, state.point, state.paths, [candidate(OFFSET)], BAR)
    assert (found.together, found.chance) == ((0.0, 0), 0.0)  # few candidates are not tested by parts
    monkeypatch.setattr(candidates, "MANY", 1)
    size = 5.0 * float(found.detectable[0])
    lame = bench_of(run_mission(replace_at(QUICK, OFFSET, size), np.random.default_rng(5), duration=900.0))
    for own, low, high in ((bench, 1e-4, 1.0), (lame, 0.0, 1e-9)):
        fitted = own.fit(QUICK, COEFFICIENTS)
        # accelerations have grown to absorb the effect, and leave little of it to see
        point = own.problem.quieted(fitted.point) if own is lame else fitted.point
        screened = screen(own.problem, point, fitted.paths, candidates_of(QUICK), BAR)
        of_rudder = [s for s in screened if s.candidate.paths[0].startswith("effects.rudder.")]
        (chance,) = {s.chance for s in of_rudder}
        assert low <= chance <= high
        evidence, parameters = of_rudder[0].together
        assert evidence >= max(s.evidence for s in of_rudder) * (1.0 - 1e-3)
        assert 1 < parameters <= 2 * len(of_rudder)


@pytest.mark.parametrize("bar", [BAR, 1e5])
def test_a_detectable_size_is_the_bar_and_a_chance_of_one_in_twenty_in_standard_errors(clean, bar):
    bench, state = clean
    (found,) = screen(bench.problem, state.point, state.paths, [candidate(OFFSET)], bar)
    paths = (*state.paths, OFFSET)
    beside = bench.problem.solve(state.plant, paths, state.point, noise=False)
    error = bench.intervals(State(bench.problem.plant_at(beside, paths), paths, beside))[OFFSET][1]
    # standard errors may be widened for colour
    assert found.detectable[0] == pytest.approx(np.sqrt(bar) * error + 1.645 * error, rel=0.15)


def test_what_is_known_of_a_coefficient_tells_it_from_the_effect_that_acts_alike(clean):
    """At a constant speed, the effect acts like the rudder effectiveness, whose prior is more or less narrow."""
    record = clean[0].record.with_channels({"u_mps": np.full(len(clean[0].record), 0.4)})
    seen = {}
    for doubt in (np.inf, 0.03, 0.01):
        bench = bench_of(record, doubt)
        point = bench.fit(QUICK, ()).point
        (seen[doubt],) = screen(bench.problem, point, COEFFICIENTS, [candidate("effects.yaw.speed_squared")], BAR)
    assert seen[np.inf].seen < SEEN < seen[0.03].seen < seen[0.01].seen
    assert seen[np.inf].unseen == "rudder effectiveness N_dr has the same effect"
    assert (seen[np.inf].evidence, seen[np.inf].detectable[0]) == (0.0, np.inf)
    assert seen[0.01].detectable[0] < 0.5 * seen[0.03].detectable[0]


def test_an_effect_with_a_corner_is_tried_at_larger_sizes_too(monkeypatch):
    """A deadband of one probe looks different from one of 5 probes; the detectable size stays that of the small one."""
    assert [candidate(p).kinked for p in (DEADBAND, LAG, OFFSET)] == [True, True, False]
    bench = bench_of(run_mission(replace_at(QUICK, DEADBAND, 0.1), np.random.default_rng(5), duration=900.0))
    state = bench.fit(QUICK, COEFFICIENTS)

    def screened(path):
        return screen(bench.problem, state.point, state.paths, [candidate(path)], BAR)[0]

    both, smooth = screened(DEADBAND), screened(OFFSET)
    monkeypatch.setattr(candidates, "KINKED_STEPS", candidates.KINKED_STEPS[:1])
    small = screened(DEADBAND)
    assert both.evidence > small.evidence + 1.0
    assert both.evidence > BAR
    assert both.detectable == pytest.approx(small.detectable, rel=1e-9)
    assert screened(OFFSET).evidence == smooth.evidence


def test_a_gain_is_screened_on_both_sides_of_a_stop(monkeypatch):
    """If all commands are at the stop, a larger gain changes nothing, and a smaller one changes much."""
    log = run_mission(QUICK, np.random.default_rng(5), duration=900.0)
    stop = QUICK.hull.rudder_limit
    log = log.with_channels({"rudder_rad": stop * np.sign(np.sin(2.0 * np.pi * (log.time + 1.0) / 80.0))})
    flown = simulate(replace_at(QUICK, GAIN, 0.9), log)
    noise = np.random.default_rng(6).normal(0.0, 0.02, len(flown))
    bench = bench_of(flown.with_channels({"heading_rad": flown["heading_rad"] + noise}).without(["r_radps"]))
    state = bench.fit(QUICK, ())

    def screened():
        return screen(bench.problem, state.point, (), [candidate(GAIN)], BAR)[0]

    both = screened()
    assert both.evidence > BAR
    assert both.estimate[0] * spec_at(QUICK, GAIN).probe == pytest.approx(-0.1, rel=0.2)
    monkeypatch.setattr(candidates, "_ONE_SIDE_AT_STOPS", frozenset())
    assert screened().evidence < 1.0


def test_a_period_is_sought_and_counted():
    plant = load_vehicle("qiandao_float")
    paths = ("effects.water.heave_sin", "effects.water.heave_cos", "effects.water.heave_period")
    true = replace_at(plant, {paths[0]: 0.02, paths[2]: 300.0})
    record = run_mission(true, np.random.default_rng(2), target_depths=(30.0, 10.0), duration=900.0)
    bench = Workbench(plant, record, parts_of(plant, record), 0.1)
    heave = Candidate("heave", paths[:2], paths[2])
    state = bench.fit(bench.plant, ())
    (found,) = screen(bench.problem, state.point, (), [heave], BAR)
    assert found.tried == len(periods_of(record)) > 30
    assert found.setting == pytest.approx(300.0, rel=0.2)
    assert found.evidence > BAR
    assert value_at(state.plant, paths[2]) != found.setting


def test_a_wave_goes_on_across_a_gap_but_not_from_one_log_to_the_next():
    time = np.r_[0:100, 140:240].astype(float)
    one = Record.from_arrays(time, {"depth_m": np.sin(time)}, np.repeat([0, 0], 100)).split_gaps(10.0)
    assert len(one.segments) == 2
    assert periods_of(one).max() == pytest.approx(239.0)
    assert periods_of(one.with_labels(["first", "second"])).size == 0


def test_periods_go_from_the_records_length_to_four_samples():
    record = run_mission(QUICK, np.random.default_rng(5), duration=240.0)
    periods = periods_of(record)
    assert (periods.max(), periods.min()) == pytest.approx((record.duration_s, 4.0 * record.sample_interval))
    assert np.all(np.diff(1.0 / periods) <= 0.5 / record.duration_s * (1.0 + 1e-9))


def test_where_an_actuator_is_stuck_is_sought_over_the_range_of_its_commands():
    time, plant = np.arange(0.0, 20.0, 0.1), load_vehicle("npsauv")
    record = Record.from_arrays(time, {"rudder_rad": 0.2 * np.sin(time), "depth_m": 10.0 + 0.0 * time})
    stuck = {c.paths[0]: c for c in candidates_of(plant, record) if c.setting}
    assert set(stuck) == {f"effects.{fin}.stuck" for fin in ("rudder", "stern_plane", "bow_plane")}
    rudder = stuck["effects.rudder.stuck"]
    assert rudder.free == ("effects.rudder.stuck", "effects.rudder.stuck_at")
    assert (rudder.sloped, rudder.periodic) == (True, False)
    assert settings_of(plant, record, rudder) == pytest.approx(np.linspace(-0.2, 0.2, 5), abs=1e-3)
    assert settings_of(plant, record, stuck["effects.bow_plane.stuck"]).tolist() == [0.0]  # no commands were logged


def test_a_delay_of_all_readings_is_sought_where_it_is_not_one_commands_dead_time():
    time, plant = np.arange(0.0, 20.0, 0.1), load_vehicle("npsauv")
    one = {"rudder_rad": np.sin(time), "stern_plane_rad": 0.0 * time, "bow_plane_rad": 0.0 * time}
    two = one | {"stern_plane_rad": np.cos(time)}
    sought = [
        any(c.paths == (COMMON_DELAY,) for c in candidates_of(plant, Record.from_arrays(time, columns)))
        for columns in (one, two)
    ]
    assert sought == [False, True]
    assert any(c.paths == ("effects.clock.rate",) for c in candidates_of(plant))


def test_what_sticks_is_found_by_its_size_alone():
    """The rudder sticks by 4.3 probes; neither the slope at neutral nor that over five probes shows it."""
    size = 4.3 * spec_at(QUICK, STICTION).probe
    rng = np.random.default_rng(8)
    bench = bench_of(run_mission(replace_at(QUICK, STICTION, size), rng, duration=900.0))
    state = bench.fit(QUICK, COEFFICIENTS)
    (found,) = screen(bench.problem, state.point, state.paths, [candidate(STICTION)], BAR)
    assert found.tried == len(bench.problem.sticking_sizes(STICTION)) > 20
    assert found.estimate[0] == pytest.approx(4.3, rel=0.02)  # the rudder moves alike at sizes so near
    assert found.evidence > BAR
    others = [one for one in candidates_of(QUICK) if one.paths[0] in (OFFSET, DEADBAND, GAIN)]
    assert all(found.evidence > one.evidence for one in screen(bench.problem, state.point, state.paths, others, BAR))
    trials = trials_of(bench, state, [candidate(STICTION), *others], 50, lambda *_: None, ())
    assert trials[0].candidate.paths == (STICTION,)
    assert not trials[0].objection
    assert value_at(trials[0].state.plant, STICTION) == pytest.approx(size, rel=0.02)
    low, high = bench.interval(trials[0].state, STICTION)
    assert low <= size <= high
