"""Tests of estimated noises: sensors, random accelerations, those that are absent, weaker or brief."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.model import simulate
from auv_gym.param import replace_at, value_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from identification.deciding import COST, LEAST_PROCESS
from identification.experiments.missions import run_mission
from identification.fit import prediction_errors
from identification.fit.noises import Noise
from identification.fit.prediction_errors import NOISE_STEPS, PredictionErrors
from tests.identification.fit.glider_logs import COEFFICIENTS, GLIDER, OFFSET, PATHS, SENSORS, glider_log, whole


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


def test_readings_of_many_short_stretches_keep_their_noise():
    """The likeliest start meets the first readings of a stretch exactly, which is no evidence of their precision."""
    record = glider_log(40)
    problem = PredictionErrors(GLIDER, record, [slice(k, k + 8) for k in range(0, len(record) - 8, 9)])
    noise = problem.noise_at(problem.solve(GLIDER, PATHS)).measurement
    assert noise == pytest.approx(SENSORS, rel=0.2)


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


def test_water_that_carries_a_float_up_and_down_is_found_as_such():
    """It moves the float at once, and its acceleration, which drag soon ends, would have to be far stronger."""
    plant, rate, tau = load_vehicle("qiandao_float"), 0.01, 30.0
    log = run_mission(plant, np.random.default_rng(3), duration=240.0)
    rng, decay, water = np.random.default_rng(4), np.exp(-log.sample_interval / tau), np.zeros(len(log))
    for k in range(1, len(log)):
        water[k] = decay * water[k - 1] + rate * np.sqrt(1.0 - decay**2) * rng.standard_normal()
    carried = log.with_channels({"depth_m": log["depth_m"] + log.sample_interval * np.cumsum(water)})
    problem = PredictionErrors(plant, carried, whole(carried))
    found = problem.noise_at(problem.solve(plant, plant.family.coefficients)).process
    assert rate / 1.6 < found["depth_m"][0] < 1.6 * rate
    assert 10.0 < found["depth_m"][1] < 90.0
