"""LS-SVM regression of long records with a given number of centres, however many samples there are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from identification.kernel_machines.bordered import squared_distances
from identification.kernel_machines.centres import farthest, of_largest_entropy
from identification.kernel_machines.machine import KernelMachine
from identification.kernel_machines.primal import Primal
from identification.kernel_machines.regression import Distances, sigma_problem
from identification.kernel_machines.samples import Samples


@dataclass(frozen=True)
class FixedSize:
    """Settings of an LS-SVM regression with radial kernels around some of the samples, fitted to all of them.

    penalty, sigma, scaled: as in `LsSvmRegression`, whose machine is the limit of this one as size grows.
    size: number of centres; all samples if there are fewer.
    centres: "farthest", each as far as possible from the earlier ones, or "entropy", swapped until their entropy is
    large.

    Example:

        >>> import numpy as np
        >>> from identification import FixedSize
        >>> x = np.linspace(-3, 3, 200)[:, None]
        >>> machine = FixedSize(size=20).fit(x, np.sin(x))
        >>> machine(np.array([[0.5]])).round(2)
        array([[0.48]])
    """

    penalty: float = 1e3
    sigma: float = 1.0
    size: int = 256
    centres: Literal["farthest", "entropy"] = "farthest"
    scaled: bool = True

    def __post_init__(self) -> None:
        if self.centres not in ("farthest", "entropy"):
            raise ValueError(f"FixedSize needs centres 'farthest' or 'entropy', got {self.centres!r}.")
        if not self.penalty > 0.0:
            raise ValueError(f"FixedSize needs penalty > 0, got {self.penalty!r}: a larger one trusts the data more.")
        if not 0.0 < self.sigma < np.inf:
            raise ValueError(
                f"FixedSize needs a finite sigma > 0, got {self.sigma!r}: a larger one gives a smoother function."
            )
        if not (isinstance(self.size, int) and self.size >= 2):
            raise ValueError(f"FixedSize needs a whole size of 2 or more, got {self.size!r}: some 256 serve well.")

    def fit(
        self,
        x: np.ndarray,
        y: np.ndarray,
        weights: np.ndarray | None = None,
        rng: np.random.Generator | None = None,
    ) -> KernelMachine:
        """The machine of samples x (n, d) with targets y (n,) or (n, m); sample i has the penalty C weights[i].

        rng: to draw centres of large entropy.  Leave-one-out errors are those with the same centres.
        """
        return Reduced.of(x, y, weights, self, rng).fitted(self)


def fit_each(
    settings: Sequence[FixedSize],
    x: np.ndarray,
    y: np.ndarray,
    weights: np.ndarray | None = None,
    rng: np.random.Generator | None = None,
) -> tuple[KernelMachine, ...]:
    """A machine for each output of y (n, m), each with C and sigma of its own, around the same centres."""
    alike = {(one.size, one.centres, one.scaled) for one in settings}
    if np.ndim(y) != 2 or len(settings) != np.shape(y)[1] or len(alike) != 1:
        raise ValueError(
            "fit_each needs y (n, m) and settings for each of its outputs, alike in all but C and sigma, got y of "
            f"shape {np.shape(y)} and {len(settings)} settings with {sorted(alike)}."
        )
    columns = Reduced.of(x, y, weights, settings[0], rng).columns()
    return tuple(column.fitted(one) for column, one in zip(columns, settings))


@dataclass(frozen=True, eq=False)
class Reduced:
    """Samples and the rows of the centres: what is common to every C and sigma.  asked: number of centres requested."""

    samples: Samples
    chosen: np.ndarray
    asked: int
    between: Distances  # of the centres

    @classmethod
    def of(
        cls,
        x: np.ndarray,
        y: np.ndarray,
        weights: np.ndarray | None,
        settings: FixedSize,
        rng: np.random.Generator | None,
    ) -> Reduced:
        """The samples, in arrays of their own; raises if no machine can be made of them."""
        samples = Samples.of(x, y, weights, settings.scaled, "FixedSize")
        if settings.centres == "farthest":
            chosen = farthest(samples.scaled, settings.size)
        elif rng is None:
            raise ValueError("FixedSize needs rng for centres of large entropy, got none: pass a numpy Generator.")
        else:
            chosen = of_largest_entropy(samples.scaled, settings.size, rng)
        between = Distances(squared_distances(samples.scaled[chosen]), radial=True)
        return cls(samples, chosen, min(settings.size, len(samples.x)), between)

    @cached_property
    def scaled(self) -> np.ndarray:
        """Centres relative to the middle of the inputs, over scale, (m, d)."""
        return self.samples.scaled[self.chosen]

    def columns(self) -> list[Reduced]:
        """The reduced samples for each output alone."""
        return [
            Reduced(self.samples.column(o), self.chosen, self.asked, self.between)
            for o in range(self.samples.y.shape[1])
        ]

    def primal(self, sigma: float, rows: np.ndarray | slice = slice(None)) -> Primal:
        """The system at a sigma, of some of the samples around all centres; raises if sigma is out of range."""
        least, most = self.between.reach
        if not least <= sigma <= most:
            raise ValueError(sigma_problem("FixedSize", sigma, self.between.reach, self.between.median))
        samples = self.samples
        return Primal.of(samples.scaled[rows] / sigma, samples.y[rows], samples.weights[rows], self.scaled / sigma)

    def fitted(self, settings: FixedSize) -> KernelMachine:
        """The machine of all samples."""
        primal = self.primal(settings.sigma)
        solution = primal.solution(settings.penalty)
        notes = []
        if len(self.chosen) < self.asked:
            notes.append(f"{len(self.chosen)} centres instead of {self.asked}: no more samples differ in their inputs")
        if len(primal.kept) < len(self.chosen):
            notes.append(
                f"{len(self.chosen) - len(primal.kept)} of {len(self.chosen)} centres carry nothing: at sigma "
                f"{settings.sigma:g} the others say the same to rounding"
            )
        return self.samples.machine(
            settings.sigma,
            self.samples.x[self.chosen],
            solution.coefficients,
            solution.bias,
            solution.leave_one_out,
            tuple(notes),
        )
