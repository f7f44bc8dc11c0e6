"""Experiments with the torpedo AUV: bang-bang fins to learn from, circles with dives to judge by.

Source: Xu, Zou, Yin and Cao 2013, Ocean Engineering 67, section 4 and figures 9 and 10.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import radians

import numpy as np

from auv_gym.model import simulate
from auv_gym.plant import Plant, load_vehicle
from auv_gym.plant.cruise import find_helm
from auv_gym.records.record import Record
from identification.experiments.excitation import bang_bang

VEHICLE = "heu_torpedo"
START_DEPTH = 5.0  # m
BANG = radians(8.0)
RUDDER_HOLD, PLANE_HOLD = (4.0, 15.0), (2.0, 10.0)  # s between changes; not stated in the paper
RUNS, RUN = 20, 60.0  # s each, from rest as in the paper's simulations, so that each covers all speeds
NOISE = {  # standard deviations; DVL against the water, gyros, inclinometer
    "u_mps": 0.01,
    "v_mps": 0.01,
    "w_mps": 0.01,
    "p_radps": radians(0.1),
    "q_radps": radians(0.1),
    "r_radps": radians(0.1),
    "roll_rad": radians(0.2),
    "pitch_rad": radians(0.2),
    "heading_rad": radians(0.5),
    "depth_m": 0.02,
}
TURNING_BACK = 1.0  # m; the planes are put over this far before the end of the dive


@cache
def vehicle() -> Plant:
    """The vehicle whose forces are to be learned."""
    return load_vehicle(VEHICLE)


def bang_bang_runs(
    voltages: Sequence[float], seed: int, *, noise: Mapping[str, float] | None = None, runs: int = RUNS
) -> list[Record]:
    """Runs from rest with both pairs of fins going from -8 to +8 deg and back at random times, shared by the voltages.

    noise: standard deviations of white noise by channel, by default none. With noise, channels without an entry are
    left out: there is no position under water.
    """
    plant, records = vehicle(), []
    n = round(RUN / plant.dt) + 1
    for number in range(runs):
        rng = np.random.default_rng([seed, number])
        commands = {
            "rudder_rad": bang_bang(n, plant.dt, rng, amplitude=BANG, hold_s=RUDDER_HOLD),
            "stern_plane_rad": bang_bang(n, plant.dt, rng, amplitude=BANG, hold_s=PLANE_HOLD),
            "propeller_V": np.full(n, voltages[number % len(voltages)]),
        }
        record = run_from_rest(plant, commands)
        if noise is not None:
            record = record.with_channels(
                {name: record[name] + s * rng.standard_normal(n) for name, s in noise.items()}
            )
            record = record.without([name for name in plant.outputs if name not in noise])
        records.append(record)
    return records


def run_from_rest(plant: Plant, commands: Mapping[str, np.ndarray]) -> Record:
    """The run of a plant from rest at the start depth, without noise."""
    n = len(next(iter(commands.values())))
    start = {"depth_m": np.full(n, START_DEPTH)}
    return simulate(plant, Record.from_arrays(plant.dt * np.arange(n), {**commands, **start}))


@dataclass(frozen=True)
class Manoeuvre:
    """A circle with dives between 5 and 15 m: fins in deg, volts, s."""

    rudder: float
    plane: float
    voltage: float
    duration: float = 200.0

    @property
    def title(self) -> str:
        return f"{self.voltage:g} V, rudder {self.rudder:g}, planes ±{self.plane:g} deg"


MANOEUVRES = tuple(Manoeuvre(rudder, plane, volts) for volts in (3.5, 4.5) for rudder, plane in ((5, 5), (10, 10)))


@cache
def circled(manoeuvre: Manoeuvre) -> Record:
    """The vehicle's run: the planes are put over each time it is within a metre of 15 or of 5 m.

    The paper does this once, at about 15 m; its vehicle then rises for the rest of 200 s, and would leave the water.
    Models are given the same commands at the same times.
    """
    plant = vehicle()
    n = round(manoeuvre.duration / plant.dt) + 1
    commands, helm = np.zeros((n, len(plant.inputs))), find_helm(plant)
    commands[:, helm.rudder], commands[:, helm.drive] = radians(manoeuvre.rudder), manoeuvre.voltage
    at = plant.outputs.index("depth_m")
    start = np.zeros(len(plant.outputs))
    start[at] = START_DEPTH
    x, side = plant.initial(start), 1.0  # planes positive: nose down
    for row in commands:
        depth = plant.output(x)[at]
        if depth > START_DEPTH + 10.0 - TURNING_BACK:
            side = -1.0
        elif depth < START_DEPTH + TURNING_BACK:
            side = 1.0
        row[helm.plane] = side * radians(manoeuvre.plane)
        x = plant.step(x, row)
    return run_from_rest(plant, dict(zip(plant.inputs, commands.T, strict=True)))


@dataclass(frozen=True)
class Judgement:
    """The difference of a model's run from the vehicle's.

    position: horizontally at the end, percent of the path.  farthest: the same at the worst moment.  depth: rms, m.
    outside: share of the samples whose velocity is outside of the training data, for a learned hull.  distance: the
    farthest of them, in the reach of the training data; 0 for a model without such a measure.
    """

    position: float
    farthest: float
    depth: float
    outside: float
    distance: float


def judged(true: Record, run: Record, plant: Plant | None = None) -> Judgement:
    """The judgement of a model's run; plant: the model, if it has a learned hull."""
    off = np.hypot(run["north_m"] - true["north_m"], run["east_m"] - true["east_m"])
    path = np.hypot(np.diff(true["north_m"]), np.diff(true["east_m"])).sum()
    depth = np.sqrt(np.mean((run["depth_m"] - true["depth_m"]) ** 2))
    distance = np.zeros(1)
    if plant is not None and plant.learned is not None:
        distance = plant.learned.distance_along(run)
    return Judgement(
        100.0 * off[-1] / path, 100.0 * off.max() / path, float(depth), float((distance > 1.0).mean()), distance.max()
    )
