"""Penalty and width of a NARX machine by its free runs over held-out parts of the record.

The leave-one-out error is that of one step, and a model that is best one step ahead can be poor in a free run.  So the
rows are cut into five parts, machines trained on the other four run free over each, and a grid over C and sigma is
searched for the least mean log of their mean square errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from auv_gym.models.narx import Narx
from identification.kernel_machines.bordered import Solution, Spectrum, squared_distances
from identification.kernel_machines.cells import Cells
from identification.kernel_machines.narx.narx_rows import Rows, Run, run_errors

FOLDS = 5
LEAST_ROWS = 10  # least rows of a part for a meaningful free run
MOST_ROWS = 1000  # most rows of a part that are run, however long the record
WIDTHS = 2.0 ** np.arange(-1, 7)  # sigmas, in median distances between samples
PENALTIES = 10.0 ** np.arange(-1, 8)  # with larger ones, coefficients of either sign cancel to rounding error
_AROUND = 2, 3  # steps of the grid by which an output's own sigma and C may differ from the shared ones
_SURE = 3.0  # standard errors of a gain; above 2, since the best of some hundred choices is better by chance
_FLOOR = 1e-12  # of the variance: a smaller error counts as none

# C and sigma in spreads of the regressors; None: the linear part alone
Choice = tuple[float, float] | None


@dataclass(frozen=True, eq=False)
class Bells:
    """Coefficients (n, p) and bias (p,) of the kernels for the choices of each output, around centres (n, d)."""

    centres: np.ndarray
    choices: tuple[Choice, ...]
    coefficients: np.ndarray
    bias: np.ndarray


def narx(rows: Rows, slopes: np.ndarray, bias: np.ndarray, bells: Bells, reach: float = 1.0) -> Narx:
    """The model of a linear part and kernels; outputs with the same sigma share their kernels."""
    sigmas = np.array([0.0 if choice is None else choice[1] for choice in bells.choices])
    used = np.unique(sigmas[sigmas > 0.0])
    lags = rows.lags
    return Narx(
        inputs=lags.inputs,
        outputs=lags.outputs,
        dt=rows.series.dt,
        n_a=lags.n_a,
        n_b=lags.n_b,
        delay=lags.delay,
        integrating=lags.integrating,
        support=rows.middle + rows.spread * bells.centres,
        middle=rows.middle,
        spread=rows.spread,
        sigma=used,
        coefficients=np.array([np.where(sigmas == s, bells.coefficients, 0.0) for s in used]).reshape(
            used.size, *bells.coefficients.shape
        ),
        slopes=slopes,
        bias=bias + bells.bias,
        rest=rows.rest,
        sway=rows.sway,
        reach=reach,
    )


@dataclass(frozen=True, eq=False)
class Fold:
    """A part of the rows as free runs, and the training data of the other parts.

    spectra, solutions: caches by sigma, and by C and sigma.
    """

    runs: Sequence[Run]
    cells: Cells
    square: np.ndarray
    slopes: np.ndarray
    bias: np.ndarray
    spectra: dict[float, Spectrum] = field(default_factory=dict)
    solutions: dict[tuple[float, float], Solution] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: Rows, start: int, stop: int, trend: bool, most: int) -> Fold:
        """The part of rows start..stop; only the beginning of a long one is run."""
        others = np.r_[0:start, stop : len(rows.z)]
        slopes, bias = rows.linear(others, trend)
        cells = Cells.of(rows.scaled[others], rows.left(slopes, bias)[others], most)
        runs = rows.runs(start, min(stop, start + MOST_ROWS))
        return cls(runs, cells, squared_distances(cells.x), slopes, bias)

    def bells(self, choices: Sequence[Choice]) -> Bells:
        """The kernels of each output at its choice."""
        coefficients, bias = np.zeros(self.cells.y.shape), np.zeros(len(choices))
        for output, choice in enumerate(choices):
            if choice is not None:
                solution = self._solution(choice)
                coefficients[:, output], bias[output] = solution.coefficients[:, output], solution.bias[output]
        return Bells(self.cells.x, tuple(choices), coefficients, bias)

    def _solution(self, choice: tuple[float, float]) -> Solution:
        penalty, sigma = choice
        if choice not in self.solutions:
            if sigma not in self.spectra:
                self.spectra[sigma] = Spectrum.of(np.exp(-self.square / sigma**2), self.cells.weights)
            self.solutions[choice] = self.spectra[sigma].solution(penalty, self.cells.y)
        return self.solutions[choice]


def best_in_free_runs(
    rows: Rows, trend: bool, most: int, penalty: float | None = None, sigma: float | None = None
) -> tuple[Choice, ...]:
    """The C and sigma of each output with the best free runs: one pair for all, then each output's own near it.

    most: number of cells to train on.  penalty, sigma: held, if given.  With a trend, no kernels at all is a choice,
    too.
    """
    edges = np.linspace(0, len(rows.z), FOLDS + 1).round().astype(int)
    if edges[1] < LEAST_ROWS:
        raise ValueError(
            f"NarxLsSvm needs at least {FOLDS * LEAST_ROWS} samples to choose by free runs, got {len(rows.z)} that "
            "have all their lags: record longer, or set tuning to leave_one_out."
        )
    folds = [Fold.of(rows, a, b, trend, most) for a, b in pairwise(edges)]
    variance = np.concatenate(rows.series.y).var(axis=0)
    middle = np.sqrt(np.median(folds[0].square))
    sigmas = WIDTHS * middle if sigma is None else np.array([sigma])
    penalties = PENALTIES if penalty is None else np.array([penalty])

    def squares(choices: Sequence[Choice]) -> np.ndarray:
        errors = [run_errors(narx(rows, f.slopes, f.bias, f.bells(choices)), f.runs) for f in folds]
        return np.array([np.mean(error**2, axis=0) for error in errors]) / variance

    grid: list[Choice] = [(float(c), float(s)) for s in sigmas for c in penalties]
    alone: list[Choice] = [None] if trend else []
    tried = {(choice,) * variance.size: squares((choice,) * variance.size) for choice in [*alone, *grid]}
    best = _least(tried)
    for output in range(variance.size if variance.size > 1 else 0):
        for choice in [*alone, *_around(grid, best[output], sigmas, penalties)]:
            choices = (*best[:output], choice, *best[output + 1 :])
            if choices not in tried:
                tried[choices] = squares(choices)
        best = _least(tried)
    if not np.isfinite(tried[best]).all():
        raise ValueError(
            "NarxLsSvm found no C and sigma whose free runs stay finite over the parts that they were not trained on: "
            "name outputs that drift as integrating, or resample to a longer step."
        )
    return best


def _least(tried: dict[tuple[Choice, ...], np.ndarray]) -> tuple[Choice, ...]:
    """The choices of least error over all parts; no kernels if the parts do not agree on their gain.

    tried: mean square errors over their variance, (parts, p).
    """
    best = min(tried, key=lambda choices: float(np.mean(np.log(tried[choices].mean(axis=0) + _FLOOR))))
    alone = (None,) * len(best)
    if alone not in tried or not np.isfinite(tried[alone]).all():
        return best
    gain = np.mean(np.log(tried[alone] + _FLOOR) - np.log(tried[best] + _FLOOR), axis=1)
    return best if gain.mean() > _SURE * gain.std(ddof=1) / np.sqrt(FOLDS) else alone


def _around(grid: Sequence[Choice], middle: Choice, sigmas: np.ndarray, penalties: np.ndarray) -> Sequence[Choice]:
    """The choices of the grid within a few steps of one; all if it is None."""
    if middle is None:
        return grid
    row, column = (list(of).index(value) for of, value in ((sigmas, middle[1]), (penalties, middle[0])))
    near = np.zeros((sigmas.size, penalties.size), dtype=bool)
    near[max(row - _AROUND[0], 0) : row + _AROUND[0] + 1, max(column - _AROUND[1], 0) : column + _AROUND[1] + 1] = True
    return [choice for choice, close in zip(grid, near.ravel()) if close]
