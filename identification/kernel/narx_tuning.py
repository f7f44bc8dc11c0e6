"""Penalty and width of a NARX machine by its free runs over parts of the record that it was not trained on.

The leave-one-out error is that of one step, and a model that is best one step ahead can be poor in a free run. So the
rows are cut into five parts, each is run free by machines trained on the other four, and C and sigma are searched on a
grid for the least mean log of their mean square errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from auv_gym.narx import Narx
from identification.kernel.bordered import Solution, Spectrum, squared_distances
from identification.kernel.cells import Cells
from identification.kernel.narx_rows import Rows, Run, run_errors

FOLDS = 5
LEAST_ROWS = 10  # of a part, below which its free run tells nothing
MOST_ROWS = 1000  # of a part that are run: a long record is judged by as many as a shorter one
FEW = 400  # cells that a part's machines are trained on
WIDTHS = 2.0 ** np.arange(-1, 7)  # sigmas, in median distances between samples
PENALTIES = 10.0 ** np.arange(-1, 10)
_AROUND = 2, 3  # steps of the grid by which an output's own sigma and C may differ from the shared ones
_FLOOR = 1e-12  # of the variance: an error below it is as good as none

# C and sigma in spreads of the regressors; None: the linear part alone
Choice = tuple[float, float] | None


@dataclass(frozen=True, eq=False)
class Bells:
    """Coefficients (n, p) and bias (p,) of the choices of each output around centres (n, d)."""

    centres: np.ndarray
    choices: tuple[Choice, ...]
    coefficients: np.ndarray
    bias: np.ndarray


def narx(rows: Rows, slopes: np.ndarray, bias: np.ndarray, bells: Bells, reach: float = 1.0) -> Narx:
    """The model of a linear part and bells; outputs of one sigma share their bells."""
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
        reach=reach,
    )


@dataclass(frozen=True, eq=False)
class Fold:
    """A part of the rows as free runs, and what machines of the other parts are made of.

    spectra, solutions: by sigma, and by C and sigma, as far as they were asked for.
    """

    runs: Sequence[Run]
    cells: Cells
    square: np.ndarray
    slopes: np.ndarray
    bias: np.ndarray
    spectra: dict[float, Spectrum] = field(default_factory=dict)
    solutions: dict[tuple[float, float], Solution] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: Rows, start: int, stop: int, trend: bool) -> Fold:
        """The part of rows start..stop, of which a long one is run at its beginning only."""
        others = np.r_[0:start, stop : len(rows.z)]
        slopes, bias = rows.linear(others, trend)
        cells = Cells.of(rows.scaled[others], rows.left(slopes, bias)[others], FEW)
        runs = rows.runs(start, min(stop, start + MOST_ROWS))
        return cls(runs, cells, squared_distances(cells.x), slopes, bias)

    def bells(self, choices: Sequence[Choice]) -> Bells:
        """The bells of each output at its choice."""
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
    rows: Rows, trend: bool, penalty: float | None = None, sigma: float | None = None
) -> tuple[Choice, ...]:
    """The C and sigma of each output with which free runs do best: one pair for all, then each output's own near it.

    penalty, sigma: held, where given.  With a trend no bells at all is a choice too.
    """
    edges = np.linspace(0, len(rows.z), FOLDS + 1).round().astype(int)
    if edges[1] < LEAST_ROWS:
        raise ValueError(
            f"NarxLsSvm needs at least {FOLDS * LEAST_ROWS} samples to choose by free runs, got {len(rows.z)} that "
            "have all their lags: record longer, or set tuning to leave_one_out."
        )
    folds = [Fold.of(rows, a, b, trend) for a, b in pairwise(edges)]
    variance = np.concatenate(rows.series.y).var(axis=0)
    middle = np.sqrt(np.median(folds[0].square))
    sigmas = WIDTHS * middle if sigma is None else np.array([sigma])
    penalties = PENALTIES if penalty is None else np.array([penalty])

    def loss(choices: Sequence[Choice]) -> float:
        errors = [run_errors(narx(rows, f.slopes, f.bias, f.bells(choices)), f.runs) for f in folds]
        squares = np.mean(np.concatenate(errors) ** 2, axis=0)
        return float(np.mean(np.log(np.maximum(squares / variance, _FLOOR))))

    grid = [(float(c), float(s)) for s in sigmas for c in penalties]
    p = variance.size
    tried: dict[tuple[Choice, ...], float] = {(choice,) * p: 0.0 for choice in [*([None] if trend else []), *grid]}
    tried = {choices: loss(choices) for choices in tried}
    best = min(tried, key=lambda choices: tried[choices])
    for output in range(p if p > 1 else 0):
        for choice in _around(grid, best[output], sigmas, penalties) + ([None] if trend else []):
            choices = (*best[:output], choice, *best[output + 1 :])
            if choices not in tried:
                tried[choices] = loss(choices)
        best = min(tried, key=lambda choices: tried[choices])
    if not np.isfinite(tried[best]):
        raise ValueError(
            "NarxLsSvm found no C and sigma whose free runs stay finite over the parts that they were not trained on: "
            "name outputs that drift as integrating, or resample to a longer step."
        )
    return best


def _around(
    grid: Sequence[tuple[float, float]], middle: Choice, sigmas: np.ndarray, penalties: np.ndarray
) -> list[Choice]:
    """The choices of the grid that are a few steps from one; all where it is none."""
    if middle is None:
        return list(grid)
    widths, sizes = list(sigmas), list(penalties)
    row, column = widths.index(middle[1]), sizes.index(middle[0])
    return [
        (c, s)
        for c, s in grid
        if abs(widths.index(s) - row) <= _AROUND[0] and abs(sizes.index(c) - column) <= _AROUND[1]
    ]
