"""Records as rows of a nonlinear difference equation, and free runs of its models over them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.models.lags import Lags
from auv_gym.models.narx import Narx
from identification.linear.regressors import Series

FAR = 1e6  # an error, in spreads of its output, at which a run counts as diverged
_EXACT = 1e-9  # of the spread of a target: a smaller residual of a linear part is rounding error


@dataclass(frozen=True, eq=False)
class Run:
    """A stretch of a segment: the remembered past at its first row, the inputs held until the last, and the outputs.

    past: (remembered,).  u: (n - 1, m).  y: (n, p).
    """

    past: np.ndarray
    u: np.ndarray
    y: np.ndarray


@dataclass(frozen=True, eq=False)
class Rows:
    """Regressors z (N, d) and targets (N, p) of all rows that have their lags in their own segment, and their series.

    middle, spread: (d,).  number: segment of each row; offset: its place there.
    """

    series: Series
    lags: Lags
    z: np.ndarray
    target: np.ndarray
    middle: np.ndarray
    spread: np.ndarray
    number: np.ndarray
    offset: np.ndarray

    @classmethod
    def of(cls, series: Series, lags: Lags) -> Rows:
        """The rows of a series; segments too short for the lags give none."""
        first, z, targets, places = lags.first, [], [], []
        for number, (u, y) in enumerate(zip(series.u, series.y, strict=True)):
            if len(y) > first + 1:
                z.append(lags.regressors(u[:-1], y[:-1]))
                targets.append(y[first + 1 :] - lags.carried * y[first:-1])
                places += [(number, row) for row in range(first, len(y) - 1)]
        found = np.concatenate(z) if z else np.empty((0, len(lags.matrix)))
        target = np.concatenate(targets) if targets else np.empty((0, len(lags.outputs)))
        middle, spread = (found.mean(axis=0), found.std(axis=0)) if len(found) else (np.zeros(0), np.zeros(0))
        at = np.array(places, dtype=int).reshape(-1, 2)
        return cls(series, lags, found, target, middle, spread, at[:, 0], at[:, 1])

    @property
    def scaled(self) -> np.ndarray:
        """(z - middle) / spread."""
        return (self.z - self.middle) / self.spread

    @property
    def rest(self) -> np.ndarray:
        """Means of the outputs and of the inputs, (p + m,)."""
        return np.concatenate([np.concatenate(s).mean(axis=0) for s in (self.series.y, self.series.u)])

    @property
    def sway(self) -> np.ndarray:
        """Root mean square of the outputs' increments, and standard deviations of the inputs, (p + m,)."""
        steps = np.concatenate([np.diff(y, axis=0) for y in self.series.y])
        return np.concatenate([np.sqrt(np.mean(steps**2, axis=0)), np.concatenate(self.series.u).std(axis=0)])

    def linear(self, chosen: np.ndarray, trend: bool) -> tuple[np.ndarray, np.ndarray]:
        """Least-squares slopes (d, p) and bias (p,) over the chosen rows; without a trend only the means."""
        target = self.target[chosen]
        if not trend:
            return np.zeros((self.spread.size, target.shape[1])), target.mean(axis=0)
        columns = np.column_stack([self.scaled[chosen], np.ones(len(target))])
        found = np.linalg.lstsq(columns, target, rcond=1e-10)[0]
        return found[:-1] / self.spread[:, None], found[-1]

    def left(self, slopes: np.ndarray, bias: np.ndarray) -> np.ndarray:
        """The residual of the targets after a linear part, (N, p); zero if it is rounding error."""
        left = self.target - bias - (self.z - self.middle) @ slopes
        return np.where(left.std(axis=0) > _EXACT * self.target.std(axis=0), left, 0.0)

    def runs(self, start: int, stop: int) -> list[Run]:
        """The stretches of segments within rows start..stop."""
        found = []
        for number in np.unique(self.number[start:stop]):
            mine = self.offset[start:stop][self.number[start:stop] == number]
            a, b, first = int(mine[0]), int(mine[-1]) + 1, self.lags.first
            u, y = self.series.u[number], self.series.y[number]
            past = self.lags.remembered(u[a - first : a + 1], y[a - first : a + 1])[0]
            found.append(Run(past, u[a:b], y[a : b + 1]))
        return found


def run_errors(model: Narx, runs: Sequence[Run]) -> np.ndarray:
    """Errors of free runs, minus their mean in each run for integrating outputs, (rows, p); infinite if diverged."""
    errors = []
    for run in runs:
        error = model.free(run.past, run.u) - run.y[1:]
        with np.errstate(invalid="ignore"):  # infinities are caught below
            errors.append(error - model.lags.carried * error.mean(axis=0))
    joined = np.concatenate(errors)
    spread = np.maximum(np.concatenate([run.y for run in runs]).std(axis=0), np.finfo(float).tiny)
    return joined if np.all(np.abs(joined) < FAR * spread) else np.full(joined.shape, np.inf)
