"""The choice of samples as centres of a fixed-size machine: far from each other, or of largest entropy."""

from __future__ import annotations

import numpy as np

from auv_gym.compiled import compiled

SWAPS_EACH = 40  # tried swaps for each centre; more hardly raise the entropy


def farthest(scaled: np.ndarray, size: int) -> np.ndarray:
    """Rows of the samples (n, d) chosen one by one, each as far as possible from the earlier ones, (at most size,).

    The first is nearest to the mean.  There are fewer if not enough samples differ.
    Source: Gonzalez 1985, Theoretical Computer Science 38 (farthest-first traversal).
    """
    first = int(np.argmin(np.sum((scaled - scaled.mean(axis=0)) ** 2, axis=1)))
    rows = np.empty(min(size, len(scaled)), dtype=np.int64)
    return rows[: _farthest(np.ascontiguousarray(scaled), first, np.full(len(scaled), np.inf), rows)]


@compiled
def _farthest(x, first, nearest, rows):
    """Fill rows, and return how many were found; nearest: (n,), inf."""
    row = first
    for found in range(rows.shape[0]):
        rows[found] = row
        most, farthest_row = 0.0, -1
        for i in range(x.shape[0]):
            square = 0.0
            for k in range(x.shape[1]):
                part = x[i, k] - x[row, k]
                square += part * part
            if square < nearest[i]:
                nearest[i] = square
            if nearest[i] > most:
                most, farthest_row = nearest[i], i
        if farthest_row < 0:
            return found + 1
        row = farthest_row
    return rows.shape[0]


def of_largest_entropy(scaled: np.ndarray, size: int, rng: np.random.Generator) -> np.ndarray:
    """Rows of `size` of the samples (n, d), drawn at random, then swapped one by one if that raises their entropy.

    There are fewer if not enough samples differ.  The entropy is Renyi's quadratic one, -log of the mean of K over all
    pairs, with a Parzen window of the width that is best for normal samples.
    Source: Suykens et al. 2002, Least Squares Support Vector Machines, ch. 6; De Brabanter et al. 2010, Computational
    Statistics and Data Analysis 54.
    """
    order = rng.permutation(np.unique(scaled, axis=0, return_index=True)[1])
    n, d = len(order), scaled.shape[1]
    if size >= n:
        return order
    width = (4.0 / ((d + 2.0) * n)) ** (1.0 / (d + 4.0)) * np.sqrt(np.mean(scaled.var(axis=0)))
    count = SWAPS_EACH * size
    leaving, coming = rng.integers(0, size, count), rng.integers(size, n, count)
    _swap(scaled / (2.0 * width), order, size, leaving, coming)
    return order[:size]


@compiled
def _swap(x, order, size, leaving, coming):
    """Swap order[leaving[i]] with order[coming[i]] if that lowers the sum of K over pairs of the first `size`."""
    for place, candidate in zip(leaving, coming):
        gain = 0.0
        for j in range(size):
            if j != place:
                gain += _bell(x, order[place], order[j]) - _bell(x, order[candidate], order[j])
        if gain > 0.0:
            order[place], order[candidate] = order[candidate], order[place]


@compiled
def _bell(x, i, j):
    square = 0.0
    for k in range(x.shape[1]):
        part = x[i, k] - x[j, k]
        square += part * part
    return np.exp(-square)
