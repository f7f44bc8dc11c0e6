"""Logs with process noise: a vehicle pushed by unrecorded accelerations, in open and in closed loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_gym.model import Diverged
from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.diagnosis.search.candidates import candidates_of
from identification.fit.windows import free_run_windows
from scripts.studies.process_noise.experiments import VEHICLES, Vehicle
from scripts.studies.process_noise.flights import Experiment
from scripts.studies.process_noise.levels import Draws, Level, Trials
from scripts.studies.process_noise.pushes import velocities

TAUS = (5.0, 120.0)  # s, range of correlation times, log-uniform
MULTIPLES = (5.0, 10.0)  # size of an effect over its standard error
LEAST, MOST = 4.5, 12.0  # the same for the standard error at the final size
ATTEMPTS = 60  # most attempts to draw an effect that the log shows

Process = Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Case:
    """A log, the true vehicle and the one that the modeller believes in.

    effect: path of the missing one, or "".  size: its value, in the parameter's unit.  error: its standard error, by a
    filter that knows the noise.  loop: "open", "closed" or "exact".  process: deviation, m/s^2 or rad/s^2, and
    correlation time, s, of the acceleration by velocity.  sensors: deviation of white noise by channel.
    free_run: error of the true model's free runs in the leading channel, over its sensor's noise.  shown: by judged
    velocity, the variance that its acceleration adds to free-run errors, over the sensor's, where it is largest.
    pushes: the accelerations, (rows, axes).
    """

    plant: Plant
    believed: Plant
    record: Record
    effect: str
    size: float
    error: float
    loop: str
    process: Process
    sensors: Mapping[str, float]
    free_run: float
    shown: Mapping[str, float]
    pushes: np.ndarray


def draw(family: str, seed: int, loop: str, effect: bool, times: float = 1.0, wrong: float = 0.0) -> Case:
    """The case of a family and a seed; the same vehicle, manoeuvres and random numbers in both loops.

    effect: whether one is missing that the log shows by `MULTIPLES` standard errors.  times: error of the true model's
    free runs by process noise, over the leading sensor's noise.  wrong: relative error of every believed coefficient.
    Raises ValueError if no attempt succeeds.
    """
    if family not in VEHICLES or loop not in VEHICLES[family].loops:
        flown = "; ".join(f"{name} ({', '.join(one.loops)})" for name, one in VEHICLES.items())
        raise ValueError(f"The families and their loops are {flown}; got {family} ({loop}).")
    vehicle = VEHICLES[family]
    plans, noises, effects, doubts = (
        np.random.default_rng(s) for s in np.random.SeedSequence([list(VEHICLES).index(family), seed]).spawn(4)
    )
    plain = vehicle.plant
    experiment = replace(vehicle.experiment(vehicle, plans), exact=loop == "exact")
    draws = _draws(vehicle, experiment, noises)
    trials = Trials.of(plain, experiment, draws, loop)
    level, path, error = trials.wanted(times), "", 0.0
    if effect:
        trials, path, error, level = _with_effect(trials, level, loop, times, effects)
    plant = trials.plant
    given = {p: value_at(plain, p) * (1.0 + wrong * doubts.choice([-1.0, 1.0])) for p in plain.family.coefficients}
    return Case(
        plant=plant,
        believed=replace_at(plain, given) if wrong else plain,
        record=level.flight.record,
        effect=path,
        size=value_at(plant, path) if path else 0.0,
        error=error,
        loop=loop,
        process=_pairs(level),
        sensors=experiment.sensors,
        free_run=level.errors[plant.family.leading],
        shown={axis: trials.shown(level.factor, axis) for axis in vehicle.judged},
        pushes=level.flight.pushes,
    )


def standard_errors(
    plant: Plant, record: Record, paths: Sequence[str], process: Process, sensors: Mapping[str, float]
) -> dict[str, float]:
    """Standard error by path of estimates from a log, by a Kalman filter that knows plant and noise."""
    from identification.fit.noises import Noise
    from identification.fit.prediction_errors import PredictionErrors

    problem = PredictionErrors(plant, record, free_run_windows(plant, record, plant.window))
    return problem.standard_errors(plant, paths, Noise(measurement=sensors, process=process))


def single_effects(plant: Plant, record: Record) -> list[str]:
    """The candidate effects with a single component."""
    return [c.paths[0] for c in candidates_of(plant, record) if len(c.free) == 1]


def _draws(vehicle: Vehicle, experiment: Experiment, rng: np.random.Generator) -> Draws:
    rows, axes, sensors = experiment.time.size, len(velocities(vehicle.plant)), len(experiment.sensors)
    return Draws(
        taus=np.exp(rng.uniform(*np.log(TAUS), size=axes)),
        pushes=rng.standard_normal((rows, axes)),
        sensors=rng.standard_normal((rows, sensors)),
        rehearsal=rng.standard_normal((rows, sensors)),
    )


def _pairs(level: Level) -> dict[str, tuple[float, float]]:
    return {name: (one.deviation, one.tau) for name, one in level.process.items()}


def _with_effect(
    without: Trials, level: Level, loop: str, times: float, rng: np.random.Generator
) -> tuple[Trials, str, float, Level]:
    """The vehicle with an effect that its log shows, its path, standard error and log; coefficients are fitted, too.

    level: of the log without an effect, for the first guess of sizes.  Standard errors of effects with a corner at
    neutral depend on the size, so they are computed again at the size.
    """
    plain, experiment = without.plant, without.experiment
    names = single_effects(plain, level.flight.record)

    def error_of(path: str, plant: Plant, level: Level) -> float:
        paths = [path, *plain.family.coefficients]
        return standard_errors(plant, level.flight.record, paths, _pairs(level), experiment.sensors)[path]

    for _ in range(ATTEMPTS):
        path, multiple, side = str(rng.choice(names)), rng.uniform(*MULTIPLES), rng.choice([-1.0, 1.0])
        spec = spec_at(plain, path)
        side = side if spec.bounds[0] < spec.neutral else 1.0
        try:
            error = error_of(path, replace_at(plain, path, spec.neutral + side * spec.probe), level)
            for _ in range(2):
                value = float(spec.neutral + side * multiple * error)
                if not (np.isfinite(value) and spec.bounds[0] < value < spec.bounds[1]):
                    break
                trials = Trials.of(replace_at(plain, path, value), experiment, without.draws, loop)
                found = trials.wanted(times)
                error = error_of(path, trials.plant, found)
                if LEAST * error <= abs(value - spec.neutral) <= MOST * error:
                    return trials, path, error, found
        except (ValueError, Diverged, np.linalg.LinAlgError):  # the vehicle could not be controlled
            continue
    raise ValueError(f"No effect of {plain.name} shows in {ATTEMPTS} draws.")
