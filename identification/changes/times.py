"""The times of a log at which something changes, by the likelihood profile, and whether sizes agree on both halves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from identification.changes.forms import kind_of
from identification.deciding import BLOCKS, MISSED
from identification.diagnosis.search.candidates import Candidate, screen
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.changing import ChangingPlant, Course, change, changed
from identification.fit.followed import Point
from identification.fit.prediction_errors import PredictionErrors

_SCANNED = 12  # rows of the first profile per span between two screened times
_REACH = 1.5  # such spans to either side that the first profile covers
_LEAST_GAIN = 0.1  # evidence that another row must bring
_DROP = 0.5 * float(chi2.isf(MISSED, 1))  # fall of the log-likelihood at the ends of a time's interval


def placed(bench: Workbench, state: State, edges: Mapping[str, tuple[int, ...]]) -> tuple[Workbench, State]:
    """The bench and the state with the edges of some forms, whose changes are still zero, moved to these rows."""
    plant = bench.problem.plant
    assert isinstance(plant, ChangingPlant)
    courses = {form: replace(plant.courses[form], edges=rows) for form, rows in edges.items()}
    other, problem = copy(bench), copy(bench.problem)
    problem.plant = replace(plant, courses={**plant.courses, **courses})
    other.problem, other.plant = problem, problem.plant
    return other, replace(state, plant=problem.plant_at(state.point, state.paths))


def finer_rows(
    bench: Workbench, state: State, fitted: Sequence[str], loud: Sequence[Candidate], bar: float
) -> dict[str, tuple[float, int]]:
    """The row with the most evidence for each form with one time, near its screened row, and that evidence.

    A wrong time of a jump, as of a compass error, leaves errors so large at a few rows that a fit is no better than
    without the effect.  So the rows up to half-way to the next screened time are screened, too.
    fitted: paths fitted so far.  loud: candidates; those without slopes, which would be tried in many sizes, stay.
    """
    plant, found = bench.problem.plant, dict[str, tuple[float, int]]()
    assert isinstance(plant, ChangingPlant)
    taken = {changed(path)[0] for path in state.paths}
    forms = {c: changed(c.paths[0])[0] for c in loud}
    moving = [c for c, form in forms.items() if c.sloped and len(plant.courses[form].edges) == 1 and form not in taken]
    cell, last = len(bench.problem.rows) / BLOCKS, int(bench.problem.rows[-1])
    step = max(round(cell / _SCANNED), 1)
    for shift in range(-round(0.5 * cell), round(0.5 * cell) + 1, step) if moving else ():
        rows = {forms[c]: int(np.clip(plant.courses[forms[c]].edges[0] + shift, 1, last)) for c in moving}
        other, _ = placed(bench, state, {form: (row,) for form, row in rows.items()})
        for one in screen(other.problem, state.point, fitted, moving, bar):
            told = one.evidence, rows[forms[one.candidate]]
            found[forms[one.candidate]] = max(told, found.get(forms[one.candidate], told))
    return found


@dataclass(frozen=True)
class Located:
    """A row of a record, and the rows at the ends of its 95 % interval."""

    row: int
    low: int
    high: int


def moved_to_best(bench: Workbench, state: State, form: str, number: int) -> tuple[Workbench, State, Located]:
    """Move one of a form's edges to its most likely row; returns the bench, the state, and the row with its interval.

    number: of the edge.  The row is sought with the filter's gains held.  If random accelerations push the vehicle,
    they may have made up for a slightly wrong row: the next rows on either side are then tried with the noises fitted
    anew, and the search is repeated from there if one of them is likelier.
    """
    bench, state, found = _moved(bench, state, form, number)
    while bench.problem.pushing(state.point):
        tried = [_refitted_at(bench, state, form, number, row) for row in (found.row - 1, found.row + 1)]
        reached = max((one for one in tried if one), key=lambda one: bench.gain(state, one[1]), default=None)
        if reached is None or bench.gain(state, reached[1]) <= _LEAST_GAIN:
            break
        before = state
        bench, state, found = _moved(*reached, form, number)
        if bench.gain(before, state) <= _LEAST_GAIN:
            break
    return bench, state, found


def _limits(bench: Workbench, form: str, number: int) -> tuple[int, int]:
    """The first and last row to which an edge may move."""
    rows = bench.problem.rows
    edges = _course(bench, form).edges
    limits = int(rows[0]), *edges[:number], *edges[number + 1 :], int(rows[-1]) + 1
    return limits[number] + 1, limits[number + 1] - 1


def _course(bench: Workbench, form: str) -> Course:
    plant = bench.problem.plant
    assert isinstance(plant, ChangingPlant)
    return plant.courses[form]


def _with_edge(problem: PredictionErrors, form: str, number: int, row: int) -> PredictionErrors:
    """The problem with one of a form's edges at a row."""
    other, plant = copy(problem), problem.plant
    assert isinstance(plant, ChangingPlant)
    edges = plant.courses[form].edges
    course = replace(plant.courses[form], edges=(*edges[:number], row, *edges[number + 1 :]))
    other.plant = replace(plant, courses={**plant.courses, form: course})
    return other


def _solved(bench: Workbench, problem: PredictionErrors, paths: Sequence[str], near: Point) -> tuple[Workbench, State]:
    """The bench with another problem, and the state fitted there from a point near it."""
    other = copy(bench)
    other.problem, other.plant = problem, problem.plant
    point = problem.solve(problem.plant_at(near, paths), paths, near, iterations=4)
    return other, State(problem.plant_at(point, paths), tuple(paths), point)


def _refitted_at(bench: Workbench, state: State, form: str, number: int, row: int) -> tuple[Workbench, State] | None:
    """The bench and the state fitted again with an edge at another row; None if it cannot be there."""
    low, high = _limits(bench, form, number)
    if not low <= row <= high:
        return None
    problem = _with_edge(bench.problem, form, number, row)
    near = problem.prepared(problem.with_gains(state.point, state.point.vector), state.paths, anew=True)
    return _solved(bench, problem, state.paths, near)


def _moved(bench: Workbench, state: State, form: str, number: int) -> tuple[Workbench, State, Located]:
    """One of a form's edges at its most likely row with the filter's gains held; see `moved_to_best`.

    Nearby rows are scanned first, since commands that change produce several local optima; steps that are halved then
    refine the best one.  Parameters and starts are refitted.  The interval ends at the first rows where the
    log-likelihood has fallen by `_DROP`.
    """
    problem = bench.problem
    low, high = _limits(bench, form, number)
    tried: dict[int, tuple[float, PredictionErrors, Point]] = {}

    def likely(row: int) -> float:
        if row not in tried:
            other = _with_edge(problem, form, number, row)
            near = tried[best][2] if tried else state.point
            here = other.prepared(other.with_gains(near, near.vector), state.paths, anew=True)
            point = other.descended(here, state.paths)
            tried[row] = other.objective(point, state.paths), other, point
        return tried[row][0]

    best, cell = _course(bench, form).edges[number], len(problem.rows) / BLOCKS
    step = max(round(cell / _SCANNED), 1)
    scan = range(max(low, best - round(_REACH * cell)), min(high, best + round(_REACH * cell)) + 1, step)
    likely(best)
    best = max(scan, key=likely)
    while step:
        row = max((r for r in (best - step, best + step) if low <= r <= high), key=likely, default=best)
        if likely(row) > likely(best):
            best = row
        else:
            step //= 2
    within = [r for r in tried if likely(r) > likely(best) - _DROP]
    ends = (_end(likely, best, min(within), low), _end(likely, best, max(within), high))
    _, moved, point = tried[best]
    return *_solved(bench, moved, state.paths, point), Located(best, *ends)


def _end(likely: Callable[[int], float], best: int, inner: int, limit: int) -> int:
    """The first row from an inner one towards a limit where the log-likelihood has fallen by `_DROP`, or the limit."""
    side, reach, outer = (1 if limit > best else -1), 1, inner
    while outer != limit and likely(outer) > likely(best) - _DROP:
        inner, outer = outer, outer + side * min(reach, abs(limit - outer))
        reach *= 2
    while abs(outer - inner) > 1:
        middle = (inner + outer) // 2
        inner, outer = (inner, middle) if likely(middle) <= likely(best) - _DROP else (middle, outer)
    return outer


def split_evidence(bench: Workbench, state: State, name: str, form: str) -> float:
    """The evidence that the size of a change differs between the halves of the time in which it acts.

    The same effect is added from the screened time nearest to the middle of that time on, in a form with numbers such
    as `from7`.  An effect outside of two times is split at the second of them.
    """
    plant = bench.problem.plant
    assert isinstance(plant, ChangingPlant)
    own, path = changed(name)
    rows = bench.problem.rows
    shares = np.array([plant.courses[own].at(int(row)) for row in rows]) if own else np.ones(len(rows))
    there = rows[shares > 0.0]
    middle = there[len(there) // 2]
    if own and len(plant.courses[own].edges) == 2 and shares[0] > 0.0:
        middle = plant.courses[own].edges[1]
    times = {
        other: course.edges[0]
        for other, course in plant.courses.items()
        if kind_of(other) == form and change(other, path) not in state.paths and there[0] < course.edges[0] < there[-1]
    }
    if not times:
        return 0.0
    added = change(min(times, key=lambda other: abs(times[other] - middle)), path)
    found = screen(bench.problem, state.point, state.paths, [Candidate(path, (added,))], 1.0)[0]
    if found.evidence < _DROP:  # also if the effect cannot be determined
        return 0.0
    return bench.gain(state, bench.fit(state.plant, (*state.paths, added), state))
