"""A plant run along a record with the gains of a filter, and the likelihood of the record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from weakref import ref

import numpy as np

from auv_gym.plant import Correction
from identification.deciding import COST, LEAST_PROCESS
from identification.fit.kalman import System, run_filter, start_slopes
from identification.fit.linearised import Linearised

_KNOWN_STARTS = 64  # points whose starts are known to tell so much


@dataclass(frozen=True, eq=False)
class Point:
    """Parameters and noises, and the filter's results for them.

    vector: (n_parameters,).  logs: (C + 2 D,), logarithms of the noises.  errors: (rows, C), one-step errors over their
    deviations.  scores: (rows,), log-likelihood of each row.  path: (rows, F), filtered states; for averaged rows, the
    states before the readings.  gains: (rows, N, C), of the live states and accelerations.
    starts: (W, F), the likeliest states where stretches begin; roots: (W, n, n), square roots of the filter's initial
    covariances, transposed.
    """

    vector: np.ndarray
    logs: np.ndarray
    errors: np.ndarray
    scores: np.ndarray
    path: np.ndarray
    gains: np.ndarray
    whiten: np.ndarray
    innovations: np.ndarray
    starts: np.ndarray
    roots: np.ndarray
    system: System | None


class Followed(Linearised):
    """A plant that follows a record by the gains of a filter, and the likelihood of the record."""

    def _numbers(self, logs: np.ndarray, every: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Variances of channels, deviations and correlation times of accelerations; see `run_filter`.

        every: include negligible accelerations, which a filter otherwise leaves out.
        """
        count, pushed = len(self.channels), len(self.pushed)
        deviations = np.exp(logs[count : count + pushed][self.leads]) * (self._there(logs) | every)
        return np.exp(2.0 * logs[:count]), deviations, np.exp(logs[count + pushed :][self.leads])

    def _followed(
        self,
        vector: np.ndarray,
        logs: np.ndarray,
        starts: np.ndarray,
        gains: np.ndarray,
        whiten: np.ndarray,
        system: System,
    ) -> Point:
        """The nonlinear vehicle run with the gains of a filter."""
        y, after = self._follow(vector[None], starts, gains, logs, system, True)
        innovations = np.where(self.finite, self.measured - y[0], 0.0)
        before = np.empty_like(after[0])
        before[1:] = after[0][:-1]
        first = starts.copy()
        for w in np.flatnonzero(self.carried):
            first[w, : len(self._shared)][self._shared] = before[self.offsets[w], : len(self._shared)][self._shared]
        before[self.offsets] = first
        if self.stride == 1:
            before[:, self._moving] += np.einsum("rnc,rc->rn", gains, innovations)
        with np.errstate(over="ignore", invalid="ignore"):
            errors, scores = self._scored(whiten, innovations)
        return Point(vector, logs, errors, scores, before, gains, whiten, innovations, starts, system.start, system)

    def _follow(
        self,
        vectors: np.ndarray,
        starts: np.ndarray,
        gains: np.ndarray,
        logs: np.ndarray,
        system: System | None,
        keep: bool,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Predictions (S, rows, C) of runs with gains and, with `keep`, the states one row later."""
        times = self._numbers(logs)[2]
        decays = np.exp(-self.durations[:, None] / times) if len(times) else np.ones((len(self.rows), 0))
        if self.stride > 1 and system is not None:
            gains = self._late(gains, decays, system.moves)
        starts = starts if starts.ndim == 3 else starts[None]
        self.work.add(len(vectors) * self.runs.rows * self.stride)
        corrected = (self.every, gains, self._moving, self.columns)
        correction = Correction(*corrected, self.kicks, decays, self.carried, self._shared)
        y, after = self.plant.follow_many(self.runs, vectors, starts, correction, keep)
        every = len(self.columns) == len(self.plant.outputs)  # channels have the order of outputs
        return y if every else y[:, :, self.columns], after

    def _late(self, gains: np.ndarray, decays: np.ndarray, moves: np.ndarray | None) -> np.ndarray:
        """Gains, (rows, N, C), that apply at the end of a row the correction of the filter's gains at its start."""
        assert moves is not None
        pushes = self._turned(decays[:, :, None] * gains[:, len(self.live) :])
        return np.concatenate([moves @ gains, pushes], axis=1)

    def _turned(self, pushes: np.ndarray) -> np.ndarray:
        """Rotate the accelerations of a swell, (rows, D, C), from the start of a row to the start of the next one."""
        found = pushes.copy()
        for d in np.flatnonzero(self.kicks[:, 3]):
            angle = self.kicks[d, 3] * self.durations[:, None]
            found[:, d] = np.cos(angle) * pushes[:, d] - np.sin(angle) * pushes[:, d + 1]
            found[:, d + 1] = np.sin(angle) * pushes[:, d] + np.cos(angle) * pushes[:, d + 1]
        return found

    def _scored(self, whiten: np.ndarray, innovations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        errors = np.einsum("rmc,rc->rm", whiten, innovations)
        diagonal = np.einsum("rcc->rc", whiten)
        logs = np.log(np.where(self.finite, np.maximum(diagonal, 1e-300), 1.0))
        scores = (logs - 0.5 * errors**2 - 0.5 * np.log(2.0 * np.pi) * self.finite).sum(axis=1)
        return errors, scores

    def total(self, point: Point) -> float:
        """The log-likelihood of the likeliest starts."""
        total = float(point.scores.sum())
        return total if np.isfinite(total) else -np.inf

    def likelihood(self, point: Point, paths: Sequence[str]) -> float:
        """The log-likelihood plus the log-priors of the paths and of the correlation times."""
        known = 0.5 * float((self.pulls(point.vector, paths)[0] ** 2).sum())
        return self.marginal(point) - known + self._prior(point.logs)[0]

    def objective(self, point: Point, paths: Sequence[str]) -> float:
        """The objective of a fit: `likelihood` minus the cost of the accelerations that are present."""
        return self.likelihood(point, paths) - self._cost(point.logs)

    def is_pushed(self, point: Point) -> bool:
        """Whether any random acceleration is present at a point."""
        return bool(self._there(point.logs).any())

    def pushes(self, point: Point) -> np.ndarray:
        """Which accelerations are present at a point, without those of a swell, (D,)."""
        return self._there(point.logs) & ~self.swells

    def swelling(self, point: Point) -> np.ndarray:
        """Which accelerations of a swell are present at a point, (D,)."""
        return self._there(point.logs) & self.swells

    def _cost(self, logs: np.ndarray) -> float:
        """The log-likelihood that accelerations must gain to be kept."""
        return COST * float(self._there(logs)[self._leading].sum())

    def _there(self, logs: np.ndarray, least: float = 10.0 * LEAST_PROCESS) -> np.ndarray:
        """Which accelerations exceed the least strength, in their units, (D,)."""
        first, pushed = len(self.channels), len(self.pushed)
        return np.exp(logs[first : first + pushed][self.leads]) > least * np.array(self.unit)

    def _prior(self, logs: np.ndarray) -> tuple[float, np.ndarray]:
        """Log-prior of correlation times, given a vehicle's time scales, and its slope by the noises, (C + 2 D,)."""
        slope, pushed = np.zeros(logs.size), len(self.pushed)
        if not pushed:
            return 0.0, slope
        deviation = self.slowness[1]
        far = np.where(self._leading, (logs[-pushed:] - self.usual_times) / deviation, 0.0)
        slope[-pushed:] = -far / deviation
        return -0.5 * float(far @ far), slope

    @cached_property
    def widest(self) -> np.ndarray:
        """Roots of the covariances of starts of which only the spread of the states over the record is known."""
        return np.array(
            [np.diag(np.where(self._fixed(w), 0.0, self.spread[self.live])) for w in range(len(self.stretches))]
        )

    def _fixed(self, stretch: int) -> np.ndarray:
        """Which live states do not begin anew in a stretch."""
        states = len(self._shared)
        return np.array([bool(self.carried[stretch]) and i < states and bool(self._shared[i]) for i in self.live])

    def marginal(self, point: Point) -> float:
        """The log-likelihood, whatever the starts of the stretches were.

        `total` is that of the likeliest starts, which take up a part of what drifts do, and meet the first readings:
        in a record of many short stretches there would seem to be hardly any noise (Neyman and Scott 1948).  The
        difference is in the determinants of the innovations' covariances (Harville 1977, restricted likelihood).
        """
        return self.total(point) + self._by_starts(point)

    def _by_starts(self, point: Point) -> float:
        if point.system is None:
            return 0.0
        key = (id(point.system), point.logs.tobytes())
        held = self._known_by_starts.get(key)
        if held is not None and held[0]() is point.system:
            return held[1]
        less = self._narrower(point, point.system)
        found = less if np.isfinite(less) else 0.0
        while len(self._known_by_starts) >= _KNOWN_STARTS:
            self._known_by_starts.pop(next(iter(self._known_by_starts)), None)
        self._known_by_starts[key] = ref(point.system), found
        return found

    def _narrower(self, point: Point, system: System) -> float:
        """Half the logarithm of the determinant of all innovations' covariance, less that with the `widest` starts.

        If each stretch begins anew, it follows from the slopes by the starts (the matrix determinant lemma), in a
        fraction of the time of a filter.
        """
        numbers = self._numbers(point.logs)
        if self.carried.any():
            diagonal = np.einsum("rcc->rc", point.whiten)[self.finite]
            return -float(np.log(diagonal).sum() + run_filter(system, *numbers, start=self.widest).spreads.sum())
        slopes, own, total = start_slopes(system, point.gains, point.whiten, numbers[2]), np.eye(len(self.live)), 0.0
        for w in range(len(self.stretches)):
            wide = np.diag(self.widest[w])
            here = slopes[:, self.stretch_of_row == w].reshape(len(own), -1) * wide[:, None]
            units = np.where(wide > 0.0, wide, 1.0)
            less = own - (system.start[w] / units).T @ (system.start[w] / units)
            total -= 0.5 * float(np.linalg.slogdet(own + less @ (here @ here.T))[1])
        return total

    @cached_property
    def _known_by_starts(self) -> dict[tuple[int, bytes], tuple[ref[System], float]]:
        return {}

    def flattened(self, columns: np.ndarray) -> np.ndarray:
        """Columns, (P, rows, C), flattened to (P, rows * C)."""
        return columns.reshape(len(columns), self.measured.size)

    def with_gains(self, point: Point, vector: np.ndarray, starts: np.ndarray | None = None) -> Point:
        """The point of other parameters, and starts, with the filter's gains of a given point."""
        if point.system is None:
            return point
        starts = point.starts if starts is None else starts
        return self._followed(vector, point.logs, starts, point.gains, point.whiten, point.system)
