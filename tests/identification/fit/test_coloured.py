"""Channels whose errors are not white, and those whose errors are of rounding."""

import numpy as np
import pytest

from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.deciding import LEFT
from identification.diagnosis.log.parts import parts_of
from identification.diagnosis.search.remainder import comes_in_bursts, what_is_left
from identification.diagnosis.search.workbench import Workbench
from identification.fit.coloured import coloured_channels, is_coloured, of_rounding
from identification.fit.prediction_errors import PredictionErrors

FLOAT = load_vehicle("qiandao_float")


def fitted(log: Record, step: float = 0.0, noise: float = 1e-3):
    """The problem and the fitted point of a float's log, whose depth has little noise and is rounded to steps, m."""
    depth = log["depth_m"] + noise * np.random.default_rng(1).standard_normal(len(log))
    log = log.with_channels({"depth_m": step * np.round(depth / step) if step else depth})
    problem = PredictionErrors(FLOAT, log, [slice(0, len(log))], process=False)
    return problem, problem.solve(FLOAT, ())


@pytest.fixture(scope="module")
def log() -> Record:
    """A float that rises and sinks slowly, exactly as its model does."""
    time = np.arange(900.0)
    piston = 0.55 + 0.0015 * np.sin(2.0 * np.pi * time / 300.0)
    record = Record.from_arrays(time, {"piston_m": piston, "depth_m": 10.0 + 1e-3 * time})
    depth = FLOAT.run(record, [slice(0, 900)], np.array([[10.0, 0.0, 0.0]]))[:, FLOAT.outputs.index("depth_m")]
    return record.with_channels({"depth_m": depth})


def test_errors_of_rounding_are_no_sign_of_an_unknown_effect(log):
    problem, point = fitted(log, step=0.05)
    assert of_rounding(problem, point).tolist() == [True]
    error, stretch = point.errors[:, 0], problem.stretch_of_row
    assert is_coloured(error, stretch, np.zeros((len(error), 0)), 0.005) or comes_in_bursts(error, stretch, 0.005)
    assert coloured_channels(problem, point) == ()


def test_values_between_readings_hide_no_rounding(log):
    held = np.random.default_rng(2).random(len(log)) > 0.6  # most values are interpolated, and on no step
    depth, time = 0.05 * np.round(log["depth_m"] / 0.05), log.time
    depth = np.where(held, depth, np.interp(time, time[held], depth[held]))
    sparse = log.with_channels({"depth_m": depth}).with_readings({"depth_m": held})
    problem = PredictionErrors(FLOAT, sparse, [slice(0, len(sparse))], process=False)
    assert of_rounding(problem, problem.solve(FLOAT, ())).tolist() == [True]


def test_nothing_is_left_beside_rounding(log):
    rounded = log.with_channels({"depth_m": 0.05 * np.round(log["depth_m"] / 0.05)})
    bench = Workbench(FLOAT, rounded, parts_of(FLOAT, rounded), 0.1)
    state = bench.fit(FLOAT, ())
    error, stretch = state.point.errors[:, 0], bench.problem.stretch_of_row
    assert comes_in_bursts(error, stretch, LEFT)
    assert what_is_left(bench, state).bursts == ()


def test_errors_beyond_rounding_are_tested(log):
    problem, point = fitted(log)
    assert of_rounding(problem, point).tolist() == [False]
