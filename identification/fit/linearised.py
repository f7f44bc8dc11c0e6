"""A plant linearised about a path of states, row by row, for the filter of a record."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from auv_gym.physics.pushes import misreads, ways_of
from identification.fit.extended import program_of
from identification.fit.kalman import System
from identification.fit.parameters import moves_of
from identification.fit.responses import Responses
from identification.fit.stretches import Stretches

_NEAR = 0.1  # of a scale, a hundredth of a coefficient: largest change of a parameter for which slopes are reused
_AT_ONCE = 2**22  # numbers in the outputs of runs that are made together, 32 MiB


def at_once(count: int, each: int, beside: int = 0) -> Iterator[slice]:
    """Slices of `count` runs that may be made together; each: numbers of one.  beside: further runs in each."""
    size = max(_AT_ONCE // max(each, 1) - beside, 1)
    return (slice(first, first + size) for first in range(0, count, size))


class Linearised(Stretches):
    """A plant along the stretches of a record, with its slopes from row to row."""

    def _system(self, vector: np.ndarray, path: np.ndarray, starts: np.ndarray, roots: np.ndarray) -> System:
        """The plant linearised along a path of states, with the prior of the stretches' starts."""
        return self._with_slopes(vector, path, starts, roots, *self._slopes(vector, path, self.live))

    def _followed_system(
        self, vector: np.ndarray, logs: tuple[np.ndarray, np.ndarray, np.ndarray], starts: np.ndarray, roots: np.ndarray
    ) -> System:
        """The plant linearised along the path of its own extended Kalman filter, see `extended.filtered`.

        logs: variances of the channels, and deviations and correlation times of accelerations, as for `run_filter`.
        """
        variances, deviations, times = logs
        plant, runs, live, there = self.plant, self.runs, self.live, deviations > 0.0
        rows, states = len(self.rows), self._size
        own = np.r_[np.arange(states), states + np.flatnonzero(there)]
        path, after = np.zeros((rows, states + len(there))), np.empty((rows, own.size))
        found, seen = np.empty((rows, own.size)), np.empty(self.measured.shape)
        a, c = np.empty((rows, live.size, live.size)), np.empty((rows, self.measured.shape[1], live.size))
        until, vectors = plant.pieces(vector)
        first, ways = ways_of(self.kicks[there])
        if self.stride == 1:  # an acceleration does not change a single reading
            first, ways = first[:0], np.full_like(ways, -1)
        pushing = np.flatnonzero(there)[first]
        moved, probes = np.r_[live, states + first], self._probes(np.r_[live, states + pushing])
        self.work.add((1 + len(moved)) * rows * self.stride)
        with np.errstate(all="ignore"):  # the filter may diverge
            program_of(plant)(
                vectors, until, runs.begin, runs.stop, self.carried, self._shared, runs.times, runs.inputs, runs.first,
                runs.references, plant.longest_step, runs.stride, runs.shares, np.ascontiguousarray(starts[:, own]),
                roots, self.measured, self.finite, self.counts, self.columns, moved, probes, ways,
                np.searchsorted(live, self._pushed[there]), np.ascontiguousarray(self.kicks[there]), self.durations,
                np.exp(-self.durations[:, None] / times[there]), variances, deviations[there], times[there],
                found, a, c, seen, after,
            )  # fmt: skip
        path[:, own] = found
        return self._with_slopes(vector, path, starts, roots, a, c, seen, after)

    def _with_slopes(
        self,
        vector: np.ndarray,
        path: np.ndarray,
        starts: np.ndarray,
        roots: np.ndarray,
        a: np.ndarray,
        c: np.ndarray,
        y: np.ndarray,
        after: np.ndarray,
    ) -> System:
        """The system from slopes along a path, and from the outputs and next states there, see `_slopes`."""
        live, solid, pushed = self.live, len(self.live), len(self.pushed)
        rows = len(self.rows)
        kicked, felt = np.zeros((rows, solid, pushed)), np.zeros((rows, c.shape[1], pushed))
        for d in np.flatnonzero(self.kicks[:, 0] < 0.0):
            felt[:, self.columns == misreads(self.kicks[d]), d] = 1.0
        first, ways = ways_of(self.kicks)
        acting = ways >= 0
        if self.stride > 1:
            moving, seen = self._slopes(vector, path, live, self._size + first)[:2]
            kicked[:, :, acting], felt[:, :, acting] = moving[:, :, ways[acting]], seen[:, :, ways[acting]]
        else:
            for d in np.flatnonzero(acting):
                j = int(np.flatnonzero(live == self._pushed[d])[0])
                kicked[:, :, d] = self.kicks[d, 1] * a[:, :, j]
                kicked[:, j, d] += self.kicks[d, 2]
            kicked *= self.durations[:, None, None]
        moves = np.concatenate([a, kicked], axis=2) if self.stride > 1 else None
        for j in np.flatnonzero(live >= len(self._shared)):  # the state of a sensor without a lag does not persist
            if np.median(np.abs(a[:, j, j] - 1.0)) < 1e-9:
                a[:, j], a[:, :, j], c[:, :, j] = 0.0, 0.0, 0.0
        error, forcing = self._residual(y, after, path, felt, kicked)
        begin = np.zeros(rows, dtype=np.int64)
        begin[self.offsets] = np.where(self.carried, 2, 1)
        constant = np.zeros(solid + pushed, dtype=bool)
        states = len(self._shared)
        constant[:solid] = [i < states and bool(self._shared[i]) for i in live]
        return System(
            np.ascontiguousarray(np.concatenate([a, kicked], axis=2)),
            np.ascontiguousarray(np.concatenate([c, felt], axis=2)), forcing, error, self.finite, self.counts,
            begin, constant, self.durations, roots, self._origin(path, starts), moves, vector, path,
            turns=np.ascontiguousarray(self.kicks[:, 3]),
        )  # fmt: skip

    def _residual(
        self, y: np.ndarray, after: np.ndarray, path: np.ndarray, felt: np.ndarray, kicked: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Measured minus the output of a zero state, and what a run from row to row adds to the state, see `System`.

        felt: (rows, C, D) and kicked: (rows, N - D, D), the effects of accelerations on a row's outputs and on the next
        row.
        """
        pushes = path[:, self._size :]
        error = np.where(self.finite, self.measured - y, 0.0)
        error += self.finite * np.einsum("rcd,rd->rc", felt, pushes)
        forcing = np.zeros((len(path), len(self.live)))
        forcing[:-1] = path[1:, self.live] - after[:-1, self.live]
        forcing += np.einsum("rnd,rd->rn", kicked, pushes)
        return error, forcing

    def _near_by(self, taken: np.ndarray | None, vector: np.ndarray) -> bool:
        """Whether no parameter is over `_NEAR` of a scale from where slopes were taken, and nothing else differs."""
        if taken is None or taken.shape != vector.shape:
            return False
        moved = set(np.flatnonzero(vector != taken).tolist())
        paths = [p for p, i in self.index.items() if i in moved] if moved else []
        return len(paths) == len(moved) and all(
            abs(vector[self.index[p]] - taken[self.index[p]]) <= _NEAR * self.scale(p) for p in paths
        )

    def _moved(self, vector: np.ndarray, moves: Sequence[tuple[str, float]]) -> tuple[np.ndarray, np.ndarray]:
        """Vectors (P, n), each with one path moved by a step in scales, within bounds, and the steps (P,)."""
        vectors, steps = np.repeat(vector[None], len(moves), axis=0), []
        for j, (path, step) in enumerate(moves):
            i, size = self.index[path], step * self.scale(path)
            if not self.bounds(path)[0] <= vectors[j, i] + size <= self.bounds(path)[1]:
                step, size = -step, -size
            vectors[j, i] += size
            steps.append(step)
        return vectors, np.array(steps)

    def _responses(self, vector: np.ndarray, path: np.ndarray, paths: Sequence[str]) -> Responses:
        """Responses of outputs and next states to paths, over one row from the states of a path, (rows, F)."""
        vectors, steps = self._moved(vector, moves_of(paths))
        onward = np.empty((len(self.rows), len(self.live), len(steps)))
        seen = np.empty((len(self.rows), len(self.columns), len(steps)))
        for some in at_once(len(steps), self.every.size, beside=1):
            own = np.concatenate([vector[None], vectors[some]])
            self.work.add(len(own) * len(self.rows) * self.stride)
            y, after = self.plant.follow_many(self._by_row, own, path[None], self._one_by_one(), True)
            with np.errstate(over="ignore", invalid="ignore"):  # a run may diverge
                for j, step in enumerate(steps[some], start=1):
                    onward[:, :, some.start + j - 1] = (after[j] - after[0])[:, self.live] / step
                    seen[:, :, some.start + j - 1] = (y[j] - y[0])[:, self.columns] / step
        return Responses(tuple(paths), onward, seen)

    def _origin(self, path: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """The initial means of stretches, relative to a path, (W, N); those of accelerations are zero."""
        origin = np.zeros((len(self.stretches), len(self.live) + len(self.pushed)))
        origin[:, : len(self.live)] = (starts - path[self.offsets])[:, self.live]
        return origin
