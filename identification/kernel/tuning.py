"""Penalty and width of an LS-SVM regression by its leave-one-out error: simulated annealing, or descent by gradient.

Both minimise the same loss, the mean over the outputs of log(mean square leave-one-out error / variance), weighted as
the samples are, over log C and log sigma; outputs that are given together share the C and sigma that come out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy import linalg, optimize

from identification.kernel.bordered import eliminated
from identification.kernel.regression import EPS, LsSvmRegression, Training

Progress = Callable[[float, str], Any]
FAILED = 50.0  # loss of a system that rounding makes singular: far above any, and finite for the searches
DIGITS_KEPT = (
    1e3  # C is at most 1 / (this n EPS): the inverse then keeps three digits, and its condition is below 1 / EPS
)
WIDTHS = 0.1, 100.0  # sigmas searched, in median distances between samples
LEAST_PENALTY = 1e-2
SCAN_SAMPLES, SCAN_WIDTHS, SCAN_PENALTIES = 300, 12, 24
FEW_SAMPLES = 600
SETTLED, SETTLED_ON_FEW = 1e-4, 1e-6


@dataclass(frozen=True)
class Tuned:
    """The settings of least leave-one-out error.

    errors: mean square leave-one-out error of each output, in its units squared.  loss: what was minimised.
    evaluations: times that a system of all samples was solved.
    """

    settings: LsSvmRegression
    errors: tuple[float, ...]
    loss: float
    evaluations: int


def anneal(
    settings: LsSvmRegression,
    x: np.ndarray,
    y: np.ndarray,
    rng: np.random.Generator,
    *,
    weights: np.ndarray | None = None,
    evaluations: int = 400,
    progress: Progress = lambda fraction, text: None,
) -> Tuned:
    """Settings with C and sigma found by simulated annealing, which takes as many evaluations as it is given."""
    if evaluations < 1:
        raise ValueError(f"anneal needs at least one evaluation, got {evaluations}: some 400 settle C and sigma.")
    search = _Search.of(settings, Training.of(x, y, weights, settings), evaluations, progress)
    named: Any = {"seed": rng}  # scipy's own name for it changes from version to version; this one all of them take
    optimize.dual_annealing(
        lambda at: search(at)[0],
        search.bounds,
        **named,
        maxiter=evaluations,
        maxfun=evaluations,
        no_local_search=True,
    )
    return search.tuned()


def descend(
    settings: LsSvmRegression,
    x: np.ndarray,
    y: np.ndarray,
    *,
    weights: np.ndarray | None = None,
    starts: int = 3,
    evaluations: int = 60,
    progress: Progress = lambda fraction, text: None,
) -> Tuned:
    """Settings with C and sigma found by L-BFGS-B, with the gradient in closed form.

    A grid over C and sigma for 300 samples, one spectrum for each sigma, gives the starts; its best `starts` local
    minima are followed on 600 samples, spread evenly over the record, and the best of them on all, to 1e-4 of the loss.
    evaluations: on all samples, counted between line searches: the last one is finished.
    """
    if starts < 1 or evaluations < 1:
        raise ValueError(f"descend needs starts and evaluations from 1, got {starts} and {evaluations}.")
    training = Training.of(x, y, weights, settings)
    search = _Search.of(settings, training, evaluations, progress)
    part = training.part(FEW_SAMPLES)
    few = search if part is training else _Search.of(settings, part, evaluations, lambda fraction, text: None)
    for start in _scanned(settings, training.part(SCAN_SAMPLES))[:starts]:
        few.follow(start, SETTLED_ON_FEW)
    if few is not search:
        search.follow(few.at if few.at.size else few.middle, SETTLED)
    return search.tuned()


@dataclass(eq=False)
class _Search:
    """The loss as a function of (log C, log sigma), or of log C alone for the linear kernel; keeps the best point."""

    settings: LsSvmRegression
    training: Training
    y: np.ndarray  # of outputs that vary, with zero mean and unit variance
    bounds: list[tuple[float, float]]
    allowed: int
    progress: Progress
    count: int = 0
    best: float = np.inf
    at: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, settings: LsSvmRegression, training: Training, allowed: int, progress: Progress) -> _Search:
        varies = np.ptp(training.y, axis=0) > 0.0
        if not varies.any():
            raise ValueError("Tuning needs an output that varies, got constants alone: fit without tuning.")
        centred = training.y[:, varies] - np.average(training.y[:, varies], axis=0, weights=training.weights)
        spread = np.sqrt(np.average(centred**2, axis=0, weights=training.weights))
        most = 1.0 / (DIGITS_KEPT * EPS * len(centred) * training.weights.max())
        bounds = [(np.log(LEAST_PENALTY), np.log(most))]
        if training.radial:
            middle = np.sqrt(np.median(training.square[training.square > 0.0]))
            least, largest = training.reach
            narrow, wide = max(WIDTHS[0] * middle, 1.001 * least), min(WIDTHS[1] * middle, 0.999 * largest)
            bounds.append((np.log(narrow), np.log(wide)))
        else:  # its values are not at most 1, as the radial ones are
            size = np.trace(training.square) / len(centred)
            bounds = [(low - np.log(size), high - np.log(size)) for low, high in bounds]
        return cls(settings, training, centred / spread, bounds, allowed, progress)

    def settings_at(self, at: np.ndarray) -> LsSvmRegression:
        sigma = float(np.exp(at[1])) if self.training.radial else self.settings.sigma
        return replace(self.settings, penalty=float(np.exp(at[0])), sigma=sigma)

    def __call__(self, at: np.ndarray, gradient: bool = False) -> tuple[float, np.ndarray]:
        """Loss and, where asked, its gradient."""
        tried = self.settings_at(at)
        self.count += 1
        kernel = self.training.kernel(tried.sigma)
        ridge = 1.0 / (tried.penalty * self.training.weights)
        slope = np.zeros(len(at))
        try:
            projected, _ = eliminated(kernel, ridge)
        except linalg.LinAlgError:
            return FAILED, slope
        coefficients = projected @ self.y
        diagonal = np.diag(projected).copy()
        errors = coefficients / diagonal[:, None]
        shares = self.training.weights / self.training.weights.sum()
        squares = np.maximum(shares @ errors**2, np.finfo(float).tiny)
        loss = float(np.mean(np.log(squares)))
        if loss < self.best:
            self.best, self.at = loss, np.array(at)
        self.progress(min(self.count / self.allowed, 1.0), f"C {tried.penalty:.3g}, sigma {tried.sigma:.3g}")
        if gradient:
            # d G = -G dH G, so each slope is the inner product of dH with G diag(pull) G - (G push) coefficients'
            push = 2.0 * shares[:, None] * errors / (diagonal[:, None] * squares * squares.size)
            pull = np.sum(push * errors, axis=1)
            pushed = projected @ push
            half = projected * np.sqrt(pull)
            slope[0] = -ridge @ (np.sum(half**2, axis=1) - np.sum(pushed * coefficients, axis=1))
            if self.training.radial:
                change = kernel * self.training.square * (2.0 / tried.sigma**2)
                slope[1] = np.vdot(change, half @ half.T) - np.sum(pushed * (change @ coefficients))
        return loss, slope

    @property
    def middle(self) -> np.ndarray:
        return np.array([sum(pair) / 2.0 for pair in self.bounds])

    def follow(self, start: np.ndarray, settled: float) -> None:
        """Go down to the local minimum below a start, as far as evaluations are left."""
        if self.count >= self.allowed:
            return
        optimize.minimize(
            lambda at: self(at, gradient=True),
            np.clip(start, *np.transpose(self.bounds)),
            jac=True,
            method="L-BFGS-B",
            bounds=self.bounds,
            options={"maxfun": self.allowed - self.count, "ftol": settled, "gtol": settled},
        )

    def tuned(self) -> Tuned:
        """The best point visited."""
        if not self.at.size:
            raise ValueError(
                "Tuning found no C and sigma at which the system can be solved: leave out repeated samples."
            )
        best = self.settings_at(self.at)
        machine = best.fit(self.training.x, self.training.y, self.training.weights)
        errors = np.average(machine.leave_one_out**2, axis=0, weights=self.training.weights)
        return Tuned(best, tuple(errors.tolist()), self.best, self.count)


def _scanned(settings: LsSvmRegression, training: Training) -> list[np.ndarray]:
    """Local minima of the loss over a grid, best first."""
    search = _Search.of(settings, training, 0, lambda fraction, text: None)
    penalties = np.linspace(*search.bounds[0], SCAN_PENALTIES)
    widths = np.linspace(*search.bounds[1], SCAN_WIDTHS) if training.radial else np.zeros(1)
    losses = np.full((len(widths) + 2, len(penalties) + 2), np.inf)
    for row, width in enumerate(widths):
        errors = training.spectrum(float(np.exp(width))).leave_one_out(np.exp(penalties), search.y)
        squares = np.einsum("i,cio->co", training.weights / training.weights.sum(), errors**2)
        losses[row + 1, 1:-1] = np.mean(np.log(np.maximum(squares, np.finfo(float).tiny)), axis=1)
    inner = losses[1:-1, 1:-1]
    around = [losses[1 + i : losses.shape[0] - 1 + i, 1 + j : losses.shape[1] - 1 + j] for i, j in _NEIGHBOURS]
    lowest = np.isfinite(inner) & np.all([inner <= other for other in around], axis=0)
    found = sorted(zip(*np.nonzero(lowest)), key=lambda place: inner[place])
    return [np.array([penalties[c], widths[w]])[: len(search.bounds)] for w, c in found]


_NEIGHBOURS = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
