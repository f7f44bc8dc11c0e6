"""Logs of a glider's heading that something pushes at random, for tests of fits by a filter."""

from dataclasses import replace

import numpy as np

from auv_gym.param import replace_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record

GLIDER = load_vehicle("ganeshblue")
SENSORS = {"heading_rad": 0.01, "r_radps": 0.003}
OFFSET, COEFFICIENTS = "effects.rudder.offset", ("hull.n_r", "hull.n_delta")
PATHS = (*COEFFICIENTS, OFFSET)
PIECES = 16  # steps of the truth within a sample, in which its yaw rate decays to an eighth


def glider_log(
    seed: int, push: float = 0.006, tau: float = 15.0, rows: int = 500, gust: float = 1.0, **changes: float
) -> Record:
    """A glider under a random yaw acceleration (push, rad/s^2; tau, s), steered by a random telegraph.

    gust: the factor of the acceleration from row 200 to 260.
    """
    plant: Plant = replace(replace_at(GLIDER, {OFFSET: 0.03} | changes), dt=GLIDER.dt / PIECES)
    rng, hold = np.random.default_rng(seed), 25
    inputs = np.zeros((rows, len(plant.inputs)))
    inputs[:, 0] = np.repeat(rng.choice([-1.0, 1.0], rows // hold) * rng.uniform(0.05, 0.3, rows // hold), hold)
    inputs[:, plant.inputs.index("u_mps")] = 0.5 + 0.05 * np.sin(np.arange(rows) / 50.0)
    at, x, pushed = plant.family.states.index("r_radps"), plant.initial(np.full(len(plant.outputs), np.nan)), 0.0
    decay, readings = np.exp(-GLIDER.dt / tau), []
    pushed = push * rng.standard_normal()
    for k, u in enumerate(inputs):
        readings.append(plant.output(x))
        kick = 0.5 * plant.dt * pushed * (gust if 200 <= k < 260 else 1.0)
        for _ in range(PIECES):
            x[at] += kick
            x = plant.step(x, u)
            x[at] += kick
        pushed = decay * pushed + push * np.sqrt(1.0 - decay**2) * rng.standard_normal()
    y = np.array(readings)
    channels = {n: y[:, plant.outputs.index(n)] + s * rng.standard_normal(rows) for n, s in SENSORS.items()}
    channels |= {n: inputs[:, plant.inputs.index(n)] for n in ("rudder_rad", "u_mps")}
    return Record.from_arrays(GLIDER.dt * np.arange(rows), channels)


def whole(record: Record) -> list[slice]:
    return [slice(0, len(record))]
