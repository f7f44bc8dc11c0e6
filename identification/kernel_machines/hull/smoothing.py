"""Smoothing of series with an estimated noise level: a summed random walk, read with white noise.

The estimate minimises |y - s|^2 + ratio |D s|^2, with D the differences of ORDER; the ratio of the two variances
maximises the restricted likelihood.  Without noise it is so small that the series stays as it is.
Source: Eilers 2003, Analytical Chemistry 75(14), 3631-3636; Wahba 1985, Annals of Statistics 13(4), 1378-1402.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize

ORDER = 2
_LOG_RATIOS = np.arange(-12.0, 10.0, 2.0)  # powers of ten; systems of larger ratios lose their digits
_SETTLED = 0.05  # of a power of ten


@dataclass(frozen=True)
class Smoothness:
    """The amount of smoothing of a series.

    ratio: variance of the noise over that of the walk's steps.  noise: standard deviation.
    """

    ratio: float
    noise: float

    @property
    def width(self) -> float:
        """Number of samples to either side that affect an estimate."""
        return self.ratio ** (0.5 / ORDER)


def smoothness_of(parts: Sequence[np.ndarray]) -> Smoothness:
    """The likeliest common smoothness of series, (n,) each; n > ORDER."""
    lengths = sorted({len(part) for part in parts})  # series of one length share their system
    alike = [np.column_stack([part for part in parts if len(part) == n]) for n in lengths]
    penalties, steps = [_penalty(n) for n in lengths], [np.diff(group, ORDER, axis=0) for group in alike]
    freedom = sum(step.size for step in steps)
    size = max(float(np.abs(group).max()) for group in alike)
    if max(float(np.abs(step).max()) for step in steps) <= 1e-14 * size:  # a straight line, to rounding
        return Smoothness(0.0, 0.0)

    def misfit(log_ratio: float) -> tuple[float, float]:
        """The part of the likelihood to minimise, and the variance of the noise."""
        ratio, square, determinant = 10.0**log_ratio, 0.0, 0.0
        for group, penalty, step in zip(alike, penalties, steps, strict=True):
            factor = linalg.cholesky_banded(_system(penalty, ratio))
            smooth = linalg.cho_solve_banded((factor, False), group)
            square += ratio * float(np.sum(step * np.diff(smooth, ORDER, axis=0)))  # y (y - s), without cancellation
            determinant += 2.0 * group.shape[1] * float(np.log(factor[ORDER]).sum())
        variance = max(square / freedom, 1e-300)
        return freedom * (np.log(variance) - np.log(ratio)) + determinant, variance

    best = int(np.argmin([misfit(at)[0] for at in _LOG_RATIOS]))
    around = _LOG_RATIOS[max(best - 1, 0)], _LOG_RATIOS[min(best + 1, _LOG_RATIOS.size - 1)]
    found = optimize.minimize_scalar(
        lambda at: misfit(at)[0], bounds=around, method="bounded", options={"xatol": _SETTLED}
    )
    return Smoothness(10.0 ** float(found.x), float(np.sqrt(misfit(float(found.x))[1])))


def smoothed(part: np.ndarray, smoothness: Smoothness) -> np.ndarray:
    """A series (n,) without its noise."""
    return linalg.solveh_banded(_system(_penalty(len(part)), smoothness.ratio), part)


def _penalty(n: int) -> np.ndarray:
    """D'D of n samples as upper bands, (ORDER + 1, n)."""
    row = np.diff(np.eye(2 * ORDER + 1), ORDER, axis=0)[0, : ORDER + 1]
    bands = np.zeros((ORDER + 1, n))
    for i, first in enumerate(row):
        for j in range(i, ORDER + 1):
            bands[ORDER - (j - i), j : n - ORDER + j] += first * row[j]
    return bands


def _system(penalty: np.ndarray, ratio: float) -> np.ndarray:
    bands = ratio * penalty
    bands[ORDER] += 1.0
    return bands
