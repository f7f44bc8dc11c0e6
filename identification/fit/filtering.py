"""An extended Kalman filter of a plant along a record, and how its one-step errors move with parameters and starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from auv_gym.plant import Correction
from identification.deciding import COST, LEAST_PROCESS
from identification.fit.adjoint import slopes_of
from identification.fit.driven import driven_slopes
from identification.fit.kalman import Pass, System, run_filter, start_slopes
from identification.fit.kept import KeptSlopes
from identification.fit.linearised import Linearised, at_once
from identification.fit.parameters import moves_of
from identification.fit.responses import Responses

_SAME = 0.05  # of the log-likelihood: starts that bring less leave the path as it is
_PASSES = 4  # of the filter, each from starts that the one before has fitted
_NO_START = 1e-9  # of the slopes by starts, below which one does nothing
_START_STEP = 1e-3  # of the probe of a state, over which slopes by starts are taken: as true as those by parameters
_LOOSE = 0.3  # deviations of a stretch's likeliest start that the filter lets it be off by
_LEAST_LEFT = 1e-10  # of a start's variance, of what a record leaves: less is rounding
_OTHER_NOISE = 0.7  # of its logarithm: noises that differ more tell of starts with another precision
_DAMPING = 1e-5  # of the information, so that no step goes far where the record tells next to nothing
_TRIES, _TIGHTER = 6, 30.0  # of a step, and how much more it is damped each time
_DESCENTS = 3  # steps of the parameters with the same gains
_AWAY = 1e100  # a slope of a run that has run away: its square would be no number
_ENOUGH = 10.0  # deviations of the noise by which a free run changes, from which on more counts the same
_MANY = 8  # coefficients of a fit, from which on it saves time to hold how the vehicle answers them
NOTHING = 1e-4  # deviations of all readings together: a path that moves them by less over a scale does nothing
LEAST_GAIN = 0.005  # of the log-likelihood, that a turn must bring for a fit to go on


@dataclass(frozen=True, eq=False)
class Point:
    """Parameters and noises, and the filter with them.

    vector: (n_parameters,).  logs: (C + 2 D,), logarithms of the noises.  errors: (rows, C), one-step errors over their
    deviations.  scores: (rows,), log-likelihood of each row.  path: (rows, F), filtered states; of
    averaged rows those before their readings.  gains: (rows, N, C), of the live states and accelerations.
    starts: (W, F), the likeliest states where stretches begin; roots: (W, n, n), how far the filter lets them be off.
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


def _other_precision(near: Point, logs: np.ndarray) -> bool:
    """Whether noises are so far from a point's that they tell of a start with another precision."""
    return bool(np.abs(logs - near.logs).max(initial=0.0) > _OTHER_NOISE)


class Filter(Linearised):
    """The filter of a plant through the stretches of a record, linearised about its own path."""

    def _fixed(self, stretch: int) -> np.ndarray:
        """Which live states do not begin anew in a stretch."""
        states = len(self._shared)
        return np.array([bool(self.carried[stretch]) and i < states and bool(self._shared[i]) for i in self.live])

    @cached_property
    def _widest(self) -> np.ndarray:
        """Roots of the starts' covariances of which nothing is known but how the states vary over the record."""
        return np.array(
            [np.diag(np.where(self._fixed(w), 0.0, self.spread[self.live])) for w in range(len(self.stretches))]
        )

    def _better_starts(
        self, system: System, made: Pass, logs: np.ndarray, starts: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The likeliest starts, and roots of `_LOOSE` times their deviations.

        A filter that begins so keeps near its linearisation.  How wide it begins does not matter: in a linear system
        its likelihood is that of the likeliest start but for a constant, whatever the model.
        """
        telling = self._telling
        slopes = slopes_of(system, made, telling, *self._numbers(logs))
        starts, roots, solid = starts.copy(), np.zeros_like(system.start), len(self.live)
        for w in range(len(self.stretches)):
            free = np.flatnonzero(~self._fixed(w))
            own = np.ix_(free, free)
            units = self.spread[self.live][free]
            r = slopes.means[w, :solid][free] * units
            with np.errstate(over="ignore", invalid="ignore"):
                n = np.outer(r, r) - 2.0 * slopes.covariances[w, :solid, :solid][own] * np.outer(units, units)
            if not np.isfinite(n).all():  # of a run so far off that its likelihood has no slope
                roots[w] = system.start[w]
                continue
            root = system.start[w][:, free] / units
            # the covariance R'R becomes R'(I - R N R')R; what that adds to its inverse is the data's information
            values, vectors = np.linalg.eigh(np.eye(len(root)) - root @ n @ root.T)
            cross = (vectors / np.sqrt(np.clip(values, _LEAST_LEFT, 1.0))).T @ root @ n
            values, vectors = np.linalg.eigh(0.5 * (n + n.T) + cross.T @ cross)
            values = np.maximum(values, 0.0)
            data, before = (vectors * values) @ vectors.T, root.T @ root
            told = r + data @ (before @ r)
            away = (self.starts[w][self.live][free] - starts[w][self.live][free]) / units
            inverse = (vectors / (values + 1.0)) @ vectors.T  # of data + I, however much the data tell
            step = inverse @ (told + away)
            starts[w, self.live[free]] += step * units
            half = vectors * np.minimum(_LOOSE / np.sqrt(values + 1.0), 1.0)
            roots[w][own] = (units[:, None] * half).T
        return starts, roots

    @property
    def _held_first(self) -> np.ndarray:
        """Which stretches begin with rows that do not count, (W,): these alone tell how they begin."""
        return self.counted[self.offsets] == 0.0

    @property
    def _telling(self) -> np.ndarray:
        """1 for the rows that tell where their stretch begins, (rows,): those before the first that counts otherwise.

        Likelihoods of rows given those between, which do not count, tell of a start what these leave.
        """
        turns = np.diff(self.counted, prepend=self.counted[0]) != 0.0
        turns[self.offsets] = False
        turned = np.cumsum(turns)
        return (turned == turned[self.offsets][self.stretch_of_row]).astype(float)

    def _numbers(self, logs: np.ndarray, every: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Variances of channels, deviations and correlation times of accelerations; see `run_filter`.

        every: those accelerations, too, that are hardly there, which a filter does without.
        """
        count, pushed = len(self.channels), len(self.pushed)
        deviations = np.exp(logs[count : count + pushed][self.leads]) * (self._there(logs) | every)
        return np.exp(2.0 * logs[:count]), deviations, np.exp(logs[count + pushed :][self.leads])

    def point(self, vector: np.ndarray, logs: np.ndarray, near: Point | None = None) -> Point:
        """The filter with parameters and noises, linearised along its own path.

        near: a point from whose starts it begins.
        """
        if near is None:
            first = self._system(vector, self.first_path, self.starts, self._widest)
            found, _ = self._filtered(vector, logs, first, self.starts, self._widest, anew=True, renewed=True)
            starts, roots = (found.starts, found.roots) if found.system else (self.starts, _LOOSE * self._widest)
        else:
            starts, roots = near.starts, near.roots
        renewed = near is None or _other_precision(near, logs)
        responses = near.system.responses if near is not None and near.system is not None else None
        best, highest = None, -np.inf
        for _ in range(_PASSES):
            system = self._followed_system(vector, self._numbers(logs), starts, roots)
            system = replace(system, responses=responses)
            found, gained = self._filtered(vector, logs, system, starts, roots, anew=False, renewed=renewed)
            total = self.total(found)
            best, highest = (found, total) if total > highest else (best, highest)
            if gained < _SAME:  # the path is that of the starts
                break
            starts, roots, renewed = found.starts, found.roots, False
        return best or self._nowhere(vector, logs)

    def _filtered(
        self,
        vector: np.ndarray,
        logs: np.ndarray,
        system: System,
        starts: np.ndarray,
        roots: np.ndarray,
        *,
        anew: bool,
        renewed: bool,
    ) -> tuple[Point, float]:
        """The filter of a linearised vehicle, and the vehicle run with its gains from the likeliest starts.

        And by how much these are likelier than those that the run began with.

        anew: whether the starts may be far from likely.  renewed: whether how well they are known may have changed.
        """
        if not (np.isfinite(system.a).all() and np.isfinite(system.error).all()):
            return self._nowhere(vector, logs), 0.0
        made = run_filter(system, *self._numbers(logs))
        if not np.isfinite(made.scores).all():
            return self._nowhere(vector, logs), 0.0
        if renewed or self._held_first.any():
            assert system.path is not None
            better, roots = self._better_starts(system, made, logs, starts)
            starts = better if anew else np.where(self._held_first[:, None], better, starts)
            system = replace(system, start=roots, origin=self._origin(system.path, starts))
            made = run_filter(system, *self._numbers(logs))
        found = self._followed(vector, logs, starts, made.gains, made.whiten, system)
        if not (np.isfinite(found.path).all() and np.isfinite(found.scores).all()):
            return self._nowhere(vector, logs), 0.0
        there = self.descended(found, ())
        assert there.system is not None
        assert system.path is not None
        system = replace(there.system, origin=self._origin(system.path, there.starts))
        return replace(there, system=system), self.total(there) - self.total(found)

    def _nowhere(self, vector: np.ndarray, logs: np.ndarray) -> Point:
        """What is left of a filter that runs away: as unlikely as can be."""
        (rows, count), size = self.finite.shape, len(self._moving)
        none, unlikely = np.zeros((rows, count)), np.full(rows, -np.inf)
        gains, whiten = np.zeros((rows, size, count)), np.zeros((rows, count, count))
        first = (self.first_path, gains, whiten, none, self.starts, self._widest)
        return Point(vector, logs, none, unlikely, *first, None)

    def _followed(
        self,
        vector: np.ndarray,
        logs: np.ndarray,
        starts: np.ndarray,
        gains: np.ndarray,
        whiten: np.ndarray,
        system: System,
    ) -> Point:
        """The vehicle itself run with the gains of a filter."""
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
        every = len(self.columns) == len(self.plant.outputs)  # channels are in the order of outputs
        return y if every else y[:, :, self.columns], after

    def _late(self, gains: np.ndarray, decays: np.ndarray, moves: np.ndarray | None) -> np.ndarray:
        """Gains that correct at the end of a row what those of the filter correct where it begins, (rows, N, C)."""
        assert moves is not None
        pushes = self._turned(decays[:, :, None] * gains[:, len(self.live) :])
        return np.concatenate([moves @ gains, pushes], axis=1)

    def _turned(self, pushes: np.ndarray) -> np.ndarray:
        """What turns of a swell make of accelerations in a row, (rows, D, C), when the next one begins."""
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
        """The log-likelihood of the rows that are counted."""
        total = float(point.scores[self.counted > 0.0].sum())
        return total if np.isfinite(total) else -np.inf

    def likelihood(self, point: Point, paths: Sequence[str]) -> float:
        """The same with what is known of the paths beforehand, and of correlation times."""
        known = 0.5 * float((self.pulls(point.vector, paths)[0] ** 2).sum())
        return self.total(point) - known + self._prior(point.logs)[0]

    def objective(self, point: Point, paths: Sequence[str]) -> float:
        """What a fit makes greatest: the same, less what accelerations must be worth to be there."""
        return self.likelihood(point, paths) - self._cost(point.logs)

    def is_pushed(self, point: Point) -> bool:
        """Whether random accelerations have any part in a point."""
        return bool(self._there(point.logs).any())

    def pushes(self, point: Point) -> np.ndarray:
        """Which of the accelerations have a part in a point, those of a swell apart, (D,)."""
        return self._there(point.logs) & ~self.swells

    def swelling(self, point: Point) -> np.ndarray:
        """Which accelerations of a swell have a part in a point, (D,)."""
        return self._there(point.logs) & self.swells

    def _cost(self, logs: np.ndarray) -> float:
        """What accelerations must be worth to be there, of the log-likelihood."""
        return COST * float(self._there(logs)[self._leading].sum())

    def _there(self, logs: np.ndarray, least: float = 10.0 * LEAST_PROCESS) -> np.ndarray:
        """Which accelerations are more than the least, in their units, (D,)."""
        first, pushed = len(self.channels), len(self.pushed)
        return np.exp(logs[first : first + pushed][self.leads]) > least * np.array(self.unit)

    def _prior(self, logs: np.ndarray) -> tuple[float, np.ndarray]:
        """Log-density of correlation times, which a vehicle's time scales bound, less what starts take up; its slope.

        Starts are fitted, so that the first readings of a stretch are met exactly, and would be the likelier the more
        exact readings are taken to be: in a record of many short stretches, without any noise (Neyman and Scott 1948).
        """
        slope, channels, pushed = np.zeros(logs.size), len(self.channels), len(self.pushed)
        slope[:channels] = self._taken_up
        value = float(self._taken_up @ logs[:channels])
        if not pushed:
            return value, slope
        centre, deviation, *_ = self.slowness
        far = np.where(self._leading, (logs[-pushed:] - centre) / deviation, 0.0)
        slope[-pushed:] = -far / deviation
        return value - 0.5 * float(far @ far), slope

    @cached_property
    def _taken_up(self) -> np.ndarray:
        """How many readings of each channel, (C,), go into the starts of stretches: one a state, of the first row."""
        first = self.finite[self.offsets[~self.carried]]
        states = int((self.live < len(self.plant.family.states)).sum())
        return (first * np.minimum(states / np.maximum(first.sum(axis=1, keepdims=True), 1), 1.0)).sum(axis=0)

    def columns_of(
        self, point: Point, moves: Sequence[tuple[str, float]], vector: np.ndarray | None = None
    ) -> np.ndarray:
        """Slopes of the predictions, over the errors' deviations, (P, rows, C), for paths moved by steps in scales.

        One call for all: the vehicle is run with the filter's gains and each parameter moved.  vector: one from which
        they are moved that predicts the same as the point's.
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
        """Let slopes of a point that are known from elsewhere, (P, rows, C), be those that `columns_of` gives."""
        self._kept.keep(point, dict(zip(self._keys(moves), columns, strict=True)))

    def _keys(self, moves: Sequence[tuple[str, float]]) -> list[tuple[int, str, float, float]]:
        return [(id(self.plant), path, step, self.scale(path)) for path, step in moves]

    @cached_property
    def _kept(self) -> KeptSlopes:
        return KeptSlopes()

    def _changes(self, point: Point, vectors: np.ndarray, starts: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """By how much predictions change, per step and over the errors' deviations, (S, rows, C)."""
        found, before = np.empty((len(vectors), *self.measured.shape)), self.measured - point.innovations
        for some in at_once(len(vectors), self.every.size):
            own = starts[some] if starts.ndim == 3 else starts
            y, _ = self._follow(vectors[some], own, point.gains, point.logs, point.system, False)
            with np.errstate(invalid="ignore", over="ignore"):
                change = (y - before) / steps[some, None, None]
            change[~((np.abs(change) < _AWAY) & self.finite)] = 0.0
            np.einsum("rmc,prc->prm", point.whiten, change, out=found[some])
        return found

    def counted_slopes(self, point: Point, paths: Sequence[str]) -> np.ndarray:
        """Slopes by the paths of the errors that count, (P, rows * C)."""
        return self.counted_flat(self.columns_of(point, moves_of(paths)))

    def own_slopes(self, point: Point, paths: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Slopes by the paths of the errors that count, and what starts cannot imitate of them, (P, rows * C) both.

        By central differences: what those to one side are off by looks like what starts cannot imitate, along a
        vehicle that turns away from its course.
        """
        moves = moves_of(paths)
        back = self.columns_of(point, [(path, -step) for path, step in moves])
        slopes = self.counted_flat(0.5 * (self.columns_of(point, moves) + back))
        basis = self._basis(0.5 * (self._run_starts(point)[0] + self._run_starts(point, -1.0)[0]))
        return slopes, slopes - (slopes @ basis) @ basis.T

    def counted_flat(self, columns: np.ndarray) -> np.ndarray:
        """Columns, (P, rows, C), flat, (P, rows * C), zero in the rows that do not count."""
        if not np.all(self.counted == 1.0):
            columns = columns * self._root
        return columns.reshape(len(columns), self.measured.size)

    def counted_errors(self, point: Point) -> np.ndarray:
        """The errors that count, (rows, C), zero in the other rows."""
        return point.errors * self._root

    @property
    def _root(self) -> np.ndarray:
        return np.sqrt(self.counted)[:, None]

    def without_starts(self, point: Point, slopes: np.ndarray) -> np.ndarray:
        """What the stretches' starts cannot imitate of slopes, (P, rows * C)."""
        basis = self.start_basis(point)
        return slopes - (slopes @ basis) @ basis.T

    def free_sensitivity(self, point: Point, paths: Sequence[str]) -> np.ndarray:
        """By how many deviations of the sensors' noise free runs change for a scale of each path, root sum square."""
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
        # a free run that is unstable says no more by running away further
        return np.sqrt((np.minimum(np.abs(columns), _ENOUGH) ** 2).sum(axis=(1, 2)))

    def start_basis(self, point: Point) -> np.ndarray:
        """An orthonormal basis, (rows * C, m), of what the stretches' starts can do to the errors that count.

        Starts are fitted: with what they imitate taken out of the slopes of parameters, it makes no difference how far
        the filter lets them be off.
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
        """Which starts do anything to the errors, by their columns, (m, rows * C)."""
        size = np.linalg.norm(columns, axis=1)
        return size > _NO_START * max(float(size.max(initial=0.0)), 1.0)

    def _run_starts(self, point: Point, side: float = 1.0) -> tuple[np.ndarray, list[tuple[np.ndarray, int]]]:
        """Columns of the starts by the vehicle itself; see `_by_start`.  side: 1, or -1 for steps back."""
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
        """Columns of the starts for steps: by the linearised filter, which is soon made, where it is true enough.

        What goes on from stretch to stretch is felt long after, where the vehicle is no longer on the filter's path.
        """
        if self.carried.any():
            return self._run_starts(point)
        assert point.system is not None
        numbers = (point.gains, point.whiten, self._numbers(point.logs)[2])
        return self._by_start(start_slopes(point.system, *numbers))

    def _by_start(self, columns: np.ndarray) -> tuple[np.ndarray, list[tuple[np.ndarray, int]]]:
        """Columns of errors that count by each start, (m, rows * C), and which stretches and state each is of.

        columns: (n, rows, C), by the live states, each moved where any stretch begins.  A state that nobody knows is
        one for all stretches in which it goes on.
        """
        columns, states = columns * self._root, len(self._shared)
        anew, own = np.cumsum(~self.carried), np.arange(len(self.stretches))
        found, owners = [], []
        for j, i in enumerate(self.live):
            group = anew if i < states and self._shared[i] else own
            for g in np.unique(group):
                mine = (group == g)[self.stretch_of_row]
                found.append(np.where(mine[:, None], columns[j], 0.0).ravel())
                owners.append((np.flatnonzero(group == g), int(i)))
        return np.array(found).reshape(len(owners), self.measured.size), owners

    def with_gains(self, point: Point, vector: np.ndarray, starts: np.ndarray | None = None) -> Point:
        """Other parameters, and starts, with the filter's gains of a point."""
        if point.system is None:
            return point
        starts = point.starts if starts is None else starts
        return self._followed(vector, point.logs, starts, point.gains, point.whiten, point.system)

    def prepared(self, point: Point, paths: Sequence[str]) -> Point:
        """The point with responses to those coefficients among paths, if they are many: `descended` is then quick.

        Those of a point farther away will do.
        """
        many = [p for p in paths if p in self.plant.doubted]
        if len(many) < _MANY or point.system is None or self.carried.any():
            return point
        known = point.system.responses
        if known is not None and known.paths == tuple(many):
            return point
        responses = self._responses(point.vector, point.path, many)
        return replace(point, system=replace(point.system, responses=responses))

    def soon_slopes(self, point: Point, paths: Sequence[str]) -> np.ndarray:
        """Slopes by the paths of the errors that count, by responses where a point has any; (P, rows * C)."""
        known = None if point.system is None else point.system.responses
        many = [] if known is None else [p for p in paths if p in known.paths]
        if not many or known is None:
            return self.counted_slopes(point, paths)
        soon = self.slopes_by(point, known.of(many))
        found = np.empty((len(paths), *self.measured.shape))
        found[[p in known.paths for p in paths]] = soon
        rest = [p for p in paths if p not in known.paths]
        found[[p in rest for p in paths]] = self.columns_of(point, moves_of(rest))
        return self.counted_flat(found)

    def changing_slopes(self, point: Point, paths: Sequence[str], shares: np.ndarray) -> np.ndarray | None:
        """Slopes by coefficients that change by shares in each row, (rows,), by responses; None where none are known.

        The same as those of the vehicle itself to what responses are off by, at hardly any cost.
        """
        known = None if point.system is None else point.system.responses
        if known is None or not set(paths) <= set(known.paths):
            return None
        later, shares = known.of(paths), shares[:, None, None]
        return self.slopes_by(point, replace(later, onward=later.onward * shares, seen=later.seen * shares))

    def partly(self, point: Point, path: str, shares: np.ndarray) -> Responses:
        """Responses to a path that changes by shares in each row, (P, rows)."""
        whole = self._responses(point.vector, point.path, (path,))
        shares = shares.T[:, None]
        return Responses((path,) * shares.shape[2], whole.onward * shares, whole.seen * shares)

    def pushed_by(self, point: Point, axis: int, laws: np.ndarray) -> Responses:
        """Responses to accelerations, or lasting errors, of the `axis`-th kind that follow laws, (P, rows).

        Of a point with a system; an acceleration is that of a row until the next one begins.  A reading errs by what a
        law was a row before: states and commands of its own row have been told by it.
        """
        assert point.system is not None
        if self.misread[axis]:
            laws = laws[:, np.maximum(np.arange(len(self.rows)) - 1, self.offsets[self.stretch_of_row])]
        solid, laws = len(self.live), laws.T[:, None]
        moved, seen = point.system.a[:, :, solid + axis, None], point.system.c[:, :, solid + axis, None]
        return Responses(("",) * laws.shape[2], moved * laws, seen * laws)

    def slopes_by(self, point: Point, responses: Responses) -> np.ndarray:
        """Slopes of the predictions by what has these responses, (P, rows, C), of a point with a system."""
        assert point.system is not None
        numbers = (point.gains, point.whiten, self._numbers(point.logs)[2])
        return driven_slopes(point.system, *numbers, responses)

    def descended(self, here: Point, paths: Sequence[str], iterations: int = _DESCENTS, exact: bool = False) -> Point:
        """The point of least squared errors over paths and starts, the filter's gains held; Levenberg and Marquardt.

        exact: whether slopes are those of the vehicle itself, also where responses are known.
        """
        if here.system is None:
            return here
        every, owners, taken, count = np.zeros((0, 0)), list[tuple[np.ndarray, int]](), None, len(paths)
        for _ in range(iterations):
            if self.carried.any() or not self._near_by(taken, here.vector):
                starts, owners = self._starts_for_steps(here)
                told = self._told_starts(starts)
                owned = np.array([not self._held_first[stretches].all() for stretches, _ in owners], dtype=bool)
                moving = np.flatnonzero(told & owned)
                starts, owners, taken = starts[moving], [owners[k] for k in moving], here.vector
                slopes = self.counted_slopes(here, paths) if exact else self.soon_slopes(here, paths)
                every = np.vstack([slopes, starts])
            if not len(every):
                break
            whole, right = every @ every.T, every @ self.counted_errors(here).ravel()
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
