"""The linear system of LS-SVM regression, solved with its leave-one-out errors by Cholesky or by eigenvalues.

The system is [[0, 1'], [1, H]] [bias; coefficients] = [0; y] with H = K + diag(1 / (C weights)).  Its border is
eliminated: coefficients = G y with G = inv(H) - inv(H) 1 1' inv(H) / (1' inv(H) 1), and the error of sample i by the
machine trained without it is coefficients[i] / G[i, i].
Source: Suykens, Van Gestel, De Brabanter, De Moor and Vandewalle 2002, Least Squares Support Vector Machines, sec. 3.1;
Cawley and Talbot 2007, Journal of Machine Learning Research 8, sec. 2 (leave-one-out in closed form).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg


@dataclass(frozen=True, eq=False)
class Solution:
    """Coefficients and leave-one-out errors, (n, m), and bias (m,)."""

    coefficients: np.ndarray
    bias: np.ndarray
    leave_one_out: np.ndarray


def squared_distances(scaled: np.ndarray) -> np.ndarray:
    """|x_i - x_j|^2 of rows, (n, n), exactly zero for equal rows."""
    square = np.zeros((len(scaled), len(scaled)))
    for column in scaled.T:  # not the product form, which loses the small distances of dense records
        square += np.subtract.outer(column, column) ** 2
    return square


def solved(kernel: np.ndarray, ridge: np.ndarray, y: np.ndarray) -> Solution:
    """The solution by Cholesky; raises LinAlgError if H is singular to rounding.

    kernel: (n, n).  ridge: diagonal 1 / (C weights), (n,).  y: (n, m).
    """
    factor = _factorised(kernel, ridge)
    solve, invert = linalg.get_lapack_funcs(("potrs", "potri"), (factor,))
    level = y.mean(axis=0)  # G 1 = 0, so the level goes to the bias without loss of digits
    # solve with the factor: products with an inverse would lose digits if the system is ill-conditioned
    inverse, _ = solve(factor, np.column_stack([np.ones(len(y)), y - level]), lower=1)
    ones, bias = inverse[:, 0], inverse[:, 0] @ (y - level) / inverse[:, 0].sum()
    coefficients = inverse[:, 1:] - np.outer(ones, bias)
    diagonal = np.diag(invert(factor, lower=1, overwrite_c=1)[0]) - ones**2 / ones.sum()
    return Solution(coefficients, level + bias, coefficients / diagonal[:, None])


def eliminated(kernel: np.ndarray, ridge: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """G (n, n) and inv(H) 1 (n,); raises LinAlgError if H is singular to rounding."""
    factor = _factorised(kernel, ridge)
    (invert,) = linalg.get_lapack_funcs(("potri",), (factor,))
    inverse, _ = invert(factor, lower=1, overwrite_c=1)
    inverse += np.tril(inverse, -1).T
    ones = inverse.sum(axis=1)
    inverse -= np.outer(ones, ones / ones.sum())
    return inverse, ones


def _factorised(kernel: np.ndarray, ridge: np.ndarray) -> np.ndarray:
    """The lower Cholesky factor of H; raises LinAlgError if H is singular to rounding."""
    full = kernel.copy().T  # symmetric; in the memory order that LAPACK works on in place
    np.einsum("ii->i", full)[:] += ridge
    factorise, condition = linalg.get_lapack_funcs(("potrf", "pocon"), (full,))
    norm = np.abs(full).sum(axis=0).max()
    factor, failed = factorise(full, lower=1, clean=1, overwrite_a=1)
    if failed:
        raise linalg.LinAlgError("the kernel matrix is not positive definite")
    reciprocal_condition, _ = condition(factor, norm, uplo="L")
    if reciprocal_condition < 10.0 * np.finfo(float).eps:
        raise linalg.LinAlgError("the kernel matrix is singular to rounding")
    return factor


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Eigenvalues of a weighted kernel matrix, from which the solution for each C takes n^2 operations.

    values, vectors: of sqrt(weights) K sqrt(weights).  root: sqrt(weights), (n,).
    """

    values: np.ndarray
    vectors: np.ndarray
    root: np.ndarray

    @classmethod
    def of(cls, kernel: np.ndarray, weights: np.ndarray) -> Spectrum:
        """The spectrum of a kernel matrix (n, n) with weights (n,)."""
        root = np.sqrt(weights)
        values, vectors = linalg.eigh(kernel * root[:, None] * root, driver="evd")
        return cls(np.maximum(values, 0.0), vectors, root)

    def solution(self, penalty: float, y: np.ndarray) -> Solution:
        """The solution at C = penalty."""
        level = y.mean(axis=0)
        gains = 1.0 / (self.values + 1.0 / penalty)
        inverse_ones = self._inverse(gains, np.ones((self.root.size, 1)))[:, 0]
        bias = inverse_ones @ (y - level) / inverse_ones.sum()
        coefficients = self._inverse(gains, y - level) - np.outer(inverse_ones, bias)
        diagonal = self.root**2 * (self.vectors**2 @ gains) - inverse_ones**2 / inverse_ones.sum()
        return Solution(coefficients, level + bias, coefficients / diagonal[:, None])

    def leave_one_out(self, penalties: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Leave-one-out errors at each C of penalties, (len(penalties), n, m)."""
        gains = 1.0 / (self.values[:, None] + 1.0 / np.asarray(penalties, dtype=float))
        diagonals = self.root[:, None] ** 2 * (self.vectors**2 @ gains)
        signals = self.vectors.T @ (self.root[:, None] * np.column_stack([np.ones(len(y)), y - y.mean(axis=0)]))
        errors = np.empty((gains.shape[1], *y.shape))
        for place, gain in enumerate(gains.T):
            inverse = self.root[:, None] * (self.vectors @ (gain[:, None] * signals))
            ones, total = inverse[:, 0], inverse[:, 0].sum()
            bias = ones @ (y - y.mean(axis=0)) / total
            errors[place] = (inverse[:, 1:] - np.outer(ones, bias)) / (diagonals[:, place] - ones**2 / total)[:, None]
        return errors

    def _inverse(self, gains: np.ndarray, y: np.ndarray) -> np.ndarray:
        root = self.root[:, None]
        return root * (self.vectors @ (gains[:, None] * (self.vectors.T @ (root * y))))
