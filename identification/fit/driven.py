"""Slopes of the predictions by parameters: a vehicle's responses (`responses.py`) passed through a filter's gains."""

from __future__ import annotations

import numpy as np

from auv_gym.compiled import compiled, outlined
from auv_gym.physics.pushes import turned
from identification.fit.kalman import System
from identification.fit.responses import Responses


def driven_slopes(
    system: System, gains: np.ndarray, whiten: np.ndarray, times: np.ndarray, responses: Responses
) -> np.ndarray:
    """Slopes of the scaled predictions by parameters, with the gains held, (P, rows, C), in the linearised filter.

    gains: (rows, N, C) and whiten: (rows, C, C), as in a pass.  times: (D,), correlation times of accelerations, s.
    """
    s, rows, count = system, *system.c.shape[:2]
    slopes = np.zeros((rows, count, len(responses.paths)))
    decays = np.exp(-s.durations[:, None] / times)
    angles = s.durations[:, None] * s.turning
    numbers = (s.a, s.c, s.begin, s.constant, decays, angles, np.ascontiguousarray(gains), whiten)
    _driven(*numbers, np.ascontiguousarray(responses.onward), np.ascontiguousarray(responses.seen), slopes)
    return np.ascontiguousarray(slopes.transpose(2, 0, 1))


@compiled
def _add_product(sums, sign, matrix, rows):
    """Add sign * matrix @ rows to sums; (M, P), (M, N) and (N, P); zeros of the matrix, which are many, are skipped."""
    for m in range(matrix.shape[0]):
        for n in range(matrix.shape[1]):
            factor = sign * matrix[m, n]
            if factor != 0.0:
                for p in range(rows.shape[1]):
                    sums[m, p] += factor * rows[n, p]


@outlined
def _driven(a, c, begin, constant, decays, angles, gains, whiten, onward, seen, slopes):
    """The loop of `driven_slopes`, for all parameters at once.  decays, angles: (rows, D); slopes: (rows, C, P)."""
    rows, count, size = c.shape
    solid, number = onward.shape[1], onward.shape[2]
    moved, after, change = np.zeros((size, number)), np.zeros((solid, number)), np.zeros((count, number))
    for k in range(rows):
        if begin[k] > 0:
            for i in range(size):
                if begin[k] == 1 or not constant[i]:
                    for p in range(number):
                        moved[i, p] = 0.0
        for m in range(count):
            for p in range(number):
                change[m, p] = seen[k, m, p]
        _add_product(change, 1.0, c[k], moved)
        _add_product(slopes[k], 1.0, whiten[k], change)
        _add_product(moved, -1.0, gains[k], change)
        for i in range(solid):
            for p in range(number):
                after[i, p] = onward[k, i, p]
        _add_product(after, 1.0, a[k], moved)
        for i in range(solid):
            for p in range(number):
                moved[i, p] = after[i, p]
        for d in range(size - solid):
            for p in range(number):
                moved[solid + d, p] *= decays[k, d]
        for d in range(size - solid):
            if angles[k, d] != 0.0:
                i, cosine, sine = solid + d, np.cos(angles[k, d]), np.sin(angles[k, d])
                for p in range(number):
                    moved[i, p], moved[i + 1, p] = turned(moved[i, p], moved[i + 1, p], cosine, sine)
