"""When a parameter changed between missions: the likeliest time of one step in all logs, and the size in each log."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from auv_gym.param import positions, replace_at, spec_at, value_at
from identification.changes.forms import Sized, in_form, sized, tied_names
from identification.changes.search_in_time import searched_in_time
from identification.changes.timed_forms import FROM, Forms
from identification.changes.times import Located, moved_to_best, placed
from identification.deciding import PROMISED
from identification.diagnosis.log.parts import OneLog
from identification.diagnosis.search.acceptance import weighed
from identification.diagnosis.search.attribution import settled
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate, screen
from identification.diagnosis.search.constancy import sizes_by_dive
from identification.diagnosis.search.known import Known
from identification.diagnosis.search.trials import Progress, size_in
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.changing import ChangingPlant, Course, change, changed


@dataclass(frozen=True)
class Within:
    """A time within a log: the log's name, and the time since its beginning, s."""

    log: str
    time: float


@dataclass(frozen=True)
class OfLog:
    """The size of a parameter in one log, with its 95 % interval, in the parameter's unit."""

    log: str
    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Moment:
    """When a parameter changed, if the change was one step.

    between: the last log with the value before, and the first one with the value after; the same log twice if the
    change falls within it.  evidence: for this time against a change between the two sides; 0 for that change itself.
    time: None between two logs.  ci95: its 95 % interval; None for a change between the two sides.
    """

    between: tuple[str, str]
    evidence: float = 0.0
    time: Within | None = None
    ci95: tuple[Within, Within] | None = None


@dataclass(frozen=True)
class Step:
    """A parameter that changed at another time than between the two sides.

    evidence: over one common value.  tied: see `identification.changes.missions.Changed`.
    """

    path: str
    moment: Moment
    before: Sized
    after: Sized
    change: Sized
    evidence: float
    tied: tuple[str, ...] = ()


@dataclass(frozen=True)
class Sides:
    """The logs of two sides, with their rows in the joined record and the names to be used as labels.

    edge: the row at which the second side begins.
    """

    logs: tuple[OneLog, ...]
    edge: int

    @property
    def middle(self) -> Moment:
        """The time between the two sides."""
        number = next(k for k, one in enumerate(self.logs) if one.rows.start == self.edge)
        return Moment((self.logs[number - 1].label, self.logs[number].label))

    def rows_of(self, bench: Workbench) -> list[int]:
        """The rows at which steps are screened: the beginning of each log, and of each of 24 equal spans of time."""
        rows = bench.problem.rows
        spans = rows[np.flatnonzero(np.diff(bench.block_of_row)) + 1].tolist()
        return sorted({row for row in (*spans, *(one.rows.start for one in self.logs)) if row > rows[0]})

    def moment(self, bench: Workbench, found: Located, evidence: float) -> Moment:
        """The moment of a step that was located.

        If its interval includes the beginning of a log, the step is between that log and the one before: in the time
        without samples, anything may have happened.
        """
        begins = [k for k, one in enumerate(self.logs) if k > 0 and found.low <= one.rows.start <= found.high]
        ends = self._within(bench, found.low), self._within(bench, found.high)
        if begins:
            k = min(begins, key=lambda k: abs(self.logs[k].rows.start - found.row))
            return Moment((self.logs[k - 1].label, self.logs[k].label), evidence, None, ends)
        time = self._within(bench, found.row)
        return Moment((time.log, time.log), evidence, time, ends)

    def _within(self, bench: Workbench, row: int) -> Within:
        log, time = next(one for one in reversed(self.logs) if one.rows.start <= row), bench.record.time
        return Within(log.label, float(time[row] - time[log.rows.start]))


def step_elsewhere(bench: Workbench, common: State, both: State, path: str, sides: Sides, count: int) -> Step | None:
    """The likeliest step of a parameter at another time than between the two sides; None if that time is not certain.

    common: the state with one value of the parameter; both: with one on each side.  count: number of all candidates.

    Steps are screened at the beginning of each log and at 23 equally spaced times.  If one of these promises more than
    a step between the sides, its time is refined row by row.  It must explain the logs better than that step, by the
    threshold for these times, and better than one value, by the rules for any effect.
    """
    rows = sides.rows_of(bench)
    bar, timed, here = threshold(len(rows)), *_with_steps(bench, common, [path], rows)
    candidates = {row: Candidate(path, (change(f"{FROM}{row}", path),)) for row in rows}
    promised = dict.fromkeys(candidates.values(), 0.0)
    for base in (here, *timed.quieted(here)):
        for one in screen(timed.problem, base.point, here.paths, list(promised), bar):
            promised[one.candidate] = max(promised[one.candidate], one.evidence)
    first = max(rows, key=lambda row: promised[candidates[row]])
    if promised[candidates[first]] - promised[candidates[sides.edge]] < PROMISED * bar:
        return None
    (added,) = candidates[first].paths
    begun = timed.fit(here.plant, [*here.paths, added], here)
    moved, state, found = moved_to_best(timed, begun, f"{FROM}{first}", 0)
    evidence = 2.0 * moved.problem.objective(state.point, state.paths)
    evidence -= 2.0 * bench.problem.objective(both.point, both.paths)
    if evidence < bar:
        return None
    size = size_in(moved, state, added)
    gained = weighed(
        moved,
        placed(moved, here, {})[1],
        state,
        [size],
        lambda: [moved.half_width_of(state, {added: 1.0})],
        threshold(count * len(rows)),
    )
    if gained.objection:
        return None
    return _step(moved, state, added, sides.moment(bench, found, evidence), gained.train)


def further_steps(
    known: Known,
    state: State,
    candidates: Sequence[Candidate],
    sides: Sides,
    count: int,
    most: int,
    progress: Progress,
) -> list[Step]:
    """Steps of parameters in which the two sides as a whole do not differ, by the search in time of `find_onsets`.

    state: what the search of the sides has found.  count: number of the candidates of that search.
    """
    rows = sides.rows_of(known.bench)
    bench, here = _with_steps(known.bench, state, [p for c in candidates for p in c.paths], rows)
    forms = [Forms(None, (tuple(in_form(c, f"{FROM}{row}") for row in rows),)) for c in candidates]
    count += sum(f.count for f in forms)
    timed = replace(known, bench=bench, nominal=here)
    bench, there, rounds, times = searched_in_time(timed, forms, count, most, progress)
    there, rounds = settled(bench, placed(bench, here, {})[1], there, rounds, count)
    steps = []
    for made in rounds:
        for added in made.chosen.candidate.paths if made.chosen else ():
            if added not in there.paths:
                continue
            form, path = changed(added)
            moment, (found,) = sides.middle, times[form]
            if not found.low <= sides.edge <= found.high:
                own = [p for p in there.paths if p != added]
                there_instead = change(f"{FROM}{sides.edge}", path)
                other = bench.fit(replace_at(there.plant, added, 0.0), [*own, there_instead], there)
                moment = sides.moment(bench, found, bench.gain(other, there))
            both = there if path in there.paths else bench.fit(there.plant, [*there.paths, path], there)
            steps.append(replace(_step(bench, both, added, moment, made.evidence[0]), tied=tied_names([made])))
    return steps


def sizes_by_log(bench: Workbench, common: State, path: str, sides: Sides) -> tuple[OfLog, ...]:
    """The size in each of more than two logs; empty if these do not certainly contradict each other in it.

    common: see `step_elsewhere`.
    """
    found = sizes_by_dive(bench, common, path) if len(sides.logs) > 2 else None
    if found is None or len(found.sizes) != len(sides.logs):
        return ()
    return tuple(OfLog(log.label, one.value, one.ci95) for log, one in zip(sides.logs, found.sizes, strict=True))


def _with_steps(bench: Workbench, state: State, paths: Sequence[str], rows: Sequence[int]) -> tuple[Workbench, State]:
    """The bench and the state with steps of parameters at these rows, all still zero; `from7` is one at row 7."""
    courses = {f"{FROM}{row}": Course((row,), (0.0, 1.0)) for row in rows}
    problem, timed = copy(bench.problem), copy(bench)
    problem.plant = plant = ChangingPlant.of(
        bench.plant, {form: list(paths) for form in courses}, courses, bench.record
    )
    problem.index = positions(plant)
    timed.problem, timed.plant = problem, plant
    here = replace_at(plant, {p: value_at(state.plant, p) for p in state.paths})
    return timed, State(here, state.paths, replace(state.point, vector=here.vector))


def _step(bench: Workbench, state: State, added: str, moment: Moment, evidence: float) -> Step:
    """The step by a fitted change of a fitted parameter."""
    path = changed(added)[1]
    limits = spec_at(state.plant, path).bounds
    before, after = (sized(bench, state, shares, 0.0, limits) for shares in ({path: 1.0}, {path: 1.0, added: 1.0}))
    return Step(path, moment, before, after, sized(bench, state, {added: 1.0}), evidence)
