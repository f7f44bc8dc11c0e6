"""Losses of ARX models of many orders from one factorisation of the largest regression."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from identification.linear.polynomials.structure import Row
from identification.linear.regressors import SAMPLES_PER_COEFFICIENT, Series, regression


@dataclass(frozen=True, eq=False)
class Nested:
    """An output's regression on all lags that any order needs, as the triangle of its QR decomposition.

    triangle: (n + 1, n + 1), columns scaled to unit length, the target last.  scale: the original lengths.  places:
    columns by lag, of the output (key -1) and of each input.  intercept: whether an intercept is estimated.
    """

    triangle: np.ndarray
    scale: float
    samples: int
    places: Mapping[tuple[int, int], int]
    intercept: bool

    @classmethod
    def of(cls, series: Series, row: Row, start: int, intercept: bool = True) -> Nested:
        """The decomposition for an equation with every lag, over the rows from `start` on of each segment."""
        problem = regression(series, row, start)
        matrix = np.column_stack([problem.matrix, problem.target])
        samples = len(matrix)
        if intercept and samples:
            # centring the columns eliminates the intercept, and keeps digits that a large mean would take
            matrix = matrix - matrix.mean(axis=0)
        size = np.sqrt(np.sum(matrix**2, axis=0))
        size[size == 0.0] = 1.0
        triangle = np.asarray(np.linalg.qr(matrix / size, mode="r"))
        places = {(-1 if t.kind == "a" else t.number, t.lag): k for k, t in enumerate(problem.terms)}
        return cls(triangle, float(size[-1]), samples, places, intercept)

    def loss(self, own: int, n_b: Sequence[int], delay: Sequence[int]) -> float:
        """Mean square equation error of these orders; NaN if the rows do not determine the coefficients.

        own: free coefficients of A, one less than n_a if the output integrates.
        """
        lags = [(-1, lag) for lag in range(1, own + 1)]
        lags += [(i, late + k) for i, (count, late) in enumerate(zip(n_b, delay, strict=True)) for k in range(count)]
        if self.samples < SAMPLES_PER_COEFFICIENT * (len(lags) + self.intercept):
            return float("nan")
        left, values, _ = np.linalg.svd(self.triangle[:, [self.places[lag] for lag in lags]], full_matrices=False)
        if values.size and values[-1] <= 10.0 * np.finfo(float).eps * self.samples * values[0]:
            return float("nan")
        target = self.triangle[:, -1]
        residual = target - left @ (left.T @ target)
        return self.scale**2 * float(residual @ residual) / self.samples
