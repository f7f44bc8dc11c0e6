"""The longest integration steps that leave fits to a record unchanged, or make it likelier."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from identification.fit.followed import Point
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.residual import noise_floors
from identification.fit.shooting import Shooting

# in standard errors: a change d of the predictions moves no parameter by more than |d / sigma| of them (Cauchy and
# Schwarz), where sigma is the fit's estimate of the errors, or before a fit its first guess
MOST_MOVED, _MOST_BEFORE = 0.1, 0.3
_PARTS = (1, 2, 4, 8)  # of a sample
_WORTH = 2.0  # least factor for longer steps: shorter ones save less than a fit that has to be repeated costs
_FINER = (2, 4)  # of the vehicle's own step
_LIKELIER = 2.0  # log-likelihood that finer steps must gain: they cost time, and no effect is named for less


def brisk(problem: PredictionErrors) -> PredictionErrors:
    """The problem with the longest step, up to a sample, that hardly moves a filter; unchanged if little is saved."""
    steps = [problem.record.sample_interval / parts for parts in _PARTS]
    # sample intervals are not equal to the last digit
    longer = [step for step in steps if step >= 0.99 * _WORTH * problem.plant.longest_step]
    if not longer:
        return problem
    point = problem.first_point()
    if not problem.keeps_to_readings(point):  # a vehicle far from its readings is sensitive to the steps
        faster = in_steps(problem, longer[-1])
        point = faster.renewed(faster.first_point(), faster.first_noise(), ())
    if not np.isfinite(point.scores).all():
        return problem
    for step in longer:
        faster = in_steps(problem, step)
        if moved_by_steps(faster, problem, point) < _MOST_BEFORE:  # False where a run is not finite
            return faster
    return problem


def suited(given: PredictionErrors, problem: PredictionErrors, point: Point, paths: Sequence[str]) -> PredictionErrors:
    """A problem with the longest steps, its own or shorter ones, that hardly move the filter of a fitted point.

    given: the problem in the vehicle's own steps.  The result of a fit may be more precise than the first guess of its
    noises suggests: if hardly anything pushes the vehicle, its filter follows the model and not the readings, and the
    integration errors accumulate.  Steps finer than the vehicle's own are taken if the record is likelier with them:
    the sea takes none, but a simulated record may have the errors of the vehicle's own.
    """
    if problem.plant.longest_step < given.plant.longest_step:
        return problem
    finer = _finer(given, point, paths)
    if finer is not given or problem.plant.longest_step == given.plant.longest_step:
        return finer
    shorter = (problem.record.sample_interval / parts for parts in _PARTS)
    tried = (in_steps(given, s) for s in shorter if given.plant.longest_step < s < 0.99 * problem.plant.longest_step)
    # False where a run is not finite
    return next((one for one in (problem, *tried) if moved_by_steps(one, given, point) < MOST_MOVED), given)


def _finer(given: PredictionErrors, point: Point, paths: Sequence[str]) -> PredictionErrors:
    """The problem in a half or a quarter of its steps if the record is likelier so, else itself."""
    half, quarter = (in_steps(given, given.plant.longest_step / parts) for parts in _FINER)
    if not moved_by_steps(given, quarter, point) >= MOST_MOVED:  # hardly, or a run is not finite
        return given
    finer = half if moved_by_steps(half, quarter, point) < MOST_MOVED else quarter
    own, other = (
        problem.objective(problem.descended(problem.with_gains(point, point.vector), paths), paths)
        for problem in (given, finer)
    )
    return finer if other - own > _LIKELIER else given


def in_steps(problem: PredictionErrors, longest: float) -> PredictionErrors:
    """The problem with its plant integrated in steps of at most `longest` seconds."""
    other = copy(problem)
    other.plant = replace(problem.plant, longest_step=longest)
    return other


def moved_by_steps(one: PredictionErrors, other: PredictionErrors, point: Point) -> float:
    """A bound on the change of a point, in standard errors, from the steps of one problem to those of another."""
    errors = [problem.with_gains(point, point.vector).errors for problem in (one, other)]
    return float(np.linalg.norm(errors[0] - errors[1]))


def readings_noise(problem: Shooting) -> np.ndarray:
    """Standard deviation of each channel's readings about a smooth curve, shape (C,)."""
    rows = np.concatenate([np.arange(w.start, w.stop) for w in problem.windows])
    held = np.stack([problem.record.readings(name)[rows] for name in problem.channels], axis=1)
    return noise_floors(problem.signals, problem.window_of_row, held, problem.record.time[rows])
