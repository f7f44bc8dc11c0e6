"""Grey box: physical parameters of a plant fitted to records by output error over multiple shooting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.plant.record_check import check_ranges
from auv_gym.records.record import Record, concat
from identification.estimate import Estimate, half_width
from identification.fit.likelihood import colour, covariance
from identification.fit.shooting import Shooting
from identification.fit.windows import free_run_windows

SAMPLES_PER_UNKNOWN = 2
DEPENDENT = 1e-7  # smallest eigenvalue of the scaled normal matrix at which parameters count as independent


@dataclass(frozen=True, eq=False)
class GreyBoxFit:
    """A plant with its free parameters fitted, and how sure they are.

    covariance: (P, P) in the parameters' units.  residual_rms: per channel.  colour: first-order autocorrelation of the
    residuals, per channel.  windows: slices of the fitted record, which holds all records given one after the other.
    """

    model: Plant
    estimates: tuple[Estimate, ...]
    covariance: np.ndarray
    residual_rms: dict[str, float]
    colour: dict[str, float]
    record: Record
    windows: tuple[slice, ...]
    starts: np.ndarray

    def __getitem__(self, path: str) -> Estimate:
        """The estimate of a path; raises KeyError on one that was not free."""
        return next((e for e in self.estimates if e.path == path), None) or _no_estimate(path, self.estimates)

    def simulated(self) -> np.ndarray:
        """Outputs over the fitted windows, from the fitted initial states, shape (rows, n_outputs)."""
        return self.model.run(self.record, self.windows, self.starts)


@dataclass(frozen=True)
class GreyBox:
    """Output error over multiple shooting, Levenberg-Marquardt; see `identification.fit.shooting`.

    free: parameter paths of the plant.  window: s, the length of one shooting segment, by default the vehicle's; longer
    ones weigh slow dynamics more, shorter ones bear more process noise.  Each segment has initial states of its own.
    Effects start one probe off neutral, where their derivative is defined. Intervals allow for residuals with
    first-order correlation (Ljung 1999, sec. 9.3).
    """

    plant: Plant
    free: Sequence[str]
    window: float | None = None
    max_iterations: int = 60

    def __post_init__(self):
        if not self.free:
            raise ValueError('GreyBox needs at least one free path, got none: for example free=["hull.n_r"].')
        if len(set(self.free)) != len(self.free):
            raise ValueError(f"GreyBox got a path twice in free={list(self.free)}: name each once.")
        for path in self.free:
            spec_at(self.plant, path)
        if self.window is not None and not self.window > 0.0:
            raise ValueError(f"GreyBox needs window > 0 s, got {self.window}.")

    def fit(self, *records: Record) -> GreyBoxFit:
        """Fit over all windows of all records; raises if they are too short or the run leaves the finite numbers."""
        if not records:
            raise ValueError("GreyBox.fit needs at least one record, got none.")
        record = records[0] if len(records) == 1 else concat(records)
        check_ranges(self.plant, record)
        window = self.plant.window if self.window is None else self.window
        windows = free_run_windows(self.plant, record, window)
        if not windows:
            longest = max(float(np.ptp(record.time[s])) for s in record.segments)
            raise ValueError(
                f"GreyBox needs a stretch of at least {window:g} s without a gap, got {longest:.1f} s: "
                "record longer or choose a shorter window."
            )
        problem = Shooting(self.plant, record, windows)
        unknowns = len(self.free) + problem.nuisances
        if problem.counts.sum() < SAMPLES_PER_UNKNOWN * unknowns:
            raise ValueError(
                f"GreyBox needs at least {SAMPLES_PER_UNKNOWN} samples per unknown ({unknowns} unknowns), got "
                f"{problem.counts.sum()}: record longer, choose longer windows or free fewer parameters."
            )
        # the coefficients first: from poor ones, an effect would be drawn to a far-fetched value
        paths = tuple(self.free)
        coefficients = [p for p in paths if not p.startswith("effects.")]
        plant, starts = self.plant, None
        if coefficients and len(coefficients) < len(paths):
            point = problem.solve(plant, coefficients)
            plant, starts = problem.plant_at(point, coefficients), point.starts
        point = min(
            (problem.solve(first, paths, starts, self.max_iterations) for first in self._first_plants(plant)),
            key=lambda p: p.cost,
        )
        if not np.isfinite(point.cost):
            raise ValueError(
                f"The runs of {self.plant.name!r} are not finite near its starting values: "
                "give a plant with stable coefficients."
            )
        return self._result(problem, point, paths)

    def _first_plants(self, plant: Plant) -> list[Plant]:
        effects = [p for p in self.free if p.startswith("effects.")]
        plants = []
        for side in (1.0, -1.0) if effects else (1.0,):
            values = {}
            for path in effects:
                spec, value = spec_at(plant, path), value_at(plant, path)
                moved = value + side * spec.probe if value == spec.neutral else value
                values[path] = moved if spec.bounds[0] <= moved <= spec.bounds[1] else value + spec.probe
            plants.append(replace_at(plant, values))
        return plants

    def _result(self, problem: Shooting, point, paths: tuple[str, ...]) -> GreyBoxFit:
        sigma = problem.sigma(point)
        linear = problem.linearise(point, paths, sigma)
        tint = colour(problem, point)
        matrix, freedom = covariance(problem, point, self.free, linear, tint)
        scales = np.array([problem.scale(p) for p in paths])
        problems = _problems(linear.information, linear.raw, paths)
        width = half_width(freedom)
        fitted = problem.plant_at(point, paths)
        estimates = []
        for i, path in enumerate(paths):
            value, error = value_at(fitted, path), float(np.sqrt(max(matrix[i, i], 0.0)) * scales[i])
            word = problems.get(path, "")
            half = np.inf if word else width * error
            spec = spec_at(fitted, path)
            estimates.append(
                Estimate(path, spec.unit, value, np.inf if word else error, (value - half, value + half), word)
            )
        return GreyBoxFit(
            model=fitted,
            estimates=tuple(estimates),
            covariance=matrix * np.outer(scales, scales),
            residual_rms=dict(zip(problem.channels, map(float, sigma), strict=True)),
            colour=dict(zip(problem.channels, map(float, tint), strict=True)),
            record=problem.record,
            windows=problem.windows,
            starts=point.starts,
        )


def _problems(information: np.ndarray, raw: np.ndarray, paths: Sequence[str]) -> dict[str, str]:
    """Why parameters are not determined, by path; empty if all are.

    A column without norm changes nothing that was measured. A null direction of the normal matrix, scaled by the raw
    sensitivities, is a change that the initial states or other parameters undo; its larger components are named.
    """
    found = {}
    alive = [i for i in range(len(paths)) if raw[i] > 1e-9]
    for i in range(len(paths)):
        if i not in alive:
            found[paths[i]] = f"{paths[i]} changes nothing that was measured in this record: do not free it."
    if alive:
        size = raw[alive]
        values, vectors = np.linalg.eigh(information[np.ix_(alive, alive)] / np.outer(size, size))
        for value, vector in zip(values, vectors.T, strict=True):
            if value < DEPENDENT:
                together = [paths[alive[j]] for j in np.flatnonzero(np.abs(vector) > 0.1)]
                for path in together:
                    others = [p for p in together if p != path]
                    found[path] = (
                        f"{path} cannot be told from {' and '.join(others)} in this record: fix one of them."
                        if others
                        else f"{path} cannot be told from the initial states in this record: do not free it."
                    )
    return found


def _no_estimate(path: str, estimates: Sequence[Estimate]):
    raise KeyError(f"{path} was not free; free were {', '.join(e.path for e in estimates)}")
