"""Least-squares support vector regression of several outputs on the same inputs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy import linalg

from identification.kernel.bordered import Solution, Spectrum, solved, squared_distances
from identification.kernel.machine import KernelMachine

FEWEST = 3
EPS = float(np.finfo(float).eps)
FLATTEST = 1e-12  # of 1 - K between the two samples farthest apart: below it, rounding is all that tells them apart


@dataclass(frozen=True)
class LsSvmRegression:
    """Settings of an LS-SVM regression.

    penalty: C; a larger one trusts the data more, inf goes through every sample.
    sigma: width of the radial kernel exp(-|x - c|^2 / sigma^2), in spreads of the inputs where `scaled`, else in their
    units; the linear kernel has none.
    scaled: each input is divided by its standard deviation over the training samples, which the machine keeps.
    """

    penalty: float = 1e3
    sigma: float = 1.0
    kernel: Literal["rbf", "linear"] = "rbf"
    scaled: bool = True

    def __post_init__(self) -> None:
        if self.kernel not in ("rbf", "linear"):
            raise ValueError(f"LsSvmRegression needs kernel 'rbf' or 'linear', got {self.kernel!r}.")
        if not self.penalty > 0.0:
            raise ValueError(
                f"LsSvmRegression needs penalty > 0, got {self.penalty!r}: a larger one trusts the data more."
            )
        if not 0.0 < self.sigma < np.inf:
            raise ValueError(
                f"LsSvmRegression needs a finite sigma > 0, got {self.sigma!r}: a larger one gives a smoother function."
            )

    def fit(self, x: np.ndarray, y: np.ndarray, weights: np.ndarray | None = None) -> KernelMachine:
        """The machine of samples x (n, d) with targets y (n,) or (n, m); sample i has the penalty C weights[i]."""
        training = Training.of(x, y, weights, self)
        try:
            solution = solved(training.kernel(self.sigma), 1.0 / (self.penalty * training.weights), training.y)
        except linalg.LinAlgError:
            raise ValueError(_singular(training, self.penalty)) from None
        return training.machine(solution, self.sigma)


@dataclass(frozen=True, eq=False)
class Training:
    """Checked samples of one regression, what every C and sigma share.

    x: (n, d), y: (n, m).  weights: (n,).  middle, scale: (d,).  square: (n, n) squared distances of scaled inputs, or
    their products for the linear kernel.  flat: y came as (n,).
    """

    x: np.ndarray
    y: np.ndarray
    weights: np.ndarray
    middle: np.ndarray
    scale: np.ndarray
    square: np.ndarray
    radial: bool
    flat: bool

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray, weights: np.ndarray | None, settings: LsSvmRegression) -> Training:
        """The samples, in arrays of their own; raises where no machine can be made of them."""
        rows, targets = np.array(x, dtype=float), np.array(y, dtype=float)
        flat = targets.ndim == 1
        targets = targets[:, None] if flat else targets
        shares = np.ones(len(rows)) if weights is None else np.array(weights, dtype=float)
        _check(rows, targets, shares)
        middle = rows.mean(axis=0)
        scale = rows.std(axis=0) if settings.scaled else np.ones(rows.shape[1])
        scaled = (rows - middle) / scale
        radial = settings.kernel == "rbf"
        square = squared_distances(scaled) if radial else scaled @ scaled.T
        return cls(rows, targets, shares, middle, scale, square, radial, flat)

    @cached_property
    def reach(self) -> tuple[float, float]:
        """The sigmas between which the kernel matrix is neither the unit matrix nor constant, to rounding."""
        apart = self.square[self.square > 0.0]
        return float(np.sqrt(apart.min() / -np.log(EPS))), float(np.sqrt(apart.max() / FLATTEST))

    def kernel(self, sigma: float) -> np.ndarray:
        """The kernel matrix (n, n); raises where sigma is out of reach."""
        if not self.radial:
            return self.square
        least, most = self.reach
        if not least <= sigma <= most:
            what = (
                "the unit matrix: no sample tells of another" if sigma < least else "constant: all samples look alike"
            )
            raise ValueError(
                f"LsSvmRegression needs sigma from {least:.3g} to {most:.3g} for these samples, got {sigma:g}, where "
                f"the kernel is {what}. Choose one near the median distance of samples, "
                f"{np.sqrt(np.median(self.square)):.3g}."
            )
        return np.exp(self.square / -(sigma * sigma))

    def part(self, most: int) -> Training:
        """At most this many of the samples, spread evenly over the record."""
        if len(self.x) <= most:
            return self
        rows = np.linspace(0, len(self.x) - 1, most).round().astype(int)
        return replace(
            self, x=self.x[rows], y=self.y[rows], weights=self.weights[rows], square=self.square[np.ix_(rows, rows)]
        )

    def spectrum(self, sigma: float) -> Spectrum:
        """What the solutions of all C at one sigma share."""
        return Spectrum.of(self.kernel(sigma), self.weights)

    def machine(self, solution: Solution, sigma: float) -> KernelMachine:
        """The machine with a solution's coefficients; a constant output has its bias alone, and a note."""
        constant = np.ptp(self.y, axis=0) == 0.0
        coefficients = np.where(constant, 0.0, solution.coefficients)
        return KernelMachine(
            support=self.x,
            coefficients=np.ascontiguousarray(coefficients),
            bias=np.where(constant, self.y[0], solution.bias),
            middle=self.middle,
            scale=self.scale,
            sigma=sigma if self.radial else None,
            leave_one_out=np.where(constant, 0.0, solution.leave_one_out),
            flat=self.flat,
            notes=tuple(
                f"output {o} is {self.y[0, o]:g} in every sample: its machine is the bias alone"
                for o in np.flatnonzero(constant)
            ),
        )


def _check(x: np.ndarray, y: np.ndarray, weights: np.ndarray) -> None:
    if x.ndim != 2 or y.ndim != 2 or weights.shape != (len(x),) or len(y) != len(x) or not x.shape[1]:
        raise ValueError(
            "LsSvmRegression needs x (n, d), y (n,) or (n, m) and weights (n,), got shapes "
            f"{x.shape}, {y.shape} and {weights.shape}: one row for each sample."
        )
    if len(x) < FEWEST:
        raise ValueError(f"LsSvmRegression needs at least {FEWEST} samples, got {len(x)}: record longer.")
    bad = ~(np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1))
    if bad.any():
        raise ValueError(
            f"LsSvmRegression needs finite inputs and targets, got {int(bad.sum())} of {bad.size} samples without, "
            f"first in row {int(np.argmax(bad))}: leave those out."
        )
    if not (np.isfinite(weights) & (weights > 0.0)).all():
        raise ValueError("LsSvmRegression needs finite weights > 0, got others: leave out samples of no weight.")
    for column in np.flatnonzero(np.ptp(x, axis=0) <= 8.0 * EPS * np.abs(x).max(axis=0)):
        raise ValueError(
            f"LsSvmRegression needs inputs that vary, got {x[0, column]:g} in every sample of column {column}: leave "
            "it out, or excite it."
        )


def _singular(training: Training, penalty: float) -> str:
    twins = len(training.x) - len(np.unique(training.x, axis=0))
    why = f"{twins} samples repeat another's inputs" if twins else "neighbouring samples are alike to rounding"
    return (
        f"LsSvmRegression cannot solve {len(training.x)} samples at penalty {penalty:g}: the kernel matrix is singular "
        f"to rounding, as {why}. Lower penalty, or sigma, or leave samples out."
    )
