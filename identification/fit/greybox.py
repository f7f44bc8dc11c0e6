"""Grey box: physical parameters of a plant, fitted to records by the likelihood of a filter's prediction errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_gym.param import check_count, check_names, replace_at, spec_at, value_at
from auv_gym.plant import Plant, check_vehicle
from auv_gym.plant.record_check import check_ranges
from auv_gym.records.record import Record, concat, records_of
from auv_gym.records.unread import only_readings
from identification.estimate import Estimate
from identification.fit.followed import Point
from identification.fit.further_noises import further_noises
from identification.fit.intervals import information_of, interval_of
from identification.fit.noises import Noise
from identification.fit.parameters import jumps
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.sensitivities import NOTHING
from identification.fit.steps import brisk, in_steps, suited
from identification.fit.strides import in_suited_rows, stride_for
from identification.fit.validation import fitted_runs
from identification.fit.windows import free_run_windows

SAMPLES_PER_UNKNOWN = 2
DEPENDENT = 1e-7  # smallest eigenvalue of the scaled normal matrix at which parameters count as independent


@dataclass(frozen=True, eq=False)
class GreyBoxFit:
    """A plant with its free parameters fitted, and their uncertainty.

    covariance: (P, P) in the parameters' units.  noise: of sensors' readings, and of the random accelerations.
    averaged: s, over which readings were averaged, 0 if they were not averaged.
    log_likelihood: of the prediction errors.  residual_rms: per channel, of free runs over the windows, each from its
    best-fitting initial states.  windows: slices of the fitted record, which is the concatenation of all given records.
    """

    model: Plant
    estimates: tuple[Estimate, ...]
    covariance: np.ndarray
    noise: Noise
    log_likelihood: float
    residual_rms: dict[str, float]
    record: Record
    windows: tuple[slice, ...]
    averaged: float = 0.0

    def __getitem__(self, path: str) -> Estimate:
        """The estimate of a path; raises KeyError if it was not free."""
        return next((e for e in self.estimates if e.path == path), None) or _no_estimate(path, self.estimates)


@dataclass(frozen=True)
class GreyBox:
    """Grey-box prediction-error fit with sensor and process noise; see `identification.fit.prediction_errors`.

    free: parameter paths of the plant.  process: whether to estimate random accelerations of the vehicle, by strength
    and correlation time; without, the fit is output error over windows with initial states of their own.  Waves and
    lasting sensor errors are added if the residuals show them (`fit.further_noises`).
    window: s, length of a window, by default the vehicle's; with process noise, adjacent windows are joined.
    doubt: relative prior standard deviation of the coefficients that state none; by default they have no prior.
    Effects start one probe off neutral, where their derivative is defined; stiction, which has none, starts at the
    likeliest of several sizes.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle, replace_at
        >>> from identification import GreyBox, closed_loop
        >>> glider = load_vehicle("slocum")
        >>> bent = replace_at(glider, "effects.rudder.offset", 0.03)
        >>> log = closed_loop(bent, rng=np.random.default_rng(0))
        >>> fit = GreyBox(glider, ["effects.rudder.offset"], process=False).fit(log)
        >>> [round(bound, 3) for bound in fit.estimates[0].ci95]
        [0.03, 0.033]
    """

    plant: Plant
    free: Sequence[str]
    window: float | None = None
    max_iterations: int = 60
    process: bool = True
    doubt: float = np.inf

    def __post_init__(self):
        check_vehicle("GreyBox", self.plant)
        check_names("GreyBox: free", self.free)
        check_count("GreyBox: max_iterations", self.max_iterations)
        if not self.free:
            raise ValueError('GreyBox needs at least one free path, got none: for example free=["hull.n_r"].')
        if len(set(self.free)) != len(self.free):
            raise ValueError(f"GreyBox got a path twice in free={list(self.free)}: name each once.")
        for path in self.free:
            spec_at(self.plant, path)
        if self.window is not None and not self.window > 0.0:
            raise ValueError(f"GreyBox needs window > 0 s, got {self.window}.")
        if not self.doubt >= 0.0:
            raise ValueError(
                f"GreyBox needs doubt >= 0 (relative standard deviation of coefficients), got {self.doubt}."
            )

    def fit(self, *records: Record) -> GreyBoxFit:
        """Fit over all windows of all records; raises if they are too short or the run leaves the finite numbers."""
        records = records_of("GreyBox.fit", records)
        record = records[0] if len(records) == 1 else concat(records)
        check_ranges(self.plant, record)
        record, lines = only_readings(record, [name for name in self.plant.outputs if record.has(name)])
        record = record.with_notes([*record.notes, *lines]) if lines else record
        window = self.plant.window if self.window is None else self.window
        windows = free_run_windows(self.plant, record, window)
        if not windows:
            raise ValueError(_no_windows(record, window))
        paths = tuple(self.free)
        stride = stride_for(self.plant, record, windows, self.free, process=self.process)
        given = PredictionErrors(self.plant, record, windows, doubt=self.doubt, process=self.process, stride=stride)
        unknowns = len(paths) + len(given.stretches) * len(given.live) + len(given.shared_values)
        if given.count < SAMPLES_PER_UNKNOWN * unknowns:
            raise ValueError(
                f"GreyBox needs at least {SAMPLES_PER_UNKNOWN} samples per unknown ({unknowns} unknowns), got "
                f"{given.count}: record longer, choose longer windows or free fewer parameters."
            )
        problem = brisk(given)
        point = self._likeliest(problem)
        shorter = in_suited_rows(problem, point, paths)
        if shorter is not problem:
            given, problem = in_steps(shorter, given.plant.longest_step), shorter
            point = self._likeliest(problem)
        better = suited(given, problem, point, paths)
        if better is not problem:
            problem, point = better, self._likeliest(better)
        for noisier in further_noises(problem, problem.plant_at(point, paths), paths, point):
            problem, point = noisier.problem, noisier.point
        return self._result(problem, point, paths, windows)

    def _likeliest(self, problem: PredictionErrors) -> Point:
        """The likeliest point; coefficients are fitted first, since poor ones would push effects far off."""
        paths = tuple(self.free)
        coefficients = [p for p in paths if not p.startswith("effects.")]
        plant, near = problem.plant, None
        if coefficients and len(coefficients) < len(paths):
            near = problem.solve(plant, coefficients)
            plant = problem.plant_at(near, coefficients)
        plant = self._over_jumps(problem, plant, near)
        point = max(
            (problem.solve(first, paths, near, self.max_iterations) for first in self._first_plants(plant)),
            key=lambda p: problem.objective(p, paths),
        )
        if not np.isfinite(point.scores).all():
            raise ValueError(
                f"The runs of {self.plant.name!r} are not finite near its starting values: "
                "give a plant with stable coefficients."
            )
        return point

    def _over_jumps(self, problem: PredictionErrors, plant: Plant, near: Point | None) -> Plant:
        """The plant with the likeliest of several sizes of effects with jumps, which no fit finds from near neutral."""
        for path in filter(jumps, self.free):
            spec, sizes = spec_at(plant, path), problem.sticking_sizes(path)
            if value_at(plant, path) == spec.neutral and sizes:
                here = problem.point(plant.vector, problem.first_noise()) if near is None else near
                tried = [replace_at(plant, path, spec.neutral + size * spec.probe) for size in sizes]
                points = [problem.with_gains(here, one.vector) for one in tried]
                plant = tried[int(np.argmax([problem.objective(point, ()) for point in points]))]
        return plant

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

    def _result(
        self, problem: PredictionErrors, point: Point, paths: tuple[str, ...], windows: Sequence[slice]
    ) -> GreyBoxFit:
        told = information_of(problem, point, paths)
        errors = np.sqrt(np.maximum(np.diag(told.covariance), 0.0)) * [problem.scale(p) for p in paths]
        untold = _problems(told.alone, problem.free_sensitivity(point, paths), paths)
        fitted = replace(problem.plant_at(point, paths), longest_step=self.plant.longest_step)
        estimates = []
        for path, error in zip(paths, errors.tolist(), strict=True):
            value, word, unit = value_at(fitted, path), untold.get(path, ""), spec_at(fitted, path).unit
            limits = (-np.inf, np.inf) if word else interval_of(problem, point, paths, path, told)
            error = np.inf if word else error
            estimates.append(Estimate(path, unit, value, error, limits, word))
        scales = np.array([problem.scale(p) for p in paths])
        runs = fitted_runs(fitted, problem.record, windows)
        rms = [np.sqrt(np.mean(runs.errors(c) ** 2)) for c in range(len(runs.channels))]
        return GreyBoxFit(
            model=fitted,
            estimates=tuple(estimates),
            covariance=told.covariance * np.outer(scales, scales),
            noise=problem.noise_at(point),
            log_likelihood=problem.total(point),
            residual_rms=dict(zip(runs.channels, map(float, rms), strict=True)),
            record=problem.record,
            windows=tuple(windows),
            averaged=problem.averaged,
        )


def _problems(information: np.ndarray, raw: np.ndarray, paths: Sequence[str]) -> dict[str, str]:
    """Why parameters cannot be determined, by path; empty if all can.

    A column without norm belongs to a parameter that changes no measurement.  A null direction of the normal matrix,
    scaled by the sensitivities of free runs, is a change that initial states or other parameters undo; its larger
    components are named.
    """
    found = {}
    alive = [i for i in range(len(paths)) if raw[i] > NOTHING]
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


def _no_windows(record: Record, window: float) -> str:
    """Why a record has no windows of this length, s, to fit."""
    longest, interval = max(float(np.ptp(record.time[s])) for s in record.segments), record.sample_interval
    if window < 2.0 * interval:
        return (
            f"GreyBox needs windows of at least two samples, {2.0 * interval:g} s in this record, got window="
            f"{window:g}: give a longer one."
        )
    needed = f"a stretch of at least {window:g} s without a gap"
    if longest >= window:
        return (
            f"GreyBox needs {needed} in which the commands determine the actuators' positions, and in which a float "
            "is below the surface; got none: record longer or choose a shorter window."
        )
    return f"GreyBox needs {needed}, got {longest:.1f} s: record longer or choose a shorter window."


def _no_estimate(path: str, estimates: Sequence[Estimate]):
    raise KeyError(f"{path} was not free; free were {', '.join(e.path for e in estimates)}")
