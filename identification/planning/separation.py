"""The evidence by which an experiment would tell two explanations apart, from simulations of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from auv_gym.channels import truth_of
from auv_gym.model import outputs_of
from auv_gym.param import replace_at, spec_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.fit.followed import Point
from identification.fit.noises import Noise
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.windows import free_run_windows

_REFITS = 3  # Gauss-Newton steps; the rivals start close to each other's data
_WORTH = 0.01  # of the remaining evidence: a step that gains less is the last


@dataclass(frozen=True, eq=False)
class Knowledge:
    """The information in a record about the fitted parameters of one explanation.

    values: (P,), of the paths.  root: (P, P), square root of the information matrix in units of the scales; its rows
    penalise departures from these values.
    """

    paths: tuple[str, ...]
    values: np.ndarray
    root: np.ndarray


def record_noise(plant: Plant, record: Record, windows: Sequence[slice]) -> Noise:
    """The noise of the sensors and the random accelerations in a record, by a plant that explains it."""
    problem = PredictionErrors(plant, record, windows)
    return problem.noise_at(problem.solve(plant, ()))


def record_knowledge(
    plant: Plant, paths: Sequence[str], record: Record, windows: Sequence[slice], noise: Noise
) -> Knowledge:
    """The information in a record about the parameters at the paths, at a plant that was fitted to it."""
    problem, point = _filtered(PredictionErrors(plant, record, windows), plant, noise)
    _, slopes = problem.own_slopes(point, paths)
    values, vectors = np.linalg.eigh(slopes @ slopes.T)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return Knowledge(tuple(paths), point.vector[[problem.index[p] for p in paths]], root)


def separation(
    records: Sequence[Record],
    truth: Plant,
    other: Plant,
    paths: Sequence[str],
    noise: Noise,
    known: Knowledge | None = None,
) -> float:
    """The evidence to be expected against `other`, refitted over the paths, in runs of `truth`.

    It is the squared mean of the prediction errors, in deviations, which `other` makes on average where those of
    `truth` are zero.
    records: of the experiment; their inputs and first states are used, and the outputs are simulated again without
    noise.  known: ties the refit to an earlier record.
    """
    problems = [_problem(record, truth, other, noise) for record in records]
    if any(problem is None for problem in problems):
        return 0.0
    tasks = [_filtered(problem, other, noise) for problem in problems if problem is not None]
    count, plant, best = len(paths), other, inf
    first = tasks[0][0]
    values: np.ndarray = np.array([other.vector[first.index[p]] for p in paths])
    scales = np.array([first.scale(p) for p in paths])
    bounds = np.array([spec_at(other, p).bounds for p in paths]).reshape(count, 2)
    for _ in range(_REFITS):
        if not all(np.isfinite(problem.total(point)) for problem, point in tasks):
            break
        told = [_told(problem, point, paths) for problem, point in tasks]
        slopes, residual = (np.concatenate(parts, axis=-1) for parts in zip(*told, strict=True))
        columns = slopes.T
        if known is not None:
            columns = np.vstack([columns, known.root])
            residual = np.r_[residual, known.root @ ((known.values - values) / scales)]
        change: np.ndarray = np.linalg.lstsq(columns, residual, rcond=1e-10)[0]
        left = float(np.sum((residual - columns @ change) ** 2))
        gained, best = best - left, min(best, left)
        if gained < _WORTH * best:
            break
        values = np.clip(values + change * scales, bounds[:, 0], bounds[:, 1])
        plant = replace_at(plant, dict(zip(paths, values.tolist(), strict=True)))
        tasks = [(problem, problem.point(plant.vector, point.logs, point)) for problem, point in tasks]
    return best if np.isfinite(best) else 0.0


def _filtered(problem: PredictionErrors, plant: Plant, noise: Noise) -> tuple[PredictionErrors, Point]:
    """The problem with all kinds of the noise, and the filter of a plant with it."""
    whole = problem.with_noises_of(noise)
    return whole, whole.point(plant.vector, whole.logs_of(noise))


def _told(problem: PredictionErrors, point: Point, paths: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Slopes by the paths, (P, rows * C), and errors, (rows * C,), both without what the starts can imitate."""
    errors = problem.without_starts(point, point.errors.reshape(1, -1))[0]
    return problem.own_slopes(point, paths)[1], errors


def _problem(record: Record, truth: Plant, other: Plant, noise: Noise) -> PredictionErrors | None:
    """The problem of `other` on noise-free outputs of `truth` under the inputs of a record."""
    names = [name for name in truth.outputs if name in noise.measurement]
    inputs = {name: record[name] for name in truth.inputs if record.has(name)}
    told = outputs_of(truth, record)
    pieces = []
    for segment in record.segments:
        start = truth.initial(told[segment.start])[: len(truth.family.states)]
        for index, state in enumerate(truth.family.states):
            if record.has(truth_of(state)):
                start[index] = record[truth_of(state)][segment.start]
        pieces.append(truth.run(record, [segment], start[None]))
    outputs = np.concatenate(pieces)
    channels = {name: outputs[:, truth.outputs.index(name)] for name in names}
    # inputs that are measured motions stay as they were recorded
    segment = record.dataset["segment"].values
    clean = Record.from_arrays(record.time, {**inputs, **channels}, segment=segment)
    longest = max(float(np.ptp(clean.time[part])) for part in clean.segments)
    windows = free_run_windows(other, clean, min(other.window, longest))
    return PredictionErrors(other, clean, windows) if windows else None
