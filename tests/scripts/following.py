"""Whether a compiled vehicle moves as a log of one by code of its own says."""

import numpy as np
import pytest

from auv_gym.plant import Plant
from auv_gym.records.record import Record


def assert_it_follows(plant: Plant, x: np.ndarray, log: Record, steps: int, depth: float, other: float) -> None:
    """A vehicle under the commands of a log, from a state on; so many steps to a sample.

    depth, other: how far it may be off in depth, m, and in any other channel.
    """
    commands = np.column_stack([log[n] if log.has(n) else np.full(len(log), plant.constants[n]) for n in plant.inputs])
    compared = [name for name in plant.outputs if log.has(name)]
    for k, held in enumerate(commands):
        y = dict(zip(plant.outputs, plant.output(x), strict=True))
        for name in compared:
            if log.readings(name)[k]:
                assert y[name] == pytest.approx(log[name][k], abs=depth if name == "depth_m" else other), (k, name)
        for _ in range(steps):
            x = plant.step(x, held)
