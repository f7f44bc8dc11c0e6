"""The evidence by which an experiment would tell two explanations apart, from simulations of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf

import numpy as np

from auv_gym.channels import truth_of
from auv_gym.model import outputs_of
from auv_gym.param import replace_at, spec_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.fit.colour import colour, whitened
from identification.fit.shooting import Point, Shooting
from identification.fit.windows import free_run_windows

_REFITS = 3  # Gauss-Newton steps; the rivals start close to each other's data
_WORTH = 0.01  # of the remaining evidence: a step that gains less is the last


@dataclass(frozen=True)
class Noise:
    """Noise of the sensors and the sea by channel: standard deviation, and first-order correlation at `dt`, s."""

    sigma: Mapping[str, float]
    colour: Mapping[str, float]
    dt: float


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
    """The noise of a record's channels: the residual of a plant that explains it."""
    problem = Shooting(plant, record, windows)
    point = problem.solve(plant, ())
    sigma, phi = problem.sigma(point), colour(problem, point)
    names = problem.channels
    return Noise(dict(zip(names, sigma.tolist())), dict(zip(names, phi.tolist())), record.sample_interval)


def record_knowledge(
    plant: Plant, paths: Sequence[str], record: Record, windows: Sequence[slice], noise: Noise
) -> Knowledge:
    """The information in a record about the parameters at the paths, at a plant that was fitted to it."""
    problem = Shooting(plant, record, windows)
    point = problem.solve(plant, ())
    sigma, phi = _levels(problem, noise, record.sample_interval)
    _, columns = _whitened_parts(problem, point, tuple(paths), sigma, phi)
    flat = columns.reshape(len(paths), -1)
    values, vectors = np.linalg.eigh(flat @ flat.T)
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

    records: of the experiment; their inputs and first states are used, and the outputs are simulated again without
    noise.  known: ties the refit to an earlier record.
    """
    problems = [_problem(record, truth, other, noise) for record in records]
    if any(problem is None for problem in problems):
        return 0.0
    tasks = [(p, *_levels(p, noise, p.record.sample_interval)) for p in problems if p is not None]
    points: list[Point] = [p.point(other.vector, p.first_guess) for p, _, _ in tasks]
    count, plant = len(paths), other
    best: float = inf
    values: np.ndarray = np.array([other.vector[tasks[0][0].index[p]] for p in paths])
    scales = np.array([tasks[0][0].scale(p) for p in paths])
    bounds = np.array([spec_at(other, p).bounds for p in paths]).reshape(count, 2)
    for _ in range(_REFITS):
        if not all(np.isfinite(point.cost) for point in points):
            break
        parts = [_whitened_parts(p, point, tuple(paths), s, c) for (p, s, c), point in zip(tasks, points)]
        residual: np.ndarray = np.concatenate([rest.ravel() for rest, _ in parts])
        columns: np.ndarray = np.concatenate([own.reshape(count, -1) for _, own in parts], axis=1).T
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
        points = [_restarted(p, p.point(plant.vector, point.starts), s) for (p, s, _), point in zip(tasks, points)]
    return best if np.isfinite(best) else 0.0


def _problem(record: Record, truth: Plant, other: Plant, noise: Noise) -> Shooting | None:
    """The shooting problem of `other` on noise-free outputs of `truth` under the inputs of a record."""
    names = [name for name in truth.outputs if name in noise.sigma]
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
    return Shooting(other, clean, windows) if windows else None


def _levels(problem: Shooting, noise: Noise, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations and correlations of the problem's channels at its own sample time, each (C,)."""
    sigma = np.array([noise.sigma[name] for name in problem.channels])
    phi = np.array([noise.colour[name] for name in problem.channels])
    return sigma, np.where(phi > 0.0, np.maximum(phi, 1e-9) ** (dt / noise.dt), 0.0)


def _whitened_parts(problem: Shooting, point: Point, paths: tuple[str, ...], sigma: np.ndarray, phi: np.ndarray):
    """Whitened residual (rows, C) and columns of the paths (P, rows, C), minus the part that the starts can imitate."""
    linear = problem.linearise(point, paths, sigma)
    innovation = np.sqrt(1.0 - phi**2)
    white = whitened(problem, np.concatenate([(point.residual / sigma)[None], linear.columns]), phi) / innovation
    starts = whitened(problem, linear.starts, phi) / innovation
    edges = np.r_[problem.offsets, problem.runs.rows]
    for a, b in pairwise(edges):
        basis = np.linalg.qr(_scaled(starts[:, a:b].reshape(len(starts), -1).T))[0]
        block = white[:, a:b].reshape(len(white), -1)
        white[:, a:b] = (block - (block @ basis) @ basis.T).reshape(white[:, a:b].shape)
    return white[0], white[1:]


def _scaled(columns: np.ndarray) -> np.ndarray:
    """The columns scaled to unit length; columns of length zero are dropped."""
    norms = np.linalg.norm(columns, axis=0)
    return columns[:, norms > 1e-9] / norms[norms > 1e-9]


def _restarted(problem: Shooting, point: Point, sigma: np.ndarray) -> Point:
    """The point with the starts that suit its parameters best, by one least-squares step."""
    if not np.isfinite(point.cost) or not problem.start_states.size:
        return point
    linear, starts = problem.linearise(point, (), sigma), point.starts.copy()
    edges = np.r_[problem.offsets, problem.runs.rows]
    for w, (a, b) in enumerate(pairwise(edges)):
        columns = linear.starts[:, a:b].reshape(len(linear.starts), -1).T
        wanted = np.where(problem.finite[a:b], point.residual[a:b] / sigma, 0.0).ravel()
        starts[w, problem.start_states] += np.linalg.lstsq(columns, wanted, rcond=1e-8)[0]
    moved = problem.point(point.vector, starts)
    return moved if np.isfinite(moved.cost) else point
