"""The quadratic program of a plan: matrices made once, vectors at every sample, and the solver DAQP."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from controllers.predictive.increments import Increments

_FAR = 1e30  # what the solver takes as no limit
_TOLERANCE = 1e-8  # of the rows, which are scaled by their limits' ranges


@dataclass(frozen=True, eq=False)
class Aims:
    """What a plan weighs and keeps to, as arrays over inputs (m) or outputs (p); infinite where there is no limit.

    weights: (p,), of an output's error, 0 where it has no target.  move_weights: (m,).  rates: (m,), a sample's
    largest change.  lowest, highest: (m,) and output_lowest, output_highest: (p,), less the model's offsets.
    fading: of the reference's distance from its goal, a sample.  soft: cost of an output's limit broken by its range.
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
    """Minimise x' hessian x / 2 + (linear s + soft)' x within bounds that s moves; s = [z | goals | references].

    x: the moves, m at a time, in units of 1 / move_weights; then how far the plan breaks each output's limits.
    rows: of x, after the simple bounds of x itself.
    """

    hessian: np.ndarray
    linear: np.ndarray
    slope: np.ndarray
    rows: np.ndarray
    upper: np.ndarray
    upper_slope: np.ndarray
    lower: np.ndarray
    lower_slope: np.ndarray
    unit: np.ndarray
    size: int

    def solve(self, s: np.ndarray) -> np.ndarray | None:
        """The moves, shape (moves, m), in the inputs' units; None if there are none within the inputs' limits."""
        upper, lower = self.upper.copy(), self.lower.copy()
        bounds = self.hessian.shape[0]
        upper[bounds:] += self.upper_slope @ s
        lower[bounds:] += self.lower_slope @ s
        x, _, status, _ = solver().solve(
            self.hessian, self.linear + self.slope @ s, self.rows, upper, lower, primal_tol=_TOLERANCE
        )
        if status <= 0:
            return None
        return x[: self.size].reshape(-1, self.unit.size) * self.unit

    def gain(self) -> np.ndarray:
        """The first move without limits per entry of s, shape (m, len(s))."""
        free = -np.linalg.solve(self.hessian[: self.size, : self.size], self.slope[: self.size])
        return self.unit[:, None] * free[: self.unit.size]


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

    # errors: outputs less goal - fading^j (goal - reference)
    weight = aims.weights[tracked][None, :, None]
    fade = aims.fading ** np.arange(aims.first, aims.horizon + 1)
    wanted = np.zeros((steps, t, 2 * t))
    wanted[:, range(t), range(t)] = (1.0 - fade)[:, None]
    wanted[:, range(t), range(t, 2 * t)] = fade[:, None]
    errors = (weight * np.concatenate([free[:, tracked], -wanted], axis=2)).reshape(steps * t, n + 2 * t)
    reach = (weight * forced[:, tracked]).reshape(steps * t, size)
    variables = size + limited.size
    hessian = np.diag(np.full(variables, 2.0 * aims.soft))
    hessian[:size, :size] = 2.0 * (reach.T @ reach + np.eye(size))
    slope = np.zeros((variables, n + 2 * t))
    slope[:size] = 2.0 * reach.T @ errors
    linear = np.zeros(variables)
    linear[size:] = aims.soft  # per range broken: exact, where the constraint's multipliers stay below it

    bound = np.concatenate([np.tile(aims.rates / unit, aims.moves), np.full(limited.size, np.inf)])
    # inputs: what they were, which z ends in, and the moves so far
    some = np.flatnonzero(np.isfinite(aims.lowest) | np.isfinite(aims.highest))
    scale = _ranges(aims.lowest[some], aims.highest[some])
    sums = np.kron(np.tril(np.ones((aims.moves, aims.moves))), (np.diag(unit)[some].T / scale).T)
    was = np.zeros((some.size, n + 2 * t))
    was[range(some.size), n - m + some] = 1.0 / scale
    rows = [np.hstack([sums, np.zeros((len(sums), limited.size))])]
    slopes = [-np.tile(was, (aims.moves, 1))]
    uppers, lowers = [np.tile(aims.highest[some] / scale, aims.moves)], [np.tile(aims.lowest[some] / scale, aims.moves)]
    for i, output in enumerate(limited):
        lowest, highest = aims.output_lowest[output], aims.output_highest[output]
        scale = _ranges(np.array([lowest]), np.array([highest]))[0]
        for limit, side in ((highest, 1.0), (lowest, -1.0)):
            if not np.isfinite(limit):
                continue
            row = np.zeros((steps, variables))
            row[:, :size] = side * forced[:, output] / scale
            row[:, size + i] = -1.0
            rows.append(row)
            at = np.zeros((steps, n + 2 * t))
            at[:, :n] = -side * free[:, output] / scale
            slopes.append(at)
            uppers.append(np.full(steps, side * limit / scale))
            lowers.append(np.full(steps, -np.inf))
    both = np.concatenate(slopes)
    return Program(
        hessian=hessian,
        linear=linear,
        slope=slope,
        rows=np.concatenate(rows),
        upper=_finite(np.concatenate([bound, *uppers])),
        upper_slope=both,
        lower=_finite(np.concatenate([-bound[:size], np.zeros(limited.size), *lowers])),
        lower_slope=both,
        unit=unit,
        size=size,
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
    """Half of each range; of one that is open at a side, the size of its end."""
    half = 0.5 * (highest - lowest)
    ends = np.where(np.isfinite(highest), np.abs(highest), np.abs(lowest))
    return np.where(np.isfinite(half), half, np.where(ends > 0.0, ends, 1.0))


def _finite(bounds: np.ndarray) -> np.ndarray:
    return np.clip(bounds, -_FAR, _FAR)
