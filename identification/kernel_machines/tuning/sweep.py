"""Penalty and width of a fixed-size LS-SVM by its leave-one-out error: all C at each of a few sigma.

The loss is that of `tuning`.  One pass over the samples gives it for every C, so that only sigma is searched, over a
grid and then by Brent's method.  This uses some of the samples with all of the centres, since the best sigma depends on
the distances of the centres.  C, which should grow with the samples, is then found on all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from scipy import optimize

from identification.kernel_machines.fixed_size import FixedSize, Reduced
from identification.kernel_machines.primal import Primal
from identification.kernel_machines.samples import EPS, Samples
from identification.kernel_machines.tuning.tuning import LEAST_PENALTY, Progress, Tuned, of_output, silent, widths

PART, PART_EACH = 4000, 8  # samples to find sigma on, in total and for each centre: the larger number counts
SCAN_WIDTHS, PENALTIES = 12, 40
TURNS, WIDTH_FOUND = 8, 0.02  # most iterations of Brent's method; its tolerance in log sigma, where the loss is flat


def sweep(
    settings: FixedSize,
    x: np.ndarray,
    y: np.ndarray,
    *,
    weights: np.ndarray | None = None,
    rng: np.random.Generator | None = None,
    progress: Progress = silent,
) -> Tuned[FixedSize]:
    """Settings with the C and sigma of least leave-one-out error of all outputs; rng: as in `FixedSize.fit`."""
    reduced = Reduced.of(x, y, weights, settings, rng)
    scan = _Scan.of(reduced)
    return _swept(settings, reduced, scan, scan.losses.mean(axis=2), progress)


def sweep_each(
    settings: FixedSize,
    x: np.ndarray,
    y: np.ndarray,
    *,
    weights: np.ndarray | None = None,
    rng: np.random.Generator | None = None,
    progress: Progress = silent,
) -> tuple[Tuned[FixedSize], ...]:
    """Like `sweep`, for each output of y (n, m) by itself around the same centres: m settings, for `fit_each`."""
    reduced = Reduced.of(x, y, weights, settings, rng)
    scan, varies, found = _Scan.of(reduced), reduced.samples.varies, []
    for output, column in enumerate(reduced.columns()):
        if varies[output]:
            losses = scan.losses[:, :, np.count_nonzero(varies[:output])]
            found.append(_swept(settings, column, scan, losses, of_output(progress, output, varies.size)))
        else:
            found.append(Tuned(settings, (0.0,), 0.0, 0))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class _Scan:
    """Losses on some of the samples, (log sigma, log C, outputs that vary)."""

    part: np.ndarray
    widths: np.ndarray
    penalties: np.ndarray
    losses: np.ndarray

    @classmethod
    def of(cls, reduced: Reduced) -> _Scan:
        samples = reduced.samples
        part = samples.spread_rows(max(PART, PART_EACH * len(reduced.chosen)))
        grid = np.linspace(*widths(reduced.between.median, reduced.between.reach), SCAN_WIDTHS)
        most = 1.0 / (EPS * len(samples.x) * samples.weights.max())
        penalties = np.linspace(np.log(LEAST_PENALTY), np.log(most), PENALTIES)
        losses = [_losses(reduced, reduced.primal(float(np.exp(width)), part), penalties) for width in grid]
        return cls(part, grid, penalties, np.array(losses))


def _swept(
    settings: FixedSize, reduced: Reduced, scan: _Scan, losses: np.ndarray, progress: Progress
) -> Tuned[FixedSize]:
    """The best C and sigma, by refining a scan with the losses (log sigma, log C)."""
    best = int(np.argmin([_lowest(row, scan.penalties)[1] for row in losses]))
    between = float(scan.widths[max(best - 1, 0)]), float(scan.widths[min(best + 1, SCAN_WIDTHS - 1)])
    turns = count(1)

    def loss_of(width: float) -> float:
        sigma = float(np.exp(width))
        progress(min(next(turns) / (TURNS + 2.0), 1.0), f"sigma {sigma:.3g}")
        found = _losses(reduced, reduced.primal(sigma, scan.part), scan.penalties)
        return _lowest(found.mean(axis=1), scan.penalties)[1]

    sigma = float(np.exp(optimize.minimize_scalar(loss_of, bounds=between, method="bounded", options=_BRENT).x))
    primal = reduced.primal(sigma)
    penalty = float(np.exp(_lowest(_losses(reduced, primal, scan.penalties).mean(axis=1), scan.penalties)[0]))
    errors = np.where(reduced.samples.varies, primal.mean_squares(np.array([penalty]))[0], 0.0)
    loss = float(_loss(reduced.samples, errors).mean())
    progress(1.0, "tuned")
    return Tuned(replace(settings, penalty=penalty, sigma=sigma), tuple(errors.tolist()), loss, 1)


_BRENT: dict[str, float] = {"maxiter": TURNS, "xatol": WIDTH_FOUND}


def _losses(reduced: Reduced, primal: Primal, penalties: np.ndarray) -> np.ndarray:
    """The loss of each output that varies at each log C, (len(penalties), outputs)."""
    return _loss(reduced.samples, primal.mean_squares(np.exp(penalties)))


def _loss(samples: Samples, squares: np.ndarray) -> np.ndarray:
    return np.log(np.maximum(squares[..., samples.varies] / samples.variance, np.finfo(float).tiny))


def _lowest(losses: np.ndarray, penalties: np.ndarray) -> tuple[float, float]:
    """Log C and loss at the minimum of the parabola through the least of some losses and its neighbours."""
    at = int(np.argmin(losses))
    if not 0 < at < len(losses) - 1:
        return float(penalties[at]), float(losses[at])
    before, here, after = losses[at - 1 : at + 2]
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float(penalties[at] + shift * (penalties[1] - penalties[0])), float(here - 0.5 * bend * shift**2)
