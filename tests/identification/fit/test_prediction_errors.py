"""Tests of prediction-error fits: equal to free runs without process noise, recovery of noises, slopes, starts."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from auv_gym.model import outputs_of, simulate
from auv_gym.param import replace_at, value_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from identification.deciding import COST, LEAST_PROCESS
from identification.experiments.missions import run_mission
from identification.fit import filtering, prediction_errors, stretches
from identification.fit.greybox import GreyBox
from identification.fit.intervals import information_of, profile_interval
from identification.fit.kalman import run_filter
from identification.fit.noises import Noise
from identification.fit.parameters import moves_of
from identification.fit.prediction_errors import NOISE_STEPS, PredictionErrors
from identification.fit.sensitivities import LEAST_GAIN
from identification.fit.shooting import Shooting
from identification.fit.windows import free_run_windows

GLIDER = load_vehicle("ganeshblue")
SENSORS = {"heading_rad": 0.01, "r_radps": 0.003}
OFFSET, COEFFICIENTS = "effects.rudder.offset", ("hull.n_r", "hull.n_delta")
PATHS = (*COEFFICIENTS, OFFSET)
PIECES = 16  # steps of the truth within a sample, in which its yaw rate decays to an eighth


def glider_log(
    seed: int, push: float = 0.006, tau: float = 15.0, rows: int = 500, gust: float = 1.0, **changes: float
) -> Record:
    """A glider under a random yaw acceleration (push, rad/s^2; tau, s), steered by a random telegraph.

    gust: the factor of the acceleration from row 200 to 260.
    """
    plant: Plant = replace(replace_at(GLIDER, {OFFSET: 0.03} | changes), dt=GLIDER.dt / PIECES)
    rng, hold = np.random.default_rng(seed), 25
    inputs = np.zeros((rows, len(plant.inputs)))
    inputs[:, 0] = np.repeat(rng.choice([-1.0, 1.0], rows // hold) * rng.uniform(0.05, 0.3, rows // hold), hold)
    inputs[:, plant.inputs.index("u_mps")] = 0.5 + 0.05 * np.sin(np.arange(rows) / 50.0)
    at, x, pushed = plant.family.states.index("r_radps"), plant.initial(np.full(len(plant.outputs), np.nan)), 0.0
    decay, readings = np.exp(-GLIDER.dt / tau), []
    pushed = push * rng.standard_normal()
    for k, u in enumerate(inputs):
        readings.append(plant.output(x))
        kick = 0.5 * plant.dt * pushed * (gust if 200 <= k < 260 else 1.0)
        for _ in range(PIECES):
            x[at] += kick
            x = plant.step(x, u)
            x[at] += kick
        pushed = decay * pushed + push * np.sqrt(1.0 - decay**2) * rng.standard_normal()
    y = np.array(readings)
    channels = {n: y[:, plant.outputs.index(n)] + s * rng.standard_normal(rows) for n, s in SENSORS.items()}
    channels |= {n: inputs[:, plant.inputs.index(n)] for n in ("rudder_rad", "u_mps")}
    return Record.from_arrays(GLIDER.dt * np.arange(rows), channels)


def whole(record: Record) -> list[slice]:
    return [slice(0, len(record))]


@pytest.fixture(scope="module")
def pushed() -> Record:
    return glider_log(0)


def test_what_pushes_the_vehicle_is_found():
    """The strength is found within a factor of 1.5; its estimate scatters by 15 % over seeds."""
    for seed in range(4):
        log = glider_log(seed)
        problem = PredictionErrors(GLIDER, log, whole(log))
        noise = problem.noise_at(problem.solve(GLIDER, PATHS))
        size, time = noise.process["r_radps"]
        assert 0.006 / 1.5 < size < 0.006 * 1.5
        assert 5.0 < time < 45.0
        assert noise.measurement == pytest.approx(SENSORS, rel=0.15)  # four standard errors of 500 readings


def test_nothing_is_said_to_push_a_vehicle_that_nothing_pushes():
    log = glider_log(1, push=0.0)
    problem = PredictionErrors(GLIDER, log, whole(log))
    assert not problem.noise_at(problem.solve(GLIDER, PATHS)).process


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


def test_a_compass_that_is_read_more_rarely_than_the_gyro_has_the_noise_that_it_has(pushed):
    """The readings are interpolated from every 5 s; their error and their number are those of true readings."""
    rows = np.arange(len(pushed))
    joined = pushed.with_channels({"heading_rad": np.interp(rows, rows[::5], pushed["heading_rad"][::5])})
    told = PredictionErrors(GLIDER, joined.with_intervals({"heading_rad": 5.0}), whole(joined))
    assert told.count == len(rows) + len(rows[::5])
    noise = told.noise_at(told.solve(GLIDER, PATHS))
    assert noise.measurement == pytest.approx(SENSORS, rel=0.3)  # four standard errors of 100 readings
    untold = PredictionErrors(GLIDER, joined, whole(joined))
    assert untold.noise_at(untold.solve(GLIDER, PATHS)).measurement["heading_rad"] < 0.6 * SENSORS["heading_rad"]


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


def test_a_run_that_has_run_away_has_no_slope(pushed, monkeypatch):
    """Slopes whose squares overflow would end a regression, or a fit, in an error."""
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    point = problem.point(GLIDER.vector, problem.first_noise())
    y, after = problem._follow(point.vector[None], point.starts, point.gains, point.logs, point.system, False)
    y[0, -3:] = 1e200
    monkeypatch.setattr(problem, "_follow", lambda *arguments: (y, after))
    columns = problem.columns_of(point, moves_of(PATHS[:1]))
    assert np.isfinite((columns**2).sum())


def test_accelerations_that_a_filter_does_without_are_brought_back(pushed):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    logs, first = problem.first_noise(), len(problem.channels)
    logs[first : first + len(problem.pushed)] = np.log(LEAST_PROCESS * np.array(problem.unit))
    point = problem.point(GLIDER.vector, logs)
    assert np.all(point.gains[:, len(problem.live) :] == 0.0)
    assert problem._there(problem.better_noise(point, NOISE_STEPS)[0]).any()


def test_noises_are_renewed_without_accelerations_that_are_missing(pushed):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    point = problem.first_point(problem._without(problem.first_noise(), [0]))
    assert not problem.is_pushed(problem.renewed(point, point.logs, (), missing=False))
    assert problem.is_pushed(problem.renewed(point, point.logs, ()))


def test_an_acceleration_that_is_far_too_strong_is_not_given_up_before_weaker_ones_are_tried():
    """A common strength for all axes may be far too large for one, so that none, but also a weaker one, is likelier."""
    log, plant = glider_log(0, push=0.0012), replace_at(GLIDER, {OFFSET: 0.03})
    problem = PredictionErrors(plant, log, whole(log))
    strong, first = problem.first_noise(), len(problem.channels)
    strong[first] = np.log(30.0 * problem.unit[0])
    point = problem.point(plant.vector, strong)
    assert point.system is not None
    none = problem._without(strong, [0])
    assert problem.likelihood_of_noises(point.system, none) > problem.likelihood_of_noises(point.system, strong)
    assert problem._there(problem.better_noise(point, NOISE_STEPS)[0]).all()


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


def test_readings_of_many_short_stretches_keep_their_noise():
    """The likeliest start meets the first readings of a stretch exactly, which is no evidence of their precision."""
    record = glider_log(40)
    problem = PredictionErrors(GLIDER, record, [slice(k, k + 8) for k in range(0, len(record) - 8, 9)])
    noise = problem.noise_at(problem.solve(GLIDER, PATHS)).measurement
    assert noise == pytest.approx(SENSORS, rel=0.2)


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


def test_better_noises_are_found_about_the_path_of_a_step_with_the_gains_held(pushed):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    wrong = problem.solve(GLIDER, COEFFICIENTS)  # with accelerations instead of the offset
    best = problem.solve(GLIDER, PATHS)
    stepped = problem.with_gains(wrong, best.vector)
    found = problem.renewed(stepped, stepped.logs, PATHS)
    assert problem.objective(found, PATHS) == pytest.approx(problem.objective(best, PATHS), abs=0.5)
    there, _ = problem._renewed(stepped, PATHS, 6)
    assert problem.objective(there, PATHS) == pytest.approx(problem.objective(best, PATHS), abs=0.5)
    assert problem.objective(stepped, PATHS) < problem.objective(best, PATHS) - 5.0


def test_starts_move_with_the_parameters():
    """Three joint steps reach what separate steps of parameters and starts would reach much later."""
    log = glider_log(2, push=0.0)
    problem = PredictionErrors(GLIDER, log, log.windows(40.0), process=False)
    first = problem.point(GLIDER.vector, np.log([*SENSORS.values()]))
    best = problem.total(problem.solve(GLIDER, PATHS, first, noise=False))
    assert best > problem.total(first) + 1e3
    assert problem.total(problem.descended(first, PATHS)) == pytest.approx(best, abs=0.1)


def test_what_is_known_of_correlation_times_and_the_cost_of_an_acceleration_are_part_of_the_objective(pushed):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    none = problem.point(GLIDER.vector, problem.logs_of(Noise(SENSORS, {})))
    assert problem.objective(none, ()) == pytest.approx(problem.marginal(none))
    for time, far in ((25.0, 0.0), (25.0 * np.e, 1.0), (5.0, np.log(5.0))):
        point = problem.point(GLIDER.vector, problem.logs_of(Noise(SENSORS, {"r_radps": (0.006, time)})))
        assert problem.objective(point, ()) - problem.marginal(point) == pytest.approx(-0.5 * far**2 - COST)


def test_what_lasts_longer_than_some_minutes_is_no_noise():
    """A missing moment acts all the time; the longest correlation time is 185 s, 25 s times e^2."""
    log = glider_log(2, push=0.0, rows=1000)
    problem = PredictionErrors(GLIDER, log, whole(log))
    (found,) = problem.noise_at(problem.solve(GLIDER, COEFFICIENTS)).process.values()
    assert found[1] == pytest.approx(25.0 * np.exp(2.0))


def test_an_acceleration_without_which_the_log_is_likelier_is_absent():
    for seed in range(1, 5):
        log = glider_log(seed, push=0.0)
        problem = PredictionErrors(GLIDER, log, whole(log))
        point = problem.solve(GLIDER, PATHS)
        without = replace(problem.noise_at(point), process={})
        assert problem.total(problem.point(point.vector, problem.logs_of(without), point)) < problem.total(point) + 0.05
    push = len(problem.channels)
    pushed = problem.logs_of(without)
    pushed[push] = np.log(0.03 * problem.unit[0])
    there = problem.point(point.vector, pushed, point)
    assert problem.pushes(there).any()
    assert not problem.pushes(problem._weaker(there, PATHS)).any()


def test_a_fit_that_goes_by_short_steps_goes_on_the_same_way(pushed, monkeypatch):
    """In a narrow valley, small errors of the slopes may make each step a tenth of the right one."""
    problem, own = PredictionErrors(GLIDER, pushed, whole(pushed)), PredictionErrors.descended
    best = problem.solve(GLIDER, PATHS)

    def short(self, here, paths, *given, **how):
        return self.with_gains(here, here.vector + 0.1 * (own(self, here, paths, *given, **how).vector - here.vector))

    monkeypatch.setattr(PredictionErrors, "descended", short)
    reached = problem.solve(GLIDER, PATHS, iterations=8)
    assert problem.objective(reached, PATHS) == pytest.approx(problem.objective(best, PATHS), abs=0.5)


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


def test_a_channel_is_no_better_than_the_steps_of_its_readings():
    """Steps of 0.05 rad/s round most yaw rates to zero, so that the noise looks smaller than the rounding error."""
    log = glider_log(3, push=0.0)
    log = log.with_channels({"r_radps": 0.05 * np.round(log["r_radps"] / 0.05)})
    problem = PredictionErrors(GLIDER, log, whole(log))
    noise = problem.noise_at(problem.solve(GLIDER, PATHS)).measurement
    assert noise["r_radps"] == pytest.approx(0.05 / np.sqrt(12.0))
    assert noise["heading_rad"] == pytest.approx(SENSORS["heading_rad"], rel=0.3)


def test_readings_without_noise_are_given_some():
    """They get 3 % of the noise by second differences, or a fit would depend on rounding errors of the simulation."""
    truth = glider_log(3, push=0.0)
    record = Record.from_arrays(truth.time, {n: truth[n] for n in ("rudder_rad", "u_mps")})
    log = simulate(GLIDER, record.with_channels({n: truth[n] for n in SENSORS}))
    problem = PredictionErrors(GLIDER, log, whole(log))
    noise = problem.noise_at(problem.solve(GLIDER, PATHS)).measurement
    assert np.array([*noise.values()]) == pytest.approx(0.03 * problem.floors)


def test_an_acceleration_acts_on_a_velocity_that_decays_as_it_does_in_fine_steps():
    problem = PredictionErrors(GLIDER, glider_log(3), [slice(0, 100)])
    (state, before, after, _), dt = problem.kicks[0], GLIDER.dt
    at, fine = int(state), replace(GLIDER, dt=dt / 200.0)
    inputs = np.zeros(len(GLIDER.inputs))
    inputs[GLIDER.inputs.index("u_mps")] = 0.5

    def moved(plant: Plant, steps: int, first: float, last: float) -> np.ndarray:
        x = plant.initial(np.array([0.0, 0.0, 0.0, 0.0]))
        for _ in range(steps):
            x[at] += first * plant.dt * 1e-3
            x = plant.step(x, inputs)
            x[at] += last * plant.dt * 1e-3
        return x[:2]  # heading and yaw rate

    # a tenth: the decay is that of the median speed, and the heading lags behind the rate
    assert moved(GLIDER, 1, before, after) == pytest.approx(moved(fine, 200, 0.5, 0.5), rel=0.1)


def test_an_acceleration_is_found_beside_motions_of_the_water_that_are_not_there():
    plant = load_vehicle("slocum")
    glide = run_mission(plant, np.random.default_rng(5), duration=900.0)
    slow = np.convolve(np.random.default_rng(5).standard_normal(len(glide) + 20), np.ones(20) / 20.0, mode="valid")
    log = glide.with_channels({"heading_rad": glide["heading_rad"] + 0.1 * slow[: len(glide)]})
    problem = PredictionErrors(plant, log, whole(log))
    assert {"r_radps", "north_m", "east_m"} <= set(problem.pushed)
    assert "r_radps" in problem.noise_at(problem.solve(plant, ())).process


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


def test_windows_that_touch_are_one_stretch_and_without_process_noise_each_is_its_own(pushed):
    windows = [slice(0, 100), slice(100, 250), slice(300, 400)]
    assert PredictionErrors(GLIDER, pushed, windows).stretches == [slice(0, 250), slice(300, 400)]
    assert PredictionErrors(GLIDER, pushed, windows, process=False).stretches == windows


def test_a_plant_that_runs_away_is_refused_in_words(pushed):
    wild = replace_at(GLIDER, "effects.discovered.yaw.r_r", 1e9)
    with pytest.raises(ValueError, match=r"not finite from one sample .* to the next"):
        PredictionErrors(wild, pushed, whole(pushed)).solve(wild, ())


def test_a_profile_of_a_smooth_parameter_is_its_interval_and_ends_at_a_bound(pushed):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    point = problem.solve(GLIDER, PATHS)
    told = information_of(problem, point, PATHS)
    k = PATHS.index(OFFSET)
    error = float(np.sqrt(told.covariance[k, k])) * problem.scale(OFFSET)
    value = point.vector[problem.index[OFFSET]]
    low, high = profile_interval(problem, point, PATHS, OFFSET, error, 1.96, None)
    assert low == pytest.approx(value - 1.96 * error, abs=0.4 * error)  # noises are held; scores may correlate
    assert high == pytest.approx(value + 1.96 * error, abs=0.4 * error)
    lag = "effects.rudder.lag"
    beside = problem.solve(replace_at(GLIDER, lag, 0.05), (*PATHS, lag))
    low, high = profile_interval(problem, beside, (*PATHS, lag), lag, 0.05, 1.96, None)
    assert low == 0.0  # a lag is not negative
    assert 0.0 < high < 2.0


def test_a_profile_leaves_a_range_in_which_nothing_changes():
    """Without any travel left, a further loss changes nothing: there is no slope, and yet a smallest size."""
    lost = "effects.rudder.lost_travel"
    stop = GLIDER.hull.rudder_limit
    log = run_mission(replace_at(GLIDER, lost, 1.0), np.random.default_rng(1), duration=600.0)
    problem = PredictionErrors(GLIDER, log, whole(log))
    point = problem.solve(replace_at(GLIDER, lost, 0.9), (lost,))
    low, high = profile_interval(problem, point, (lost,), lost, 0.0, 1.96, None)
    assert low == pytest.approx(stop, rel=0.1)
    assert high == 1.0


def test_a_profile_follows_what_makes_up_for_its_parameter(pushed, monkeypatch):
    """If a fit from far away finds nothing better, the first-order way gives the right width, else far too small."""
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    point = problem.solve(GLIDER, PATHS)
    told = information_of(problem, point, PATHS)
    covariance = np.linalg.inv(told.alone)
    k = PATHS.index("hull.n_r")  # compensated by the rudder effectiveness
    error, alone = (float(v**0.5) * problem.scale(PATHS[k]) for v in (covariance[k, k], 1.0 / told.alone[k, k]))
    assert error > 1.5 * alone
    monkeypatch.setattr(problem, "descended", lambda here, *rest: here)
    way = covariance[:, k] / covariance[k, k]
    for given, half in ((way, 1.96 * error), (None, 1.96 * alone)):
        low, high = profile_interval(problem, point, PATHS, PATHS[k], error, 1.96, given)
        assert high - low == pytest.approx(2.0 * half, rel=0.2)


def test_weaker_accelerations_are_tried_only_where_the_filter_keeps_to_the_record(pushed, monkeypatch):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    point, own = problem.solve(GLIDER, PATHS), problem.point
    assert problem.quieted(point) is not None
    lost = 2.0  # log-likelihood of each row
    monkeypatch.setattr(
        problem, "point", lambda *which: replace(there := own(*which), scores=there.scores - lost), raising=True
    )
    assert problem.quieted(point) is None
    assert problem._quieter(point, PATHS) is point


def test_accelerations_that_suit_a_record_are_not_tried_at_other_strengths(pushed, monkeypatch):
    """A small negative slope at a nearly likeliest strength is no reason to try far weaker ones."""
    problem, asked = PredictionErrors(GLIDER, pushed, whole(pushed)), []
    point = problem.solve(GLIDER, PATHS)
    first, pushes = len(problem.channels), len(problem.pushed)
    strong = point.logs.copy()
    strong[first : first + pushes] += 2.0
    tried = problem._likeliest
    monkeypatch.setattr(problem, "_likeliest", lambda *which: asked.append(which) or tried(*which))
    near = point.logs.copy()
    near[first : first + pushes] += 0.01
    assert -2.0 < problem.noise_slopes(point, near)[1][first] < 0.0
    problem.better_noise(problem.with_noise(point, near), NOISE_STEPS)
    assert not asked
    problem.better_noise(problem.with_noise(point, strong), NOISE_STEPS)
    assert asked


def test_a_push_that_lasts_is_tried_as_a_brief_one_which_cannot_take_a_steady_effects_part(monkeypatch):
    """This glider has no process noise, but a rudder offset: without the offset, a lasting acceleration is found."""
    log = glider_log(0, push=0.0)
    problem = PredictionErrors(GLIDER, log, whole(log))
    lasting = problem.solve(GLIDER, COEFFICIENTS)
    assert problem.lasting(lasting).all()
    brief = problem.hurried(lasting)
    assert brief is not None
    assert brief.logs[-1] == problem.slowness[2]
    assert problem.hurried(brief) is None  # no acceleration lasts any more
    monkeypatch.setattr(problem, "quieted", lambda here: None)
    assert problem._quieter(lasting, PATHS) is lasting  # 1.8 less likely in each row
    monkeypatch.setattr(prediction_errors, "FAR", 2.0)
    there = problem._quieter(lasting, PATHS)
    assert problem.objective(there, PATHS) > problem.objective(lasting, PATHS) + 5.0
    monkeypatch.setattr(problem, "hurried", lambda here: None)
    assert problem._quieter(lasting, PATHS) is lasting


def test_some_accelerations_alone_are_taken_for_weaker(pushed):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    point = problem.solve(GLIDER, PATHS)
    same = problem.quieted(point, np.zeros(len(problem.pushed), dtype=bool))
    weaker = problem.quieted(point)
    assert same is not None
    assert weaker is not None
    assert np.array_equal(same.logs, point.logs)
    assert weaker.logs[len(problem.channels)] < point.logs[len(problem.channels)] - 1.0


def test_better_noises_are_not_sought_where_weaker_accelerations_leave_rows_far_less_likely(pushed, monkeypatch):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    point = problem.solve(GLIDER, PATHS)
    asked = []
    monkeypatch.setattr(problem, "renewed", lambda there, *_: asked.append(there) or there)
    for lost, times in ((2.0, 0), (0.5, 1)):
        monkeypatch.setattr(
            problem, "descended", lambda here, *_, lost=lost: replace(here, scores=point.scores - lost), raising=True
        )
        problem._quieter(point, PATHS)
        assert len(asked) == times


def test_a_fit_that_runs_out_of_turns_leaves_out_what_is_likelier_absent(pushed, monkeypatch):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    kept = problem.solve(GLIDER, PATHS)
    monkeypatch.setattr(problem, "stilled", lambda here, paths: kept)
    assert problem.solve(GLIDER, PATHS, iterations=1) is kept


def test_a_profile_does_not_count_what_the_colour_of_errors_tells_of_coefficients():
    """Neither do estimates nor covariances: it adds no certainty to a dead time that coefficients almost imitate."""
    time = "effects.rudder.dead_time"
    log = glider_log(3, **{time: 0.3})
    problem, paths = PredictionErrors(GLIDER, log, whole(log)), (*COEFFICIENTS, time)
    point = problem.solve(replace_at(GLIDER, time, 0.3), paths)
    told = information_of(problem, point, paths)
    error = float(np.linalg.inv(told.alone)[2, 2] ** 0.5) * problem.scale(time)
    low, high = profile_interval(problem, point, paths, time, error, 1.96, None)
    assert high - low == pytest.approx(2.0 * 1.96 * error, rel=0.15)  # a dead time is not quite linear


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


def test_how_well_starts_are_known_follows_the_noises(pushed):
    """A filter with weak accelerations is equally likely, found from one with stronger ones or from the readings."""
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    near = problem.solve(GLIDER, ())
    logs = near.logs.copy()
    logs[len(problem.channels) : len(problem.channels) + len(problem.pushed)] -= np.log(30.0)
    there, afresh = problem.point(GLIDER.vector, logs, near), problem.point(GLIDER.vector, logs)
    assert problem.total(there) == pytest.approx(problem.total(afresh), abs=0.01)


def test_a_fit_is_tried_with_weak_accelerations_where_strong_ones_took_the_part_of_an_effect():
    """The dead time is 4 s; at the start, 0.1 s, its slope has the wrong sign while accelerations are strong."""
    path, log = "effects.rudder.dead_time", glider_log(0, 0.0005, **{OFFSET: 0.0, "effects.rudder.dead_time": 4.0})
    problem = PredictionErrors(GLIDER, log, whole(log))
    without = problem.solve(GLIDER, COEFFICIENTS)
    plant = replace_at(problem.plant_at(without, COEFFICIENTS), path, 0.1)
    found = problem.plant_at(problem.solve(plant, (*COEFFICIENTS, path), without), (path,))
    assert value_at(found, path) == pytest.approx(4.0, abs=0.2)


def test_a_fit_begins_with_a_first_guess_of_noises_where_the_vehicle_runs_away_with_those_near_by(monkeypatch):
    problem = PredictionErrors(GLIDER, glider_log(3), [slice(0, 500)])
    near, own = problem.solve(GLIDER, ()), problem.point

    def point(vector, logs, near=None):
        lost = near is not None and np.array_equal(logs, near.logs)
        return problem._nowhere(vector, logs) if lost else own(vector, logs, near)

    monkeypatch.setattr(problem, "point", point)
    begun = problem._begun(replace_at(GLIDER, OFFSET, 0.02).vector, near)
    assert begun.system is not None
    assert np.array_equal(begun.logs, problem.first_noise())


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


def test_noises_that_hardly_change_keep_the_linearisation(pushed, monkeypatch):
    problem = PredictionErrors(GLIDER, pushed, whole(pushed))
    near, points, own = problem.solve(GLIDER, PATHS), [], problem.point
    monkeypatch.setattr(problem, "point", lambda *args: points.append(args) or own(*args))
    found, _ = problem._renewed(problem.with_noise(near, near.logs - 0.4), PATHS, NOISE_STEPS)
    assert not points
    assert problem.objective(found, PATHS) == pytest.approx(problem.objective(near, PATHS), abs=0.05)
    problem._renewed(problem.with_noise(near, near.logs - 2.0), PATHS, NOISE_STEPS)
    assert len(points) == 1


@pytest.mark.parametrize("peak", [0.01, 0.1, 1.0])
def test_the_likeliest_strength_is_found_without_trying_all(peak, monkeypatch):
    """The strength is tried at seven powers of ten, and none at all."""
    problem = PredictionErrors(GLIDER, log := glider_log(0), whole(log))
    tried, first, logs = [], len(problem.channels), problem.first_noise()
    unit = problem.unit[0]

    def likelihood(system, logs):
        tried.append(logs[first])
        return -abs(logs[first] - np.log(peak * unit))

    monkeypatch.setattr(problem, "likelihood_of_noises", likelihood)
    found = problem._likeliest(problem._first_system, problem._without(logs, [0]), [0], problem._guesses)
    assert np.exp(found[first]) == pytest.approx(peak * unit)
    assert len(tried) <= 7  # with the noises as they were
