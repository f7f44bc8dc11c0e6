"""A record in training and held-out windows, and the fits that a diagnosis makes on it."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from auv_gym.model import Diverged
from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.estimate import half_width
from identification.fit.filtering import Point
from identification.fit.intervals import Information, information_of, interval_of, predictive_scores
from identification.fit.noises import Noise
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.steps import brisk
from identification.fit.validation import free_runs

FAR_FROM_GIVEN = 0.1  # change of a coefficient from which on a search also begins at its given value


@dataclass(frozen=True, eq=False)
class State:
    """A vehicle with free parameters and noises fitted to the training windows, and the filter of all windows.

    quiet: with less process noise than suits it best.
    """

    plant: Plant
    paths: tuple[str, ...]
    point: Point
    quiet: bool = False

    @property
    def finite(self) -> bool:
        """Whether the filter came to an end with it."""
        return bool(np.isfinite(self.point.scores).all())


class Workbench:
    """A record in training and held-out windows, and the fits made on it.

    One filter goes through all windows; fits count the training windows, and the held-out ones tell whether what was
    found holds there too.
    plant: as given, integrated in the longest steps that hardly move its free runs (`identification.fit.steps`).
    doubt: standard deviation of its coefficients, relative.
    """

    def __init__(
        self, plant: Plant, record: Record, train: Sequence[slice], held: Sequence[slice], doubt: float = np.inf
    ):
        self.plant = brisk(plant, record, train)
        self.record, self.train, self.held, self.doubt = record, tuple(train), tuple(held), doubt
        self.problem = PredictionErrors(self.plant, record, [*train, *held], doubt=doubt, counted=train)
        starts = sorted(w.start for w in (*train, *held))
        self.window_of_row = np.searchsorted(starts, self.problem.rows, side="right") - 1
        self._held_windows = np.searchsorted(starts, [w.start for w in held])
        self._known: WeakKeyDictionary[State, np.ndarray] = WeakKeyDictionary()
        self._told: WeakKeyDictionary[State, Information] = WeakKeyDictionary()

    def fit(self, plant: Plant, paths: Sequence[str], near: State | None = None) -> State:
        """The likeliest state in the training windows over the paths and the noises, from the plant's values on."""
        point = self.problem.solve(plant, paths, near.point if near else None)
        return State(self.problem.plant_at(point, paths) if paths else plant, tuple(paths), point)

    def without(self, state: State, paths: Sequence[str]) -> State:
        """The state fitted again with effects at their neutral values and no longer free."""
        plant = replace_at(state.plant, {p: spec_at(state.plant, p).neutral for p in paths})
        return self.fit(plant, [p for p in state.paths if p not in paths], state)

    def gains(self, before: State, after: State) -> tuple[float, float]:
        """Twice the gain in log-likelihood in the training and in the held-out windows, each with its own noises.

        What is known of coefficients and correlation times counts in the first.
        """
        p = self.problem
        fitted = p.objective(after.point, after.paths) - p.objective(before.point, before.paths)
        return 2.0 * fitted, 2.0 * float((self._foretold(after) - self._foretold(before)).sum())

    def _foretold(self, state: State) -> np.ndarray:
        """Log-likelihood of each held-out window, what the state has fitted as uncertain as that leaves it."""
        if state not in self._known:
            fitted = [p for p in state.paths if p not in state.plant.coefficients and not spec_at(state.plant, p).probe]
            own = self.problem.scaled({p: abs(value_at(state.plant, p)) or 1.0 for p in fitted})  # terms have no scale
            self._known[state] = predictive_scores(own, state.point, state.paths, self.held)
        return self._known[state]

    def intervals(self, state: State) -> dict[str, tuple[float, float, float]]:
        """Value, standard error and half width of the 95 % interval of each fitted path."""
        if not state.paths:
            return {}
        found, result = self._information(state), {}
        for k, path in enumerate(state.paths):
            error = float(np.sqrt(max(found.covariance[k, k], 0.0))) * self.problem.scale(path)
            result[path] = (value_at(state.plant, path), error, half_width(float(found.freedom[k])) * error)
        return result

    def interval(self, state: State, path: str) -> tuple[float, float]:
        """The 95 % interval of a fitted path (see `identification.fit.intervals.interval_of`)."""
        return interval_of(self.problem, state.point, state.paths, path, self._information(state))

    def _information(self, state: State) -> Information:
        if state not in self._told:
            self._told[state] = information_of(self.problem, state.point, state.paths)
        return self._told[state]

    def noise(self, state: State) -> Noise:
        """The noises that suit a state best in all windows, held-out ones too."""
        return self._every.noise_at(self._every.renewed(state.point, state.point.logs, state.paths))

    def fitted_basis(self, state: State) -> np.ndarray:
        """Orthonormal columns of what the starts of all stretches may change in the errors, (rows, C, q)."""
        basis = self._every.start_basis(state.point)
        return basis.reshape(*state.point.errors.shape, basis.shape[1])

    @property
    def _every(self) -> PredictionErrors:
        """The problem in which all windows count, held-out ones too."""
        every = copy(self.problem)
        every.counted = self.problem.within([*self.train, *self.held])
        return every

    def costs(self, state: State) -> np.ndarray:
        """Minus twice the log-likelihood of each window, in the order of the record, shape (W,)."""
        scores = np.bincount(self.window_of_row, state.point.scores)
        scores[self._held_windows] = self._foretold(state)
        return -2.0 * scores

    def flies(self, plant: Plant, settle: float | None = None) -> bool:
        """Whether free runs over the held-out windows stay finite."""
        try:
            free_runs(plant, self.record, self.held, plant.settle if settle is None else settle)
        except Diverged:
            return False
        return True


def given_values(given: Plant, state: State) -> dict[str, float]:
    """The fitted coefficients as the vehicle was given, if the fit has taken one of them far from there; else none."""
    values = {p: value_at(given, p) for p in state.paths if p in given.coefficients}
    far = any(abs(value_at(state.plant, p) - v) > FAR_FROM_GIVEN * abs(v) for p, v in values.items())
    return values if far else {}
