"""Free runs of a plant over windows of a record as a least-squares problem, and its solution.

Multiple shooting: every window has initial states of its own, which are fitted with the parameters and eliminated by
blocks, so the cost grows with the length of the record and not with the square of the number of windows.
Source: Bock 1983, "Recent advances in parameter identification techniques for ODE"; Schittkowski 2002, ch. 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from auv_gym.channels import channel
from auv_gym.model import outputs_of
from auv_gym.param import spec_at, value_at
from auv_gym.plant import Chart, Plant, Runs
from auv_gym.records.record import Record
from identification.fit.blocks import Blocks, block_step
from identification.fit.first_readings import first_readings
from identification.fit.parameters import Parameters

_START_STEP = 1e-4  # change of an initial state for its slopes
_START_PROBE = 1e-3  # change of an initial state to test whether it matters
FORGOTTEN = 0.05  # share of that change left after a sample, below which an initial state is not fitted
PIECE = 6  # samples of the short runs from which shared states are first guessed
TRIES, TIGHTER = 10, 8.0  # most tries of a step, and the factor of its damping each time
STALE_TRIES = 2  # most tries of a step by slopes that were taken elsewhere
FAR = 1e6  # a residual, rad or m, at which a run counts as diverged
RESIDUAL_FLOOR = 1e-12  # keeps the logarithm of a perfect fit finite
_ENOUGH = 1e-7  # gain in cost for each reading below which a fit ends


@dataclass(frozen=True, eq=False)
class Point:
    """A parameter vector, the states at the windows' starts, and the resulting residuals and cost.

    vector: (n_parameters,).  starts: (W, n_states).  residual: (rows, C), NaN where nothing was measured.
    """

    vector: np.ndarray
    starts: np.ndarray
    residual: np.ndarray
    cost: float


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Sensitivities of the outputs with the windows' starts projected out, weighted by the channels' deviations.

    columns: (P, rows, C).  starts: (F, rows, C), sensitivities to the windows' starts.  raw: (P,), norms of the columns
    before the projection.
    """

    columns: np.ndarray
    starts: np.ndarray
    raw: np.ndarray


class Shooting(Parameters):
    """Measured outputs of a record in windows, and the runs of a plant that are fitted to them.

    channels: the plant's outputs that the record holds.  measured: (rows, C), the target of the runs.  logged: the
    record's values, and signals: the values that follow the vehicle's motion; these three differ for attitudes in a
    `Chart`, which the starts then use, too.  start_states: indices of the states that the outputs reveal.
    shared: index and unit of the states that have one value in each segment, the same in all its windows (`Family`).
    segments: (W,), number of each window's segment, among the segments with windows.
    """

    def __init__(self, plant: Plant, record: Record, windows: Sequence[slice]):
        if not windows:
            raise ValueError(
                "A fit needs at least one window of data, got none: record longer or choose shorter windows."
            )
        super().__init__(plant, np.inf)
        self.record, self.windows = record, tuple(windows)
        self.chart = Chart.along(plant.family, record)
        self.runs = Runs.over(plant, record, windows, self.chart)
        self.channels = tuple(name for name in plant.outputs if record.has(name))
        if not self.channels:
            raise ValueError(
                f"Plant {plant.name!r} needs at least one of {', '.join(plant.outputs)} in the record, "
                f"got {', '.join(record.names)}: rename the columns by a mapping."
            )
        columns = [plant.outputs.index(name) for name in self.channels]
        self.columns = np.array(columns)
        self.angles = np.array([channel(name).angle for name in self.channels])
        rows = np.concatenate([np.arange(w.start, w.stop) for w in windows])
        self.logged = outputs_of(plant, record)[rows][:, columns]
        self.measured = self.chart.readings(self.channels, self.logged)
        self.signals = self.chart.signals(self.channels, self.logged, rows)
        self.finite = np.isfinite(self.measured)
        self.counts = self.finite.sum(axis=0)
        lengths = self.runs.stop - self.runs.begin
        self.offsets = np.r_[0, np.cumsum(lengths)[:-1]]
        self.window_of_row = np.repeat(np.arange(len(windows)), lengths)
        self.steps = plant.family.differences
        unknown = unknown_states(plant)
        self.shared = [(plant.family.states.index(state), spec_at(plant, unknown[state]).probe) for state in unknown]
        self.segments = np.unique(self.runs.first[self.runs.begin], return_inverse=True)[1]

    @cached_property
    def first_guess(self) -> np.ndarray:
        """States at the windows' starts, shape (W, n_states).

        Measured states are read off, rates of measured signals come from their first samples, shared states from runs
        over a few samples, in which a wrong value has little effect, and the rest are zero.
        """
        return self._with_shared(first_readings(self), self.plant)

    @cached_property
    def _short(self) -> Shooting | None:
        """The record in runs of a few samples, in which shared states have little effect; None if it is already."""
        if not self.shared or max(w.stop - w.start for w in self.windows) < 2 * PIECE:
            return None
        return Shooting(self.plant, self.record, [p for w in self.windows for p in _pieces(w)])

    def _with_shared(self, starts: np.ndarray, plant: Plant) -> np.ndarray:
        """The starts with the shared states fitted to short runs of a plant."""
        if self._short is None:
            return starts
        found = self._short.solve(plant, ()).starts
        first = np.unique(self._short.segments, return_index=True)[1]
        starts = starts.copy()
        for state, _ in self.shared:
            starts[:, state] = found[first, state][self.segments]
        return starts

    def euler_starts(self, starts: np.ndarray) -> np.ndarray:
        """The states of a point at the windows' starts in the plant's own coordinates, (W, n_states)."""
        return self.chart.kept(starts, self.runs.begin)

    def point(self, vector: np.ndarray, starts: np.ndarray, paths: Sequence[str] = ()) -> Point:
        """The residuals and the cost of one parameter vector with these starts; paths: the fitted ones."""
        residual = self._residuals(vector[None], starts[None])[0]
        return Point(vector, starts, residual, self._cost(residual) + self._pull(vector, paths))

    def _pull(self, vector: np.ndarray, paths: Sequence[str]) -> float:
        return 0.5 * float((self.pulls(vector, paths)[0] ** 2).sum())

    def linearise(self, point: Point, paths: Sequence[str], sigma: np.ndarray) -> Linearisation:
        """Sensitivities to the paths at a point, by differences over the family's first step, within the bounds."""
        flat, start_columns = (values / sigma for values in self._slopes(point, paths, self.steps[0]))
        gram, cross, _ = self.blocks.normal(start_columns, flat, None)
        gain = np.linalg.solve(gram, cross)  # (W, F, P)
        rest, count = flat - self.blocks.rows(gain.transpose(0, 2, 1) @ self.blocks.of(start_columns)), len(paths)
        columns, shared = rest[:count], rest[count:]
        if len(shared) and count:
            shared = shared.reshape(len(shared), -1)
            own = np.linalg.lstsq(shared.T, columns.reshape(count, -1).T, rcond=1e-10)[0]
            columns = columns - (own.T @ shared).reshape(columns.shape)
        return Linearisation(columns, start_columns, np.sqrt((flat[:count] ** 2).sum(axis=(1, 2))))

    def _equations(
        self, columns: np.ndarray, residual: np.ndarray, vector: np.ndarray, paths: Sequence[str]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix (n, n) and gradient (n,) of columns (n, rows, C), with the priors of the paths.

        The columns of the paths come first; the others have no prior.
        """
        flat = columns.reshape(len(columns), residual.size)
        normal, gradient = flat @ flat.T, flat @ residual.ravel()
        pulled, rates = self.pulls(vector, paths)
        own = slice(0, len(paths))
        normal[own, own] += np.diag(rates**2)
        gradient[own] -= rates * pulled
        return normal, gradient

    def _moved(
        self, vector: np.ndarray, starts: np.ndarray, paths: Sequence[str], step
    ) -> tuple[np.ndarray, np.ndarray]:
        """A vector and starts changed by a step, within the bounds of the paths."""
        (change, start_change), starts = step, starts.copy()
        vector = self.moved_vector(vector, paths, change[: len(paths)])
        starts[:, self.start_states] += start_change
        for (state, unit), sizes in zip(self.shared, self._by_segment(change[len(paths) :]), strict=True):
            starts[:, state] += unit * sizes[self.segments]
        return vector, starts

    def solve(
        self, plant: Plant, paths: Sequence[str], max_iterations: int = 40, guess: np.ndarray | None = None
    ) -> Point:
        """The point of least cost over the paths and the starts, from the plant's values; Levenberg-Marquardt.

        guess: of the starts, by default from the readings.

        Slopes are updated by secants while steps succeed, and computed anew when steps stop gaining.
        The cost is the negative log-likelihood with one unknown variance per channel. Source: More 1978 (damping,
        bounds by projection), Nocedal and Wright 2006, ch. 10.
        """
        here = self.point(plant.vector, self.first_guess if guess is None else guess, paths)
        if not paths and self._short is not None:  # far from the given plant, its guess may be useless
            other = self.point(plant.vector, self._with_shared(self.first_guess, plant), paths)
            here = min(here, other, key=lambda point: point.cost)
        damping, steps, slopes = 1e-3, list(self.steps if paths or self.shared else self.steps[:1]), None
        for _ in range(max_iterations):
            sigma = self.sigma(here)
            stale = slopes is not None
            slopes = slopes or self._slopes(here, paths, steps[0])
            flat, start_columns = (values / sigma for values in slopes)
            weighted = np.where(self.finite, here.residual / sigma, 0.0)
            gram, cross, start_gradient = self.blocks.normal(start_columns, flat, weighted)
            normal, gradient = self._equations(flat, weighted, here.vector, paths)
            held = self.at_edge(here.vector, paths, gradient)
            normal[held], normal[:, held], gradient[held], cross[:, :, held] = 0.0, 0.0, 0.0, 0.0
            normal[held, held] = 1.0
            improved, tries = False, 0
            while not improved and tries < (STALE_TRIES if stale else TRIES):
                step = block_step(normal, gradient, gram, cross, start_gradient, damping * TIGHTER**tries)
                there = self.point(*self._moved(here.vector, here.starts, paths, step), paths)
                improved, tries = there.cost < here.cost, tries + 1
            damping *= TIGHTER ** (tries if not improved else tries - 1)
            gain = here.cost - there.cost if improved else 0.0
            slopes = self._secant(slopes, here, there, paths) if improved and tries == 1 else None
            if improved:
                here, damping = there, max(damping / 12.0, 1e-9)
            if gain < _ENOUGH * max(self.finite.sum(), 1):
                if stale:
                    slopes = None
                    continue
                if len(steps) == 1:
                    break
                damping, steps, slopes = 1e-3, steps[1:], None
        return here

    def sigma(self, point: Point) -> np.ndarray:
        """Root mean square of each channel's residual, shape (C,)."""
        return np.sqrt(np.nansum(point.residual**2, axis=0) / np.maximum(self.counts, 1)) + 1e-9

    def _outputs(self, vectors: np.ndarray, starts: np.ndarray) -> np.ndarray:
        return self.plant.run_many(self.runs, np.ascontiguousarray(vectors), starts)

    def _residuals(self, vectors: np.ndarray, starts: np.ndarray) -> np.ndarray:
        residual = self.measured - self._outputs(vectors, starts)[:, :, self.columns]
        # An angle's residual starts within half a turn and is continuous in a window; it is not wrapped any further.
        turns = np.round(residual[:, self.offsets][:, :, self.angles] / (2.0 * np.pi))
        turns = np.where(np.isfinite(turns), turns, 0.0)
        if turns.any():
            residual[:, :, self.angles] -= 2.0 * np.pi * turns[:, self.window_of_row]
        return residual

    def _cost(self, residual: np.ndarray) -> float:
        if not np.all(np.abs(residual[self.finite]) < FAR):
            return np.inf
        squares = np.nansum(residual**2, axis=0)
        return 0.5 * float(np.sum(self.counts * np.log(squares / np.maximum(self.counts, 1) + RESIDUAL_FLOOR)))

    def _by_segment(self, values: np.ndarray) -> np.ndarray:
        """Values of the shared states, one row for each: (len(shared), segments)."""
        return values.reshape(len(self.shared), -1) if self.shared else np.empty((0, 0))

    def _slopes(self, point: Point, paths: Sequence[str], step: float) -> tuple[np.ndarray, np.ndarray]:
        """Columns (P + S, rows, C) of the paths, per scale, and the S shared values, per unit; (F, rows, C) of starts.

        step: in scales.
        """
        shared = [(state, step) for state, _ in self.shared]
        moves = [*((path, step) for path in paths), *((int(s), _START_STEP) for s in self.start_states), *shared]
        if not moves:
            return np.empty((0, *self.measured.shape)), np.empty((0, *self.measured.shape))
        moved = [self._nudged(point, *move) for move in moves]
        residuals = self._residuals(np.array([m[0] for m in moved]), np.array([m[1] for m in moved]))
        with np.errstate(invalid="ignore", over="ignore"):
            slopes = (point.residual - residuals) / np.array([m[2] for m in moved])[:, None, None]
        slopes[~(np.isfinite(slopes) & self.finite)] = 0.0
        own, starts, common = np.split(slopes, [len(paths), len(moves) - len(shared)])
        of_row = self.segments[self.window_of_row]
        apart = [column * (of_row == g)[:, None] for column in common for g in range(of_row[-1] + 1)]
        return np.array([*own, *apart]).reshape(-1, *self.measured.shape), starts

    def _nudged(self, point: Point, what: str | int, step: float) -> tuple[np.ndarray, np.ndarray, float]:
        """The vector and starts with a path, or the state of an index, changed by a step, and the step with its sign.

        A path's step is in its scales and points into its bounds; a shared state's is in its units.
        """
        vector, starts = point.vector.copy(), point.starts.copy()
        if isinstance(what, str):
            i, size = self.index[what], step * self.scale(what)
            step, size = (step, size) if vector[i] + size <= self.bounds(what)[1] else (-step, -size)
            vector[i] += size
        else:
            starts[:, what] += step * dict(self.shared).get(what, 1.0)
        return vector, starts, step

    def _secant(
        self, slopes: tuple[np.ndarray, np.ndarray], here: Point, there: Point, paths: Sequence[str]
    ) -> tuple[np.ndarray, np.ndarray]:
        """The slopes corrected by the observed change from one point to another, window by window.

        The error of the predicted change is shared out by the size of each part.  Source: Broyden 1965, Mathematics of
        Computation 19.
        """
        count, sigma = len(slopes[0]), self.sigma(there)
        every = np.concatenate(slopes)
        moved = [(there.vector[self.index[p]] - here.vector[self.index[p]]) / self.scale(p) for p in paths]
        gone, first = there.starts - here.starts, np.unique(self.segments, return_index=True)[1]
        moved += [float(size) for state, unit in self.shared for size in gone[first, state] / unit]
        change = np.where(self.finite, here.residual - there.residual, 0.0)
        parts = self.blocks.of(every)
        own = gone[:, self.start_states]
        moves = np.concatenate([np.broadcast_to(np.array(moved), (len(own), count)), own], axis=1)
        share = parts**2 @ np.tile(sigma**-2.0, self.blocks.longest) * moves
        whole = (share * moves).sum(axis=1, keepdims=True)
        share = np.divide(share, whole, out=np.zeros_like(share), where=whole > 0.0)
        missed = self.blocks.of(change[None]) - moves[:, None] @ parts
        every = self.blocks.rows(parts + share[:, :, None] * missed)
        return every[:count], every[count:]

    @cached_property
    def blocks(self) -> Blocks:
        """The rows of the windows as blocks of one length."""
        return Blocks(self.runs.stop - self.runs.begin, len(self.channels))

    @cached_property
    def start_states(self) -> np.ndarray:
        """Indices of the states whose start affects a measured output for longer than a sample: the fitted ones."""
        starts, family = self.first_guess, self.plant.family
        names, left = family.states, set(family.shared) | family.resting(self.channels)
        states = [names.index(name) for name in names if name not in left]
        moved = np.repeat(starts[None], len(states) + 1, axis=0)
        for k, state in enumerate(states, start=1):
            moved[k, :, state] += _START_PROBE
        outputs = self._outputs(np.repeat(self.plant.vector[None], len(moved), axis=0), moved)
        changes = outputs[1:] - outputs[0]
        return np.array([s for s, c in zip(states, changes, strict=True) if self._reveals(names[s], c)], dtype=int)

    def _reveals(self, state: str, change: np.ndarray) -> bool:
        seen = np.nanmax(np.abs(np.where(self.finite, change[:, self.columns], 0.0))) > 1e-9
        return bool(seen and not self._forgotten(state, change))

    def _forgotten(self, state: str, change: np.ndarray) -> bool:
        """Whether a change of a start is gone one sample later, for states that are outputs.

        Fitting such a start would only use up the first sample, and let a fit wander to absurd values.
        """
        if state not in self.plant.outputs:
            return False
        left = change[self.offsets + 1, self.plant.outputs.index(state)] / _START_PROBE
        return bool(np.median(np.abs(left)) < FORGOTTEN)


def _pieces(window: slice) -> list[slice]:
    """The window in runs of `PIECE` samples, the last one longer by the remainder."""
    count = max((window.stop - window.start) // PIECE, 1)
    edges = [window.start + PIECE * i for i in range(count)] + [window.stop]
    return [slice(a, b) for a, b in pairwise(edges)]


def unknown_states(plant: Plant) -> dict[str, str]:
    """The states with an unknown value for each segment, with the effect that acts like them."""
    family = plant.family
    if family.shared_unless and value_at(plant, family.shared_unless) != 0.0:
        return {}
    return dict(family.shared)
