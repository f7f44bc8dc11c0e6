"""Tests of readings averaged over rows of samples: exact model means, and hardly any loss of information."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import Correction, Plant, Runs, load_vehicle
from auv_gym.records.record import Record
from identification.fit import strides
from identification.fit.averaging import Averages
from identification.fit.followed import Point
from identification.fit.intervals import information_of
from identification.fit.kalman import start_slopes
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.strides import _longest, stride_for
from identification.fit.validation import whiteness

DT = 0.1  # s
GLIDER = replace(load_vehicle("slocum"), dt=DT, window=60.0)
SENSORS = {"heading_rad": 0.01, "r_radps": 0.003}
OFFSET, LAG, COEFFICIENTS = "effects.rudder.offset", "effects.rudder.lag", ("hull.n_r", "hull.n_delta")
PATHS = (*COEFFICIENTS, OFFSET)


def dense_log(seed: int, rows: int = 6000, push: float = 0.0, noise: float = 1.0, **changes: float) -> Record:
    """A glider logged at 10 Hz under a rudder that steps every other second."""
    plant: Plant = replace_at(GLIDER, {OFFSET: 0.03} | changes)
    rng, hold = np.random.default_rng(seed), 17
    inputs = np.zeros((rows, len(plant.inputs)))
    inputs[:, 0] = np.repeat(rng.uniform(-0.3, 0.3, rows // hold + 1), hold)[:rows]
    inputs[:, plant.inputs.index("u_mps")] = 0.5 + 0.1 * np.sin(np.arange(rows) / 200.0)
    names = ("rudder_rad", "u_mps")
    commands = {n: inputs[:, plant.inputs.index(n)] for n in names}
    record = Record.from_arrays(DT * np.arange(rows), commands)
    y = plant.run(record, record.segments, np.zeros((1, len(plant.family.states))))
    if push:
        at, x = plant.family.states.index("r_radps"), plant.initial(np.full(len(plant.outputs), np.nan))
        pushed, decay = push * rng.standard_normal(), np.exp(-DT / 15.0)
        for k, u in enumerate(inputs):
            y[k] = plant.output(x)
            x[at] += 0.5 * DT * pushed
            x = plant.step(x, u)
            x[at] += 0.5 * DT * pushed
            pushed = decay * pushed + push * np.sqrt(1.0 - decay**2) * rng.standard_normal()
    read = {n: y[:, plant.outputs.index(n)] + noise * s * rng.standard_normal(rows) for n, s in SENSORS.items()}
    return record.with_channels(read)


def whole(record: Record) -> list[slice]:
    return [slice(0, len(record))]


@pytest.fixture(scope="module")
def pushed() -> Record:
    return dense_log(1, push=2e-4)


def solved(record: Record, stride: int) -> tuple[PredictionErrors, Point]:
    problem = PredictionErrors(GLIDER, record, whole(record), stride=stride)
    return problem, problem.solve(GLIDER, PATHS)


def errors_of(problem: PredictionErrors, point: Point) -> np.ndarray:
    return np.sqrt(np.diag(information_of(problem, point, PATHS).covariance))


def test_rows_are_whole_and_means_are_of_the_readings_that_there_are():
    values = np.arange(24.0).reshape(12, 2)
    values[3, 0] = np.nan
    time = 0.5 * np.arange(12)
    record = Record.from_arrays(time, {"heading_rad": values[:, 0], "r_radps": values[:, 1]})
    record = record.with_intervals({"r_radps": 2.5})  # one reading in five samples
    found = Averages.of(record, ("heading_rad", "r_radps"), values, [slice(1, 12)], 3)
    assert found.stretches == (slice(1, 10),)
    assert found.rows.tolist() == [1, 4, 7]
    assert found.samples.tolist() == list(range(1, 10))
    assert found.values[:, 0].tolist() == [3.0, 10.0, 16.0]
    assert found.counts[:, 0].tolist() == [2.0, 3.0, 3.0]
    rare = np.flatnonzero(record.readings("r_radps"))
    kept = [k for k in rare if 1 <= k < 10]
    assert found.values[np.isfinite(found.values[:, 1]), 1].tolist() == [values[k, 1] for k in kept]
    assert found.shares[kept, 1].tolist() == [1.0] * len(kept)
    assert found.shares[3, 0] == found.shares[0, 0] == found.shares[10, 0] == 0.0
    assert found.away.tolist() == [0.5] * 3


@pytest.mark.parametrize("stride", [1, 3])
def test_what_a_blank_cell_was_filled_with_is_no_reading(stride):
    """A sensor of half the rate leaves blanks in a table; interpolated values in them are no readings."""
    time = 0.5 * np.arange(12)
    blank = np.where(np.arange(12) % 2, np.nan, np.arange(12.0) ** 2)
    record = Record.from_arrays(time, {"heading_rad": 0.1 * time, "r_radps": blank[:11].tolist() + [121.0]})
    values = record.matrix(("heading_rad", "r_radps"))
    assert values[3, 1] == 10.0  # between 4 and 16
    found = Averages.of(record, ("heading_rad", "r_radps"), values, [slice(0, 12)], stride)
    held = np.isfinite([*blank[:11], 121.0]).reshape(-1, stride)
    assert found.counts[:, 1].tolist() == np.maximum(held.sum(axis=1), 1).tolist()
    assert np.isfinite(found.values[:, 1]).tolist() == held.any(axis=1).tolist()
    assert found.values[0, 1] == (0.0 if stride == 1 else 2.0)  # the mean of 0 and 4, without 1


def test_single_samples_are_read_as_they_are():
    record = dense_log(0, 50)
    values = np.stack([record["heading_rad"], record["r_radps"]], axis=1)
    found = Averages.of(record, ("heading_rad", "r_radps"), values, whole(record), 1)
    assert np.array_equal(found.values, values)
    assert np.all(found.counts == 1.0)
    assert found.shares.shape == (0, 2)


@pytest.mark.parametrize("stride", [2, 5, 7])
def test_a_row_has_the_mean_of_the_outputs_at_its_samples(stride):
    """This is exact for any commands within the row, and up to the end of each segment."""
    plant = replace_at(GLIDER, {LAG: 0.25, "effects.rudder.dead_time": 0.13})
    rng, rows = np.random.default_rng(3), 8 * stride
    channels = {"rudder_rad": rng.uniform(-0.3, 0.3, 2 * rows), "u_mps": np.full(2 * rows, 0.5)}
    record = Record.from_arrays(DT * np.arange(2 * rows), channels, segment=np.repeat([0, 1], rows))
    shares = np.full((2 * rows, len(plant.outputs)), 1.0 / stride)
    starts = np.zeros((1, 2, len(plant.family.states) + len(plant.family.sensors)))
    starts[:, :, 0] = 0.02

    def run(runs: Runs) -> np.ndarray:
        return plant.follow_many(runs, plant.vector[None], starts, Correction.none(plant, runs), False)[0][0]

    single = run(Runs.over(plant, record, record.segments))
    means = run(Runs.over(plant, record, record.segments, stride=stride, shares=shares))
    assert means == pytest.approx(single.reshape(-1, stride, single.shape[1]).mean(axis=1), abs=1e-13)


@pytest.mark.parametrize("stride", [1, 3, 10])
def test_the_right_model_predicts_means_without_an_error(stride):
    record = dense_log(2, 600, noise=0.0)
    problem = PredictionErrors(GLIDER, record, whole(record), stride=stride)
    truth = replace_at(GLIDER, OFFSET, 0.03)
    logs = np.log(np.r_[0.01, 0.003, 1e-9 * problem.unit, np.full(len(problem.pushed), 20.0)])
    point = problem.point(truth.vector, logs)
    # the rest is due to the likeliest start; a mean of ten samples differs a hundred times more from its middle sample
    assert np.abs(point.innovations).max() < 2e-5


@pytest.mark.slow
def test_a_filter_of_means_says_the_same_as_surely(pushed):
    """With and without averages, a log gives nearly the same estimates, standard errors and noises."""
    (single, point), (means, other) = solved(pushed, 1), solved(pushed, 4)
    assert len(means.rows) == len(single.rows) // 4
    errors, scales = errors_of(single, point), np.array([single.scale(p) for p in PATHS])
    at = [single.index[p] for p in PATHS]
    assert np.all(np.abs(other.vector[at] - point.vector[at]) < 0.3 * errors * scales)
    assert errors_of(means, other) == pytest.approx(errors, rel=0.1)
    noise, there = single.noise_at(point), means.noise_at(other)
    assert there.measurement == pytest.approx(noise.measurement, rel=0.05)  # of a reading, not of a mean
    assert there.measurement == pytest.approx(SENSORS, rel=0.06)  # 1500 rows: three standard errors
    assert there.process["r_radps"] == pytest.approx(noise.process["r_radps"], rel=0.15)


def test_gains_at_the_end_of_a_row_are_those_of_the_filter(pushed):
    """The corrected vehicle moves with its starts as the linear filter does, including accelerations."""
    problem, point = solved(pushed, 5)
    linear = start_slopes(point.system, point.gains, point.whiten, np.exp(point.logs[-len(problem.pushed) :]))
    run, owners = problem._run_starts(point)
    for column, (_, state) in zip(run, owners, strict=True):
        expected = linear[list(problem.live).index(state)].ravel()
        assert np.abs(column - expected).max() < 1e-3 * np.abs(expected).max()


def test_errors_of_means_are_white_and_of_unit_variance(pushed):
    problem, point = solved(pushed, 5)
    errors = point.errors[5:]
    assert errors.std(axis=0) == pytest.approx(1.0, abs=0.08)  # 1200 rows: four standard errors
    for e in errors.T:
        assert abs(np.corrcoef(e[1:], e[:-1])[0, 1]) < 0.12


def test_a_channel_that_is_read_rarely_has_the_noise_that_it_has(pushed):
    rows = np.arange(len(pushed))
    joined = pushed.with_channels({"heading_rad": np.interp(rows, rows[::6], pushed["heading_rad"][::6])})
    problem, point = solved(joined.with_intervals({"heading_rad": 6.0 * DT}), 4)
    assert problem.noise_at(point).measurement == pytest.approx(SENSORS, rel=0.1)  # four standard errors of 1000
    counts = problem.counts[:, list(problem.channels).index("heading_rad")]
    assert np.all(counts == 1.0)


def test_a_lag_shorter_than_a_row_is_still_found():
    record = dense_log(6, noise=0.3, **{LAG: 0.3})
    problem = PredictionErrors(GLIDER, record, whole(record), stride=5)
    paths = (*PATHS, LAG)
    point = problem.solve(replace_at(GLIDER, LAG, 0.1), paths)
    error = float(np.sqrt(information_of(problem, point, paths).covariance[-1, -1])) * problem.scale(LAG)
    assert abs(point.vector[problem.index[LAG]] - 0.3) < 3.0 * error
    assert error < 0.05


def test_rows_are_as_long_as_the_slowest_loss_allows(monkeypatch):
    record = dense_log(7, 9000)
    monkeypatch.setattr(strides, "LEAST_ROWS", 300)
    monkeypatch.setattr(strides, "MOST_ROWS", 9000)
    slow = stride_for(GLIDER, record, whole(record), COEFFICIENTS)
    assert slow > 1
    quick = stride_for(GLIDER, record, whole(record), (*COEFFICIENTS, "effects.rudder.dead_time"))
    assert quick <= slow
    monkeypatch.setattr(strides, "MOST_LOST", 1e-9)
    assert stride_for(GLIDER, record, whole(record), COEFFICIENTS) == 1


@pytest.mark.slow
def test_what_is_lost_is_what_was_allowed(monkeypatch):
    record = dense_log(8, 9000)
    monkeypatch.setattr(strides, "LEAST_ROWS", 300)
    paths = (*COEFFICIENTS, OFFSET, "effects.rudder.dead_time")
    stride = stride_for(GLIDER, record, whole(record), paths)
    single = PredictionErrors(GLIDER, record, whole(record))
    means = PredictionErrors(GLIDER, record, whole(record), stride=stride)
    point = single.solve(GLIDER, COEFFICIENTS)
    there = means.point(point.vector, point.logs)
    grown = strides._variances(means, there, paths, ()) / strides._variances(single, point, paths, ())
    assert np.all(grown < 1.0 + 1.2 * strides.MOST_LOST)  # first guesses of noises differ from the fitted ones


def test_an_effect_that_shows_plainly_may_lose_more(monkeypatch):
    record, delay = dense_log(9, 9000), ("effects.rudder.dead_time",)
    monkeypatch.setattr(strides, "LEAST_ROWS", 300)
    monkeypatch.setattr(strides, "MOST_LOST", 0.01)
    monkeypatch.setattr(strides, "MOST_OF_EFFECTS", 0.02)
    monkeypatch.setattr(strides, "_PLAIN", 1e-9)
    plain = stride_for(GLIDER, record, whole(record), (), delay)
    monkeypatch.setattr(strides, "_PLAIN", np.inf)
    sought = stride_for(GLIDER, record, whole(record), (), delay)
    assert stride_for(GLIDER, record, whole(record), delay) <= sought < plain
    monkeypatch.setattr(strides, "MOST_OF_EFFECTS", 0.5)
    assert stride_for(GLIDER, record, whole(record), (), delay) > sought


def test_short_records_and_short_windows_are_read_sample_by_sample():
    record = dense_log(7, 3000)
    assert stride_for(GLIDER, record, whole(record), COEFFICIENTS) == 1
    pieces = [slice(k, k + 20) for k in range(0, 3000, 20)]
    assert stride_for(GLIDER, record, pieces * 3, COEFFICIENTS) == 1


def test_no_record_has_more_rows_than_a_fit_could_get_through(monkeypatch):
    """The limit holds whatever longer rows lose; among rows that are long enough, the loss decides."""
    record = dense_log(7, 6000)
    monkeypatch.setattr(strides, "LEAST_ROWS", 300)
    monkeypatch.setattr(strides, "MOST_LOST", 1e-9)
    monkeypatch.setattr(strides, "MOST_ROWS", 1000)
    assert stride_for(GLIDER, record, whole(record), COEFFICIENTS) == 7  # the first stride of at least 6
    monkeypatch.setattr(strides, "MOST_ROWS", 3000)
    assert stride_for(GLIDER, record, whole(record), COEFFICIENTS) == 1
    monkeypatch.setattr(strides, "MOST_LOST", 1e9)
    assert stride_for(GLIDER, record, whole(record), COEFFICIENTS) == 20


@pytest.mark.parametrize("stride", [4, 10])
def test_what_pushes_a_vehicle_within_a_row_leaves_its_errors_white(stride):
    """The acceleration changes more between readings than their mean is noisy, so that it must act at each of them."""
    log, plant = dense_log(5, push=0.02), replace_at(GLIDER, {OFFSET: 0.03})
    problem = PredictionErrors(plant, log, whole(log), stride=stride)
    point = problem.solve(plant, ())
    for errors in point.errors.T:  # 0.17 if half of it acted before the row and half after it
        assert abs(whiteness(errors, problem.stretch_of_row).correlation[0]) < 0.06
    size, _ = problem.noise_at(point).process["r_radps"]
    assert size == pytest.approx(0.02, rel=0.1)


def test_the_longest_rows_that_lose_little_are_found_in_halves():
    for most in range(8):
        tried = []

        def suits(stride: int, most: int = most, tried: list[int] = tried) -> bool:
            tried.append(stride)
            return stride <= most

        assert _longest([2, 3, 4, 5, 6, 7], suits, 1) == (most if most > 1 else 1)
        assert len(tried) <= 3
