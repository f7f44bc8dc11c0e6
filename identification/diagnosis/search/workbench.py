"""A workbench for a diagnosis: a record in parts, and the fits to it."""

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

ITERATIONS = 12  # most iterations of a trial's fit


@dataclass(frozen=True, eq=False)
class State:
    """A vehicle with fitted parameters and noises, and its filter along the record.

    paths: the fitted parameters.  quiet: whether its accelerations were weakened or made brief, to absorb less.
    suited: whether it has the noises that suit it, so that its errors are as large as these make them.
    """

    plant: Plant
    paths: tuple[str, ...]
    point: Point
    quiet: bool = False
    suited: bool = True

    @property
    def brief(self) -> bool:
        """Whether lasting accelerations were made brief, and all noises suit that."""
        return self.quiet and self.suited

    @property
    def finite(self) -> bool:
        """Whether the filter's likelihood is finite in all rows."""
        return bool(np.isfinite(self.point.scores).all())


def tried(problem: PredictionErrors, near: State, settled: bool = False) -> State:
    """The state that a trial's fit reaches from a nearby state; settled: see `PredictionErrors.solve`."""
    point = problem.solve(near.plant, near.paths, near.point, ITERATIONS, gain=TRIAL_GAIN, settled=settled)
    return State(problem.plant_at(point, near.paths), near.paths, point)


class Workbench:
    """A record in parts, and the fits to it.

    One filter passes through the whole record, and fits count all of it.  The likelihood of each part is also known as
    a function of the parameters, which shows whether a change of the model predicts the part from the others.
    plant: the vehicle as given.  The attribute of this name is integrated in the longest steps that hardly move its
    filter, see `identification.fit.steps`.
    doubt: relative standard deviation of coefficients that state none.  windows: those of free runs, by default the
    pieces of the parts.
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
        """Start to count the work, with an empty cache of states."""
        self.block_of_row = block_numbers(self.record, self.problem.stretches, BLOCKS)[:: self.problem.stride]
        self._most, self.unfinished = self.problem.work.done + MOST_WORK, list[str]()
        self._known: WeakKeyDictionary[State, dict[Hashable, Any]] = WeakKeyDictionary()

    def once(self, state: State, question: Hashable, work: Callable[[], T]) -> T:
        """The cached result of `work`, by state and question; it is kept as long as the state."""
        known = self._known.setdefault(state, {})
        if question not in known:
            known[question] = work()
        return known[question]

    def in_suited_steps(self, state: State) -> Workbench:
        """A bench with other integration steps if the present ones do not suit a state, else itself."""
        problem = suited(self._as_stepped, self.problem, state.point, state.paths)
        if problem is self.problem:
            return self
        other = copy(self)
        other.problem, other.plant = problem, problem.plant
        other._begin()
        return other

    def in_suited_rows(self, state: State) -> Workbench:
        """A bench with readings averaged over less time if the averages mislead the fit of a state, else itself."""
        return self._in_rows(in_suited_rows(self.problem, state.point, state.paths))

    def in_shortest_rows(self) -> Workbench:
        """A bench with readings not averaged, or averaged over the least time that a long record allows, or itself."""
        return self._in_rows(in_shortest_rows(self.problem))

    def _in_rows(self, problem: PredictionErrors) -> Workbench:
        """A bench with the problem in other rows, or itself if it is the same problem."""
        if problem is self.problem:
            return self
        other = copy(self)
        other.problem, other._as_stepped = problem, in_steps(problem, self._as_stepped.plant.longest_step)
        other._begin()
        return other

    def with_noises(self, velocities: Sequence[int], readings: Sequence[int], period: float) -> Workbench:
        """A bench with further noises, see `identification.fit.stretches.Stretches.with_noises`."""
        other, added = copy(self), (velocities, readings, period)
        other._as_stepped, other.problem = self._as_stepped.with_noises(*added), self.problem.with_noises(*added)
        other._begin()
        return other

    def taken_over(self, state: State) -> State:
        """A state of a bench with other steps or rows, fitted again with those of this bench."""
        plant = replace(state.plant, longest_step=self.plant.longest_step)
        near = replace(state.point, system=None)  # its responses are for other rows
        point = self.problem.point(plant.vector, state.point.logs, near)
        return self.fit(plant, state.paths, State(plant, state.paths, point))

    def goes_on(self, step: str) -> bool:
        """Whether time is left for a step of the search, described in words; if not, `unfinished` lists the step."""
        if self.problem.work.done < self._most:
            return True
        if step not in self.unfinished:
            self.unfinished.append(step)
        return False

    @property
    def followed(self) -> int:
        """The number of the vehicle's states that the filter follows."""
        return sum(i < len(self.plant.family.states) for i in self.problem.live)

    def fit(self, plant: Plant, paths: Sequence[str], near: State | None = None, gain: float = LEAST_GAIN) -> State:
        """The likeliest state over the paths and the noises, starting from the plant's values; gain: see `solve`."""
        point = self.problem.solve(plant, paths, near.point if near else None, gain=gain)
        return State(self.problem.plant_at(point, paths) if paths else plant, tuple(paths), point)

    def fit_from(
        self, starts: Sequence[tuple[Plant, State]], paths: Sequence[str], rival: State, hopeless: float
    ) -> State:
        """The state that a trial's fit reaches from the likeliest of several plants, each with a state near it.

        rival: a state to compare with.  If the evidence against the result is more than `hopeless` after the fit of
        its parameters, its noises are not fitted.
        """
        points = side_by_side(lambda one: self.problem.point(one[0].vector, one[1].point.logs, one[1].point), starts)
        best = max(points, key=lambda p: self.problem.objective(p, paths))  # minus infinity if a filter diverges
        point = self.problem.descended(best, paths)
        settled = State(self.problem.plant_at(point, paths), tuple(paths), point)
        if self.gain(settled, rival) > hopeless:
            return settled
        return tried(self.problem, settled)

    def with_given(self, state: State) -> tuple[State, ...]:
        """The state with its coefficients as given, if the fit has moved one of them far from there; else empty."""

        def found() -> tuple[State, ...]:
            plant = self._put_back(state)
            there = [] if plant is None else [self._renewed_at(plant, state)]
            return tuple(one for one in there if one.finite)

        return self.once(state, "as given", found)

    def _put_back(self, state: State) -> Plant | None:
        """The vehicle of a state with all coefficients as given; None if the fit has moved none of them far away.

        Coefficients move together, as do inertia and moments about one axis.  If only some of them were put back, the
        result would resemble neither vehicle.
        """
        values = {p: value_at(self.plant, p) for p in state.paths if p in self.plant.doubted}
        far = any(abs(value_at(state.plant, p) - v) > FAR_FROM_GIVEN * abs(v) for p, v in values.items())
        return replace_at(state.plant, values) if far else None

    def likelier_from_given(self, state: State, hopeless: float) -> State:
        """The state, or the result of a fit from its effects with the coefficients as given, whichever is likelier.

        Coefficients that have compensated a missing effect may lie in a valley of the likelihood that a fit cannot
        leave.
        hopeless: evidence against that vehicle, before the fit, above which it is not fitted.
        """
        plant = self._put_back(state)
        return state if plant is None or not state.finite else self._likelier(state, plant, state, hopeless)

    def likelier_beside(self, state: State, trial: State) -> State:
        """The state, or the result of a fit from a trial's result without its effect, whichever is likelier.

        A fit may end in a narrow valley of the likelihood, along which a fit with one more free parameter gets further.
        """
        plant = replace_at(state.plant, {p: value_at(trial.plant, p) for p in state.paths})
        return self._likelier(state, plant, trial, np.inf)

    def _likelier(self, state: State, plant: Plant, near: State, hopeless: float) -> State:
        """The state, or the likelier result of a fit of the same paths from a plant with the noises of a state near it.

        hopeless: evidence against the plant, before the fit, above which it is not fitted.
        """
        there = State(plant, state.paths, self.problem.point(plant.vector, near.point.logs, near.point))
        if not there.finite or self.gain(there, state) > hopeless:
            return state
        there = tried(self.problem, there)
        return there if self.gain(state, there) > 0.0 else state

    def _renewed_at(self, plant: Plant, near: State) -> State:
        """A plant with the noises that suit it, without free parameters.

        The search begins with the noises of a nearby state, and with first guesses: the noises of a vehicle that
        follows the record need not suit one that leaves it.
        """
        problem = self.problem

        def renewed(near: Point | None) -> Point:
            point = problem.point(plant.vector, problem.first_noise() if near is None else near.logs, near)
            return problem.renewed(point, point.logs, ())

        found = side_by_side(renewed, [near.point, None])
        return State(plant, (), max(found, key=lambda point: problem.objective(point, ())))

    def quieted(self, state: State) -> tuple[State, ...]:
        """The variants of a state with less process noise, of all or some kinds, whose filters still follow the record.

        The first has weaker accelerations of all kinds but a swell.  Lasting accelerations can absorb a steady effect,
        while brief ones, such as those by waves, may still be needed: the second has brief ones instead of the lasting
        ones, and the parameters and noises that suit them.  A swell can absorb the effect of regular waves, or of what
        makes a control loop oscillate: the third has a weaker swell.
        """
        problem = self.problem
        if not problem.pushed:
            return ()

        def found() -> tuple[State, ...]:
            swell = problem.swelling(state.point)
            weaker = [problem.quieted(state.point, which) for which in [None, *[swell] * bool(swell.any())]]
            there = [State(state.plant, state.paths, p, quiet=True, suited=False) for p in weaker if p is not None]
            brief = problem.from_brief(state.point, state.paths)
            if brief is not None:
                there.insert(1, State(problem.plant_at(brief, state.paths), state.paths, brief, quiet=True))
            return tuple(there)

        return self.once(state, "quieted", found)

    def worth(self, state: State, paths: Sequence[str]) -> float:
        """The evidence for some of a state's paths, with all else but the noises refitted to second order."""
        own = self._scaled(state)
        rows = [state.paths.index(p) for p in paths]
        moved = [(value_at(state.plant, p) - spec_at(state.plant, p).neutral) / own.scale(p) for p in paths]
        spread = self.by_part(state).spread[np.ix_(rows, rows)]
        return float(np.array(moved) @ np.linalg.pinv(spread, hermitian=True) @ np.array(moved))

    def without(self, state: State, paths: Sequence[str]) -> State:
        """The state fitted again, with some effects fixed at their neutral values."""
        plant = replace_at(state.plant, {p: spec_at(state.plant, p).neutral for p in paths})
        return self.fit(plant, [p for p in state.paths if p not in paths], state)

    def gains(self, before: State, after: State) -> tuple[float, float]:
        """The evidence in all rows and in parts predicted from the others: `gain` and `gain_foretold`."""
        return self.gain(before, after), self.gain_foretold(before, after)

    def gain(self, before: State, after: State) -> float:
        """Evidence in all rows: twice the gain of the objective, which includes priors and costs of accelerations."""
        p = self.problem
        return 2.0 * (p.objective(after.point, after.paths) - p.objective(before.point, before.paths))

    def gain_foretold(self, before: State, after: State, soon: bool = False) -> float:
        """Evidence in parts: twice the gain in log-likelihood of each part predicted from the others, summed.

        Each state has its own noises.
        """
        return 2.0 * float((self.by_part(after, soon).foretold - self.by_part(before, soon).foretold).sum())

    def known_gain(self, before: State, after: State) -> float:
        """The part of `gain` due to coefficients that are closer to their stated values."""
        squares = [float((self.problem.pulls(s.point.vector, s.paths)[0] ** 2).sum()) for s in (before, after)]
        return squares[0] - squares[1]

    def by_part(self, state: State, soon: bool = False) -> ByPart:
        """The likelihood of each part near a state, see `ByPart`; soon: use responses where the state has them."""

        def told() -> ByPart:
            return told_by_part(self._scaled(state), state.point, state.paths, self.parts, soon)

        return self.once(state, ("by part", soon), told)

    def half_widths_if_white(self, state: State, paths: Sequence[str]) -> list[float]:
        """Half widths of the 95 % intervals of some of a state's paths, for white errors of known noise.

        Those of `intervals` are as wide or wider, and take far longer.
        """
        variances, own = np.diag(self.by_part(state, soon=True).spread), self._scaled(state)
        errors = dict(zip(state.paths, np.sqrt(np.maximum(variances, 0.0)), strict=True))
        return [half_width(np.inf) * float(errors[p]) * own.scale(p) for p in paths]

    def _scaled(self, state: State) -> PredictionErrors:
        """The problem with the sizes of a state's fitted terms as their scales, since the vehicle states none."""
        fitted = [p for p in state.paths if p not in state.plant.coefficients and not spec_at(state.plant, p).probe]
        return self.problem.scaled({p: abs(value_at(state.plant, p)) or 1.0 for p in fitted})

    def unseen(self, state: State, part: int) -> Plant:
        """The vehicle of a state, with its paths refitted, to second order, without a part of the record."""
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
        """Half the width of the 95 % interval of a weighted sum of fitted paths; shares: weights by path."""
        found = self._information(state)
        rows = [state.paths.index(p) for p in shares]
        units = np.array([share * self.problem.scale(p) for p, share in shares.items()])
        variance = float(units @ found.covariance[np.ix_(rows, rows)] @ units)
        return half_width(float(found.freedom[rows].min())) * float(np.sqrt(max(variance, 0.0)))

    def spread(self, state: State) -> tuple[Plant, ...]:
        """Vehicles moved by one standard error, one for each independent direction of a state's fitted parameters."""
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
        """Minus twice the objective in each of `BLOCKS` equal times of the record, (B,).

        Terms of the objective that belong to no row, such as priors, are shared equally.
        """
        p, scores = self.problem, np.bincount(self.block_of_row, state.point.scores, minlength=BLOCKS)
        known = p.total(state.point) - p.objective(state.point, state.paths)
        return 2.0 * (known / BLOCKS - scores)

    def flies(self, state: State, settle: float | None = None) -> bool:
        """Whether free runs stay finite."""
        return self._free_errors(state, settle) is not None

    def nearer(self, before: State, after: State) -> float:
        """The decrease of free-run errors from one state to another: of the logarithm of RMS, mean over channels.

        It is 1 or -1 if only the first or only the second diverges, and 0 if both do.
        """
        first, second = self._free_errors(before), self._free_errors(after)
        if first is None or second is None:
            return float(first is None) - float(second is None)
        return float(np.mean(np.log(first / second)))

    def _free_errors(self, state: State, settle: float | None = None) -> np.ndarray | None:
        """RMS errors of free runs over all windows, by channel, (C,); None if a run diverges."""
        plant = state.plant

        def found() -> np.ndarray | None:
            try:
                with np.errstate(over="ignore", invalid="ignore"):
                    runs = free_runs(plant, self.record, self.windows, plant.settle if settle is None else settle)
            except Diverged:
                return None
            squares = [runs.errors(c) ** 2 for c in range(len(runs.channels))]
            return np.maximum([np.sqrt(s.sum() / max(s.size, 1)) for s in squares], 1e-12)

        return self.once(state, ("free errors", settle), found)
