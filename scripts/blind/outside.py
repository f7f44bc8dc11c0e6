"""Logs with a cause in them that the library does not know, simulated by code that shares nothing with it."""

from __future__ import annotations

import numpy as np

from auv_gym.plant import Plant
from auv_gym.plant.cruise import find_cruise
from auv_gym.records.record import Record
from identification.fit.shooting import Shooting
from identification.fit.windows import free_run_windows
from scripts.blind import own_float, own_torpedo
from scripts.blind.disturbances import Around, Gusts, Slack, Sticking, Tripping, slipped
from scripts.blind.logs import Conditions, log_of, torpedo_excitation, torpedo_noise
from scripts.blind.own_glider import OwnGlider

CAUSES_OF = {
    "glider": ("drag", "current", "fin", "clock"),
    "float_piston": ("drag", "current", "tether", "fin", "clock"),
    "float_oil": ("drag", "current", "tether", "clock"),
    "body": ("drag", "current", "tether", "fin", "clock"),
}
SIZES = (1.0, 2.0, 4.0, 8.0)  # tried in turn until the log shows the cause
VISIBLE = 1.0  # excess over the noise variance that a refit of the coefficients must leave in some channel
_MERMAID_DAYS = 4e5  # s, more than eight dives take


def causes_of(plant: Plant) -> tuple[str, ...]:
    """What may be the matter with a vehicle beyond the library."""
    return CAUSES_OF.get(plant.family.name, CAUSES_OF.get(plant.family.kind, ()))


def outside_log(plant: Plant, cause: str, size: float, conditions: Conditions, seed: int) -> Record:
    """The log of a plant without effects and with a cause, "" for none; size: 1 is a small one.

    Raises ValueError where the vehicle cannot be kept on its way.
    """
    rng = np.random.default_rng([seed, 1])
    family = plant.family.name
    if family == "glider":
        record = log_of(plant, conditions, seed, _glider(plant, cause, size, conditions.duration, rng))
        spacing = 60.0
    elif plant.family.kind == "float":
        record = log_of(plant, conditions, seed, _float(plant, cause, size, rng))
        spacing = 200.0 if family == "float_piston" else 2e4
    else:
        around = _around_torpedo(plant, cause, size, conditions.duration, rng)
        noise, excitation = torpedo_noise(conditions.noise), torpedo_excitation(conditions.excitation)
        manoeuvres = np.random.default_rng(seed)
        record = own_torpedo.own_manoeuvres(plant, around, manoeuvres, conditions.duration, excitation, noise)
        spacing = 25.0
    if cause != "clock":
        return record
    stamps = np.concatenate([slipped(record.time[s], rng, 0.03 * size, spacing) for s in record.segments])
    labels = np.repeat(record.labels, [s.stop - s.start for s in record.segments])
    return Record.from_arrays(stamps, {n: record[n] for n in record.names}, segment=labels, attrs=record.attrs)


def excess(plant: Plant, record: Record, clean: Record, window: float) -> float:
    """Mean square that is left after a refit, over that in a clean log, less 1, in the channel where it is largest."""
    left = []
    for log in (record, clean):
        problem = Shooting(plant, log, free_run_windows(plant, log, window))
        left.append(problem.sigma(problem.solve(plant, plant.family.coefficients, max_iterations=15)) ** 2)
    return float(np.max(left[0] / left[1])) - 1.0


def _glider(plant: Plant, cause: str, size: float, duration: float, rng: np.random.Generator) -> OwnGlider:
    hull = plant.hull
    fastest = abs(hull.n_delta * hull.speed * hull.rudder_limit / (hull.length * hull.n_r))  # rad/s, steady
    if cause == "drag":
        return OwnGlider(plant, tripping=Tripping(0.5 * size, 0.08 * fastest, 0.25 * fastest))
    if cause == "current":
        return OwnGlider(plant, gusts=Gusts.draw(rng, duration + 60.0, 0.05 * size, 120.0, "horizontal"))
    if cause == "fin":
        return OwnGlider(plant, sticking=Sticking.draw(rng, duration, 0.02 * size, 90.0, 6.0 * size))
    return OwnGlider(plant)


def _float(plant: Plant, cause: str, size: float, rng: np.random.Generator):
    deep = plant.family.name == "float_oil"
    around = Around()
    if cause == "drag":
        low, high = (0.05, 0.09) if deep else (0.03, 0.08)
        around = Around(tripping=Tripping(0.5 * size, low, high))
    elif cause == "current":
        spacing, length = (1e4, _MERMAID_DAYS) if deep else (240.0, 2500.0)
        around = Around(gusts=Gusts.draw(rng, length, 0.01 * size, spacing, "vertical"))
    elif cause == "tether":
        around = Around(tether=Slack(2e-4 * size, 500.0) if deep else Slack(0.004 * size, 25.0))
    elif cause == "fin":
        around = Around(sticking=Sticking.draw(rng, 2500.0, 2e-3 * size, 300.0, 40.0 * size))
    begun = iter(np.cumsum(rng.uniform(2e4, 4e4, 64)) if deep else [0.0])

    def start(given: Plant, depth: float, rate: float = 0.0, volume: float = 0.0) -> own_float.OwnSwim:
        return own_float.OwnSwim(given, around, depth, rate, volume, begun=float(next(begun)))

    return start


def _around_torpedo(plant: Plant, cause: str, size: float, duration: float, rng: np.random.Generator) -> Around:
    speed, length = find_cruise(plant).speed, plant.hull.length
    if cause == "drag":
        return Around(tripping=Tripping(0.06 * size, 0.78 * speed, 0.9 * speed))
    if cause == "current":
        return Around(gusts=Gusts.draw(rng, duration, 0.025 * size, 40.0, "horizontal"))
    if cause == "tether":
        distance = float(np.hypot(0.85 * own_torpedo.FOLLOW * speed, 15.0 * length))
        push = abs(plant.hull.surge.u_u) * speed**2  # N
        return Around(tether=Slack(0.001 * size * push, distance * rng.uniform(0.6, 0.8)))
    if cause == "fin":
        return Around(sticking=Sticking.draw(rng, duration, 0.02 * size, 30.0, 3.0 * size))
    return Around()
