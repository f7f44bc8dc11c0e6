"""A trained kernel machine, and its predictions in compiled code."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from auv_gym.compiled import compiled
from auv_gym.physics.radial import BITS, radial_blocks, radial_distances, radial_sums


@compiled
def sums_of_rows(x, blocks, out):
    """`radial_sums` at every row of x (n, d), into out (n, m)."""
    room = np.empty((2 + out.shape[1], blocks.shape[2]))
    for i in range(x.shape[0]):
        radial_sums(x[i], blocks, room, out[i])


@compiled
def radial_slopes(x, support, rate, coefficients, out):
    """Writes the derivative by x[k] of sum_j coefficients[j, o] exp(-|(x - support[j]) rate|^2) into out[o, k]."""
    out[:, :] = 0.0
    for j in range(support.shape[0]):
        square = 0.0
        for k in range(support.shape[1]):
            part = (x[k] - support[j, k]) * rate[k]
            square += part * part
        kernel = -2.0 * np.exp(-square)
        for k in range(support.shape[1]):
            slope = kernel * (x[k] - support[j, k]) * rate[k] * rate[k]
            for o in range(out.shape[0]):
                out[o, k] += coefficients[j, o] * slope


@dataclass(frozen=True, eq=False)
class KernelMachine:
    """f(x) = sum_j coefficients[j] K(x, support[j]) + bias, of several outputs that share their kernel.

    K(x, c) = exp(-|(x - c) / scale|^2 / sigma^2), or with sigma None (x - middle)(c - middle) / scale^2, summed.
    support: (n, d), in the units of x.  coefficients: (n, m).  bias: (m,).  leave_one_out: (n, m), the error
    at each training sample of the machine without it.  flat: outputs come as (n,), as the target did.
    notes: what a reader of the fit should know.
    """

    support: np.ndarray
    coefficients: np.ndarray
    bias: np.ndarray
    middle: np.ndarray
    scale: np.ndarray
    sigma: float | None
    leave_one_out: np.ndarray
    flat: bool = False
    notes: tuple[str, ...] = ()

    @property
    def rate(self) -> np.ndarray:
        """1 / (scale sigma), (d,): what differences are multiplied by; 1 / scale for the linear kernel."""
        return 1.0 / (self.scale * (1.0 if self.sigma is None else self.sigma))

    @cached_property
    def weights(self) -> np.ndarray:
        """Slopes of the outputs of a linear kernel, (d, m): f(x) = (x - middle) @ weights + bias."""
        return ((self.support - self.middle) / self.scale**2).T @ self.coefficients

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Outputs at the rows of x, (n, m), or (n,) where the target was one column."""
        rows = self._rows(x)
        if self.sigma is None:
            out = (rows - self.middle) @ self.weights + self.bias
        else:
            out = np.empty((len(rows), self.bias.size))
            sums_of_rows((rows - self.middle) * (self.rate * BITS), self._blocks, out)
            out += self.bias
        return out[:, 0] if self.flat else out

    def slopes(self, x: np.ndarray) -> np.ndarray:
        """Derivatives of the outputs by x at its rows, (n, m, d)."""
        rows = self._rows(x)
        if self.sigma is None:
            return np.repeat(self.weights.T[None], len(rows), axis=0)
        out = np.empty((len(rows), self.bias.size, rows.shape[1]))
        for row, slopes in zip(rows, out):
            radial_slopes(row, self.support, self.rate, self.coefficients, slopes)
        return out

    def distance(self, x: np.ndarray) -> np.ndarray:
        """How far each row of x is from the nearest one of the support, in scaled units, (n,), to some 1e-8."""
        rows = self._rows(x)
        out = np.empty(len(rows))
        radial_distances((rows - self.middle) * (BITS / self.scale), self._centres, out)
        return out

    @cached_property
    def _blocks(self) -> np.ndarray:
        return radial_blocks(self.support - self.middle, self.rate, self.coefficients)

    @cached_property
    def _centres(self) -> np.ndarray:
        return radial_blocks(self.support - self.middle, 1.0 / self.scale, np.empty((len(self.support), 0)))

    def _rows(self, x: np.ndarray) -> np.ndarray:
        rows = np.ascontiguousarray(x, dtype=float)
        if rows.ndim != 2 or rows.shape[1] != self.support.shape[1]:
            raise ValueError(
                f"KernelMachine needs rows of {self.support.shape[1]} inputs, got an array of shape {rows.shape}: "
                "pass one sample as x[None]."
            )
        return rows
