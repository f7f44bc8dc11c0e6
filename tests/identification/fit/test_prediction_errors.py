"""Tests of prediction-error fits: equal to free runs without process noise, slopes, likelihood ratios."""

import numpy as np
import pytest
from scipy import stats

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.experiments.missions import run_mission
from identification.fit.greybox import GreyBox
from identification.fit.intervals import information_of
from identification.fit.noises import Noise
from identification.fit.parameters import moves_of
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.shooting import Shooting
from identification.fit.windows import free_run_windows
from tests.identification.fit.glider_logs import COEFFICIENTS, GLIDER, OFFSET, PATHS, SENSORS, glider_log, whole


@pytest.mark.slow
def test_estimates_scatter_by_what_is_said_of_them_where_free_runs_do_not():
    scores: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(12):
        log = glider_log(seed)
        for process, found in scores.items():
            fit = GreyBox(GLIDER, PATHS, process=process).fit(log)
            found += [(fit[p].value - (0.03 if p == OFFSET else value_at(GLIDER, p))) / fit[p].error for p in PATHS]
    spread = {process: float(np.sqrt(np.mean(np.square(found)))) for process, found in scores.items()}
    assert 0.6 < spread[True] < 1.5  # 12 logs of three parameters, two of which correlate
    assert spread[False] > 1.3 * spread[True]


def test_without_process_noise_the_fit_is_output_error():
    """The fits by the filter and by free runs over windows with fitted starts are equally likely, by either measure."""
    log = glider_log(2, push=0.0)
    windows = log.windows(100.0)
    problem, shooting = PredictionErrors(GLIDER, log, windows, process=False), Shooting(GLIDER, log, windows)
    point, runs = problem.solve(GLIDER, PATHS), shooting.solve(GLIDER, PATHS)
    other = problem.point(runs.vector, point.logs, point)
    assert problem.total(other) == pytest.approx(problem.total(point), abs=0.05)
    cost = shooting.solve(problem.plant_at(point, PATHS), ()).cost
    assert cost == pytest.approx(runs.cost, abs=0.05)
    # at the beginning of a window the filter knows less than the fitted start
    assert np.sqrt(np.mean(point.innovations**2, axis=0)) == pytest.approx(shooting.sigma(runs), rel=0.1)


def test_process_noise_that_tends_to_zero_gives_free_runs():
    log = glider_log(4, push=0.0)
    problem = PredictionErrors(GLIDER, log, whole(log))
    true = replace_at(GLIDER, OFFSET, 0.03)
    point = problem.point(true.vector, problem.logs_of(Noise(SENSORS, {"r_radps": (1e-9, 15.0)})))
    runs = Shooting(true, log, whole(log)).solve(true, ())
    # after a tenth of the log the filter has forgotten its start
    assert point.innovations[50:] == pytest.approx(runs.residual[50:], abs=0.1 * SENSORS["heading_rad"])


def test_slopes_are_those_of_the_errors_with_the_gains_held(pushed):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    point = problem.solve(GLIDER, ())
    columns = problem.columns_of(point, moves_of(PATHS))
    for path, column in zip(PATHS, columns, strict=True):
        vectors = []
        for side in (-1.0, 1.0):
            vector = point.vector.copy()
            vector[problem.index[path]] += side * 1e-3 * problem.scale(path)
            vectors.append(vector)
        before, after = (problem.with_gains(point, vector).errors for vector in vectors)
        central = (before - after) / 2e-3
        assert column == pytest.approx(central, abs=2e-3 * np.abs(central).max())


def test_errors_of_the_right_model_are_white_and_of_unit_variance(pushed):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    errors = problem.solve(GLIDER, PATHS).errors
    assert np.mean(errors**2, axis=0) == pytest.approx([1.0, 1.0], abs=0.1)
    for error in errors.T:
        assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 4.0 / np.sqrt(len(error))


def test_a_log_tells_no_more_at_a_higher_rate(pushed):
    """Resampled to a third of its interval, a log gives the same estimates with the same precision."""
    found = []
    for log in (pushed, pushed.resample(GLIDER.dt / 3.0)):
        problem = PredictionErrors(GLIDER, log, whole(log))
        point = problem.solve(GLIDER, PATHS)
        found.append((problem.count, problem.plant_at(point, PATHS), information_of(problem, point, PATHS)))
    (count, plant, told), (other_count, other, other_told) = found
    assert count == other_count
    errors = np.sqrt(np.diag(told.covariance))
    alone, other_alone = (np.sqrt(np.diag(np.linalg.inv(one.alone))) for one in (told, other_told))
    assert other_alone == pytest.approx(alone, rel=0.1)
    # the movement of estimates with the noise is of second order in the noise, which is estimated again
    assert np.sqrt(np.diag(other_told.covariance)) == pytest.approx(errors, rel=0.15)
    for path, error in zip(PATHS, errors * [problem.scale(p) for p in PATHS], strict=True):
        assert value_at(other, path) == pytest.approx(value_at(plant, path), abs=0.3 * error)


def test_starts_move_with_the_parameters():
    """Three joint steps reach what separate steps of parameters and starts would reach much later."""
    log = glider_log(2, push=0.0)
    problem = PredictionErrors(GLIDER, log, log.windows(40.0), process=False)
    first = problem.point(GLIDER.vector, np.log([*SENSORS.values()]))
    best = problem.total(problem.solve(GLIDER, PATHS, first, noise=False))
    assert best > problem.total(first) + 1e3
    assert problem.total(problem.descended(first, PATHS)) == pytest.approx(best, abs=0.1)


def test_a_fit_that_goes_by_short_steps_goes_on_the_same_way(pushed, monkeypatch):
    """In a narrow valley, small errors of the slopes may make each step a tenth of the right one."""
    problem, own = PredictionErrors(GLIDER, pushed, whole(pushed)), PredictionErrors.descended
    best = problem.solve(GLIDER, PATHS)

    def short(self, here, paths, *given, **how):
        return self.with_gains(here, here.vector + 0.1 * (own(self, here, paths, *given, **how).vector - here.vector))

    monkeypatch.setattr(PredictionErrors, "descended", short)
    reached = problem.solve(GLIDER, PATHS, iterations=8)
    assert problem.objective(reached, PATHS) == pytest.approx(problem.objective(best, PATHS), abs=0.5)


def test_a_plant_that_runs_away_is_refused_in_words(pushed):
    wild = replace_at(GLIDER, "effects.discovered.yaw.r_r", 1e9)
    with pytest.raises(ValueError, match=r"not finite from one sample .* to the next"):
        PredictionErrors(wild, pushed, whole(pushed)).solve(wild, ())


def clean_log(vehicle: str, seed: int) -> Record:
    """A log of a vehicle without missing effects: a glider with process noise, a float or a torpedo without."""
    if vehicle == "ganeshblue":
        return glider_log(seed, rows=400, **{OFFSET: 0.0})
    duration = {"qiandao_float": 400.0, "npsauv": 40.0}[vehicle]
    return run_mission(load_vehicle(vehicle), np.random.default_rng(seed), duration=duration)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2, 3])
def test_a_float_at_the_surface_is_as_likely_as_free_runs_say_and_no_likelier_with_less_freedom(seed):
    """Where the float bobs, its model is far from linear, and fits might end in poor local maxima."""
    plant, log, drag = load_vehicle("qiandao_float"), clean_log("qiandao_float", seed), ("hull.drag_quadratic",)
    problem, runs = PredictionErrors(plant, log, whole(log)), Shooting(plant, log, whole(log))
    fewer = problem.solve(plant, drag)
    cost, count = runs.solve(plant, drag).cost, int(runs.counts.sum())
    assert problem.total(fewer) > -cost - 0.5 * count * (np.log(2.0 * np.pi) + 1.0) - 0.2
    both = (*drag, "effects.piston.gain")
    more = problem.solve(problem.plant_at(fewer, drag), both, fewer)
    again = problem.solve(problem.plant_at(fewer, drag), drag, more)
    assert problem.objective(more, both) > problem.objective(fewer, drag) - 0.05
    assert problem.objective(again, drag) > problem.objective(fewer, drag) - 0.05


@pytest.mark.slow
@pytest.mark.parametrize(
    "vehicle, fitted, effect",
    [
        ("ganeshblue", COEFFICIENTS, "effects.rudder.offset"),
        ("qiandao_float", ("hull.drag_quadratic",), "effects.volume.compressibility"),
        ("npsauv", ("hull.yaw.uv", "hull.yaw.ur"), "effects.rudder.gain"),
    ],
)
def test_likelihood_ratios_on_clean_logs_follow_chi_square(vehicle, fitted, effect):
    """Twice the gain by an absent effect, with refitted noises: quantiles over 500 logs."""
    plant, ratios = load_vehicle(vehicle), []
    for seed in range(500):
        log = clean_log(vehicle, seed)
        problem = PredictionErrors(plant, log, free_run_windows(plant, log, min(plant.window, 30.0)))
        without = problem.solve(plant, fitted)
        beside = problem.solve(problem.plant_at(without, fitted), (*fitted, effect), without)
        # the smaller model with the noises of the larger one, if it ended in a lower local maximum
        again = problem.solve(problem.plant_at(without, fitted), fitted, beside)
        best = max(problem.objective(p, fitted) for p in (without, again))
        ratios.append(2.0 * (problem.objective(beside, (*fitted, effect)) - best))
    for share in (0.5, 0.9, 0.95, 0.99):
        above = float(np.mean(np.array(ratios) > stats.chi2.ppf(share, 1)))
        spread = np.sqrt(share * (1.0 - share) / 500)
        assert above == pytest.approx(1.0 - share, abs=3.5 * spread), share
