"""Windows that an unstable vehicle bears, steps of integration, priors of coefficients, and evidence by windows."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import load_vehicle
from identification.diagnosis.log.checking import noise_limited_length
from identification.diagnosis.search.workbench import State, Workbench, given_values
from identification.experiments.missions import run_mission
from identification.fit.windows import free_run_windows, held_out
from tests.identification.gliders import QUICK

OFFSET = "effects.rudder.offset"


@pytest.fixture(scope="module")
def torpedoes():
    return {v: run_mission(load_vehicle(v), np.random.default_rng(1), duration=100.0) for v in ("vt690", "remus100")}


def test_windows_are_as_long_as_the_vehicle_bears(torpedoes):
    assert noise_limited_length(load_vehicle("vt690"), torpedoes["vt690"], 25.0) == 25.0
    assert noise_limited_length(load_vehicle("remus100"), torpedoes["remus100"], 25.0) < 10.0  # its yaw is unstable


def test_long_runs_that_settle_far_from_the_record_do_not_count_as_calm():
    plant = load_vehicle("remus100")
    pushed = replace_at(plant, "effects.load.moment_y", 0.1)
    record = run_mission(pushed, np.random.default_rng(4), duration=50.0)
    assert noise_limited_length(plant, record, 25.0) < 10.0


def test_fits_of_a_steady_torpedo_come_down_to_the_noise_in_steps_of_a_sample(torpedoes):
    plant, record = load_vehicle("vt690"), torpedoes["vt690"]
    bench = Workbench(plant, record, *held_out(plant, record, free_run_windows(plant, record, 25.0)), 5.0)
    assert bench.plant.longest_step == record.sample_interval > plant.longest_step
    noise = bench.problem.noise_at(bench.fit(bench.plant, ()).point)
    assert noise.measurement["u_dvl_mps"] == pytest.approx(0.01, rel=0.1)
    assert noise.measurement["r_radps"] == pytest.approx(np.radians(0.1), rel=0.15)
    assert noise.process == {}


def bench_of(record, doubt: float = 0.1) -> Workbench:
    """A bench of the glider whose last window is held out."""
    windows = free_run_windows(QUICK, record, QUICK.window)
    windows = windows[: len(windows) // 2 * 2]
    return Workbench(QUICK, record, windows[0::2], windows[1::2], doubt)


@pytest.fixture(scope="module")
def log():
    """A glider whose rudder does 10 % more than it is believed to."""
    path = QUICK.family.coefficients[0]
    true = replace_at(QUICK, path, 1.1 * value_at(QUICK, path))
    return path, true, run_mission(true, np.random.default_rng(3), duration=500.0)


@pytest.fixture(scope="module")
def bench(log):
    return bench_of(log[2])


def test_what_is_known_of_coefficients_holds_those_that_the_log_does_not_tell(log):
    path, true, record = log
    given, found = value_at(QUICK, path), {}
    for doubt in (np.inf, 1e-3):
        own = bench_of(record, doubt)
        found[doubt] = own.intervals(own.fit(QUICK, (path,)))[path]
    loose, tight = found[np.inf], found[1e-3]
    assert loose[0] == pytest.approx(value_at(true, path), abs=3.0 * loose[1])
    assert loose[1] < 0.05 * abs(given)
    assert tight[0] == pytest.approx(given, rel=0.01)
    assert tight[1] < 1.2e-3 * abs(given) < loose[1]


def test_the_fit_reads_no_held_out_window(log, bench):
    """Of the last window, which is held out, nothing may reach what was fitted before it."""
    _, _, record = log
    (*_, last), paths = bench.held, QUICK.family.coefficients
    heading = record["heading_rad"].copy()
    heading[last] += 0.02 * np.arange(last.stop - last.start)  # as if the glider had another drift there
    other = bench_of(record.with_channels({"heading_rad": heading}))
    sizes, same = (b.intervals(b.fit(QUICK, paths)) for b in (bench, other))
    for path in paths:  # where the search for the noises begins is another
        assert same[path][0] == pytest.approx(sizes[path][0], abs=0.1 * sizes[path][1])
    counted = np.concatenate([np.arange(w.start, w.stop) for w in bench.train])
    assert np.array_equal(bench.problem.rows[bench.problem.counted > 0.0], counted)


def test_evidence_is_told_by_the_windows_that_it_comes_from(bench):
    before = bench.fit(QUICK, ())
    more = np.where(bench.problem.within(bench.held) > 0.0, 0.3, 0.1)
    after = replace(before, point=replace(before.point, scores=before.point.scores + more))
    rows = sum(w.stop - w.start for w in bench.train), sum(w.stop - w.start for w in bench.held)
    assert bench.gains(before, after) == pytest.approx((0.2 * rows[0], 0.6 * rows[1]))
    costs = bench.costs(before) - bench.costs(after)
    windows = sorted((*bench.train, *bench.held), key=lambda w: w.start)
    expected = [(0.2 if w in bench.train else 0.6) * (w.stop - w.start) for w in windows]
    assert costs == pytest.approx(expected)


def test_held_out_windows_cost_what_they_say_against_a_model(bench):
    """Also of parameters that a fit leaves uncertain: ties and the evidence for a name rest on the same likelihood."""
    before, after = bench.fit(QUICK, ()), bench.fit(QUICK, QUICK.family.coefficients)
    windows = sorted((*bench.train, *bench.held), key=lambda w: w.start)
    held = np.array([w in bench.held for w in windows])
    saved = (bench.costs(before) - bench.costs(after))[held].sum()
    assert saved == pytest.approx(bench.gains(before, after)[1])
    exact = 2.0 * (after.point.scores - before.point.scores)[bench.problem.within(bench.held) > 0.0].sum()
    assert saved != pytest.approx(exact, abs=0.1)


def test_each_model_has_the_noises_that_suit_it_best():
    """Accelerations take the part of an offset that is missing, and come to nothing once it is there."""
    true = replace_at(QUICK, OFFSET, 0.05)
    bench = bench_of(run_mission(true, np.random.default_rng(3), duration=500.0))
    before = bench.fit(QUICK, ())
    after = bench.fit(true, (), before)
    assert "r_radps" in bench.problem.noise_at(before.point).process
    assert not bench.problem.noise_at(after.point).process
    # wherever the search for them begins; it ends where a turn gains less than 0.04
    assert sum(bench.gains(bench.fit(true, ()), after)) == pytest.approx(0.0, abs=0.5)


def test_an_effect_is_found_although_accelerations_have_taken_its_part():
    """Half of a rudder's travel is lost, of which a fit that begins at a probe sees little while they are strong."""
    path, paths = "effects.rudder.lost_travel", QUICK.family.coefficients
    bench = bench_of(run_mission(replace_at(QUICK, path, 0.5), np.random.default_rng(3), duration=900.0))
    without = bench.fit(QUICK, paths)
    beside = bench.fit(replace_at(without.plant, path, spec_at(QUICK, path).probe), (*paths, path), without)
    assert value_at(beside.plant, path) == pytest.approx(0.5, abs=0.02)
    assert not bench.problem.noise_at(beside.point).process


def test_what_is_taken_out_leaves_accelerations_to_take_its_part():
    """The evidence for an offset is the same whether it was added to the model without it or is taken out again."""
    paths = QUICK.family.coefficients
    bench = bench_of(run_mission(replace_at(QUICK, OFFSET, 0.02), np.random.default_rng(4), duration=900.0))
    before = bench.fit(QUICK, paths)
    beside = bench.fit(replace_at(before.plant, OFFSET, 0.01), (*paths, OFFSET), before)
    taken, added = sum(bench.gains(bench.without(beside, [OFFSET]), beside)), sum(bench.gains(before, beside))
    assert taken == pytest.approx(added, abs=5.0)  # thousands if they stay away; noises of two fits are a little apart


def test_noises_are_told_of_all_windows(log, bench):
    """Readings that are worse in the held-out windows are no concern of the fit, but of what is said of the sensor."""
    _, true, record = log
    more = 0.05 * np.random.default_rng(0).standard_normal(len(record))
    for window in bench.train:
        more[window] = 0.0
    other = bench_of(record.with_channels({"heading_rad": record["heading_rad"] + more}))
    state = other.fit(true, ())
    fitted = other.problem.noise_at(state.point).measurement["heading_rad"]
    stated = other.noise(state).measurement["heading_rad"]
    assert fitted < 0.015
    assert stated == pytest.approx(0.05 / np.sqrt(2.0), rel=0.2)  # half of the rows, and 0.01 more in both


def test_evidence_for_a_refit_is_less_what_the_coefficients_had_to_move(bench):
    paths = QUICK.family.coefficients
    before = bench.fit(QUICK, ())
    moved = replace_at(QUICK, {p: 1.2 * value_at(QUICK, p) for p in paths})
    after = State(moved, paths, replace(before.point, vector=moved.vector))
    assert bench.gains(before, after)[0] == pytest.approx(-2 * 2.0**2)  # two coefficients, two deviations each


def test_a_free_run_that_runs_away_is_no_flight(bench):
    assert bench.flies(QUICK)
    wild = replace_at(QUICK, "effects.discovered.yaw.r_r", 1e6)
    assert not bench.flies(wild)
    point = bench.problem.point(wild.vector, bench.problem.first_noise())
    assert not State(wild, (), point).finite


def test_what_is_taken_out_is_neutral_and_no_longer_free(bench):
    paths = QUICK.family.coefficients
    beside = bench.fit(replace_at(QUICK, OFFSET, 0.02), (*paths, OFFSET))
    without = bench.without(beside, [OFFSET])
    assert value_at(beside.plant, OFFSET) != 0.0
    assert value_at(without.plant, OFFSET) == 0.0
    assert without.paths == paths
    assert bench.gains(without, beside)[0] >= 0.0


def test_only_coefficients_that_went_far_are_tried_as_given():
    (path, *_), state = QUICK.family.coefficients, State(QUICK, QUICK.family.coefficients, None)  # type: ignore[arg-type]
    far, near = (replace(state, plant=replace_at(QUICK, path, f * value_at(QUICK, path))) for f in (1.12, 1.08))
    assert given_values(QUICK, near) == {}
    assert given_values(QUICK, far) == {p: value_at(QUICK, p) for p in QUICK.family.coefficients}
