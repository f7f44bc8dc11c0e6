"""A record in parts, and the fits that a diagnosis makes on it."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from auv_gym.model import Diverged
from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from auv_gym.threads import side_by_side
from identification.deciding import BLOCKS, FAR_FROM_GIVEN, MOST_WORK
from identification.diagnosis.log.parts import block_numbers
from identification.diagnosis.search.candidates import candidates_of
from identification.estimate import half_width
from identification.fit.followed import Point
from identification.fit.intervals import ByPart, Information, information_of, interval_of, told_by_part
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.sensitivities import LEAST_GAIN, TRIAL_GAIN
from identification.fit.steps import brisk, in_steps, suited
from identification.fit.strides import in_shortest_rows, in_suited_rows, stride_for
from identification.fit.validation import free_runs

T = TypeVar("T")

ITERATIONS = 12  # of a trial's fit


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


def tried(problem: PredictionErrors, near: State) -> State:
    """The likeliest state that a trial's fit reaches from a state."""
    point = problem.solve(near.plant, near.paths, near.point, ITERATIONS, gain=TRIAL_GAIN)
    return State(problem.plant_at(point, near.paths), near.paths, point)


class Workbench:
    """A record in parts, and the fits made on it.

    One filter goes through all of it, and fits count all of it; what each part tells by itself says whether what was
    found foretells the part from the others.
    plant: as given, integrated in the longest steps that hardly move its filter (`identification.fit.steps`).
    doubt: standard deviation of its coefficients, relative.  windows: of free runs, by default the parts' pieces.
    """

    def __init__(
        self,
        plant: Plant,
        record: Record,
        parts: Sequence[Sequence[slice]],
        doubt: float = np.inf,
        windows: Sequence[slice] = (),
    ):
        pieces = sorted((piece for part in parts for piece in part), key=lambda w: w.start)
        self.windows = tuple(windows) or tuple(pieces)
        self.record, self.parts, self.doubt = record, tuple(parts), doubt
        known = [p for p in plant.coefficients if plant.deviation(p, doubt) > 0.0]
        sought = [path for c in candidates_of(plant, record) if c.sloped for path in c.paths]
        stride = stride_for(plant, record, pieces, known, sought, doubt=doubt)
        self._as_stepped = PredictionErrors(plant, record, pieces, doubt=doubt, stride=stride)
        self.problem = brisk(self._as_stepped)
        self.plant = self.problem.plant
        self._begin()

    def _begin(self) -> None:
        """Start to count the work, with nothing known of any state."""
        self.block_of_row = block_numbers(self.record, self.problem.stretches, BLOCKS)[:: self.problem.stride]
        self._most, self.unfinished = self.problem.work.done + MOST_WORK, list[str]()
        self._known: WeakKeyDictionary[State, dict[Hashable, Any]] = WeakKeyDictionary()

    def once(self, state: State, question: Hashable, work: Callable[[], T]) -> T:
        """What is worked out of a state, which is kept as long as the state is."""
        known = self._known.setdefault(state, {})
        if question not in known:
            known[question] = work()
        return known[question]

    def in_suited_steps(self, state: State) -> Workbench:
        """A bench in shorter steps of integration if the present ones move the filter of a state, else itself."""
        problem = suited(self._as_stepped, self.problem, state.point)
        if problem is self.problem:
            return self
        other = copy(self)
        other.problem, other.plant = problem, problem.plant
        other._begin()
        return other

    def in_suited_rows(self, state: State) -> Workbench:
        """A bench with readings averaged over less time if averages mislead the fit of a state, else itself."""
        return self._in_rows(in_suited_rows(self.problem, state.point, state.paths))

    def in_shortest_rows(self) -> Workbench:
        """A bench with readings averaged over no time, or over the least that a long record allows, or itself."""
        return self._in_rows(in_shortest_rows(self.problem))

    def _in_rows(self, problem: PredictionErrors) -> Workbench:
        """A bench with a problem in other rows."""
        if problem is self.problem:
            return self
        other = copy(self)
        other.problem, other._as_stepped = problem, in_steps(problem, self._as_stepped.plant.longest_step)
        other._begin()
        return other

    def with_noises(self, velocities: Sequence[int], readings: Sequence[int], period: float) -> Workbench:
        """A bench with more noises, see `identification.fit.stretches.Stretches.with_noises`."""
        other, added = copy(self), (velocities, readings, period)
        other._as_stepped, other.problem = self._as_stepped.with_noises(*added), self.problem.with_noises(*added)
        other._begin()
        return other

    def taken_over(self, state: State) -> State:
        """A state of a bench in other steps or rows, fitted in those of this one."""
        plant = replace(state.plant, longest_step=self.plant.longest_step)
        near = replace(state.point, system=None)  # with responses of its own rows
        point = self.problem.point(plant.vector, state.point.logs, near)
        return self.fit(plant, state.paths, State(plant, state.paths, point))

    def goes_on(self, step: str) -> bool:
        """Whether there is time left for a step of the search, in words; `unfinished` lists what there was none for."""
        if self.problem.work.done < self._most:
            return True
        if step not in self.unfinished:
            self.unfinished.append(step)
        return False

    @property
    def followed(self) -> int:
        """How many states of the vehicle the filter follows."""
        return sum(i < len(self.plant.family.states) for i in self.problem.live)

    def fit(self, plant: Plant, paths: Sequence[str], near: State | None = None, gain: float = LEAST_GAIN) -> State:
        """The likeliest state over the paths and the noises, from the plant's values on; gain: see `solve`."""
        point = self.problem.solve(plant, paths, near.point if near else None, gain=gain)
        return State(self.problem.plant_at(point, paths) if paths else plant, tuple(paths), point)

    def fit_from(
        self, starts: Sequence[tuple[Plant, State]], paths: Sequence[str], rival: State, hopeless: float
    ) -> State:
        """The likeliest state that is reached from the likeliest of several plants, each with a state near it.

        rival: a state that it is compared with; where it is behind that by `hopeless` once its parameters have settled,
        the noises that suit it are not sought.
        """
        points = side_by_side(lambda one: self.problem.point(one[0].vector, one[1].point.logs, one[1].point), starts)
        best = max(points, key=lambda p: self.problem.objective(p, paths))  # minus infinity where a filter is lost
        point = self.problem.descended(best, paths)
        settled = State(self.problem.plant_at(point, paths), tuple(paths), point)
        if self.gain(settled, rival) > hopeless:
            return settled
        return tried(self.problem, settled)

    def with_given(self, state: State) -> tuple[State, ...]:
        """The state with its coefficients as the vehicle was given, if the fit has taken one of them far from there."""

        def found() -> tuple[State, ...]:
            plant = self._put_back(state)
            there = [] if plant is None else [self._renewed_at(plant, state)]
            return tuple(one for one in there if one.finite)

        return self.once(state, "as given", found)

    def _put_back(self, state: State) -> Plant | None:
        """The vehicle of a state with its coefficients as given, None if the fit has taken none of them far away.

        All of them: what is left of those that were moved together, as inertia and moments of one axis are, would be
        another vehicle than either.
        """
        values = {p: value_at(self.plant, p) for p in state.paths if p in self.plant.doubted}
        far = any(abs(value_at(state.plant, p) - v) > FAR_FROM_GIVEN * abs(v) for p, v in values.items())
        return replace_at(state.plant, values) if far else None

    def likelier_from_given(self, state: State, hopeless: float) -> State:
        """The state, or what a fit reaches from its effects and the coefficients as given, whichever is likelier.

        Coefficients that have paid for what was missing may lie in a valley of the likelihood that no fit leaves once
        it is there.  hopeless: evidence by which that vehicle may be behind at first to be fitted.
        """
        plant = self._put_back(state)
        return state if plant is None or not state.finite else self._likelier(state, plant, state, hopeless)

    def likelier_beside(self, state: State, trial: State) -> State:
        """The state, or what a fit reaches from a trial's end without what the trial has added, whichever is likelier.

        A fit may end in a narrow valley of the likelihood, which one that is free in one more direction follows on.
        """
        plant = replace_at(state.plant, {p: value_at(trial.plant, p) for p in state.paths})
        return self._likelier(state, plant, trial, np.inf)

    def _likelier(self, state: State, plant: Plant, near: State, hopeless: float) -> State:
        """The state, or what a fit of the same paths reaches from a plant with the noises of a state near it."""
        there = State(plant, state.paths, self.problem.point(plant.vector, near.point.logs, near.point))
        if not there.finite or self.gain(there, state) > hopeless:
            return state
        there = tried(self.problem, there)
        return there if self.gain(state, there) > 0.0 else state

    def _renewed_at(self, plant: Plant, near: State) -> State:
        """A plant with the noises that suit it, nothing free.

        Sought from those of the state near by, and from first ones: noises of a vehicle that follows the record say
        little where this one leaves it.
        """
        problem = self.problem

        def renewed(near: Point | None) -> Point:
            point = problem.point(plant.vector, problem.first_noise() if near is None else near.logs, near)
            return problem.renewed(point, point.logs, ())

        found = side_by_side(renewed, [near.point, None])
        return State(plant, (), max(found, key=lambda point: problem.objective(point, ())))

    def quieted(self, state: State) -> tuple[State, ...]:
        """The state with less process noise, if its filter still follows the record; and with less of some kinds of it.

        Accelerations that last take a steady effect's part, while shorter ones, as of waves, may be needed all the
        same; a swell takes that of regular waves, or of what makes a loop swing.
        """
        problem = self.problem
        if not problem.pushed:
            return ()

        def found() -> tuple[State, ...]:
            lasting = problem.lasting(state.point)
            brief, swell = problem.pushes(state.point) & ~lasting, problem.swelling(state.point)
            kinds = [None, *[lasting] * bool(lasting.any() and brief.any()), *[swell] * bool(swell.any())]
            there = [problem.quieted(state.point, which) for which in kinds]
            return tuple(State(state.plant, state.paths, p, True) for p in there if p is not None)

        return self.once(state, "quieted", found)

    def worth(self, state: State, paths: Sequence[str]) -> float:
        """The evidence for some of a state's paths, all else refitted to second order, but for the noises."""
        own = self._scaled(state)
        rows = [state.paths.index(p) for p in paths]
        moved = [(value_at(state.plant, p) - spec_at(state.plant, p).neutral) / own.scale(p) for p in paths]
        spread = self.by_part(state).spread[np.ix_(rows, rows)]
        return float(np.array(moved) @ np.linalg.pinv(spread, hermitian=True) @ np.array(moved))

    def without(self, state: State, paths: Sequence[str]) -> State:
        """The state fitted again with effects at their neutral values and no longer free."""
        plant = replace_at(state.plant, {p: spec_at(state.plant, p).neutral for p in paths})
        return self.fit(plant, [p for p in state.paths if p not in paths], state)

    def gains(self, before: State, after: State) -> tuple[float, float]:
        """`gain` and `gain_foretold`."""
        return self.gain(before, after), self.gain_foretold(before, after)

    def gain(self, before: State, after: State) -> float:
        """Twice the gain in log-likelihood, of all rows; what is known of coefficients and correlation times counts."""
        p = self.problem
        return 2.0 * (p.objective(after.point, after.paths) - p.objective(before.point, before.paths))

    def gain_foretold(self, before: State, after: State, soon: bool = False) -> float:
        """Twice the gain in log-likelihood of each part foretold by the others, summed; each with its own noises."""
        return 2.0 * float((self.by_part(after, soon).foretold - self.by_part(before, soon).foretold).sum())

    def known_gain(self, before: State, after: State) -> float:
        """How much of `gain` is due to coefficients that are nearer to what was stated of them."""
        squares = [float((self.problem.pulls(s.point.vector, s.paths)[0] ** 2).sum()) for s in (before, after)]
        return squares[0] - squares[1]

    def by_part(self, state: State, soon: bool = False) -> ByPart:
        """What each part tells of what a state has fitted; soon: by responses where there are any."""

        def told() -> ByPart:
            return told_by_part(self._scaled(state), state.point, state.paths, self.parts, soon)

        return self.once(state, ("by part", soon), told)

    def half_widths_if_white(self, state: State, paths: Sequence[str]) -> list[float]:
        """Half widths of the 95 % intervals of some of a state's paths if errors were white and their noise was known.

        Those of `intervals` are as wide or wider, and take far longer.
        """
        variances, own = np.diag(self.by_part(state, soon=True).spread), self._scaled(state)
        errors = dict(zip(state.paths, np.sqrt(np.maximum(variances, 0.0)), strict=True))
        return [half_width(np.inf) * float(errors[p]) * own.scale(p) for p in paths]

    def _scaled(self, state: State) -> PredictionErrors:
        """The problem with scales of what a state has fitted and the vehicle has none for: terms, by their size."""
        fitted = [p for p in state.paths if p not in state.plant.coefficients and not spec_at(state.plant, p).probe]
        return self.problem.scaled({p: abs(value_at(state.plant, p)) or 1.0 for p in fitted})

    def unseen(self, state: State, part: int) -> Plant:
        """The vehicle of a state as its paths are without a part of the record."""
        step, _ = self.by_part(state).refitted(np.arange(len(self.parts)) != part)
        own = self._scaled(state)
        vector = own.moved_vector(state.point.vector, state.paths, step)
        values = {p: float(vector[own.index[p]]) for p in state.paths}
        return replace_at(state.plant, values) if values else state.plant

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

    def half_width_of(self, state: State, shares: Mapping[str, float]) -> float:
        """Half the width of the 95 % interval of a sum of fitted paths, each with its share."""
        found = self._information(state)
        rows = [state.paths.index(p) for p in shares]
        units = np.array([share * self.problem.scale(p) for p, share in shares.items()])
        variance = float(units @ found.covariance[np.ix_(rows, rows)] @ units)
        return half_width(float(found.freedom[rows].min())) * float(np.sqrt(max(variance, 0.0)))

    def spread(self, state: State) -> tuple[Plant, ...]:
        """The vehicle of a state, moved by a standard error in each independent direction of what was fitted."""
        if not state.paths:
            return ()
        values, vectors = np.linalg.eigh(self._information(state).covariance)
        problem, steps = self.problem, (vectors * np.sqrt(np.maximum(values, 0.0))).T
        moved = (problem.moved_vector(state.point.vector, state.paths, step) for step in steps)
        return tuple(
            replace_at(state.plant, {p: float(vector[problem.index[p]]) for p in state.paths}) for vector in moved
        )

    def _information(self, state: State) -> Information:
        return self.once(state, "information", lambda: information_of(self.problem, state.point, state.paths))

    def costs(self, state: State) -> np.ndarray:
        """Minus twice the objective in each of `BLOCKS` equal times of the record, (B,); what is known shared out."""
        p, scores = self.problem, np.bincount(self.block_of_row, state.point.scores, minlength=BLOCKS)
        known = p.total(state.point) - p.objective(state.point, state.paths)
        return 2.0 * (known / BLOCKS - scores)

    def flies(self, plant: Plant, settle: float | None = None) -> bool:
        """Whether free runs stay finite."""
        return self._free_errors(plant, settle) is not None

    def nearer(self, before: State, after: State) -> float:
        """By how much free runs with a second state are nearer to the record than with a first one.

        The mean of the logarithms of RMS errors over the channels, by which it is less.
        """
        first, second = self._free_errors(before.plant), self._free_errors(after.plant)
        if first is None or second is None:
            return float(first is None) - float(second is None)
        return float(np.mean(np.log(first / second)))

    def _free_errors(self, plant: Plant, settle: float | None = None) -> np.ndarray | None:
        """RMS errors of free runs over all windows by channel, (C,); None where they diverge."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                runs = free_runs(plant, self.record, self.windows, plant.settle if settle is None else settle)
        except Diverged:
            return None
        squares = [runs.errors(c) ** 2 for c in range(len(runs.channels))]
        return np.maximum([np.sqrt(s.sum() / max(s.size, 1)) for s in squares], 1e-12)
