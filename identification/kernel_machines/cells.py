"""Reduction of many samples to cells spread over the space of the inputs, each with the mean of its samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auv_gym.compiled import compiled


@dataclass(frozen=True, eq=False)
class Cells:
    """Means of the samples in each cell, inputs x (n, d) and targets y (n, m), and their numbers, weights (n,)."""

    x: np.ndarray
    y: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray, most: int) -> Cells:
        """The samples in at most `most` cells; one cell each if there are no more.

        Each new centre is the sample farthest from all earlier ones, so that rare inputs have cells as common ones do.
        Source: Gonzalez 1985, Theoretical Computer Science 38, 293-306.
        """
        if len(x) <= most:
            return cls(x, y, np.ones(len(x)))
        first = int(np.argmin(np.sum((x - x.mean(axis=0)) ** 2, axis=1)))
        number, square = np.zeros(len(x), dtype=np.int64), np.full(len(x), np.inf)
        count = _spread_out(np.ascontiguousarray(x), first, most, number, square)
        weights = np.bincount(number, minlength=count).astype(float)
        means = [
            np.stack([np.bincount(number, column, minlength=count) for column in values.T], axis=1) / weights[:, None]
            for values in (x, y)
        ]
        return cls(means[0], means[1], weights)


@compiled
def _spread_out(x, first, most, number, square):
    """Write the number of each sample's cell into number (n,); return the number of cells."""
    centre = first
    for cell in range(most):
        farthest, distance = centre, 0.0
        for i in range(x.shape[0]):
            total = 0.0
            for k in range(x.shape[1]):
                total += (x[i, k] - x[centre, k]) ** 2
            if total < square[i]:
                square[i], number[i] = total, cell
            if square[i] > distance:
                farthest, distance = i, square[i]
        if distance == 0.0:  # all remaining samples repeat a centre
            return cell + 1
        centre = farthest
    return most
