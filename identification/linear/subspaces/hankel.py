"""Triangular factors of tall matrices, including block Hankel ones: all windows of one length in all segments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from identification.linear.triangles import spans, triangle_from


def rows_of(parts: Sequence[np.ndarray], length: int) -> int:
    """Number of windows of this length in the segments."""
    return sum(max(len(part) - length + 1, 0) for part in parts)


def triangle(parts: Sequence[np.ndarray], length: int, columns: np.ndarray) -> np.ndarray:
    """R, upper triangular, of the QR decomposition of [1, windows[:, columns]].

    A window's entry is channel + channels * (sample in the window).
    """
    used = [part for part in parts if len(part) >= length]
    order = np.concatenate([[0], 1 + columns])
    return triangle_from(_normal_matrix(used, length)[np.ix_(order, order)], lambda: _rows(used, length, columns))


def _normal_matrix(parts: Sequence[np.ndarray], length: int) -> np.ndarray:
    """The matrix [1, windows]' [1, windows]; each block is its upper left neighbour plus one row and minus another."""
    q = parts[0].shape[1]
    total = np.zeros((1 + length * q, 1 + length * q))
    for z in parts:
        rows = len(z) - length + 1
        blocks = np.empty((length, length, q, q))
        for lag in range(length):
            blocks[0, lag] = z[:rows].T @ z[lag : lag + rows]
        leaving, coming = z[: length - 1], z[rows:]
        for i in range(1, length):
            blocks[i, i:] = (
                blocks[i - 1, i - 1 : -1]
                + coming[i - 1][:, None] * coming[i - 1 :][:, None, :]
                - leaving[i - 1][:, None] * leaving[i - 1 :][:, None, :]
            )
            blocks[i, :i] = blocks[:i, i].transpose(0, 2, 1)
        total[1:, 1:] += blocks.transpose(0, 2, 1, 3).reshape(length * q, length * q)
        sums = z[:rows].sum(axis=0) + np.concatenate([np.zeros((1, q)), np.cumsum(coming - leaving, axis=0)])
        total[0, 1:] += sums.ravel()
        total[1:, 0] += sums.ravel()
        total[0, 0] += rows
    return total


def _rows(parts: Sequence[np.ndarray], length: int, columns: np.ndarray) -> Iterator[np.ndarray]:
    for z in parts:
        windows = np.lib.stride_tricks.sliding_window_view(z, length, axis=0).transpose(0, 2, 1)
        for span in spans(len(windows)):
            flat = windows[span].reshape(-1, length * z.shape[1])[:, columns]
            yield np.concatenate([np.ones((len(flat), 1)), flat], axis=1)
