"""Windows that an unstable vehicle bears, steps of integration, priors of coefficients, and tests over windows."""

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from identification.diagnosis.search.acceptance import chance_of_none
from identification.diagnosis.search.workbench import Workbench, noise_limited_length
from identification.experiments.missions import run_mission
from identification.fit.likelihood import colour, covariance
from identification.fit.shooting import Shooting
from identification.fit.windows import free_run_windows, held_out
from tests.identification.gliders import QUICK


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
    state = bench.fit(bench.plant, ())
    sizes = dict(zip(bench.train.channels, bench.train.sigma(state.train), strict=True))
    assert sizes["u_dvl_mps"] == pytest.approx(0.01, rel=0.1)
    assert sizes["r_radps"] == pytest.approx(np.radians(0.1), rel=0.15)


def test_what_is_known_of_coefficients_holds_those_that_the_log_does_not_tell():
    given = QUICK
    path = given.family.coefficients[0]
    true = replace_at(given, path, 1.1 * value_at(given, path))
    record = run_mission(true, np.random.default_rng(3), duration=300.0)
    free, held = (Shooting(given, record, record.windows(100.0), doubt=doubt) for doubt in (np.inf, 1e-3))
    paths = (path,)
    assert free.pulls(given.vector, paths)[1] == 0.0
    loose, tight = free.solve(given, paths), held.solve(given, paths)
    at = free.index[path]
    assert loose.vector[at] == pytest.approx(true.vector[at], rel=0.05)
    assert tight.vector[at] == pytest.approx(given.vector[at], rel=0.01)
    errors = [
        covariance(p, x, paths, p.linearise(x, paths, p.sigma(x)), colour(p, x))[0][0, 0] * p.scale(path) ** 2
        for p, x in ((free, loose), (held, tight))
    ]
    assert errors[1] ** 0.5 < 1.2e-3 * abs(value_at(given, path)) < errors[0] ** 0.5


def test_one_jump_with_each_candidate_gains_most_for_what_is_there():
    true = replace_at(load_vehicle("slocum"), "effects.rudder.offset", 0.05)
    given, record = load_vehicle("slocum"), run_mission(true, np.random.default_rng(5), duration=600.0)
    problem = Shooting(given, record, record.windows(120.0))
    here = problem.solve(given, given.family.coefficients)
    groups = [("effects.rudder.offset",), ("effects.yaw.quadratic_damping",), ("effects.compass.lag",)]
    points = problem.jumps(here, given.family.coefficients, groups, [1.0] * 3)
    assert all(p.cost <= here.cost for p in points)
    assert here.cost - points[0].cost > 3.0 * max(here.cost - p.cost for p in points[1:])


def test_gains_of_one_odd_window_may_be_chance_and_gains_of_most_are_not():
    rng = np.random.default_rng(0)
    odd = np.r_[50.0, -np.ones(11)]
    steady = 1.0 + rng.standard_normal(12)
    assert chance_of_none(odd) > 0.1
    assert chance_of_none(steady) < 0.01
    assert chance_of_none(steady) == chance_of_none(steady)
    counts = [chance_of_none(np.random.default_rng(k).standard_normal(12)) < 0.01 for k in range(200)]
    assert np.mean(counts) < 0.06


def test_gains_that_come_in_runs_of_windows_are_less_sure():
    gains = np.array([4.0, -2.0, 3.0, -1.0, 4.0, -2.0, 3.0, -1.0])
    in_runs, mixed = np.repeat(gains, 2), np.r_[gains, gains]
    assert chance_of_none(in_runs) > 0.05 > 0.01 > chance_of_none(mixed)
