"""The autocorrelation of free-run residuals, and its removal, for planning experiments."""

from __future__ import annotations

import numpy as np

from identification.fit.shooting import Point, Shooting


def colour(problem: Shooting, point: Point) -> np.ndarray:
    """First-order autocorrelation of each channel's residual within the windows, shape (C,), 0 where it is white.

    A fit of F states per window of n samples lowers the estimate by about F (1 + 2 phi) / n (Marriott and Pope 1954,
    for a mean and a trend); this bias is corrected.  Coefficients within 2 standard errors of white count as white.
    """
    coefficients = []
    same = problem.window_of_row[1:] == problem.window_of_row[:-1]
    for c in range(len(problem.channels)):
        e = np.where(problem.finite[:, c], point.residual[:, c], 0.0)
        n, power = int(problem.counts[c]), float(e @ e)
        length = n / len(problem.windows)
        raw = float(np.sum(e[1:] * e[:-1] * same)) / power if power > 0.0 else 0.0
        lost = len(problem.start_states) / len(problem.channels) / length
        phi = (raw * length / max(length - 1.0, 1.0) + lost) / max(1.0 - 2.0 * lost, 0.5)
        coefficients.append(0.0 if phi < 2.0 / np.sqrt(max(n, 1)) else min(phi, 0.98))
    return np.array(coefficients)


def whitened(problem: Shooting, values: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Values (..., rows, C) as innovations of a first-order process in each window; unchanged if coefficients are 0.

    Source: Prais and Winsten 1954, with the first sample of a window scaled by sqrt(1 - phi^2).
    """
    values = np.where(problem.finite, values, 0.0)
    before = np.roll(values, 1, axis=-2)
    first = np.zeros(values.shape[-2], dtype=bool)
    first[problem.offsets] = True
    return np.where(first[:, None], values * np.sqrt(1.0 - coefficients**2), values - coefficients * before)
