"""Sensitivities of a filter's errors to parameters and initial states, and least-squares steps of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from identification.fit.driven import driven_slopes
from identification.fit.followed import Followed, Point
from identification.fit.kalman import start_slopes
from identification.fit.kept import KeptSlopes
from identification.fit.linearised import at_once
from identification.fit.parameters import jumps, moves_of
from identification.fit.responses import Responses

_NO_START = 1e-9  # norm of the slopes by an initial state, over the largest one (or 1), below which it has no effect
_START_STEP = 1e-3  # step of an initial state, over its probe: slopes as accurate as those by parameters
_DAMPING = 1e-5  # over the information, so that no step goes far where the record holds next to no information
_TRIES, _TIGHTER = 6, 30.0  # tries of a step, and the factor of the damping from one try to the next
_DESCENTS = 3  # steps of the parameters with the same gains
_AWAY = 1e100  # a slope of a run that has diverged: the square of a larger one would not be finite
_ENOUGH = 10.0  # change of a free run, in deviations of the noise, above which a larger one counts the same
_BESIDE = (0.001, 0.003, 0.01, 0.02, 0.04, 0.06, 0.08, 0.1)
_NEAR_JUMPS = (*(1.0 - b for b in _BESIDE), *(1.0 + b for b in _BESIDE))  # factors tried for an effect with jumps
_MANY = 8  # fewest fitted coefficients for which keeping their responses saves time
NOTHING = 1e-4  # norm of the slopes by a path, in deviations per scale, below which the path has no effect
LEAST_GAIN = 0.005  # least gain of log-likelihood by an iteration for a fit to continue
TRIAL_GAIN = 0.1  # the same for a fit that is compared with others: two are tied within 4.5


class Sensitivities(Followed):
    """Sensitivities of a filter's errors to parameters and to the initial states of stretches, with the gains held."""

    def columns_of(
        self, point: Point, moves: Sequence[tuple[str, float]], vector: np.ndarray | None = None
    ) -> np.ndarray:
        """Slopes of the predictions, over the errors' deviations, (P, rows, C), for paths moved by steps in scales.

        The vehicle is run with the filter's gains for each moved parameter, all in one call.
        vector: the vector to move from, if not the point's; it must predict the same.
        """
        if not moves:
            return np.zeros((0, *self.measured.shape))

        def make(which: Sequence[int]) -> np.ndarray:
            vectors, steps = self._moved(point.vector if vector is None else vector, [moves[k] for k in which])
            return self._changes(point, vectors, point.starts, steps)

        if vector is not None:
            return make(range(len(moves)))
        return self._kept.of(point, self._keys(moves), make)

    def keep_columns(self, point: Point, moves: Sequence[tuple[str, float]], columns: np.ndarray) -> None:
        """Keep slopes of a point that were computed elsewhere, (P, rows, C); `columns_of` then returns them."""
        self._kept.keep(point, dict(zip(self._keys(moves), columns, strict=True)))

    def _keys(self, moves: Sequence[tuple[str, float]]) -> list[tuple[int, str, float, float]]:
        return [(id(self.plant), path, step, self.scale(path)) for path, step in moves]

    @cached_property
    def _kept(self) -> KeptSlopes:
        return KeptSlopes()

    def _changes(self, point: Point, vectors: np.ndarray, starts: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Changes of the predictions, over the steps and the errors' deviations, (S, rows, C)."""
        found, before = np.empty((len(vectors), *self.measured.shape)), self.measured - point.innovations
        for some in at_once(len(vectors), self.every.size):
            own = starts[some] if starts.ndim == 3 else starts
            y, _ = self._follow(vectors[some], own, point.gains, point.logs, point.system, False)
            with np.errstate(invalid="ignore", over="ignore"):
                change = (y - before) / steps[some, None, None]
            change[~((np.abs(change) < _AWAY) & self.finite)] = 0.0
            np.einsum("rmc,prc->prm", point.whiten, change, out=found[some])
        return found

    def flat_slopes(self, point: Point, paths: Sequence[str]) -> np.ndarray:
        """Slopes of the predictions by the paths, (P, rows * C)."""
        return self.flattened(self.columns_of(point, moves_of(paths)))

    def own_slopes(self, point: Point, paths: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Slopes of the predictions by the paths, and their part without initial states, (P, rows * C) both.

        The second is the part that initial states cannot imitate.  The differences are central: for a vehicle that
        turns away from its course, the error of one-sided ones would look like such a part.
        """
        moves = moves_of(paths)
        back = self.columns_of(point, [(path, -step) for path, step in moves])
        slopes = self.flattened(0.5 * (self.columns_of(point, moves) + back))
        basis = self._basis(0.5 * (self._run_starts(point)[0] + self._run_starts(point, -1.0)[0]))
        return slopes, slopes - (slopes @ basis) @ basis.T

    def without_starts(self, point: Point, slopes: np.ndarray, soon: bool = False) -> np.ndarray:
        """The part of slopes, (P, rows * C), that the initial states of the stretches cannot imitate.

        soon: use slopes by initial states from the linearised filter, which are as accurate as slopes by responses.
        """
        basis = self._basis(self._starts_for_steps(point)[0]) if soon else self.start_basis(point)
        return slopes - (slopes @ basis) @ basis.T

    def free_sensitivity(self, point: Point, paths: Sequence[str]) -> np.ndarray:
        """Change of free runs for a scale of each path, (P,): root sum square over readings, in sensor deviations."""
        deviations = np.sqrt(self._numbers(point.logs)[0])
        free = replace(
            point,
            gains=np.zeros_like(point.gains),
            innovations=self.measured
            - self._follow(
                point.vector[None], point.starts, np.zeros_like(point.gains), point.logs, point.system, False
            )[0][0],
            whiten=(self.finite * np.sqrt(self.counts))[:, :, None] * np.diag(1.0 / deviations),
        )
        columns = self.columns_of(free, moves_of(paths))
        # the distance to which an unstable free run diverges holds no information
        return np.sqrt((np.minimum(np.abs(columns), _ENOUGH) ** 2).sum(axis=(1, 2)))

    def start_basis(self, point: Point) -> np.ndarray:
        """An orthonormal basis, (rows * C, m), of the errors' changes by initial states of the stretches.

        Initial states are fitted.  With the part that they imitate taken out of the parameters' slopes, the filter's
        initial covariance makes no difference.
        """
        return self._basis(self._run_starts(point)[0])

    def _basis(self, columns: np.ndarray) -> np.ndarray:
        kept = columns[self._told_starts(columns)]
        if not len(kept):
            return np.zeros((columns.shape[1], 0))
        left, values, _ = np.linalg.svd((kept / np.linalg.norm(kept, axis=1)[:, None]).T, full_matrices=False)
        return left[:, values > 1e-6 * values[0]]

    @staticmethod
    def _told_starts(columns: np.ndarray) -> np.ndarray:
        """Which initial states have an effect on the errors, (m,), from their slopes, (m, rows * C)."""
        size = np.linalg.norm(columns, axis=1)
        return size > _NO_START * max(float(size.max(initial=0.0)), 1.0)

    def _run_starts(self, point: Point, side: float = 1.0) -> tuple[np.ndarray, list[tuple[np.ndarray, int]]]:
        """Slopes by the initial states from runs of the vehicle; see `_by_start`.  side: 1, or -1 for steps back."""
        probes = side * _START_STEP * self._probes(self.live)

        def make(which: Sequence[int]) -> np.ndarray:
            starts = np.repeat(point.starts[None], len(which), axis=0)
            for j, k in enumerate(which):
                starts[j, :, self.live[k]] += probes[k]
            vectors = np.repeat(point.vector[None], len(which), axis=0)
            return self._changes(point, vectors, starts, probes[which])

        keys = [(id(self.plant), int(i), float(probe)) for i, probe in zip(self.live, probes, strict=True)]
        return self._by_start(self._kept.of(point, keys, make))

    def _starts_for_steps(self, point: Point) -> tuple[np.ndarray, list[tuple[np.ndarray, int]]]:
        """Slopes by the initial states for steps: by the linearised filter, which is fast, if it is accurate enough.

        If a state continues from stretch to stretch, its initial value acts long after, when the vehicle is no longer
        on the filter's path.  The slopes are then from runs of the vehicle.
        """
        if self.carried.any():
            return self._run_starts(point)
        assert point.system is not None
        numbers = (point.gains, point.whiten, self._numbers(point.logs)[2])
        return self._by_start(start_slopes(point.system, *numbers))

    def _by_start(self, columns: np.ndarray) -> tuple[np.ndarray, list[tuple[np.ndarray, int]]]:
        """Slopes of the predictions by each initial state, (m, rows * C), and its stretches and state.

        columns: (n, rows, C), slopes by the live states, each moved at the beginning of every stretch.  An unknown
        constant has one initial state for all the stretches through which it continues.
        """
        states, anew, own = len(self._shared), np.cumsum(~self.carried), np.arange(len(self.stretches))
        found, owners = [], []
        for j, i in enumerate(self.live):
            group = anew if i < states and self._shared[i] else own
            for g in np.unique(group):
                mine = (group == g)[self.stretch_of_row]
                found.append(np.where(mine[:, None], columns[j], 0.0).ravel())
                owners.append((np.flatnonzero(group == g), int(i)))
        return np.array(found).reshape(len(owners), self.measured.size), owners

    @staticmethod
    def is_answered(point: Point) -> bool:
        """Whether a point has responses to coefficients."""
        return point.system is not None and point.system.responses is not None

    def prepared(self, point: Point, paths: Sequence[str], anew: bool = False) -> Point:
        """The point with responses to the coefficients among the paths, if these are many; `descended` is then fast.

        Responses to the same coefficients that the point already has are kept, even if from farther away.
        anew: compute them at this point in any case.
        """
        many = [p for p in paths if p in self.plant.doubted]
        if len(many) < _MANY or point.system is None or self.carried.any():
            return point
        known = point.system.responses
        if known is not None and known.paths == tuple(many) and not anew:
            return point
        responses = self._responses(point.vector, point.path, many)
        return replace(point, system=replace(point.system, responses=responses))

    def soon_slopes(self, point: Point, paths: Sequence[str]) -> np.ndarray:
        """Slopes of the predictions by the paths, (P, rows * C), by responses where the point has them."""
        known = None if point.system is None else point.system.responses
        many = [] if known is None else [p for p in paths if p in known.paths]
        if not many or known is None:
            return self.flat_slopes(point, paths)
        soon = self.slopes_by(point, known.of(many))
        found = np.empty((len(paths), *self.measured.shape))
        found[[p in known.paths for p in paths]] = soon
        rest = [p for p in paths if p not in known.paths]
        found[[p in rest for p in paths]] = self.columns_of(point, moves_of(rest))
        return self.flattened(found)

    def changing_slopes(self, point: Point, paths: Sequence[str], shares: np.ndarray) -> np.ndarray | None:
        """Slopes by coefficients that change by shares in each row, (rows,), by responses; None without responses.

        They equal those from runs of the vehicle up to the error of the responses, and cost next to nothing.
        """
        known = None if point.system is None else point.system.responses
        if known is None or not set(paths) <= set(known.paths):
            return None
        later, shares = known.of(paths), shares[:, None, None]
        return self.slopes_by(point, replace(later, onward=later.onward * shares, seen=later.seen * shares))

    def partly(self, point: Point, path: str, shares: np.ndarray) -> Responses:
        """The responses to a path that changes by shares in each row, (P, rows)."""
        whole = self._responses(point.vector, point.path, (path,))
        shares = shares.T[:, None]
        return Responses((path,) * shares.shape[2], whole.onward * shares, whole.seen * shares)

    def pushed_by(self, point: Point, axis: int, laws: np.ndarray) -> Responses:
        """The responses to accelerations, or lasting sensor errors, of the `axis`-th kind that follow laws, (P, rows).

        point: one with a system.  An acceleration holds from its row to the next one.  A sensor error follows the law
        one row late, since the reading has influenced the states and the commands of its own row.
        """
        assert point.system is not None
        if self.misread[axis]:
            laws = laws[:, np.maximum(np.arange(len(self.rows)) - 1, self.offsets[self.stretch_of_row])]
        solid, laws = len(self.live), laws.T[:, None]
        moved, seen = point.system.a[:, :, solid + axis, None], point.system.c[:, :, solid + axis, None]
        return Responses(("",) * laws.shape[2], moved * laws, seen * laws)

    def slopes_by(self, point: Point, responses: Responses) -> np.ndarray:
        """The slopes of the predictions that follow from responses, (P, rows, C).  point: one with a system."""
        assert point.system is not None
        numbers = (point.gains, point.whiten, self._numbers(point.logs)[2])
        slopes = driven_slopes(point.system, *numbers, responses)
        slopes[~(np.abs(slopes) < _AWAY)] = 0.0  # as of runs that diverge
        return slopes

    def _jumped(self, here: Point, paths: Sequence[str]) -> Point:
        """The point with the likeliest nearby sizes of effects with jumps, which slopes cannot find."""
        for path in filter(jumps, paths):
            k, tried = self.index[path], [here]
            for share in _NEAR_JUMPS:
                vector = here.vector.copy()
                vector[k] = np.clip(share * vector[k], *self.bounds(path))
                there = self.with_gains(here, vector)
                tried += [there] * bool(np.isfinite(there.scores).all())
            here = max(tried, key=lambda point: self.objective(point, paths))
        return here

    def descended(self, here: Point, paths: Sequence[str], iterations: int = _DESCENTS) -> Point:
        """The point of least squared errors over paths and initial states, with the filter's gains held.

        The iterations are those of Levenberg and Marquardt.
        """
        if here.system is None:
            return here
        here, paths = self._jumped(here, paths), [p for p in paths if not jumps(p)]
        every, owners, taken, count = np.zeros((0, 0)), list[tuple[np.ndarray, int]](), None, len(paths)
        for _ in range(iterations):
            if self.carried.any() or not self._near_by(taken, here.vector):
                starts, owners = self._starts_for_steps(here)
                moving = np.flatnonzero(self._told_starts(starts))
                starts, owners, taken = starts[moving], [owners[k] for k in moving], here.vector
                every = np.vstack([self.soon_slopes(here, paths), starts])
            if not len(every):
                break
            whole, right = every @ every.T, every @ here.errors.ravel()
            pulled, rates = self.pulls(here.vector, paths)
            whole[:count, :count] += np.diag(rates**2)
            right[:count] -= rates * pulled
            held = self.at_edge(here.vector, paths, right)
            whole[held], whole[:, held], right[held] = 0.0, 0.0, 0.0
            whole[held, held] = 1.0
            size, damping = np.sqrt(np.maximum(np.diag(whole), 1e-300)), _DAMPING
            scaled, before = whole / np.outer(size, size), self.objective(here, paths)
            for _ in range(_TRIES):
                step = np.linalg.solve(scaled + damping * np.eye(len(size)), right / size) / size
                if 0.5 * float(right @ step) < 0.1 * LEAST_GAIN:
                    return here
                moved = here.starts.copy()
                for (stretches, i), way in zip(owners, step[count:], strict=True):
                    moved[stretches, i] += way
                there = self.with_gains(here, self.moved_vector(here.vector, paths, step[:count]), moved)
                if self.objective(there, paths) > before:
                    break
                damping *= _TIGHTER
            else:
                return here
            here = there
        return here
