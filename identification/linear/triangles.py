"""Triangular factors of matrices with many rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

SPAN = 1024  # rows per decomposition, so that they stay in the processor's cache
# Smallest eigenvalue of the scaled normal matrix for which its Cholesky factor is six digits more accurate than the
# noise; if smaller (without noise, or with an integrator), the rows themselves are factorised.
_WELL_CONDITIONED = 1e-8


def triangle_of(parts: Iterable[np.ndarray]) -> np.ndarray:
    """R of the QR decomposition of stacked parts, square, with zero rows if they have too few."""
    r = np.empty((0, 0))
    for part in parts:
        r = np.asarray(np.linalg.qr(np.concatenate([r.reshape(-1, part.shape[1]), part]), mode="r"))
    return np.concatenate([r, np.zeros((r.shape[1] - r.shape[0], r.shape[1]))])


def triangle_tall(matrix: np.ndarray) -> np.ndarray:
    """R of the QR decomposition of a matrix with many rows."""
    return triangle_from(matrix.T @ matrix, lambda: (matrix[span] for span in spans(len(matrix))))


def triangle_from(normal: np.ndarray, rows: Callable[[], Iterable[np.ndarray]]) -> np.ndarray:
    """R of a matrix from its normal matrix, or from its rows if the normal matrix has lost digits."""
    size = np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))
    scaled = normal / np.outer(size, size)
    if np.linalg.eigvalsh(scaled)[0] > _WELL_CONDITIONED:
        return np.linalg.cholesky(scaled).T * size
    return triangle_of(rows())


def spans(count: int) -> list[slice]:
    """Slices of at most `SPAN` rows."""
    return [slice(at, min(at + SPAN, count)) for at in range(0, max(count, 1), SPAN)]
