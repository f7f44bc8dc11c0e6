"""Tests of a vehicle's extended Kalman filter against an independent one, its linearisation, and other starts."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.model import inputs_of
from auv_gym.param import replace_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from identification.fit.changing import ChangingPlant, Course, change
from identification.fit.kalman import run_filter
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.strides import stride_for

SENSORS = {"heading_rad": 0.01, "r_radps": 0.003, "u_mps": 0.01, "roll_rad": 0.01, "pitch_rad": 0.01, "depth_m": 0.03}
DRAG, NONE = "hull.surge.u_u", -50.0  # the logarithm of a negligible acceleration


def torpedo_log(rows: int, seed: int = 0, dt: float = 0.1) -> Record:
    """A torpedo under steps of its fins and its propeller."""
    plant, rng = replace(load_vehicle("remus100"), dt=dt), np.random.default_rng(seed)
    inputs = np.zeros((rows, len(plant.inputs)))
    for j, name in enumerate(plant.inputs):
        scale = plant.constants.get(name, 0.0)
        held = np.repeat(rng.uniform(-1.0, 1.0, rows // 20 + 1), 20)[:rows]
        inputs[:, j] = scale * (1.0 + 0.3 * held) if scale else 0.15 * held
    start, readings = np.full(len(plant.outputs), np.nan), []
    start[plant.outputs.index("u_mps")] = 1.5
    x = plant.initial(start)
    for u in inputs:
        readings.append(plant.output(x))
        x = plant.step(x, u)
    y = np.array(readings)
    channels = {n: y[:, plant.outputs.index(n)] + s * rng.standard_normal(rows) for n, s in SENSORS.items()}
    channels |= {n: inputs[:, j] for j, n in enumerate(plant.inputs)}
    return Record.from_arrays(dt * np.arange(rows), channels)


def problem_of(plant: Plant, log: Record, stride: int = 1) -> tuple[PredictionErrors, np.ndarray]:
    """The filter of a log, and noises: first guesses for the channels, and no accelerations."""
    rows = len(log) // stride * stride
    problem = PredictionErrors(plant, log, [slice(0, rows)], stride=stride)
    logs = problem.first_noise()
    logs[len(problem.channels) : len(problem.channels) + len(problem.pushed)] = NONE
    return problem, logs


def by_covariances(plant: Plant, log: Record, problem: PredictionErrors, logs: np.ndarray) -> np.ndarray:
    """Scores by a short reference filter with covariances instead of roots, joint readings, and no accelerations."""
    live, count = problem.live, len(problem.channels)
    assert (live < len(plant.family.states)).all()
    noise, probes, columns = np.diag(np.exp(2.0 * logs[:count])), problem._probes(live), problem.columns
    covariance = problem.widest[0].T @ problem.widest[0]
    inputs, scores = inputs_of(plant, log), []
    x = plant.settled(problem.starts[0, : len(plant.family.states)], inputs[0])
    for k, u in enumerate(inputs):
        nudged = x + np.eye(x.size)[live] * probes[:, None]
        c = np.array([plant.output(z) - plant.output(x) for z in nudged]).T[columns] / probes
        spread = c @ covariance @ c.T + noise
        error = problem.measured[k] - plant.output(x)[columns]
        scores.append(-0.5 * (error @ np.linalg.solve(spread, error) + np.linalg.slogdet(2.0 * np.pi * spread)[1]))
        gain = covariance @ c.T @ np.linalg.inv(spread)
        x = x.copy()
        x[live] += gain @ error
        covariance = covariance - gain @ c @ covariance
        nudged, onward = x + np.eye(x.size)[live] * probes[:, None], plant.step(x, u)
        a = np.array([plant.step(z, u) - onward for z in nudged]).T[live] / probes
        x, covariance = onward, a @ covariance @ a.T
    return np.array(scores)


def filtered(problem: PredictionErrors, vector: np.ndarray, logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Scores of the rows by the filter linearised along its path, and by the vehicle run with its gains."""
    numbers = problem._numbers(logs)
    system = problem._followed_system(vector, numbers, problem.starts, problem.widest)
    made = run_filter(system, *numbers)
    run = problem._followed(vector, logs, problem.starts, made.gains, made.whiten, system)
    return made.scores, run.scores


def test_it_is_an_extended_kalman_filter():
    plant, log = replace(replace_at(load_vehicle("remus100"), DRAG, -2.5), dt=0.1), torpedo_log(80)
    problem, logs = problem_of(plant, log)
    assert filtered(problem, plant.vector, logs)[0] == pytest.approx(
        by_covariances(plant, log, problem, logs), abs=1e-5
    )


@pytest.mark.parametrize("stride", [1, 3])
def test_a_filter_far_from_its_record_is_as_likely_as_its_linearisation(stride):
    """It is linearised along the filter's own path; for rows of several samples, along that before their readings."""
    plant, log = replace(load_vehicle("remus100"), dt=0.1), torpedo_log(300)
    problem, logs = problem_of(plant, log, stride)
    near, (linear, run) = (filtered(problem, replace_at(plant, DRAG, d).vector, logs) for d in (-1.62, -2.5))
    assert run.sum() < near[1].sum() - 300.0  # it is far from the record
    assert linear == pytest.approx(run, abs=1e-3 * np.abs(run).max())


@pytest.mark.parametrize("readings", [0, 3], ids=["accelerations", "readings"])
@pytest.mark.parametrize("stride", [1, 3])
def test_a_filter_in_a_swell_is_as_likely_as_its_linearisation(stride, readings):
    """The vehicle run with the filter's gains and rotating pairs of accelerations equals the linear system.

    The same holds for sensor errors of this kind.
    """
    plant, log = replace(load_vehicle("remus100"), dt=0.1), torpedo_log(300)
    problem, _ = problem_of(plant, log, stride)
    problem = problem.with_noises([] if readings else problem.velocities, range(readings), 3.0)
    logs, count = problem.first_noise(), len(problem.channels)
    logs[count : count + len(problem.pushed)] = np.log(np.where(problem.swells, 0.03, 0.01) * problem.unit)
    logs[count + len(problem.pushed) :] = np.log(np.where(problem.swells, 6.0, 10.0))
    linear, run = filtered(problem, plant.vector, logs)
    assert linear == pytest.approx(run, abs=1e-3 * np.abs(run).max())
    still = replace(problem._followed_system(plant.vector, problem._numbers(logs), problem.starts, problem.widest))
    fading = run_filter(replace(still, turns=None), *problem._numbers(logs)).scores
    assert np.abs(linear - fading).max() > 0.1  # the rotation makes a difference


@pytest.mark.slow
def test_it_is_the_same_from_anywhere():
    """This holds once the starts have converged, at suitable noises; an unstable vehicle needs a few passes."""
    plant, log = replace(load_vehicle("remus100"), dt=0.1), torpedo_log(300)
    problem, _ = problem_of(plant, log, 3)
    here, totals = problem.solve(plant, ()), []
    for drag in (-1.2, -1.62, -2.5):
        point = problem.point(replace_at(plant, DRAG, drag).vector, here.logs, here)
        for _ in range(6):
            point = problem.point(plant.vector, here.logs, point)
        totals.append(problem.total(point))
    assert totals == pytest.approx([totals[0]] * 3, abs=0.3)


def test_a_change_along_the_record_is_followed():
    """Before the change the vehicle is the original one; with a change at the first row, it is the other one."""
    plant, log = replace(load_vehicle("remus100"), dt=0.1), torpedo_log(300)
    other, size = replace_at(plant, DRAG, -2.5), -2.5 - plant.parameters.hull.surge.u_u
    problem, logs = problem_of(plant, log)
    before, after = (filtered(problem, p.vector, logs)[1] for p in (plant, other))
    for edge in (0, 150):
        changing = ChangingPlant.of(plant, {"later": [DRAG]}, {"later": Course((edge,), (0.0, 1.0))})
        own = problem_of(changing, log)[0]
        linear, run = filtered(own, replace_at(changing, change("later", DRAG), size).vector, logs)
        assert run[:edge] == pytest.approx(before[:edge], abs=1e-6)
        assert (edge > 0) != (run == pytest.approx(after, abs=1e-6))
        assert linear == pytest.approx(run, abs=1e-3 * np.abs(run).max())


@pytest.mark.slow
def test_rows_are_so_short_that_the_filter_of_a_vehicle_far_from_its_record_keeps_to_its_linearisation(monkeypatch):
    plant, log = replace(load_vehicle("remus100"), dt=0.1), torpedo_log(1600)
    windows, paths = [slice(0, len(log))], [DRAG]
    assert stride_for(plant, log, windows, paths) == 3
    asked = []
    monkeypatch.setattr(PredictionErrors, "follows", lambda self, logs: asked.append(self.stride))
    assert stride_for(plant, log, windows, paths) == 1
    assert asked
