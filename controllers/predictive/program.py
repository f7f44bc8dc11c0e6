"""The quadratic program of a plan: matrices built once, vectors at every sample, and the solver DAQP."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from controllers.predictive.increments import Increments

_FAR = 1e30  # the solver's value for no limit
_STIFFEST = 3e-5  # of a limit: its square is the smallest number that the solver distinguishes from zero
_TOLERANCE = 1e-8  # of the rows, which are scaled by their limits' ranges


@dataclass(frozen=True, eq=False)
class Aims:
    """The weights and limits of a plan, as arrays over inputs (m) or outputs (p); infinite without a limit.

    weights: (p,), of an output's error, 0 if it has no target.  move_weights: (m,).  rates: (m,), largest change in a
    sample.  lowest, highest: (m,) and output_lowest, output_highest: (p,), minus the model's offsets.
    fading: factor per sample of the reference's distance from its goal.  soft: see Program.
    """

    horizon: int
    moves: int
    first: int
    weights: np.ndarray
    move_weights: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    rates: np.ndarray
    output_lowest: np.ndarray
    output_highest: np.ndarray
    fading: float
    soft: float


@dataclass(frozen=True, eq=False)
class Program:
    """Minimise x' hessian x / 2 + (slope s)' x within bounds that depend on s; s = [z | goals | references].

    x: the moves, m at a time, in units of 1 / move_weights.  rows: of x, after the simple bounds of x itself; the last
    `softened` of them are limits of outputs.
    Output limits are kept if any moves can keep them, at whatever cost.  Otherwise they are softened: the square of the
    violation, in half ranges, costs `soft` times the plan's own slope, so that no weight outweighs it.
    """

    hessian: np.ndarray
    slope: np.ndarray
    rows: np.ndarray
    upper: np.ndarray
    lower: np.ndarray
    bound_slope: np.ndarray
    unit: np.ndarray
    softened: int
    soft: float

    def solve(self, s: np.ndarray) -> np.ndarray | None:
        """The moves, shape (moves, m), in the inputs' units; None if there are none within the inputs' limits."""
        upper, lower = self.upper.copy(), self.lower.copy()
        linear, moved = self.slope @ s, self.bound_slope @ s
        upper[linear.size :] += moved
        lower[linear.size :] += moved
        x, _, status, _ = solver().solve(self.hessian, linear, self.rows, upper, lower, primal_tol=_TOLERANCE)
        if status <= 0 and self.softened:
            x, status = self._give_way(linear, upper, lower)
        return x[: linear.size].reshape(-1, self.unit.size) * self.unit if status > 0 else None

    def _give_way(self, linear: np.ndarray, upper: np.ndarray, lower: np.ndarray) -> tuple[np.ndarray, int]:
        """Moves, followed by the violations of the last rows, in rows' lengths; and the solver's status.

        The violations are explicit variables: the solver's own soft constraints, in the version tried, write out of
        bounds.
        """
        n, more = linear.size, self.softened
        hessian = 2.0 * np.eye(n + more)
        hessian[:n, :n] = self.hessian
        rows = np.hstack([self.rows, np.zeros((len(self.rows), more))])
        lengths = np.diag(np.linalg.norm(self.rows[-more:], axis=1))
        free = np.full(more, _FAR)
        upper, lower = np.concatenate([upper[:n], free, upper[n:]]), np.concatenate([lower[:n], -free, lower[n:]])
        give = max(1.0 / np.sqrt(self.soft * (1.0 + np.abs(linear).max())), _STIFFEST)
        linear = np.concatenate([linear, np.zeros(more)])
        x, status = linear, 0
        while status <= 0 and give < 1.0:
            rows[-more:, n:] = -give * lengths
            x, _, status, _ = solver().solve(hessian, linear, rows, upper, lower, primal_tol=_TOLERANCE)
            give *= 10.0  # an unstable model's far rows are nearly dependent: the solver then accepts a softer limit
        return x, status


def build(increments: Increments, aims: Aims) -> Program:
    """The program of a plan.  Source: Maciejowski 2002, Predictive Control with Constraints, secs. 2.6, 3.1 to 3.4."""
    a, b, c = increments.a, increments.b, increments.c
    m, n = b.shape[1], a.shape[0]
    unit = 1.0 / aims.move_weights
    tracked = np.flatnonzero(aims.weights)
    limited = np.flatnonzero(np.isfinite(aims.output_lowest) | np.isfinite(aims.output_highest))
    free, forced = _predictions(a, b * unit, c, aims.horizon, aims.moves)
    free, forced = free[aims.first - 1 :], forced[aims.first - 1 :]
    steps, size, t = len(free), aims.moves * m, tracked.size

    # errors: outputs minus goal - fading^j (goal - reference)
    weight = aims.weights[tracked][None, :, None]
    fade = aims.fading ** np.arange(aims.first, aims.horizon + 1)
    wanted = np.zeros((steps, t, 2 * t))
    wanted[:, range(t), range(t)] = (1.0 - fade)[:, None]
    wanted[:, range(t), range(t, 2 * t)] = fade[:, None]
    errors = (weight * np.concatenate([free[:, tracked], -wanted], axis=2)).reshape(steps * t, n + 2 * t)
    reach = (weight * forced[:, tracked]).reshape(steps * t, size)

    bound = np.tile(aims.rates / unit, aims.moves)
    # inputs: their last values, at the end of z, plus the moves so far
    some = np.flatnonzero(np.isfinite(aims.lowest) | np.isfinite(aims.highest))
    scale = _ranges(aims.lowest[some], aims.highest[some])
    sums = np.kron(np.tril(np.ones((aims.moves, aims.moves))), (np.diag(unit)[some].T / scale).T)
    was = np.zeros((some.size, n + 2 * t))
    was[range(some.size), n - m + some] = 1.0 / scale
    rows = [sums]
    slopes = [-np.tile(was, (aims.moves, 1))]
    uppers, lowers = [np.tile(aims.highest[some] / scale, aims.moves)], [np.tile(aims.lowest[some] / scale, aims.moves)]
    for output in limited:
        lowest, highest = aims.output_lowest[output], aims.output_highest[output]
        scale = float(_ranges(np.array([lowest]), np.array([highest]))[0])
        rows.append(forced[:, output] / scale)
        slopes.append(np.hstack([-free[:, output] / scale, np.zeros((steps, 2 * t))]))
        uppers.append(np.full(steps, highest / scale))
        lowers.append(np.full(steps, lowest / scale))
    return Program(
        hessian=2.0 * (reach.T @ reach + np.eye(size)),
        slope=2.0 * reach.T @ errors,
        rows=np.concatenate(rows),
        upper=_finite(np.concatenate([bound, *uppers])),
        lower=_finite(np.concatenate([-bound, *lowers])),
        bound_slope=np.concatenate(slopes),
        unit=unit,
        softened=limited.size * steps,
        soft=aims.soft,
    )


def solver() -> Any:
    """DAQP; raises if it is not installed."""
    try:
        return import_module("daqp")
    except ImportError:
        raise ValueError("Predictive control needs the package `daqp`: pip install daqp.") from None


def _predictions(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, horizon: int, moves: int
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs 1 to `horizon` samples ahead per state, (horizon, p, n), and per move, (horizon, p, moves m)."""
    p, m = c.shape[0], b.shape[1]
    free, power = np.empty((horizon, p, a.shape[0])), c
    pulse = np.empty((horizon, p, m))
    for j in range(horizon):
        pulse[j] = power @ b
        power = power @ a
        free[j] = power
    forced = np.zeros((horizon, p, moves * m))
    for move in range(min(moves, horizon)):
        forced[move:, :, move * m : (move + 1) * m] = pulse[: horizon - move]
    return free, forced


def _ranges(lowest: np.ndarray, highest: np.ndarray) -> np.ndarray:
    """Half of each range; for a range open at one side, the magnitude of its end."""
    half = 0.5 * (highest - lowest)
    ends = np.where(np.isfinite(highest), np.abs(highest), np.abs(lowest))
    return np.where(np.isfinite(half), half, np.where(ends > 0.0, ends, 1.0))


def _finite(bounds: np.ndarray) -> np.ndarray:
    return np.clip(bounds, -_FAR, _FAR)
