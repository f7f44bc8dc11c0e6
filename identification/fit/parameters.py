"""The parameters of a plant in a fit: their scales, their bounds and their priors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from typing import Protocol, Self

import numpy as np

from auv_gym.param import positions, replace_at, spec_at, value_at
from auv_gym.plant import Plant
from identification.deciding import REACH
from identification.fit.work import Work

# step, in scales, of a parameter's slopes: larger near a corner, and larger if the effect has jumps, so that some of
# the jumps differ; else small enough for slopes to 1e-5, since their errors move estimates of nearly collinear
# parameters far, and rounding errors are still smaller
STEP, _STEP_ABOUT_CORNERS, _STEP_OVER_JUMPS = 1e-4, 0.1, 0.3
# last part of the path of effects with jumps
_JUMPS = frozenset(["stiction"])
_KINKED = frozenset(["deadband", "backlash", "stiction", "dead_time", "delay", "lag", "slowness", "lost_travel"])


class Vector(Protocol):
    """A point of a search, with a vector of all parameters, (n_parameters,)."""

    @property
    def vector(self) -> np.ndarray: ...


class Parameters:
    """A plant whose parameters are fitted.

    doubt: relative prior standard deviation of the plant's own coefficients that state none (`Plant.deviation`).
    """

    def __init__(self, plant: Plant, doubt: float):
        self.plant, self.doubt = plant, doubt
        self.scales: dict[str, float] = {}
        self.index = positions(plant)
        self.work = Work()  # one for all copies
        self._bounds: dict[str, tuple[float, float]] = {}
        self._deviations: dict[str, float] = {}

    def scale(self, path: str) -> float:
        """The unit of a parameter's change in the fit: as given, its probe, or a tenth of its value."""
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
        """The bounds of a parameter; at most `REACH` prior deviations from its given value, if it has a prior.

        The drag of a hovering vehicle keeps its sign, however uncertain it is.
        """
        if path not in self._bounds:
            low, high = spec_at(self.plant, path).bounds
            value, far = value_at(self.plant, path), REACH * self.plant.deviation(path, self.doubt)
            high = 0.0 if value <= 0.0 and path in self.plant.family.dissipating else high
            self._bounds[path] = (max(low, value - far), min(high, value + far))
        return self._bounds[path]

    def pulls(self, vector: np.ndarray, paths: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Deviations of the paths from the given plant, in prior standard deviations, and 1 over those, in scales.

        Shape (len(paths),) both; 0 for a path without a prior.
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
        """Indices of the paths at a bound that a step would push beyond it.

        gradient: (len(paths),) or longer, the direction of the step.
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
    """Whether an effect acts in one direction from its neutral value, with a corner there."""
    return path.rpartition(".")[2] in _KINKED


def jumps(path: str) -> bool:
    """Whether the result of an effect changes by jumps with its size, so that slopes say nothing of other sizes."""
    return path.rpartition(".")[2] in _JUMPS


def moves_of(paths: Iterable[str]) -> list[tuple[str, float]]:
    """Each path with the step of its slopes, in its scales."""
    return [(p, _STEP_OVER_JUMPS if jumps(p) else _STEP_ABOUT_CORNERS if kinked(p) else STEP) for p in paths]
