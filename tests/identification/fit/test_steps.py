"""Tests of integration steps, which are longer if this moves no estimate."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from identification.experiments.missions import run_mission
from identification.fit import greybox, steps
from identification.fit.greybox import GreyBox
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.steps import MOST_MOVED, brisk, in_steps, moved_by_steps, suited
from identification.fit.windows import free_run_windows


def logged(vehicle: str, duration: float = 60.0):
    plant = load_vehicle(vehicle)
    record = run_mission(plant, np.random.default_rng(1), duration=duration)
    return plant, PredictionErrors(plant, record, free_run_windows(plant, record, 20.0), doubt=0.1)


def test_a_steady_torpedo_is_integrated_in_steps_of_a_sample():
    plant, problem = logged("vt690")
    faster = brisk(problem)
    assert faster.plant.longest_step == pytest.approx(problem.record.sample_interval)
    assert problem.plant.longest_step == plant.longest_step


def test_an_unstable_one_in_shorter_steps():
    plant, problem = logged("remus100")
    assert plant.longest_step <= brisk(problem).plant.longest_step < problem.record.sample_interval


def test_steps_are_judged_where_the_filter_follows_the_record():
    """A top-heavy vehicle leaves the readings of a log without roll and rates; then integration steps move it far."""
    plant, whole = logged("vt690")
    few = whole.record.without([n for n in whole.channels if not n.endswith(("dvl_mps", "pitch_rad", "depth_m"))])
    heavy = replace_at(plant, "effects.load.z_g", -0.015)
    far = PredictionErrors(heavy, few, [slice(0, len(few))], doubt=0.1, stride=5)
    first, sample = far.first_point(), far.record.sample_interval
    assert not far.keeps_to_readings(first)
    assert moved_by_steps(in_steps(far, sample), far, first) > 1.0
    assert brisk(far).plant.longest_step == pytest.approx(sample)


@pytest.mark.slow
def test_steps_are_judged_again_with_what_a_fit_has_found():
    """Without process noise, the filter follows the model, and integration errors accumulate."""
    plant, problem = logged("remus100", 120.0)
    faster = in_steps(problem, problem.record.sample_interval / 2.0)
    point = problem.solve(plant, ())
    assert problem.noise_at(point).process == {}
    assert moved_by_steps(faster, problem, point) > MOST_MOVED
    better = suited(problem, faster, point, ())
    assert plant.longest_step <= better.plant.longest_step < faster.plant.longest_step
    assert moved_by_steps(better, problem, point) < MOST_MOVED
    assert suited(problem, better, point, ()) is better
    assert suited(problem, problem, point, ()) is problem


def test_steps_shorter_than_given_ones_are_not_tried():
    _, problem = logged("vt690")
    coarse = in_steps(problem, problem.record.sample_interval)
    assert brisk(coarse) is coarse


@pytest.mark.slow
def test_longer_steps_move_no_estimate_and_are_not_kept_in_the_fitted_plant(monkeypatch):
    plant, problem = logged("vt690", 30.0)
    record = problem.record
    free = ["hull.yaw.ur", "hull.pitch.uq"]
    found = GreyBox(plant, free, window=20.0).fit(record)
    assert found.model.longest_step == plant.longest_step < brisk(problem).plant.longest_step
    monkeypatch.setattr(greybox, "brisk", lambda problem: problem)
    fine = GreyBox(plant, free, window=20.0).fit(record)
    for path in free:
        assert abs(found[path].value - fine[path].value) < MOST_MOVED * fine[path].error
        assert found[path].value != fine[path].value != value_at(plant, path)
    monkeypatch.undo()
    monkeypatch.setattr(steps, "MOST_MOVED", 0.0)  # as if any movement mattered
    again = GreyBox(plant, free, window=20.0).fit(record)
    assert [again[path].value for path in free] == [fine[path].value for path in free]


@pytest.mark.parametrize("parts, finer", [(1, False), (4, True)])
def test_steps_finer_than_the_vehicles_own_are_taken_where_the_record_is_likelier_with_them(parts, finer):
    """The record of a vehicle in coarse steps has their errors, that of one in fine steps, like the sea, has not."""
    coarse = replace(load_vehicle("bluerov2_heavy"), longest_step=0.05)
    true = replace(coarse, longest_step=coarse.longest_step / parts)
    record = run_mission(true, np.random.default_rng(1), duration=40.0)
    problem = PredictionErrors(coarse, record, free_run_windows(coarse, record, 20.0))
    better = suited(problem, problem, problem.solve(coarse, ()), ())
    assert (better.plant.longest_step < coarse.longest_step) is finer
    assert suited(problem, better, problem.first_point(), ()) is better
