"""The longest steps of integration that leave fits to a record as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.fit.filtering import Point
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.residual import noise_floors
from identification.fit.shooting import Shooting

# standard errors: a change d of what is predicted moves no parameter by more than |d / sigma| of them (Cauchy and
# Schwarz), sigma being what a fit says of the errors; before a fit, by free runs and the readings' noise about a smooth
# curve, a filter's errors being less than what free runs gather
MOST_MOVED, _MOST_BEFORE = 0.1, 0.3
_PARTS = (1, 2, 4, 8)  # of a sample
_WORTH = 4.0  # times longer, from which on steps save more than it may cost to find out after a fit that they were not


def brisk(plant: Plant, record: Record, windows: Sequence[slice]) -> Plant:
    """The plant with the longest step, up to a sample, that hardly moves free runs; as it is if little is saved."""
    problem = Shooting(plant, record, windows)
    noise = readings_noise(problem)
    given, starts = problem.point(plant.vector, problem.first_guess).residual, problem.first_guess
    for parts in _PARTS:
        step = record.sample_interval / parts
        if step < _WORTH * plant.longest_step:
            return plant
        faster = replace(plant, longest_step=step)
        moved = Shooting(faster, record, windows).point(plant.vector, starts).residual - given
        with np.errstate(over="ignore", invalid="ignore"):
            far = float(np.sqrt((np.where(problem.finite, moved / noise, 0.0) ** 2).sum()))
        if far < _MOST_BEFORE:  # False where a run is not finite
            return faster
    return plant


def moved_by_steps(fine: PredictionErrors, point: Point) -> float:
    """Standard errors by which a point that was found with long steps may be off, by the problem with fine ones."""
    return float(np.linalg.norm(fine.counted_errors(fine.with_gains(point, point.vector)) - fine.counted_errors(point)))


def readings_noise(problem: Shooting) -> np.ndarray:
    """Standard deviation of each channel's readings about a smooth curve, shape (C,)."""
    rows = np.concatenate([np.arange(w.start, w.stop) for w in problem.windows])
    held = np.stack([problem.record.readings(name)[rows] for name in problem.channels], axis=1)
    return noise_floors(problem.measured, problem.window_of_row, held)
