"""Least-squares support vector regression of several outputs on the same inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy import linalg

from identification.kernel_machines.bordered import Spectrum, solved, squared_distances
from identification.kernel_machines.machine import KernelMachine
from identification.kernel_machines.samples import EPS, Samples

FLATTEST = 1e-12  # least 1 - K between the two samples farthest apart: below it, they differ only by rounding


@dataclass(frozen=True)
class LsSvmRegression:
    """Settings of an LS-SVM regression.

    penalty: C; a larger one trusts the data more, inf goes through every sample.
    sigma: width of the radial kernel exp(-|x - c|^2 / sigma^2), in spreads of the inputs if `scaled`, else in their
    units; the linear kernel has none.
    scaled: whether each input is divided by its standard deviation over the training samples, which the machine keeps.

    Example:

        >>> import numpy as np
        >>> from identification import LsSvmRegression
        >>> x = np.linspace(-3, 3, 50)[:, None]
        >>> machine = LsSvmRegression(penalty=100.0).fit(x, np.sin(x))
        >>> machine(np.array([[0.5]])).round(2)
        array([[0.48]])
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
        return Training.of(x, y, weights, self).fitted(self)


def fit_each(
    settings: Sequence[LsSvmRegression], x: np.ndarray, y: np.ndarray, weights: np.ndarray | None = None
) -> tuple[KernelMachine, ...]:
    """A machine for each output of y (n, m), each with settings of its own; distances are computed once.

    The settings must agree in kernel and in `scaled`, such as those of `descend_each`.
    """
    alike = {(one.kernel, one.scaled) for one in settings}
    if np.ndim(y) != 2 or len(settings) != np.shape(y)[1] or len(alike) != 1:
        raise ValueError(
            "fit_each needs y (n, m) and settings for each of its outputs, alike in kernel and in `scaled`, got y of "
            f"shape {np.shape(y)} and {len(settings)} settings with {sorted(alike)}."
        )
    columns = Training.of(x, y, weights, settings[0]).columns()
    return tuple(column.fitted(one) for column, one in zip(columns, settings))


@dataclass(frozen=True, eq=False)
class Distances:
    """Squared distances of scaled inputs, or their products for the linear kernel, (n, n), and derived quantities."""

    square: np.ndarray
    radial: bool

    @cached_property
    def reach(self) -> tuple[float, float]:
        """The range of sigma in which the kernel matrix is neither the unit matrix nor constant, to rounding."""
        apart = self.square[self.square > 0.0]
        return sigma_range(float(apart.min()), float(apart.max()))

    @cached_property
    def median(self) -> float:
        """The median distance of samples that differ."""
        return float(np.sqrt(np.median(self.square[self.square > 0.0])))


def sigma_range(least: float, largest: float) -> tuple[float, float]:
    """The narrowest and the widest sigma for samples whose squared distances are from `least` to `largest`."""
    return float(np.sqrt(least / -np.log(EPS))), float(np.sqrt(largest / FLATTEST))


def sigma_problem(what: str, sigma: float, reach: tuple[float, float], median: float) -> str:
    """Why a machine cannot have this sigma, and which it can have."""
    least, most = reach
    why = "the unit matrix: no sample tells of another" if sigma < least else "constant: all samples look alike"
    return (
        f"{what} needs sigma from {least:.3g} to {most:.3g} for these samples, got {sigma:g}, where the kernel is "
        f"{why}. Choose one near the median distance of samples, {median:.3g}."
    )


@dataclass(frozen=True, eq=False)
class Training:
    """Samples and their distances, common to every C and sigma of a regression."""

    samples: Samples
    distances: Distances

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray, weights: np.ndarray | None, settings: LsSvmRegression) -> Training:
        """The samples, in arrays of their own; raises if no machine can be made of them."""
        samples = Samples.of(x, y, weights, settings.scaled, "LsSvmRegression")
        radial = settings.kernel == "rbf"
        scaled = samples.scaled
        return cls(samples, Distances(squared_distances(scaled) if radial else scaled @ scaled.T, radial))

    def kernel(self, sigma: float) -> np.ndarray:
        """The kernel matrix (n, n); raises if sigma is out of range."""
        if not self.distances.radial:
            return self.distances.square
        least, most = self.distances.reach
        if not least <= sigma <= most:
            raise ValueError(sigma_problem("LsSvmRegression", sigma, self.distances.reach, self.distances.median))
        return np.exp(self.distances.square / -(sigma * sigma))

    def part(self, most: int) -> Training:
        """At most `most` of the samples, spread evenly over the record; all if an output is constant in those alone."""
        rows = self.samples.spread_rows(most)
        samples = self.samples.rows(rows)
        if len(rows) == len(self.samples.x) or (samples.varies != self.samples.varies).any():
            return self
        return Training(samples, replace(self.distances, square=self.distances.square[np.ix_(rows, rows)]))

    def columns(self) -> list[Training]:
        """The training data for each output alone."""
        return [replace(self, samples=self.samples.column(o)) for o in range(self.samples.y.shape[1])]

    def spectrum(self, sigma: float) -> Spectrum:
        """The part of the solutions at one sigma that is common to all C."""
        return Spectrum.of(self.kernel(sigma), self.samples.weights)

    def fitted(self, settings: LsSvmRegression) -> KernelMachine:
        """The machine of all samples."""
        ridge = 1.0 / (settings.penalty * self.samples.weights)
        try:
            solution = solved(self.kernel(settings.sigma), ridge, self.samples.y)
        except linalg.LinAlgError:
            raise ValueError(_singular(self.samples.x, settings.penalty)) from None
        return self.samples.machine(
            settings.sigma if self.distances.radial else None,
            self.samples.x,
            solution.coefficients,
            solution.bias,
            solution.leave_one_out,
        )


def _singular(x: np.ndarray, penalty: float) -> str:
    twins = len(x) - len(np.unique(x, axis=0))
    why = f"{twins} samples repeat another's inputs" if twins else "neighbouring samples are alike to rounding"
    return (
        f"LsSvmRegression cannot solve {len(x)} samples at penalty {penalty:g}: the kernel matrix is singular "
        f"to rounding, as {why}. Lower penalty, or sigma, or leave samples out."
    )
