"""The system of a fixed-size LS-SVM, solved for its features instead of its samples, in blocks of rows.

    minimise  a' K_mm a / 2 + C / 2 sum_i weights_i (y_i - K(x_i, centres) a - b)^2

K_mm = L L' with pivots, which drop centres that add nothing to rounding.  With the features K(x, centres) inv(L)' this
is a ridge regression of n rows and at most m columns.  Only the triangle of their orthogonal factorisation, updated
block by block, is kept of the samples, and its singular values give the solution for every C.
Source: Suykens et al. 2002, Least Squares Support Vector Machines, ch. 6; De Brabanter et al. 2010, Computational
Statistics and Data Analysis 54 (leave-one-out by the diagonal of the smoother).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from identification.kernel_machines.bordered import Solution
from identification.kernel_machines.samples import EPS

BLOCK = 4096  # rows


@dataclass(frozen=True, eq=False)
class Primal:
    """The part of the solutions at one width that is common to all C.

    x: (n, d) and centres (m, d), over scale and sigma.  y: (n, p).  weights: (n,).  kept: centres that carry features,
    (r,).  values: singular values of weighted features, (r,).  rotation: (r, r), from K(x, centres[kept]) to features
    along them, whose weighted means are `means`, (r,).  signals: (r, p).  level: weighted means of y, (p,).
    """

    x: np.ndarray
    y: np.ndarray
    weights: np.ndarray
    centres: np.ndarray
    kept: np.ndarray
    values: np.ndarray
    rotation: np.ndarray
    means: np.ndarray
    signals: np.ndarray
    level: np.ndarray

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray, weights: np.ndarray, centres: np.ndarray) -> Primal:
        """The samples, reduced; arguments as the fields."""
        kept, lower = _pivoted(bells(centres, centres))
        roots, size, root = centres[kept], len(kept), np.sqrt(weights)[:, None]
        columns = 1 + size + y.shape[1]
        triangle = np.zeros((columns, columns))
        for rows in _blocks(len(x)):
            features = linalg.solve_triangular(lower, bells(roots, x[rows]), lower=True, check_finite=False).T
            block = root[rows] * np.column_stack([np.ones(len(features)), features, y[rows]])
            triangle = np.asarray(np.linalg.qr(np.vstack([triangle, block]), mode="r"))
        first, inner, last = triangle[0, 0], slice(1, size + 1), slice(size + 1, columns)
        left, values, right = linalg.svd(triangle[inner, inner])
        rotation = linalg.solve_triangular(lower, right.T, lower=True, trans=1)
        means, level = right @ triangle[0, inner] / first, triangle[0, last] / first
        return cls(x, y, weights, centres, kept, values, rotation, means, left.T @ triangle[inner, last], level)

    def solution(self, penalty: float) -> Solution:
        """Coefficients of all centres, (m, p), bias, and leave-one-out errors, at C = penalty."""
        along = self._gains(penalty)[:, None] * self.values[:, None] * self.signals
        coefficients = np.zeros((len(self.centres), len(self.level)))
        coefficients[self.kept] = self.rotation @ along
        errors = np.concatenate([found[0] for _, found in self._errors(np.array([penalty]))])
        return Solution(coefficients, self.level - self.means @ along, errors)

    def mean_squares(self, penalties: np.ndarray) -> np.ndarray:
        """Weighted mean square leave-one-out error at each C, (len(penalties), p)."""
        sums = np.zeros((len(penalties), len(self.level)))
        for rows, errors in self._errors(penalties):
            sums += np.einsum("i,cip->cp", self.weights[rows], errors**2)
        return sums / self.weights.sum()

    def _errors(self, penalties: np.ndarray) -> Iterator[tuple[slice, np.ndarray]]:
        """Leave-one-out errors at each C, (len(penalties), rows, p), block by block."""
        gains = np.column_stack([self._gains(penalty) for penalty in penalties])
        along = np.einsum("rc,rp->rcp", gains * self.values[:, None], self.signals).reshape(len(gains), -1)
        for rows in _blocks(len(self.x)):
            features = bells(self.x[rows], self.centres[self.kept]) @ self.rotation - self.means
            smoothed = (features @ along).reshape(len(features), len(penalties), -1)
            own = self.weights[rows][:, None] * (features**2 @ gains + 1.0 / self.weights.sum())
            left = np.maximum(1.0 - own, EPS * len(self.values))
            residuals = (self.y[rows] - self.level)[:, None] - smoothed
            yield rows, np.moveaxis(residuals / left[:, :, None], 1, 0)

    def _gains(self, penalty: float) -> np.ndarray:
        told = self.values > EPS * self.values.size * self.values[0]
        return np.where(told, 1.0 / (np.where(told, self.values, 1.0) ** 2 + 1.0 / penalty), 0.0)


def bells(x: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """exp(-|x_i - c_j|^2), (n, m), of rows over scale and sigma."""
    square = x @ centres.T
    square *= 2.0
    square -= np.sum(x**2, axis=1)[:, None]
    square -= np.sum(centres**2, axis=1)
    return np.exp(np.minimum(square, 0.0, out=square), out=square)


def _pivoted(kernel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows that span a kernel matrix to rounding, and the lower triangle L with L L' = K between these."""
    (factorise,) = linalg.get_lapack_funcs(("pstrf",), (kernel,))
    factor, order, rank, _ = factorise(kernel, lower=1)
    return order[:rank] - 1, np.tril(factor[:rank, :rank])


def _blocks(count: int) -> Iterator[slice]:
    return (slice(start, start + BLOCK) for start in range(0, count, BLOCK))
