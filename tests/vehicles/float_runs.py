"""Free runs of a float with a piston."""

import numpy as np

from auv_gym.plant import Plant
from auv_gym.records.record import Record


def run(plant: Plant, times, depth=100.0, rate=0.0, volume=0.0, **inputs) -> np.ndarray:
    """Depth and depth rate of a free run, (n, 2); inputs: numbers or arrays."""
    times = np.asarray(times, dtype=float)
    given_inputs = {"piston_m": 0.0, "oil_volume_m3": 0.0, **inputs}
    record = Record.from_arrays(times, {name: np.zeros(times.size) + value for name, value in given_inputs.items()})
    return plant.run(record, record.segments, np.array([[depth, rate, volume]]))
