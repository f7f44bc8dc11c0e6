"""Logs with a cause outside the library, simulated by code that shares nothing with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from auv_gym.model import Diverged
from auv_gym.plant import Plant
from auv_gym.plant.cruise import find_cruise
from auv_gym.plant.record_check import described
from auv_gym.records.record import Record
from identification.fit.shooting import Shooting
from identification.fit.windows import free_run_windows
from scripts.blind import own_float, own_torpedo
from scripts.blind.disturbances import Around, Slack, Sticking, Tripping, slipped
from scripts.blind.logs import (
    Conditions,
    glider_log,
    heaved,
    hover_log,
    lake_log,
    sea_log,
    torpedo_excitation,
    torpedo_noise,
    yo_log,
)
from scripts.blind.own_glider import OwnGlider

EXCESS = (1.2, 5.0)  # range over the noise variance, after a refit, in the channel where it is largest
_SIZES = (1.0 / 64.0, 16.0)  # range of the sizes that are tried
_TRIES = 10  # most sizes that are tried
_FARTHEST = 4.0  # largest ratio between consecutive tries
Draws = np.random.Generator  # for drawing the cause


def excess(plant: Plant, record: Record, clean: Record, window: float) -> float:
    """Mean square residual after a refit, over that in a clean log, minus 1, in the channel where it is largest."""
    return float(np.max(left_over(plant, record, window) / left_over(plant, clean, window))) - 1.0


def left_over(plant: Plant, record: Record, window: float) -> np.ndarray:
    """Mean square residual of each channel in free runs of a plant whose coefficients are refitted."""
    log = described(plant, record)
    problem = Shooting(plant, log, free_run_windows(plant, log, window))
    return problem.sigma(problem.solve(plant, plant.family.coefficients, max_iterations=15)) ** 2


@dataclass(frozen=True, eq=False)
class Sized:
    """A log with a cause, the cause's size, and its excess."""

    record: Record
    size: float
    excess: float


def sized(plant: Plant, make: Callable[[float], Record], clean: Record, window: float) -> Sized | None:
    """The log, made by its cause's size, whose excess lies in `EXCESS`; None if no such size is found.

    clean: the log without the cause.  Raises the error of the smallest size if the vehicle cannot be controlled at any.
    """
    noise, low, high, size = left_over(plant, clean, window), 0.0, np.inf, 1.0
    for _ in range(_TRIES):
        try:
            record = make(size)
            found = float(np.max(left_over(plant, record, window) / noise)) - 1.0
        except (ValueError, Diverged, np.linalg.LinAlgError):  # the vehicle could not be controlled
            if size < _SIZES[0] * _FARTHEST:
                raise
            found = np.inf
        else:
            if EXCESS[0] <= found <= EXCESS[1]:
                return Sized(record, size, found)
        low, high = (max(low, size), high) if found < EXCESS[0] else (low, min(high, size))
        if low > 0.0 and high < np.inf:
            size = float(np.sqrt(low * high))
        else:  # the excess is about proportional to the square of the size
            aim = np.sqrt(np.sqrt(EXCESS[0] * EXCESS[1]) / max(found, 1e-3))
            size *= float(np.clip(aim, 1.0 / _FARTHEST, _FARTHEST))
        if not _SIZES[0] <= size <= _SIZES[1]:
            return None
    return None


# Logs of a plant without effects and with a cause, "" for none; size: 1 is small. They raise ValueError if the
# vehicle cannot be controlled. The cause is drawn by one generator, the experiment by another.


def glider_outside(
    plant: Plant, cause: str, size: float, conditions: Conditions, experiment: np.random.Generator, rng: Draws
) -> Record:
    """The log of a glider."""
    return glider_log(plant, conditions, experiment, _glider(plant, cause, size, conditions.duration, rng))


def lake_outside(
    plant: Plant, cause: str, size: float, conditions: Conditions, experiment: np.random.Generator, rng: Draws
) -> Record:
    """The log of a float with a piston."""
    around = Around()
    if cause == "drag":
        around = Around(tripping=Tripping(0.5 * size, 0.03, 0.08))
    elif cause == "side":
        around = Around(side=0.02 * size)
    elif cause == "tether":
        around = Around(tether=Slack(0.004 * size, 25.0))
    elif cause == "fin":
        around = Around(sticking=Sticking.draw(rng, 2500.0, 2e-3 * size, 300.0, 40.0 * size))
    return lake_log(plant, conditions, experiment, _started(around))


def sea_outside(
    plant: Plant, cause: str, size: float, conditions: Conditions, experiment: np.random.Generator, rng: Draws
) -> Record:
    """The log of a float with an oil bladder."""
    around = Around()
    if cause == "drag":
        around = Around(tripping=Tripping(0.5 * size, 0.05, 0.09))
    elif cause == "tether":
        around = Around(tether=Slack(2e-4 * size, 500.0))
    return sea_log(plant, conditions, experiment, _started(around))


def yo_outside(
    plant: Plant, cause: str, size: float, conditions: Conditions, experiment: np.random.Generator, rng: Draws
) -> Record:
    """The log of a flying glider."""
    record = yo_log(plant, conditions, experiment)
    if cause != "layer":
        return record
    depth = record["depth_m"]
    top = float(np.max(depth)) * rng.uniform(0.4, 0.7)  # m
    return heaved(record, np.where(depth > top, -0.005 * size, 0.0))


def torpedo_outside(
    plant: Plant, cause: str, size: float, conditions: Conditions, experiment: np.random.Generator, rng: Draws
) -> Record:
    """The log of a torpedo."""
    around = _around_torpedo(plant, cause, size, conditions.duration, rng)
    noise, excitation = torpedo_noise(conditions.noise), torpedo_excitation(conditions.excitation)
    return own_torpedo.own_manoeuvres(plant, around, experiment, conditions.duration, excitation, noise)


def hover_outside(
    plant: Plant, cause: str, size: float, conditions: Conditions, experiment: np.random.Generator, rng: Draws
) -> Record:
    """The log of a vehicle with thrusters, of which only the clock is simulated by other code."""
    return hover_log(plant, conditions, experiment)


def slipped_clock(record: Record, size: float, spacing: float, rng: np.random.Generator) -> Record:
    """A record with the time stamps of a clock that slips about every `spacing` s."""
    stamps = np.concatenate([slipped(record.time[s], rng, 0.03 * size, spacing) for s in record.segments])
    number = np.repeat(np.arange(len(record.segments)), [s.stop - s.start for s in record.segments])
    slips = Record.from_arrays(stamps, {n: record[n] for n in record.names}, segment=number, attrs=record.attrs)
    return slips.with_labels(record.labels)


def _glider(plant: Plant, cause: str, size: float, duration: float, rng: np.random.Generator) -> OwnGlider:
    hull = plant.hull
    fastest = abs(hull.n_delta * hull.speed * hull.rudder_limit / (hull.length * hull.n_r))  # rad/s, steady
    if cause == "drag":
        return OwnGlider(plant, tripping=Tripping(0.5 * size, 0.08 * fastest, 0.25 * fastest))
    if cause == "side":
        return OwnGlider(plant, side=0.1 * size)
    if cause == "fin":
        return OwnGlider(plant, sticking=Sticking.draw(rng, duration, 0.02 * size, 90.0, 6.0 * size))
    return OwnGlider(plant)


def _started(around: Around) -> Callable[..., own_float.OwnSwim]:
    """A function that starts a float for each dive."""

    def start(given: Plant, depth: float, rate: float = 0.0, volume: float = 0.0) -> own_float.OwnSwim:
        return own_float.OwnSwim(given, around, depth, rate, volume)

    return start


def _around_torpedo(plant: Plant, cause: str, size: float, duration: float, rng: np.random.Generator) -> Around:
    speed, length = find_cruise(plant).speed, plant.hull.length
    if cause == "drag":
        return Around(tripping=Tripping(0.06 * size, 0.78 * speed, 0.9 * speed))
    if cause == "side":
        return Around(side=0.05 * size)
    if cause == "tether":
        distance = float(np.hypot(0.85 * own_torpedo.FOLLOW * speed, 15.0 * length))
        push = abs(plant.hull.surge.u_u) * speed**2  # N
        return Around(tether=Slack(0.001 * size * push, distance * rng.uniform(0.6, 0.8)))
    if cause == "fin":
        return Around(sticking=Sticking.draw(rng, duration, 0.02 * size, 30.0, 3.0 * size))
    return Around()
