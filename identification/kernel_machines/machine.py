"""A trained kernel machine, and its predictions in compiled code."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from auv_gym.compiled import compiled
from auv_gym.physics.radial import BITS, radial_blocks, radial_sums


@compiled
def sums_of_rows(x, blocks, out):
    """Write `radial_sums` at every row of x (n, d) into out (n, m)."""
    room = np.empty((2 + out.shape[1], blocks.shape[2]))
    for i in range(x.shape[0]):
        radial_sums(x[i], blocks, room, out[i])


@dataclass(frozen=True, eq=False)
class KernelMachine:
    """f(x) = sum_j coefficients[j] K(x, support[j]) + bias, of several outputs that share their kernel.

    K(x, c) = exp(-|(x - c) / scale|^2 / sigma^2), or with sigma None the sum of (x - middle)(c - middle) / scale^2.
    support: (n, d), in the units of x.  coefficients: (n, m).  bias: (m,).  leave_one_out: (n, m), the error at each
    training sample of the machine trained without it.  flat: outputs are (n,), as the target was.
    notes: remarks for the reader of the fit.
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
        """1 / (scale sigma), (d,), the factor of differences; 1 / scale for the linear kernel."""
        return 1.0 / (self.scale * (1.0 if self.sigma is None else self.sigma))

    @cached_property
    def weights(self) -> np.ndarray:
        """Slopes of the outputs of a linear kernel, (d, m): f(x) = (x - middle) @ weights + bias."""
        return ((self.support - self.middle) / self.scale**2).T @ self.coefficients

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Outputs at the rows of x, (n, m), or (n,) if the target was one column."""
        rows = self._rows(x)
        if self.sigma is None:
            out = (rows - self.middle) @ self.weights + self.bias
        else:
            out = np.empty((len(rows), self.bias.size))
            sums_of_rows((rows - self.middle) * (self.rate * BITS), self._blocks, out)
            out += self.bias
        return out[:, 0] if self.flat else out

    @cached_property
    def _blocks(self) -> np.ndarray:
        return radial_blocks(self.support - self.middle, self.rate, self.coefficients)

    def _rows(self, x: np.ndarray) -> np.ndarray:
        rows = np.ascontiguousarray(x, dtype=float)
        if rows.ndim != 2 or rows.shape[1] != self.support.shape[1]:
            raise ValueError(
                f"KernelMachine needs rows of {self.support.shape[1]} inputs, got an array of shape {rows.shape}: "
                "pass one sample as x[None]."
            )
        if not np.isfinite(rows).all():
            bad = int(np.argmin(np.isfinite(rows).all(axis=1)))
            raise ValueError(f"KernelMachine needs finite inputs, got {rows[bad]} in row {bad}: leave such rows out.")
        return rows
