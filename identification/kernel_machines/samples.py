"""Checked samples of one regression, in the form of all kernel machines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from identification.kernel_machines.machine import KernelMachine

FEWEST = 3
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Samples:
    """Inputs x (n, d), targets y (n, m) and weights (n,), in arrays of their own; inputs are divided by scale (d,).

    middle: mean inputs, (d,).  flat: y came as (n,).
    """

    x: np.ndarray
    y: np.ndarray
    weights: np.ndarray
    middle: np.ndarray
    scale: np.ndarray
    flat: bool

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray, weights: np.ndarray | None, scaled: bool, what: str) -> Samples:
        """The samples of the regression named `what`; raises if no machine can be made of them."""
        rows, targets = np.array(x, dtype=float), np.array(y, dtype=float)
        flat = targets.ndim == 1
        targets = targets[:, None] if flat else targets
        shares = np.ones(len(rows)) if weights is None else np.array(weights, dtype=float)
        _check(rows, targets, shares, what)
        scale = rows.std(axis=0) if scaled else np.ones(rows.shape[1])
        return cls(rows, targets, shares, rows.mean(axis=0), scale, flat)

    @cached_property
    def scaled(self) -> np.ndarray:
        """Inputs relative to their middle, over scale, (n, d)."""
        return (self.x - self.middle) / self.scale

    @property
    def varies(self) -> np.ndarray:
        """Which outputs are not constant, (m,)."""
        return np.ptp(self.y, axis=0) > 0.0

    @cached_property
    def variance(self) -> np.ndarray:
        """Weighted variances of the outputs that vary; raises if none does."""
        if not self.varies.any():
            raise ValueError("Tuning needs an output that varies, got constants alone: fit without tuning.")
        return np.average(self._centred**2, axis=0, weights=self.weights)

    @cached_property
    def standard(self) -> np.ndarray:
        """The outputs that vary, scaled to zero weighted mean and unit weighted variance."""
        return self._centred / np.sqrt(self.variance)

    @property
    def _centred(self) -> np.ndarray:
        varying = self.y[:, self.varies]
        return varying - np.average(varying, axis=0, weights=self.weights)

    def spread_rows(self, most: int) -> np.ndarray:
        """Rows of at most `most` samples, spread evenly over the record."""
        return np.unique(np.linspace(0, len(self.x) - 1, min(most, len(self.x))).round().astype(int))

    def rows(self, rows: np.ndarray) -> Samples:
        """Some of the samples, with the middle and scale of all."""
        return replace(self, x=self.x[rows], y=self.y[rows], weights=self.weights[rows])

    def column(self, output: int) -> Samples:
        """The samples with one of their outputs."""
        return replace(self, y=self.y[:, [output]], flat=True)

    def machine(
        self,
        sigma: float | None,
        support: np.ndarray,
        coefficients: np.ndarray,
        bias: np.ndarray,
        leave_one_out: np.ndarray,
        notes: tuple[str, ...] = (),
    ) -> KernelMachine:
        """The machine with a solution's coefficients; a constant output has only its bias, and a note."""
        return KernelMachine(
            support=support,
            coefficients=np.ascontiguousarray(np.where(self.varies, coefficients, 0.0)),
            bias=np.where(self.varies, bias, self.y[0]),
            middle=self.middle,
            scale=self.scale,
            sigma=sigma,
            leave_one_out=np.where(self.varies, leave_one_out, 0.0),
            flat=self.flat,
            notes=notes
            + tuple(
                f"output {o} is {self.y[0, o]:g} in every sample: its machine is the bias alone"
                for o in np.flatnonzero(~self.varies)
            ),
        )


def _check(x: np.ndarray, y: np.ndarray, weights: np.ndarray, what: str) -> None:
    if x.ndim != 2 or y.ndim != 2 or weights.shape != (len(x),) or len(y) != len(x) or not x.shape[1]:
        raise ValueError(
            f"{what} needs x (n, d), y (n,) or (n, m) and weights (n,), got shapes "
            f"{x.shape}, {y.shape} and {weights.shape}: one row for each sample."
        )
    if len(x) < FEWEST:
        raise ValueError(f"{what} needs at least {FEWEST} samples, got {len(x)}: record longer.")
    bad = ~(np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1))
    if bad.any():
        raise ValueError(
            f"{what} needs finite inputs and targets, got {int(bad.sum())} of {bad.size} samples without, "
            f"first in row {int(np.argmax(bad))}: leave those out."
        )
    if not (np.isfinite(weights) & (weights > 0.0)).all():
        raise ValueError(f"{what} needs finite weights > 0, got others: leave out samples of no weight.")
    for column in np.flatnonzero(np.ptp(x, axis=0) <= 8.0 * EPS * np.abs(x).max(axis=0)):
        raise ValueError(
            f"{what} needs inputs that vary, got {x[0, column]:g} in every sample of column {column}: leave "
            "it out, or excite it."
        )
