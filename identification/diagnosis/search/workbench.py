"""A record in training and held-out windows, and the fits that a diagnosis makes on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.estimate import half_width
from identification.fit.likelihood import colour, covariance, evidence, polished, window_costs
from identification.fit.residual import noise_floor
from identification.fit.shooting import RESIDUAL_FLOOR, Point, Shooting
from identification.fit.validation import head_windows
from identification.fit.windows import LEAST_SAMPLES, free_run_windows

MOST_GROWTH = 60.0  # of noise at the start of a free run; beyond, fits of the start end in the nearest valley
FAR_FROM_GIVEN = 0.1  # change of a coefficient from which on a search also begins at its given value
KEPT = 32  # states of which the likeliest points are remembered
FINE = 0.02  # of the noise: how far a coarser step of integration may move the outputs


@dataclass(frozen=True, eq=False)
class State:
    """A vehicle with its free parameters fitted in the training windows, and its runs in both sets of windows."""

    plant: Plant
    paths: tuple[str, ...]
    train: Point
    held: Point
    colour: np.ndarray


class Workbench:
    """A record in training and held-out windows, and the fits made on it.

    plant: as given, integrated in the longest steps that change its runs by less than the noise would show.
    doubt: standard deviation of its coefficients, relative.  steady: whether free runs from states that are fitted to
    their first seconds say anything; those of an unstable vehicle end anywhere.
    """

    def __init__(
        self,
        plant: Plant,
        record: Record,
        train: Sequence[slice],
        held: Sequence[slice],
        settle: float,
        doubt: float = np.inf,
        steady: bool = True,
    ):
        self.steady = steady
        self.plant = _brisk(plant, record, train)
        self.heads = Shooting(self.plant, record, head_windows(record, held, settle))
        self.train = Shooting(self.plant, record, train, doubt=doubt)
        self.held = Shooting(self.plant, record, held)
        self._polished: dict[tuple[State, bytes], tuple[Point, Point]] = {}

    def fit(self, plant: Plant, paths: Sequence[str], near: State | None = None) -> State:
        """The state of least cost in the training windows over the paths, started from the plant's values."""
        train = self.train.solve(plant, paths, near.train.starts if near else None)
        fitted = self.train.plant_at(train, paths)
        return self._state(fitted, paths, train, self.held.solve(fitted, (), near.held.starts if near else None))

    def fit_anew(self, plant: Plant, paths: Sequence[str], near: State) -> State:
        """As `fit`, also from what the record says of the starts: those of poorer models may lie in another valley."""
        anew = self.train.solve(plant, paths)
        going_on = self.train.solve(plant, paths, near.train.starts)
        train = min(anew, going_on, key=lambda point: point.cost)
        fitted = self.train.plant_at(train, paths)
        held = [self.held.solve(fitted, (), starts) for starts in (None, near.held.starts)]
        return self._state(fitted, paths, train, min(held, key=lambda point: point.cost))

    def _state(self, fitted: Plant, paths: Sequence[str], train: Point, held: Point) -> State:
        return State(fitted, tuple(paths), train, held, colour(self.train, train))

    def without(self, state: State, paths: Sequence[str]) -> State:
        """The state fitted again with effects at their neutral values and no longer free."""
        plant = replace_at(state.plant, {p: spec_at(state.plant, p).neutral for p in paths})
        return self.fit(plant, [p for p in state.paths if p not in paths], state)

    def gains(self, before: State, after: State) -> tuple[float, float]:
        """Evidence for the change in the training and in the held-out windows; what is known of coefficients counts."""
        slow = after.colour
        (train, held), (other, other_held) = self._likeliest(before, slow), self._likeliest(after, slow)
        pulls = [
            float((self.train.pulls(point.vector, state.paths)[0] ** 2).sum())
            for state, point in ((before, train), (after, other))
        ]
        return (
            evidence(self.train, train, other, slow) + pulls[0] - pulls[1],
            evidence(self.held, held, other_held, slow),
        )

    def _likeliest(self, state: State, slow: np.ndarray) -> tuple[Point, Point]:
        """The state's points, likeliest where residuals have a colour; those that were asked for lately are kept."""
        key = (state, slow.tobytes())
        if key not in self._polished:
            while len(self._polished) >= KEPT:
                del self._polished[next(iter(self._polished))]
            self._polished[key] = (
                polished(self.train, state.train, state.paths, slow),
                polished(self.held, state.held, (), slow),
            )
        return self._polished[key]

    def free_run_errors(self, plant: Plant) -> np.ndarray:
        """Sum of squared errors of free runs by held-out window and channel, (W, C), started as an operator would.

        The initial states are fitted to the settling time of each window alone, and its samples are not counted.
        """
        starts = self.heads.solve(plant, (), max_iterations=12, tolerance=1e-5).starts
        squares = np.where(self.held.finite, self.held.point(plant.vector, starts).residual, 0.0) ** 2
        squares[~np.isfinite(squares)] = np.inf  # of runs that diverged
        past = np.arange(self.held.runs.rows) - self.held.offsets[self.held.window_of_row]
        settled = past >= (self.heads.runs.stop - self.heads.runs.begin)[self.held.window_of_row]
        return np.add.reduceat(np.where(settled[:, None], squares, 0.0), self.held.offsets, axis=0)

    def improvements(self, before: State, after: State) -> np.ndarray:
        """By how much the squared errors of each held-out window fell, (W,).

        In units of the mean square that is left in each channel, so that one which starts badly and is fitted well, as
        a depth is, does not drown what the others say.
        """
        if self.steady:
            first, then = self.free_run_errors(before.plant), self.free_run_errors(after.plant)
        else:
            white = np.zeros(len(self.held.channels))
            first, then = (window_costs(self.held, s.held, white) for s in (before, after))
        unit = then.sum(axis=0) / np.maximum(self.held.counts, 1) + RESIDUAL_FLOOR
        with np.errstate(invalid="ignore"):  # not a number where runs diverge
            return ((first - then) / unit).sum(axis=1)

    def intervals(self, state: State) -> dict[str, tuple[float, float, float]]:
        """Value, standard error and half width of the 95 % interval of each fitted path."""
        if not state.paths:
            return {}
        linear = self.train.linearise(state.train, state.paths, self.train.sigma(state.train))
        matrix, freedom = covariance(self.train, state.train, state.paths, linear, state.colour)
        errors = np.sqrt(np.maximum(np.diag(matrix), 0.0))
        width = half_width(freedom)
        result = {}
        for path, error in zip(state.paths, errors, strict=True):
            size = float(error * self.train.scale(path))
            result[path] = (value_at(state.plant, path), size, width * size)
        return result

    def costs(self, state: State, reference: State) -> np.ndarray:
        """Cost of each window, training then held-out, in units of the reference's innovation variance; shape (W,)."""
        slow, parts = reference.colour, []
        mine, theirs = self._likeliest(state, slow), self._likeliest(reference, slow)
        for problem, point, against in zip((self.train, self.held), mine, theirs, strict=True):
            unit = window_costs(problem, against, slow).sum(axis=0) / np.maximum(problem.counts, 1)
            parts.append((window_costs(problem, point, slow) / (unit + 1e-30)).sum(axis=1))
        return np.concatenate(parts)


def given_values(given: Plant, state: State) -> dict[str, float]:
    """The fitted coefficients as the vehicle was given, if the fit has taken one of them far from there; else none."""
    values = {p: value_at(given, p) for p in state.paths if p in given.coefficients}
    far = any(abs(value_at(state.plant, p) - v) > FAR_FROM_GIVEN * abs(v) for p, v in values.items())
    return values if far else {}


def noise_limited_length(plant: Plant, record: Record, seconds: float) -> float:
    """Seconds that free runs may last before the noise of their first reading decides them: at most those given.

    Doubled from the shortest while noise in a measured state grows by less than `MOST_GROWTH` on its way to any output.
    A vehicle that is unstable in yaw, as many torpedoes are, tells of its model for a few seconds only.  From short to
    long, since long runs of a wrong model leave the record for where it may be stable.
    """
    lengths = [seconds]
    while True:
        windows = free_run_windows(plant, record, lengths[-1] / 2.0)
        if not windows or min(w.stop - w.start for w in windows) < 2 * LEAST_SAMPLES:
            break
        lengths.append(lengths[-1] / 2.0)
    calm = lengths.pop()
    while lengths and _growth(plant, record, lengths[-1]) < MOST_GROWTH:
        calm = lengths.pop()
    return calm


def _growth(plant: Plant, record: Record, seconds: float) -> float:
    """By how much noise in a measured state at the start of a window grows, in noises of the outputs."""
    problem = Shooting(plant, record, free_run_windows(plant, record, seconds))
    noise, point = _noise(problem), problem.point(plant.vector, problem.first_guess)
    if not np.isfinite(point.cost):
        return np.inf
    grown = np.abs(problem.linearise(point, (), noise).starts).max(axis=(1, 2))
    states = [plant.family.states[i] for i in problem.start_states]
    own = np.array([noise[problem.channels.index(s)] if s in problem.channels else 0.0 for s in states])
    return float((grown * own).max(initial=0.0))


def _brisk(plant: Plant, record: Record, windows: Sequence[slice]) -> Plant:
    """The plant with the longest step of integration, up to a sample, that leaves its runs as they are."""
    problem = Shooting(plant, record, windows)
    noise = _noise(problem)
    given, starts = problem.point(plant.vector, problem.first_guess).residual, problem.first_guess
    for parts in (1, 2, 4, 8):
        step = record.sample_interval / parts
        if step <= plant.longest_step:
            return plant
        faster = replace(plant, longest_step=step)
        moved = Shooting(faster, record, windows).point(plant.vector, starts).residual - given
        size = np.sqrt(np.nanmean(moved**2, axis=0))
        if np.all(size < FINE * noise):  # False where a run is not finite
            return faster
    return plant


def _noise(problem: Shooting) -> np.ndarray:
    """Standard deviation of each channel's readings about a smooth curve, shape (C,)."""
    return np.array([noise_floor(readings, problem.window_of_row) for readings in problem.measured.T])
