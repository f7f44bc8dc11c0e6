"""Tests of a filter about a vehicle: starts, their likelihood, missing readings, a vehicle that runs away."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.model import outputs_of
from auv_gym.param import replace_at
from auv_gym.records.record import Record
from identification.deciding import COST
from identification.fit import filtering, stretches
from identification.fit.kalman import run_filter
from identification.fit.noises import Noise
from identification.fit.parameters import moves_of
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.sensitivities import LEAST_GAIN
from identification.fit.shooting import Shooting
from tests.identification.fit.glider_logs import GLIDER, OFFSET, PATHS, SENSORS, glider_log, whole


def test_a_wrong_start_is_corrected_and_costs_no_likelihood(pushed):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    logs = problem.solve(GLIDER, ()).logs
    right = problem.total(problem.point(GLIDER.vector, logs))
    problem.starts = problem.starts + np.array([0.05, 0.02, *np.zeros(problem.starts.shape[1] - 2)])
    assert problem.total(problem.point(GLIDER.vector, logs)) == pytest.approx(right, abs=0.2)


def test_stretches_begin_with_their_likeliest_starts():
    log = glider_log(2, push=0.0)
    windows = log.windows(100.0)
    problem = PredictionErrors(GLIDER, log, windows, process=False)
    true = replace_at(GLIDER, OFFSET, 0.03)
    runs = Shooting(true, log, windows).solve(true, ())
    problem.starts = problem.starts + np.array([0.05, 0.02, *np.zeros(problem.starts.shape[1] - 2)])
    point = problem.point(true.vector, np.log([*SENSORS.values()]))
    assert point.starts[:, 0] == pytest.approx(runs.starts[:, 0], abs=0.1 * SENSORS["heading_rad"])


@pytest.mark.parametrize("slope", [1e200, 1e90])
def test_a_start_of_which_the_likelihood_has_no_slope_stays_where_it_is(pushed, monkeypatch, slope):
    """Squares of diverged slopes overflow; their eigenvalues would end a fit in an error."""
    problem = PredictionErrors(GLIDER, pushed, pushed.windows(100.0), process=False)
    slopes_of = filtering.slopes_of

    def overflown(*arguments):
        slopes = slopes_of(*arguments)
        slopes.means[0] = slope
        return slopes

    monkeypatch.setattr(filtering, "slopes_of", overflown)
    logs = np.log([*SENSORS.values()])
    system = problem._system(GLIDER.vector, problem.first_path, problem.starts, problem.widest)
    made = run_filter(system, *problem._numbers(logs))
    starts, roots = problem._better_starts(system, made, logs, problem.starts)
    np.testing.assert_array_equal(starts[0], problem.starts[0])
    np.testing.assert_array_equal(roots[0], system.start[0])
    assert not np.array_equal(starts[1], problem.starts[1])
    assert np.isfinite(problem.point(GLIDER.vector, logs).scores).all()


def test_the_likelihood_is_that_of_any_starts():
    """The likeliest starts absorb a part of the accelerations; a linear filter from a wide start prevents this."""
    log, plant = glider_log(60, push=0.002, tau=30.0, rows=400), replace_at(GLIDER, OFFSET, 0.03)
    problem = PredictionErrors(plant, log, [slice(k, k + 20) for k in range(0, 380, 21)])
    noises = [problem.logs_of(Noise(SENSORS, process)) for process in ({}, {"r_radps": (0.002, 30.0)})]
    points = [problem.point(plant.vector, logs) for logs in noises]
    linear = [problem.likelihood_of_noises(problem._first_system, p.logs) + COST * problem.is_pushed(p) for p in points]
    for point in points:  # the same holds for the search of noises
        own = problem.likelihood_of_noises(point.system, point.logs) + COST * problem.is_pushed(point)
        assert problem.noise_slopes(point, point.logs)[0] == pytest.approx(own + problem._prior(point.logs)[0])
    first, second = (problem.marginal(p) for p in points)
    assert second - first == pytest.approx(linear[1] - linear[0], abs=0.3)
    assert problem.total(points[1]) - problem.total(points[0]) < linear[1] - linear[0] - 5.0


@pytest.mark.parametrize("swelling", [False, True])
def test_what_wide_starts_cost_follows_from_the_slopes_by_the_starts(swelling):
    log = glider_log(60, push=0.002, tau=30.0, rows=400)
    problem = PredictionErrors(GLIDER, log, [slice(k, k + 20) for k in range(0, 380, 21)])
    swell = {10.0: {"r_radps": (0.001, 40.0)}} if swelling else {}
    noise = Noise(SENSORS, {"r_radps": (0.002, 30.0)}, swell)
    problem = problem.with_noises_of(noise)
    point = problem.point(GLIDER.vector, problem.logs_of(noise))
    numbers = problem._numbers(point.logs)
    wide, own = (run_filter(point.system, *numbers, start=start).spreads.sum() for start in (problem.widest, None))
    assert own - wide < -1.0
    assert problem.marginal(point) - problem.total(point) == pytest.approx(own - wide, rel=1e-9)


def test_how_well_starts_are_known_follows_the_noises(pushed):
    """A filter with weak accelerations is equally likely, found from one with stronger ones or from the readings."""
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    near = problem.solve(GLIDER, ())
    logs = near.logs.copy()
    logs[len(problem.channels) : len(problem.channels) + len(problem.pushed)] -= np.log(30.0)
    there, afresh = problem.point(GLIDER.vector, logs, near), problem.point(GLIDER.vector, logs)
    assert problem.total(there) == pytest.approx(problem.total(afresh), abs=0.01)


def test_a_vehicle_that_leaves_the_record_is_given_up_unless_nothing_better_is_known(pushed, monkeypatch):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    near, own, passes = problem.solve(GLIDER, ()), problem._filtered, []

    def astray(*args, **options):
        found, _ = own(*args, **options)
        passes.append(found)
        return replace(found, scores=found.scores - 2.0), 1.0  # starts improve, but rows are far less likely

    monkeypatch.setattr(problem, "_filtered", astray)
    problem.point(GLIDER.vector, near.logs, near)
    assert len(passes) == 1
    problem.point(GLIDER.vector, near.logs, replace(near, scores=near.scores - 4.0))
    assert len(passes) == 5
    problem.point(GLIDER.vector, near.logs)
    assert len(passes) == 10


def test_missing_readings_count_for_nothing(pushed, monkeypatch):
    """A third of one channel is missing, as between the pings of a Doppler log, and one whole row."""
    missing = np.zeros((len(pushed), len(GLIDER.outputs)), dtype=bool)
    missing[:, GLIDER.outputs.index("heading_rad")] = np.random.default_rng(0).random(len(pushed)) < 0.33
    missing[100] = True
    whole_one = PredictionErrors(GLIDER, pushed, whole(pushed))
    monkeypatch.setattr(
        stretches, "outputs_of", lambda plant, record: np.where(missing, np.nan, outputs_of(plant, record))
    )
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    assert problem.count == 2 * len(pushed) - missing[:, :2].sum()
    noise = Noise(SENSORS, {"r_radps": (0.006, 15.0)})
    point, all_told = (p.point(GLIDER.vector, p.logs_of(noise)) for p in (problem, whole_one))
    assert point.system is not None
    assert point.scores[100] == 0.0
    assert np.all(point.errors[~problem.finite] == 0.0)
    linear = run_filter(point.system, *problem._numbers(point.logs)).scores
    assert point.scores.sum() == pytest.approx(linear.sum(), abs=1.0)
    assert np.mean(point.errors[problem.finite] ** 2) == pytest.approx(np.mean(all_told.errors**2), rel=0.1)


def test_a_run_that_has_run_away_has_no_slope(pushed, monkeypatch):
    """Slopes whose squares overflow would end a regression, or a fit, in an error."""
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    point = problem.point(GLIDER.vector, problem.first_noise())
    y, after = problem._follow(point.vector[None], point.starts, point.gains, point.logs, point.system, False)
    y[0, -3:] = 1e200
    monkeypatch.setattr(problem, "_follow", lambda *arguments: (y, after))
    columns = problem.columns_of(point, moves_of(PATHS[:1]))
    assert np.isfinite((columns**2).sum())


def test_windows_that_touch_are_one_stretch_and_without_process_noise_each_is_its_own(pushed):
    windows = [slice(0, 100), slice(100, 250), slice(300, 400)]
    assert PredictionErrors(GLIDER, pushed, windows).stretches == [slice(0, 250), slice(300, 400)]
    assert PredictionErrors(GLIDER, pushed, windows, process=False).stretches == windows


def test_a_column_of_zeros_counts_as_not_measured(pushed):
    zeros = pushed.with_channels({"r_radps": np.zeros(len(pushed))})
    without = Record.from_arrays(pushed.time, {n: pushed[n] for n in pushed.names if n != "r_radps"})
    still_there, absent = (PredictionErrors(GLIDER, log, whole(log)) for log in (zeros, without))
    wanted = absent.solve(GLIDER, PATHS)
    near = still_there.point(wanted.vector, wanted.logs, wanted)  # in a flat valley, the start decides the end
    assert still_there.total(near) == pytest.approx(absent.total(wanted), abs=LEAST_GAIN)
    found = still_there.solve(still_there.plant_at(near, PATHS), PATHS, near)
    assert found.vector == pytest.approx(wanted.vector, rel=1e-2)
    still = zeros.with_channels({"heading_rad": np.full(len(pushed), 1.0)})
    with pytest.raises(ValueError, match="readings that vary"):
        PredictionErrors(GLIDER, still, whole(still))
