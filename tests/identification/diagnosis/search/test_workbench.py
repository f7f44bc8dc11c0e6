"""Tests of the workbench: windows for unstable vehicles, integration steps, priors, noises, and evidence by parts."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import load_vehicle
from identification.deciding import TIE
from identification.diagnosis.log.checking import noise_limited_length
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search import workbench
from identification.diagnosis.search.workbench import State, Workbench
from identification.experiments.missions import run_mission
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.steps import in_steps
from tests.identification.diagnosis.stand_ins import PLANT, state_of
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


@pytest.mark.slow
def test_fits_of_a_steady_torpedo_come_down_to_the_noise_in_steps_of_a_sample(torpedoes):
    plant, record = load_vehicle("vt690"), torpedoes["vt690"]
    bench = Workbench(plant, record, parts_of(plant, record), 5.0)
    assert bench.plant.longest_step == record.sample_interval > plant.longest_step
    noise = bench.problem.noise_at(bench.fit(bench.plant, ()).point)
    assert noise.measurement["u_dvl_mps"] == pytest.approx(0.01, rel=0.1)
    assert noise.measurement["r_radps"] == pytest.approx(np.radians(0.1), rel=0.15)
    assert noise.process == {}


def bench_of(record, doubt: float = 0.1) -> Workbench:
    return Workbench(QUICK, record, parts_of(QUICK, record), doubt)


@pytest.fixture(scope="module")
def log():
    """A glider whose rudder is 10 % more effective than believed."""
    path = QUICK.family.coefficients[0]
    true = replace_at(QUICK, path, 1.1 * value_at(QUICK, path))
    return path, true, run_mission(true, np.random.default_rng(3), duration=500.0)


@pytest.fixture(scope="module")
def bench(log):
    return bench_of(log[2])


def test_what_is_known_of_coefficients_holds_those_that_the_log_does_not_tell(log):
    path, true, record = log
    given, found = value_at(QUICK, path), {}
    for doubt in (np.inf, 2e-4):
        own = bench_of(record, doubt)
        found[doubt] = own.intervals(own.fit(QUICK, (path,)))[path]
    loose, tight = found[np.inf], found[2e-4]
    assert loose[0] == pytest.approx(value_at(true, path), abs=3.0 * loose[1])
    assert loose[1] < 0.05 * abs(given)
    assert tight[0] == pytest.approx(given, rel=0.01)
    assert tight[1] < 2.4e-4 * abs(given) < loose[1]


def test_a_vehicle_without_a_part_has_the_parameters_that_the_others_give(log, bench):
    paths, far = QUICK.family.coefficients, []
    point = bench.problem.solve(QUICK, paths, gain=1e-4)
    state = State(bench.problem.plant_at(point, paths), paths, point)
    last = len(bench.parts) - 1  # the only part whose rows inform on nothing before or after
    unseen, others = bench.unseen(state, last), [piece for part in bench.parts[:last] for piece in part]
    fewer = PredictionErrors(bench.plant, log[2], others, doubt=0.1)
    there = fewer.point(state.point.vector, state.point.logs)
    for _ in range(3):  # by errors alone, as parts do: the initial covariance depends on parameters, too
        there = fewer.descended(fewer.point(there.vector, there.logs, there), paths)
    for path in paths:
        error, value = bench.intervals(state)[path][1], value_at(state.plant, path)
        moved = there.vector[fewer.index[path]] - value
        assert value_at(unseen, path) - value == pytest.approx(moved, abs=0.1 * error)
        far.append(abs(moved) / error)
    assert max(far) > 0.3


def test_evidence_is_told_by_the_parts_that_it_comes_from(bench):
    before = bench.fit(QUICK, ())
    more = np.where(bench.problem.within(bench.parts[1]) > 0.0, 0.3, 0.1)
    after = replace(before, point=replace(before.point, scores=before.point.scores + more))
    rows = np.array([sum(w.stop - w.start for w in part) for part in bench.parts])
    expected = 0.2 * rows.sum() + 0.4 * rows[1]
    assert bench.gains(before, after) == pytest.approx((expected, expected))
    assert bench.gain(before, after) == pytest.approx(expected)
    costs = bench.costs(before) - bench.costs(after)
    assert costs.size == workbench.BLOCKS
    assert costs.sum() == pytest.approx(expected)
    assert costs[4:8].sum() == pytest.approx(0.6 * rows[1], rel=0.1)  # a sixth of the record is four blocks


def test_parts_foretell_each_other_worse_than_a_fit_of_all_explains_them(bench):
    before, after = bench.fit(QUICK, ()), bench.fit(QUICK, QUICK.family.coefficients)
    fitted, foretold = bench.gains(before, after)
    assert foretold < fitted - 0.5
    assert fitted == pytest.approx(float((bench.costs(before) - bench.costs(after)).sum()), abs=1.0)  # over blocks, too


def test_each_model_has_the_noises_that_suit_it_best():
    """Accelerations absorb a missing offset, and vanish once it is in the model."""
    true = replace_at(QUICK, OFFSET, 0.05)
    bench = bench_of(run_mission(true, np.random.default_rng(3), duration=500.0))
    before = bench.fit(QUICK, ())
    after = bench.fit(true, (), before)
    assert "r_radps" in bench.problem.noise_at(before.point).process
    assert not bench.problem.noise_at(after.point).process
    # wherever the search for noises begins; it ends when an iteration gains less than 0.04
    assert bench.gain(bench.fit(true, ()), after) == pytest.approx(0.0, abs=0.5)


def test_an_effect_is_found_although_accelerations_have_taken_its_part():
    """Half of the rudder's travel is lost; a fit from one probe sees little of it while accelerations are strong."""
    path, paths = "effects.rudder.lost_travel", QUICK.family.coefficients
    bench = bench_of(run_mission(replace_at(QUICK, path, 0.5), np.random.default_rng(3), duration=900.0))
    without = bench.fit(QUICK, paths)
    beside = bench.fit(replace_at(without.plant, path, spec_at(QUICK, path).probe), (*paths, path), without)
    assert value_at(beside.plant, path) == pytest.approx(0.5, abs=0.02)
    assert not bench.problem.noise_at(beside.point).process


def test_what_is_taken_out_leaves_accelerations_to_take_its_part():
    """The evidence for an offset is the same whether it is added to a model or taken out of it."""
    paths = QUICK.family.coefficients
    bench = bench_of(run_mission(replace_at(QUICK, OFFSET, 0.02), np.random.default_rng(4), duration=900.0))
    before = bench.fit(QUICK, paths)
    beside = bench.fit(replace_at(before.plant, OFFSET, 0.01), (*paths, OFFSET), before)
    taken, added = bench.gain(bench.without(beside, [OFFSET]), beside), bench.gain(before, beside)
    assert taken == pytest.approx(added, abs=5.0)  # thousands without accelerations; noises differ slightly


def test_evidence_for_a_refit_is_less_what_the_coefficients_had_to_move(bench):
    paths = QUICK.family.coefficients
    before = bench.fit(QUICK, ())
    moved = replace_at(QUICK, {p: 1.2 * value_at(QUICK, p) for p in paths})
    after = State(moved, paths, replace(before.point, vector=moved.vector))
    assert bench.gains(before, after)[0] == pytest.approx(-2 * 2.0**2)  # two coefficients, two deviations each


def test_a_free_run_that_runs_away_is_no_flight(bench):
    assert bench.flies(bench.fit(QUICK, ()))
    wild = replace_at(QUICK, "effects.discovered.yaw.r_r", 1e6)
    there = State(wild, (), bench.problem.point(wild.vector, bench.problem.first_noise()))
    assert not bench.flies(there)
    assert not there.finite


def test_what_is_taken_out_is_neutral_and_no_longer_free(bench):
    paths = QUICK.family.coefficients
    beside = bench.fit(replace_at(QUICK, OFFSET, 0.02), (*paths, OFFSET))
    without = bench.without(beside, [OFFSET])
    assert value_at(beside.plant, OFFSET) != 0.0
    assert value_at(without.plant, OFFSET) == 0.0
    assert without.paths == paths
    assert bench.gains(without, beside)[0] >= 0.0


def test_only_coefficients_that_went_far_are_tried_as_given(bench):
    path, *_ = paths = QUICK.family.coefficients
    state = bench.fit(QUICK, ())
    far, near = (
        replace(state, plant=replace_at(QUICK, path, f * value_at(QUICK, path)), paths=paths) for f in (1.12, 1.08)
    )
    assert bench.with_given(near) == ()
    (given,) = bench.with_given(far)
    assert given.paths == ()
    assert given.plant == QUICK
    assert bench.with_given(far) == (given,)  # computed once


@pytest.mark.parametrize("factor", [0.6, 1.3])
def test_coefficients_as_given_get_noises_of_their_own(factor):
    """The noises of a fit that follows the record without any acceleration do not suit a vehicle that leaves it."""
    path, *_ = paths = QUICK.family.coefficients
    true = replace_at(QUICK, path, factor * value_at(QUICK, path))
    bench = bench_of(run_mission(true, np.random.default_rng(3), duration=500.0))
    (given,) = bench.with_given(bench.fit(QUICK, paths))
    assert given.plant == bench.plant
    assert bench.gain(given, bench.fit(bench.plant, ())) == pytest.approx(0.0, abs=0.5)


def test_a_fit_goes_on_from_the_end_of_a_likelier_one_without_what_that_has_added(bench, log):
    path, true, _ = log
    paths = QUICK.family.coefficients
    there = bench.fit(replace_at(QUICK, path, 1.3 * value_at(QUICK, path)), ())  # where a fit might have stopped
    stuck, trial = replace(there, paths=paths), bench.fit(replace_at(true, OFFSET, 1e-4), (*paths, OFFSET))
    better = bench.likelier_beside(stuck, trial)
    assert better.paths == paths
    assert value_at(better.plant, OFFSET) == 0.0
    assert bench.gain(stuck, better) > 10.0
    assert value_at(better.plant, path) == pytest.approx(value_at(true, path), rel=0.02)
    assert 0.0 <= bench.gain(better, bench.likelier_beside(better, stuck)) < 0.5  # it is at the maximum


def test_inertia_is_put_back_with_the_moments(torpedoes):
    """If all coefficients of one axis change together, the vehicle is nearly the same; if only some do, it is not."""
    plant, record = load_vehicle("vt690"), torpedoes["vt690"].between(0.0, 40.0)
    bench = Workbench(plant, record, parts_of(plant, record), 0.1)
    paths = ("hull.yaw.ur", "parts.rudder.moment", "hull.i_zz", "hull.added_mass.n_rdot")
    moved = replace_at(bench.plant, {p: 1.2 * value_at(plant, p) for p in paths})
    assert bench._put_back(State(moved, paths, bench.problem.first_point())) == bench.plant


def test_a_fit_begins_again_at_the_given_coefficients_if_these_are_likelier(bench, log):
    path, true, _ = log
    paths = QUICK.family.coefficients
    there = bench.fit(replace_at(QUICK, path, 1.3 * value_at(QUICK, path)), ())  # where a fit might have stopped
    stuck = replace(there, paths=paths)
    better = bench.likelier_from_given(stuck, np.inf)
    assert better.paths == paths
    assert bench.gain(stuck, better) > 10.0
    assert value_at(better.plant, path) == pytest.approx(value_at(true, path), rel=0.02)
    assert bench.likelier_from_given(stuck, -np.inf) is stuck  # too far behind to be tried
    assert bench.likelier_from_given(better, np.inf) is better


@pytest.mark.slow
def test_what_was_fitted_is_taken_over_into_shorter_steps(torpedoes, monkeypatch):
    plant, record = load_vehicle("remus100"), torpedoes["remus100"]
    monkeypatch.setattr(workbench, "brisk", lambda problem: in_steps(problem, 0.05))
    bench = Workbench(plant, record, parts_of(plant, record), 0.1)
    state = bench.fit(bench.plant, ())
    bench.unfinished.append("a search")
    finer = bench.in_suited_steps(state)
    assert finer.unfinished == []  # the search has not begun
    assert finer.plant.longest_step < bench.plant.longest_step
    assert finer.in_suited_steps(state) is finer
    taken = finer.taken_over(state)
    assert taken.plant == finer.plant
    assert abs(finer.gain(taken, finer.fit(finer.plant, ()))) < 0.05 * TIE  # too little to change any decision


@pytest.mark.parametrize("lasts, swells, kinds", [(1, 0, "wb"), (0, 0, "w"), (0, 1, "ws"), (1, 1, "wbs")])
def test_all_accelerations_are_taken_for_weaker_lasting_ones_for_brief_and_a_swell_for_weaker(lasts, swells, kinds):
    asked = []

    def quieted(point, which=None):
        asked.append("w" if which is None else "s")
        return point

    def from_brief(point, paths):
        assert paths == ("hull.n_r",)
        return replace(point, scores=np.array([7.0])) if lasts else None

    problem = SimpleNamespace(
        pushed=("u",),
        swelling=lambda point: np.array([bool(swells)]),
        quieted=quieted,
        from_brief=from_brief,
        plant_at=lambda point, paths: replace_at(PLANT, "hull.n_r", -0.09),
    )
    bench = SimpleNamespace(problem=problem, once=lambda state, question, work: work())
    bases = Workbench.quieted(bench, state_of(PLANT, "hull.n_r"))
    assert asked == [kind for kind in kinds if kind != "b"]
    assert [base.suited for base in bases] == [kind == "b" for kind in kinds]
    assert all(base.quiet for base in bases)
    for base in bases:  # only what has brief accelerations has parameters of its own
        assert (value_at(base.plant, "hull.n_r") == -0.09) == base.suited == (base.point.scores[0] == 7.0)
