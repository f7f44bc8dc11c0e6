"""Hull forces learned from data: Gaussian radial basis functions of the velocities, plus a trend.

They replace everything that the hull's coefficients give, C(v)v + D(v)v; mass, weight, fins, propulsion and effects
remain the vehicle's.  Source: Xu, Zou, Yin and Cao 2013, Ocean Engineering 67, equation (20).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from auv_gym.compiled import compiled, outlined, tail_of
from auv_gym.physics.radial import BITS, LANES, radial_blocks, radial_distance, radial_sums

VELOCITIES = ("u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps")
AXES = len(VELOCITIES)
_ROWS = 2 * AXES + 1  # in a block
_TREND = 3 + 2 * AXES  # index of the trend in a table, after kernels, blocks of each, reach; bias; 1 / spread
_HEAD = _TREND + AXES * AXES
ROOM = 2 * AXES + (2 + AXES) * LANES  # size of the work array


@compiled
def _scale(velocity, table, factor, x):
    """Write the velocity in spreads, times a factor, into x."""
    for i in range(AXES):
        x[i] = velocity[i] * table[3 + AXES + i] * factor


@outlined
def learned_forces(p, velocity, room):
    """The forces -(C(v)v + D(v)v) by the table that follows the record p, N and N m.

    velocity: begins with u v w p q r.  room: scratch, shape (ROOM,).
    """
    table = tail_of(p, int(p.computed.learned))
    kernels, count = int(table[0]), int(table[1])
    size = count * _ROWS * LANES
    x, force = room[:AXES], room[AXES : 2 * AXES]
    lanes = room[2 * AXES :].reshape((2 + AXES, LANES))
    f1, f2, f3, f4, f5, f6 = table[3], table[4], table[5], table[6], table[7], table[8]
    for i in range(AXES):
        term, at = abs(velocity[0]) * velocity[i], _TREND + AXES * i
        f1 += term * table[at]
        f2 += term * table[at + 1]
        f3 += term * table[at + 2]
        f4 += term * table[at + 3]
        f5 += term * table[at + 4]
        f6 += term * table[at + 5]
    for k in range(kernels):
        at = _HEAD + kernels + k * size
        _scale(velocity, table, BITS / table[_HEAD + k], x)
        radial_sums(x, table[at : at + size].reshape((count, _ROWS, LANES)), lanes, force)
        f1 += force[0]
        f2 += force[1]
        f3 += force[2]
        f4 += force[3]
        f5 += force[4]
        f6 += force[5]
    return -f1, -f2, -f3, -f4, -f5, -f6


@outlined
def support_distance(p, velocity, room):
    """Distance of a velocity from the nearest one in the table after p, relative to its reach; arguments as above."""
    table = tail_of(p, int(p.computed.learned))
    kernels, count = int(table[0]), int(table[1])
    at, size = _HEAD + kernels, count * _ROWS * LANES
    x, lanes = room[:AXES], room[2 * AXES :].reshape((2 + AXES, LANES))
    _scale(velocity, table, BITS / table[_HEAD], x)
    return radial_distance(x, table[at : at + size].reshape((count, _ROWS, LANES)), lanes) * table[_HEAD] / table[2]


def trend_terms(velocities: np.ndarray) -> np.ndarray:
    """|u| times each velocity, (n, 6)."""
    rows = np.atleast_2d(np.asarray(velocities, dtype=float))
    return np.abs(rows[:, :1]) * rows


@dataclass(frozen=True, eq=False)
class LearnedHull:
    """Learned forces C(v)v + D(v)v, N and N m: bias + |u| v trend + sum_kj coefficients[k, j] exp(-(d_j / sigma_k)^2).

    d_j = |(v - support[j]) / spread|.  support: (n, 6), u v w p q r, m/s and rad/s.  spread: (6,).  sigma: (kernels,),
    in spreads.  coefficients: (kernels, n, 6).  bias: (6,).  reach: the largest d to the nearest centre for which a
    velocity is similar to the training data.  trend: (6, 6), lift and damping proportional to the speed, a row for each
    velocity, a column for each force.  Raises for mismatched shapes and non-finite numbers.
    """

    support: np.ndarray
    spread: np.ndarray
    sigma: np.ndarray
    coefficients: np.ndarray
    bias: np.ndarray
    reach: float
    trend: np.ndarray = field(default_factory=lambda: np.zeros((AXES, AXES)))

    def __post_init__(self):
        n, kernels = len(self.support), len(self.sigma)
        expected = {
            "support": (n, AXES),
            "spread": (AXES,),
            "sigma": (kernels,),
            "coefficients": (kernels, n, AXES),
            "bias": (AXES,),
            "trend": (AXES, AXES),
        }
        for name, shape in expected.items():
            value = getattr(self, name)
            if np.shape(value) != shape or not np.isfinite(value).all() or not n or not kernels:
                raise ValueError(
                    f"LearnedHull needs finite {name} of shape {shape}, with at least one centre and one kernel, got "
                    f"shape {np.shape(value)}{'' if np.isfinite(value).all() else ' with values that are not finite'}."
                )
        if not (np.min(self.spread) > 0.0 and np.min(self.sigma) > 0.0 and 0.0 < self.reach < np.inf):
            raise ValueError(
                f"LearnedHull needs spread, sigma and reach > 0, got {self.spread}, {self.sigma} and {self.reach!r}."
            )

    @classmethod
    def silent(cls) -> LearnedHull:
        """A hull without any force of its own."""
        return cls(np.zeros((1, AXES)), np.ones(AXES), np.ones(1), np.zeros((1, 1, AXES)), np.zeros(AXES), 1.0)

    @cached_property
    def table(self) -> np.ndarray:
        """The numbers for compiled code, flat."""
        blocks = [
            radial_blocks(self.support, 1.0 / (self.spread * sigma), coefficients)
            for sigma, coefficients in zip(self.sigma, self.coefficients, strict=True)
        ]
        head = [len(self.sigma), len(blocks[0]), self.reach]
        numbers = [head, self.bias, 1.0 / self.spread, np.ravel(self.trend), self.sigma]
        return np.concatenate([*numbers, *(block.ravel() for block in blocks)])

    def __call__(self, velocities: np.ndarray) -> np.ndarray:
        """C(v)v + D(v)v, N and N m, at velocities of shape (n, 6); same shape."""
        x = np.atleast_2d(np.asarray(velocities, dtype=float)) / self.spread
        square = ((x[:, None] - (self.support / self.spread)[None]) ** 2).sum(axis=2)
        parts = [np.exp(-square / sigma**2) @ c for sigma, c in zip(self.sigma, self.coefficients, strict=True)]
        return np.sum(parts, axis=0) + self.bias + trend_terms(velocities) @ self.trend

    def outside(self, record: Any) -> float:
        """The share of a record's samples with velocities unlike the training data; unmeasured ones do not count."""
        found = self.distance_along(record)
        return float((found[np.isfinite(found)] > 1.0).mean())

    def distance_along(self, record: Any) -> np.ndarray:
        """The `distance` of a record's velocities, one value per sample, NaN where they were not measured."""
        return self.distance(np.column_stack([record[name] for name in VELOCITIES]))

    def distance(self, velocities: np.ndarray) -> np.ndarray:
        """Distance of velocities (n, 6) from the nearest centre, over `reach`: above 1 is extrapolation. Shape (n,)."""
        x, centres = np.atleast_2d(np.asarray(velocities, dtype=float)) / self.spread, self.support / self.spread
        square = np.full(len(x), np.inf)
        for centre in centres:
            square = np.minimum(square, ((x - centre) ** 2).sum(axis=1))  # NaN stays NaN
        return np.sqrt(square) / self.reach
