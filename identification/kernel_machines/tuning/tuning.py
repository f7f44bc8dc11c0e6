"""Penalty and width of an LS-SVM regression by its leave-one-out error: simulated annealing, or descent by gradient.

Both minimise the same loss over log C and log sigma, the mean over the outputs of log(mean square leave-one-out error /
variance), with the weights of the samples; outputs given together share C and sigma.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import numpy as np
from scipy import linalg, optimize

from identification.kernel_machines.bordered import eliminated
from identification.kernel_machines.regression import LsSvmRegression, Training
from identification.kernel_machines.samples import EPS, Samples

Progress = Callable[[float, str], Any]
FAILED = 50.0  # loss of a numerically singular system: far above any other, and finite for the searches
DIGITS_KEPT = 1e3  # C is at most 1 / (this n EPS), which keeps three digits of the inverse
WIDTHS = 0.1, 100.0  # sigmas searched, in median distances between samples
LEAST_PENALTY = 1e-2
SCAN_SAMPLES, SCAN_WIDTHS, SCAN_PENALTIES = 300, 12, 24
FEW_SAMPLES = 600
SETTLED, SETTLED_CLOSELY = 1e-3, 1e-6  # of the loss: a thousandth is far below its chance variation
CURVATURE_STEP, LEAST_CURVATURE = 0.05, 1e-2
LONGEST_STEP, BACK = 1.0, 0.3  # of the last steps on all samples, in log C and log sigma


Settings = TypeVar("Settings")


@dataclass(frozen=True)
class Tuned(Generic[Settings]):
    """The settings of least leave-one-out error.

    errors: mean square leave-one-out error of each output, in its units squared.  loss: the minimised loss, 0 for a
    constant output, which has nothing to tune.  evaluations: number of solutions with all samples.
    """

    settings: Settings
    errors: tuple[float, ...]
    loss: float
    evaluations: int


def silent(fraction: float, text: str) -> None:
    pass


def anneal(
    settings: LsSvmRegression,
    x: np.ndarray,
    y: np.ndarray,
    rng: np.random.Generator,
    *,
    weights: np.ndarray | None = None,
    evaluations: int = 400,
    progress: Progress = silent,
) -> Tuned[LsSvmRegression]:
    """Settings with C and sigma found by simulated annealing, with all of the given evaluations."""
    if evaluations < 1:
        raise ValueError(f"anneal needs at least one evaluation, got {evaluations}: some 400 settle C and sigma.")
    search = _Search.of(settings, Training.of(x, y, weights, settings), evaluations, progress)
    named: Any = {"seed": rng}  # scipy's own name for it changes between versions; all accept this one
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
    progress: Progress = silent,
) -> Tuned[LsSvmRegression]:
    """Settings with C and sigma found by L-BFGS-B, with the gradient in closed form.

    A grid over C and sigma for 300 samples, with one spectrum for each sigma, gives the starts.  Its best `starts`
    local minima are followed on 600 samples, spread evenly over the record, and the best of them on twice as many, and
    so on, by quasi-Newton steps from the curvature found before, until less than 1e-3 of the loss can be gained.
    evaluations: on all samples; if all are followed, the limit is checked between line searches, and the last one is
    completed.
    """
    training = _asked(settings, x, y, weights, starts, evaluations)
    part = training.part(SCAN_SAMPLES)
    return _descended(settings, training, _Grid.of(part).minima()[:starts], evaluations, progress)


def descend_each(
    settings: LsSvmRegression,
    x: np.ndarray,
    y: np.ndarray,
    *,
    weights: np.ndarray | None = None,
    starts: int = 3,
    evaluations: int = 60,
    progress: Progress = silent,
) -> tuple[Tuned[LsSvmRegression], ...]:
    """Like `descend`, for each output of y (n, m) by itself: m settings, for `fit_each`.

    Distances and spectra are computed once for all.  evaluations: for each output.
    """
    training = _asked(settings, x, y, weights, starts, evaluations)
    grid, found = _Grid.of(training.part(SCAN_SAMPLES)), []
    for output, column in enumerate(training.columns()):
        if not column.samples.varies.any():
            found.append(Tuned(settings, (0.0,), 0.0, 0))
            continue
        minima = grid.minima(output)[:starts]
        found.append(_descended(settings, column, minima, evaluations, of_output(progress, output, len(grid.varies))))
    return tuple(found)


def of_output(progress: Progress, output: int, outputs: int) -> Progress:
    return lambda fraction, text: progress((output + fraction) / outputs, f"output {output}: {text}")


def _asked(
    settings: LsSvmRegression, x: np.ndarray, y: np.ndarray, weights: np.ndarray | None, starts: int, evaluations: int
) -> Training:
    if starts < 1 or evaluations < 1:
        raise ValueError(f"descend needs starts and evaluations from 1, got {starts} and {evaluations}.")
    return Training.of(x, y, weights, settings)


def _descended(
    settings: LsSvmRegression, training: Training, starts: list[np.ndarray], evaluations: int, progress: Progress
) -> Tuned[LsSvmRegression]:
    """The best of the minima found from the starts, followed on a part of many samples and finished on all."""
    search = _Search.of(settings, training, evaluations, progress)
    if len(training.samples.x) <= FEW_SAMPLES:
        for start in starts:
            search.follow(start, SETTLED_CLOSELY)
        progress(1.0, "tuned")
        return search.tuned()
    few, curvature = _Search.of(settings, training.part(FEW_SAMPLES), evaluations, silent), None
    ends = [few.follow(start, 0.1 * SETTLED) for start in starts]
    size = 2 * FEW_SAMPLES
    while 1.5 * size < len(training.samples.x):
        ends, curvature = _Search.of(settings, training.part(size), evaluations, silent).settle(ends, curvature, few)
        size *= 2
    search.settle(ends, curvature, few)
    progress(1.0, "tuned")
    return search.tuned()


@dataclass(eq=False)
class _Search:
    """The loss as a function of (log C, log sigma), or of log C alone for the linear kernel; keeps the best point."""

    settings: LsSvmRegression
    training: Training
    y: np.ndarray  # outputs that vary, with zero mean and unit variance
    bounds: list[tuple[float, float]]
    allowed: int
    progress: Progress
    count: int = 0
    best: float = np.inf
    at: np.ndarray = field(default_factory=lambda: np.zeros(0))
    squares: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, settings: LsSvmRegression, training: Training, allowed: int, progress: Progress) -> _Search:
        return cls(settings, training, training.samples.standard, _bounds(training), allowed, progress)

    def settings_at(self, at: np.ndarray) -> LsSvmRegression:
        sigma = float(np.exp(at[1])) if self.training.distances.radial else self.settings.sigma
        return replace(self.settings, penalty=float(np.exp(at[0])), sigma=sigma)

    def __call__(self, at: np.ndarray, gradient: bool = False) -> tuple[float, np.ndarray]:
        """Loss and, with `gradient`, its gradient."""
        tried = self.settings_at(at)
        self.count += 1
        kernel = self.training.kernel(tried.sigma)
        weights = self.training.samples.weights
        ridge = 1.0 / (tried.penalty * weights)
        slope = np.zeros(len(at))
        try:
            projected, _ = eliminated(kernel, ridge)
        except linalg.LinAlgError:
            return FAILED, slope
        coefficients = projected @ self.y
        diagonal = np.diag(projected).copy()
        errors = coefficients / diagonal[:, None]
        shares = weights / weights.sum()
        squares = np.maximum(shares @ errors**2, np.finfo(float).tiny)
        loss = float(np.mean(np.log(squares)))
        if loss < self.best:
            self.best, self.at, self.squares = loss, np.array(at), squares
        self.progress(min(self.count / self.allowed, 1.0), f"C {tried.penalty:.3g}, sigma {tried.sigma:.3g}")
        if gradient:
            # d G = -G dH G, so each slope is the inner product of dH with G diag(pull) G - (G push) coefficients'
            push = 2.0 * shares[:, None] * errors / (diagonal[:, None] * squares * squares.size)
            pull = np.sum(push * errors, axis=1)
            pushed = projected @ push
            half = projected * np.sqrt(pull)
            slope[0] = -ridge @ (np.sum(half**2, axis=1) - np.sum(pushed * coefficients, axis=1))
            if self.training.distances.radial:
                change = kernel * self.training.distances.square * (2.0 / tried.sigma**2)
                slope[1] = np.vdot(change, half @ half.T) - np.sum(pushed * (change @ coefficients))
        return loss, slope

    @property
    def middle(self) -> np.ndarray:
        return np.array([sum(pair) / 2.0 for pair in self.bounds])

    def follow(self, start: np.ndarray, settled: float) -> np.ndarray:
        """The local minimum found from a start within the remaining evaluations."""
        if self.count >= self.allowed:
            return start
        return optimize.minimize(
            lambda at: self(at, gradient=True),
            np.clip(start, *np.transpose(self.bounds)),
            jac=True,
            method="L-BFGS-B",
            bounds=self.bounds,
            options={"maxfun": self.allowed - self.count, "ftol": settled, "gtol": settled},
        ).x

    def curvature(self, at: np.ndarray) -> np.ndarray:
        """The second derivatives of the loss, by differences of its gradient; positive definite."""
        columns = [
            (self(at + move, gradient=True)[1] - self(at - move, gradient=True)[1]) / (2.0 * CURVATURE_STEP)
            for move in CURVATURE_STEP * np.eye(at.size)
        ]
        values, vectors = np.linalg.eigh(0.5 * (np.array(columns) + np.transpose(columns)))
        return vectors @ np.diag(np.maximum(np.abs(values), LEAST_CURVATURE)) @ vectors.T

    def settle(
        self, starts: list[np.ndarray], curvature: np.ndarray | None, part: _Search
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Quasi-Newton steps from the best start, near a minimum; their end, and the curvature there.

        The initial curvature is the given one, or that of a part of the samples, which is nearly that of all.
        """
        low, high = np.transpose(self.bounds)
        starts = [np.clip(start, low, high) for start in starts]
        at = min(starts, key=lambda start: self(start)[0]) if len(starts) > 1 else starts[0]
        curvature = part.curvature(at) if curvature is None else curvature
        loss, slope = self(at, gradient=True)
        while self.count < self.allowed:
            free = ~(((at <= low) & (slope > 0.0)) | ((at >= high) & (slope < 0.0)))
            step = np.zeros(at.size)
            step[free] = -np.linalg.solve(curvature[np.ix_(free, free)], slope[free])
            step *= min(1.0, LONGEST_STEP / np.abs(step).max(initial=LONGEST_STEP))
            step = np.clip(at + step, low, high) - at
            if -slope @ step < 2.0 * SETTLED:  # the expected gain is half of this
                break
            after, slope_after = self(at + step, gradient=True)
            while after >= loss and self.count < self.allowed and -slope @ step > SETTLED:
                step *= BACK
                after, slope_after = self(at + step, gradient=True)
            if after >= loss:
                break
            turn, bent = slope_after - slope, curvature @ step
            if turn @ step > 0.0:
                curvature = curvature + np.outer(turn, turn) / (turn @ step) - np.outer(bent, bent) / (bent @ step)
            at, loss, slope = at + step, after, slope_after
        return [at], curvature

    def tuned(self) -> Tuned[LsSvmRegression]:
        """The best point visited."""
        if not self.at.size:
            raise ValueError(
                "Tuning found no C and sigma at which the system can be solved: leave out repeated samples."
            )
        errors = np.zeros(self.training.samples.varies.size)
        errors[self.training.samples.varies] = self.squares * self.training.samples.variance
        return Tuned(self.settings_at(self.at), tuple(errors.tolist()), self.best, self.count)


def _bounds(training: Training) -> list[tuple[float, float]]:
    """The bounds of log C and log sigma, or of log C alone, in the search."""
    samples, distances = training.samples, training.distances
    bounds = [(np.log(LEAST_PENALTY), np.log(largest_penalty(samples)))]
    if distances.radial:
        return [*bounds, widths(distances.median, distances.reach)]
    size = np.trace(distances.square) / len(samples.x)  # unlike radial kernels, its values may exceed 1
    return [(low - np.log(size), high - np.log(size)) for low, high in bounds]


def largest_penalty(samples: Samples) -> float:
    """The C up to which a system of radial kernels keeps some digits."""
    return 1.0 / (DIGITS_KEPT * EPS * len(samples.x) * samples.weights.max())


def widths(median: float, reach: tuple[float, float]) -> tuple[float, float]:
    """The bounds of log sigma, for samples of this median distance and this range of sigma."""
    return np.log(max(WIDTHS[0] * median, 1.001 * reach[0])), np.log(min(WIDTHS[1] * median, 0.999 * reach[1]))


@dataclass(frozen=True, eq=False)
class _Grid:
    """Loss of each output at each pair of log sigma (w,) and log C (c,): losses (outputs that vary, w, c)."""

    widths: np.ndarray
    penalties: np.ndarray
    losses: np.ndarray
    varies: np.ndarray
    radial: bool

    @classmethod
    def of(cls, training: Training) -> _Grid:
        samples, bounds, radial = training.samples, _bounds(training), training.distances.radial
        penalties = np.linspace(*bounds[0], SCAN_PENALTIES)
        widths = np.linspace(*bounds[1], SCAN_WIDTHS) if radial else np.zeros(1)
        shares, losses = samples.weights / samples.weights.sum(), []
        for width in widths:
            errors = training.spectrum(float(np.exp(width))).leave_one_out(np.exp(penalties), samples.standard)
            losses.append(log_mean_square(shares, errors))
        return cls(widths, penalties, np.moveaxis(np.array(losses), 2, 0), samples.varies, radial)

    def minima(self, output: int | None = None) -> list[np.ndarray]:
        """Local minima over sigma, each at its best C, best first, for one output or for all together.

        They are not minima over both: the valley of good pairs runs diagonally through the grid and looks like many
        minima.
        """
        place = None if output is None else int(np.count_nonzero(self.varies[:output]))
        losses = self.losses.mean(axis=0) if place is None else self.losses[place]
        profile = np.pad(losses.min(axis=1), 1, constant_values=np.inf)
        lowest = (profile[1:-1] <= profile[:-2]) & (profile[1:-1] <= profile[2:])
        found = sorted(np.flatnonzero(lowest), key=lambda w: profile[w + 1])
        starts = [np.array([self.penalties[losses[w].argmin()], self.widths[w]]) for w in found]
        return starts if self.radial else [start[:1] for start in starts]


def log_mean_square(shares: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """log sum_i shares[i] errors[..., i, m]^2, shape (..., m)."""
    return np.log(np.maximum(np.einsum("i,...im->...m", shares, errors**2), np.finfo(float).tiny))
