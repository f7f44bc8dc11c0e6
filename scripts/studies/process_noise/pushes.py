"""Process noise: Ornstein-Uhlenbeck accelerations of a vehicle's velocities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from auv_gym.plant import Plant

VELOCITIES = ("_mps", "_radps")  # how the names of velocities end


@dataclass(frozen=True)
class Disturbance:
    """A stationary Ornstein-Uhlenbeck acceleration: deviation, m/s^2 or rad/s^2, and correlation time tau, s."""

    deviation: float
    tau: float


def velocities(plant: Plant) -> tuple[str, ...]:
    """The states of a plant that are velocities."""
    return tuple(name for name in plant.family.states if name.endswith(VELOCITIES))


def unit_paths(normals: np.ndarray, taus: np.ndarray, dt: float) -> np.ndarray:
    """Stationary Ornstein-Uhlenbeck paths of deviation 1 at samples dt apart, (n, axes).

    normals: (n, axes), white.  taus: (axes,), s.  The discretisation is exact.
    """
    paths = np.empty_like(normals)
    for axis, tau in enumerate(taus):
        kept = np.exp(-dt / tau)
        driven = normals[:, axis] * np.sqrt(1.0 - kept * kept)
        driven[0] = normals[0, axis]
        paths[:, axis] = lfilter([1.0], [1.0, -kept], driven)
    return paths


def accelerations(process: Mapping[str, Disturbance], normals: np.ndarray, dt: float) -> np.ndarray:
    """Accelerations at samples dt apart, (n, axes), from white noise of the same shape."""
    taus = np.array([one.tau for one in process.values()])
    return unit_paths(normals, taus, dt) * np.array([one.deviation for one in process.values()])
