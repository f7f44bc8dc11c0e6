"""The parameters of a plant in a fit: the scales they are counted in, their bounds, and what is known beforehand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from typing import Protocol, Self

import numpy as np

from auv_gym.param import positions, replace_at, spec_at, value_at
from auv_gym.plant import Plant
from identification.deciding import REACH
from identification.fit.work import Work

# scales of a parameter, over which its slopes are taken: more about a corner, and more where it jumps, so that some of
# the jumps differ; else so little that slopes are true to 1e-5, since what they are off by moves those estimates far
# that act nearly alike, and rounding is still less
STEP, _STEP_ABOUT_CORNERS, _STEP_OVER_JUMPS = 1e-4, 0.1, 0.3
# what comes last in their paths
_JUMPS = frozenset(["stiction"])
# in probes, that are tried of what changes by jumps: two neighbours have nine jumps in ten in common
SIZES_OF_JUMPS = tuple(float(size) for size in np.geomspace(0.3, 9.0, 36))
_KINKED = frozenset(["deadband", "backlash", "stiction", "dead_time", "delay", "lag", "slowness", "lost_travel"])


class Vector(Protocol):
    """A point of a search: it has a vector of all parameters, (n_parameters,)."""

    @property
    def vector(self) -> np.ndarray: ...


class Parameters:
    """A plant whose parameters are fitted.

    doubt: standard deviation of the plant's own coefficients, relative, where they have none of their own
    (`Plant.deviation`); fits hold them to their values by it.
    """

    def __init__(self, plant: Plant, doubt: float):
        self.plant, self.doubt = plant, doubt
        self.scales: dict[str, float] = {}
        self.index = positions(plant)
        self.work = Work()  # one for all copies
        self._bounds: dict[str, tuple[float, float]] = {}
        self._deviations: dict[str, float] = {}

    def scale(self, path: str) -> float:
        """The change of a parameter that counts as one in the fit: as given, its probe, or a tenth of its value."""
        if path not in self.scales:
            spec, value = spec_at(self.plant, path), abs(value_at(self.plant, path))
            own = 0.1 * value if path in self.plant.coefficients else 0.0
            self.scales[path] = own or spec.probe or 0.1 * value or 1.0
        return self.scales[path]

    def scaled(self, scales: Mapping[str, float]) -> Self:
        """The same problem with other scales of these paths."""
        other = copy(self)
        other.scales = self.scales | dict(scales)
        return other

    def bounds(self, path: str) -> tuple[float, float]:
        """The least and the most that a parameter may be; `REACH` deviations from given where it has one.

        Drag of a vehicle that hovers stays drag, however little is known of it.
        """
        if path not in self._bounds:
            low, high = spec_at(self.plant, path).bounds
            value, far = value_at(self.plant, path), REACH * self.plant.deviation(path, self.doubt)
            high = 0.0 if value <= 0.0 and path in self.plant.family.dissipating else high
            self._bounds[path] = (max(low, value - far), min(high, value + far))
        return self._bounds[path]

    def pulls(self, vector: np.ndarray, paths: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """How far the paths are from the given plant, in standard deviations of it, and 1 over those, in scales.

        Shape (len(paths),) both; 0 where nothing is known of a path beforehand.
        """
        far = np.array([vector[self.index[p]] - self.plant.vector[self.index[p]] for p in paths]).reshape(len(paths))
        for path in paths:
            if path not in self._deviations:
                self._deviations[path] = self.plant.deviation(path, self.doubt)
        deviations = np.array([self._deviations[p] for p in paths]).reshape(len(paths))
        scales = np.array([self.scale(p) for p in paths]).reshape(len(paths))
        return far / deviations, scales / deviations

    def moved_vector(self, vector: np.ndarray, paths: Sequence[str], step: np.ndarray) -> np.ndarray:
        """A vector moved by a step in scales, within the bounds."""
        vector = vector.copy()
        for path, size in zip(paths, step, strict=True):
            low, high = self.bounds(path)
            i = self.index[path]
            vector[i] = min(max(vector[i] + size * self.scale(path), low), high)
        return vector

    def bounded(self, vector: np.ndarray, paths: Sequence[str]) -> np.ndarray:
        """A vector with the values of these paths within their bounds."""
        return self.moved_vector(vector, paths, np.zeros(len(paths)))

    def at_edge(self, vector: np.ndarray, paths: Sequence[str], gradient: np.ndarray) -> list[int]:
        """Numbers of the paths at a bound that a step would push them over: it leaves these alone.

        gradient: (len(paths),) or longer, the way that each would go.
        """
        held = []
        for number, path in enumerate(paths):
            value, (low, high) = vector[self.index[path]], self.bounds(path)
            if (value <= low and gradient[number] < 0.0) or (value >= high and gradient[number] > 0.0):
                held.append(number)
        return held

    def plant_at(self, point: Vector, paths: Sequence[str]) -> Plant:
        """The plant with the point's values at the paths."""
        return replace_at(self.plant, {p: float(point.vector[self.index[p]]) for p in paths})


def kinked(path: str) -> bool:
    """Whether an effect works in one direction from its neutral value, with a corner there."""
    return path.rpartition(".")[2] in _KINKED


def jumps(path: str) -> bool:
    """Whether what an effect does changes by jumps with its size, so that no slope tells of another size."""
    return path.rpartition(".")[2] in _JUMPS


def moves_of(paths: Iterable[str]) -> list[tuple[str, float]]:
    """Each path with the step, in its scales, over which its slopes are taken."""
    return [(p, _STEP_OVER_JUMPS if jumps(p) else _STEP_ABOUT_CORNERS if kinked(p) else STEP) for p in paths]
