"""How likely the residuals of a fit are: their colour, the evidence for a change, the covariance of the parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter

from identification.fit.blocks import block_step
from identification.fit.shooting import RESIDUAL_FLOOR, Linearisation, Point, Shooting

POLISH, POLISH_DAMPING = 3, 1e-6  # steps at most
POLISH_SHARES = (1.0, 0.4, 0.1)  # of a step that are tried


def colour(problem: Shooting, point: Point) -> np.ndarray:
    """First-order autocorrelation of each channel's residual within the windows, shape (C,), 0 where it is white.

    A fit of F states per window of n samples takes about F (1 + 2 phi) / n from the estimate (Marriott and Pope 1954,
    for a mean and a trend); that is put back. Coefficients within 2 standard errors of white count as white.
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
    """Values (..., rows, C) as innovations of a first-order process in each window; unchanged where coefficients are 0.

    Source: Prais and Winsten 1954, with the first sample of a window scaled by sqrt(1 - phi^2).
    """
    values = np.where(problem.finite, values, 0.0)
    before = np.roll(values, 1, axis=-2)
    first = np.zeros(values.shape[-2], dtype=bool)
    first[problem.offsets] = True
    return np.where(first[:, None], values * np.sqrt(1.0 - coefficients**2), values - coefficients * before)


def window_costs(problem: Shooting, point: Point, coefficients: np.ndarray) -> np.ndarray:
    """Sums of squared innovations by window and channel, shape (W, C)."""
    return np.add.reduceat(whitened(problem, point.residual, coefficients) ** 2, problem.offsets, axis=0)


def evidence(problem: Shooting, before: Point, after: Point, coefficients: np.ndarray) -> float:
    """Twice the gain in log-likelihood from one point to another, residuals taken as first-order processes."""
    a = window_costs(problem, before, coefficients).sum(axis=0)
    b = window_costs(problem, after, coefficients).sum(axis=0)
    return float(np.sum(problem.counts * np.log((a + RESIDUAL_FLOOR) / (b + RESIDUAL_FLOOR))))


def polished(problem: Shooting, point: Point, paths: Sequence[str], coefficients: np.ndarray) -> Point:
    """The point near by that is likelier where residuals are first-order processes; the same where they are white.

    A fit takes residuals for white. What two such fits leave of slow residuals differs by what their starts happen to
    take up, far more than by what a small effect explains: only the likeliest starts and paths can be compared.
    """
    if not np.any(coefficients):
        return point
    here, cost = point, _negative_likelihood(problem, point, paths, coefficients)
    for _ in range(POLISH):
        sigma = np.sqrt(window_costs(problem, here, coefficients).sum(axis=0) / np.maximum(problem.counts, 1)) + 1e-9
        flat, starts = (whitened(problem, x, coefficients) for x in problem.differences(here, paths, sigma))
        residual = whitened(problem, here.residual, coefficients) / sigma
        gram, cross, start_gradient = problem.blocks.normal(starts, flat, residual)
        normal, gradient = problem.equations(flat, residual, here.vector, paths)
        step = block_step(normal, gradient, gram, cross, start_gradient, POLISH_DAMPING)
        best = here
        for share in POLISH_SHARES:
            there = problem.point(*problem.moved(here.vector, here.starts, paths, step, share), paths)
            reached = _negative_likelihood(problem, there, paths, coefficients)
            if reached < cost:
                best, cost = there, reached
                break
        if best is here:
            break
        here = best
    return here


def _negative_likelihood(problem: Shooting, point: Point, paths: Sequence[str], coefficients: np.ndarray) -> float:
    """Minus the log-likelihood of residuals of a colour and of what is known of the paths, but for a constant."""
    if not np.isfinite(point.cost):
        return np.inf
    costs = window_costs(problem, point, coefficients).sum(axis=0)
    return 0.5 * float(
        problem.counts @ np.log(costs + RESIDUAL_FLOOR) + (problem.pulls(point.vector, paths)[0] ** 2).sum()
    )


def covariance(
    problem: Shooting, point: Point, paths: Sequence[str], linear: Linearisation, coefficients: np.ndarray
) -> tuple[np.ndarray, float]:
    """Covariance of the parameters in units of their scales, (P, P), and its degrees of freedom.

    Sandwich form for residuals with first-order correlation; it is the usual inverse of the normal matrix for white
    ones. Slow residuals are what the fitted starts and parameters absorb most: the residuals' variance is raised by
    what they take of it.  Source: Ljung 1999, sec. 9.3-9.4.
    """
    count = linear.columns.shape[0]
    middle = np.zeros((count, count))
    gram, mixed = np.zeros((2, len(problem.windows), len(linear.starts), len(linear.starts)))
    for c, phi in enumerate(coefficients):
        x, z = linear.columns[:, :, c], linear.starts[:, :, c]
        middle += _correlated(x, phi, problem.offsets) @ x.T
        gram += _by_window(z, z, problem.offsets)
        mixed += _by_window(z, _correlated(z, phi, problem.offsets), problem.offsets)
    known = np.diag(problem.pulls(point.vector, paths)[1] ** 2)
    middle += known
    bread = np.linalg.pinv(linear.information + known, rcond=1e-12, hermitian=True)
    taken = np.trace(bread @ middle) + np.einsum("wff->", np.linalg.pinv(gram, rcond=1e-12, hermitian=True) @ mixed)
    total = float(problem.counts.sum())
    sigma = problem.sigma(point)
    variance = float(np.mean((sigma * linear.weights) ** 2)) * total / max(total - float(taken), 0.1 * total)
    fitted = count + problem.nuisances
    freedom = float(np.sum(problem.counts * (1.0 - coefficients))) - fitted
    return bread @ middle @ bread * variance, max(freedom, 3.0)


def _by_window(x: np.ndarray, y: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """x y^T over the rows of each window; x, y: (F, rows); the result is (W, F, F)."""
    return np.add.reduceat(np.einsum("fr,gr->rfg", x, y), offsets, axis=0)


def _correlated(x: np.ndarray, phi: float, offsets: np.ndarray) -> np.ndarray:
    """x (P, rows) times the Toeplitz matrix phi^|i-j| of each window."""
    if phi == 0.0:
        return x
    result = np.empty_like(x)
    for start, stop in zip(offsets, np.r_[offsets[1:], x.shape[1]], strict=True):
        block = x[:, start:stop]
        forward = lfilter([1.0], [1.0, -phi], block)
        backward = np.fliplr(lfilter([1.0], [1.0, -phi], np.fliplr(block)))
        result[:, start:stop] = forward + backward - block
    return result
