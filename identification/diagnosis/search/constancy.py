"""Tests of whether parameters are the same throughout a record, or differ from dive to dive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.stats import chi2

from auv_gym.param import positions, replace_at, spec_at, value_at
from auv_gym.records.record import Record
from identification.deciding import BLOCKS, FEW_STATES, MOST_PARTS, SLIGHTLY, UNSTEADY
from identification.diagnosis.log.parts import logs_in
from identification.diagnosis.search.beside_noise import Weight, freedom_of
from identification.diagnosis.search.candidates import Candidate, Screening, screen
from identification.diagnosis.search.workbench import ITERATIONS, State, Workbench
from identification.fit.changing import ChangingPlant, Course, change, changed
from identification.fit.followed import Point
from identification.fit.parameters import moves_of
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.sensitivities import TRIAL_GAIN

_GROWS = "grows"  # the form of a change that grows evenly along the record
_SHARES = (1.0, 0.2)  # of the step by a regression, as starts of a fit: far from the log, the full step is too long


@dataclass(frozen=True)
class Steadiness:
    """The parameter in which the times of a record contradict each other most.

    probability: of so large a difference in any of the tested parameters, if each is the same throughout.
    apart: largest deviation at some time from the whole record, as a share of the size there; infinite if unknown.
    """

    path: str
    probability: float
    apart: float = np.inf

    @property
    def varies(self) -> bool:
        """Whether it surely differs between parts, and by more than a little."""
        return varies(self.probability, self.apart)


def varies(probability: float, apart: float) -> bool:
    """Whether a size surely differs between parts, and by more than a little; see `Steadiness`."""
    return probability < UNSTEADY and apart > SLIGHTLY


@dataclass(frozen=True)
class OfDive:
    """The size of an effect in one dive, with its 95 % interval, in the parameter's unit."""

    dive: str
    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True, eq=False)
class ByDive:
    """An effect whose size differs from dive to dive in a record; bench, state: the fit with all of these sizes."""

    path: str
    sizes: tuple[OfDive, ...]
    bench: Workbench
    state: State


def steadiness(
    bench: Workbench,
    state: State,
    paths: Sequence[str],
    quietly: bool = True,
    tried: int | None = None,
    level: float = UNSTEADY,
) -> Steadiness:
    """The parameter, of some paths, whose size differs most significantly along the record.

    The test is a regression on changes from each sixth on, and on a change that grows evenly: a single parameter, which
    shows growth where sixths beside slow noise do not.  With `quietly`, it is repeated with weaker accelerations, since
    these grow to explain a misfit and then hide it.  Only if it promises a difference is that fitted, with noises that
    suit it, and only until it is certain enough: the probability is then an upper bound.  For paths that are not
    fitted, the first sixth has a size of its own, too, so that an effect that ends at some time is none of the later
    sixths.
    tried: number of paths from which these were chosen; by default these only.  level: the significance level; a
    probability above it takes noises as known exactly.
    """
    count = len(paths) if tried is None else tried

    def found() -> Steadiness:
        courses, forms = _divisions(bench, paths, not set(paths).isdisjoint(state.paths))
        times = count * max(len(own) for own in forms.values())
        best, chance, _, changing = _changed(bench, state, forms, courses, level / times, quietly, False)
        return Steadiness(best, min(times * chance, 1.0), _apart(bench, state, changing, best, courses))

    return bench.once(state, ("steadiness", *paths, quietly, count, level), found)


def _divisions(
    bench: Workbench, paths: Sequence[str], fitted: bool
) -> tuple[dict[str, Course], dict[str, list[tuple[str, ...]]]]:
    """Changes from each sixth of the record on and one that grows, and the sets of them that a path may have, by path.

    An effect of only some logs has changes from each sixth of these.  fitted: whether any of the paths is fitted, so
    that the first sixth needs no change.
    """
    rows, courses, forms = bench.problem.rows, dict[str, Course](), dict[str, list[tuple[str, ...]]]()
    sixths = _sixths(bench)
    # in many small steps, or if these take too long, as they do for many states, from sixth to sixth
    steps = np.unique(bench.block_of_row if bench.followed <= FEW_STATES else sixths, return_index=True)[1]
    if len(steps) > 1:
        courses[_GROWS] = Course(tuple(rows[steps[1:]].tolist()), tuple(np.linspace(0.0, 1.0, len(steps)).tolist()))
    for path in paths:
        own, number, begins = changed(path)[0], sixths, range(int(fitted), int(sixths[-1]) + 1)
        if own and isinstance(bench.plant, ChangingPlant):
            acts = bench.plant.courses[own].over(rows) != 0.0
            number = np.where(acts, (np.cumsum(acts) - 1) * MOST_PARTS // max(int(acts.sum()), 1), -1)
            begins = range(1, MOST_PARTS)
        cuts = {f"{own}part{k}": int(rows[np.argmax(number == k)]) for k in begins if (number == k).any()}
        courses |= {name: Course((row,), (0.0, 1.0)) for name, row in cuts.items()}
        forms[path] = [tuple(cuts)] + [(_GROWS,)] * (_GROWS in courses and not own)
    return courses, forms


def _sixths(bench: Workbench) -> np.ndarray:
    """The sixth of the record of each row, (n,); for up to six logs about as many parts, none across logs."""
    begins = [begin for _, begin in dives_of(bench.record, bench.problem.rows)]
    if not 2 <= len(begins) <= MOST_PARTS:
        return bench.block_of_row * MOST_PARTS // BLOCKS
    log = np.searchsorted(begins, bench.problem.rows, side="right") - 1
    each, found = round(MOST_PARTS / len(begins)), np.zeros(log.size, dtype=int)
    for k in range(len(begins)):
        own = log == k
        found[own] = k * each + np.arange(own.sum()) * each // own.sum()
    return found


def _apart(bench: Workbench, state: State, found: State | None, path: str, courses: Mapping[str, Course]) -> float:
    """The largest deviation of the size of a path along a record from that of the whole, see `Steadiness`.

    found: a fit with its changes.  courses: of these, by form.
    """
    size = value_at(state.plant, path) - spec_at(state.plant, path).neutral
    if found is None or path not in state.paths or not size:
        return np.inf
    moved = value_at(found.plant, path) - value_at(state.plant, path) + np.zeros(len(bench.problem.rows))
    for form, course in courses.items():
        if change(form, path) in found.paths:
            moved += value_at(found.plant, change(form, path)) * course.over(bench.problem.rows)
    return float(np.abs(moved).max() / abs(size))


def sizes_by_dive(bench: Workbench, state: State, path: str) -> ByDive | None:
    """The size of an effect in each dive, if the dives of the record surely contradict each other in it.

    Each dive costs a parameter, except the first if the effect is already fitted: the evidence for these parameters
    must have a probability of less than 0.1 %.
    """
    dives = dives_of(bench.record, bench.problem.rows)
    if len(dives) < 2:
        return None
    begins, fitted = [*(begin for _, begin in dives), np.iinfo(np.int64).max], path in state.paths
    courses = {
        f"dive{k + 1}": Course((begins[k], begins[k + 1]), (0.0, 1.0, 0.0)) for k in range(int(fitted), len(dives))
    }
    _, chance, by_dive, found = _changed(bench, state, {path: [tuple(courses)]}, courses, UNSTEADY, True, True)
    if found is None or chance >= UNSTEADY:
        return None
    sizes, limits, common = [], spec_at(found.plant, path).bounds, {path: 1.0} if fitted else {}
    for k, (dive, _) in enumerate(dives, 1):
        shares = common | ({change(f"dive{k}", path): 1.0} if f"dive{k}" in courses else {})
        value, half = sum(value_at(found.plant, p) for p in shares), by_dive.half_width_of(found, shares)
        value, low, high = np.clip([value, value - half, value + half], *limits).tolist()
        sizes.append(OfDive(dive, value, (low, high)))
    return ByDive(path, tuple(sizes), by_dive, found)


def dives_of(record: Record, rows: np.ndarray) -> list[tuple[str, int]]:
    """The dives of a record, the segments of one label, each with the first of the given rows that lies in it."""
    found: list[tuple[str, int]] = []
    for dive in logs_in(record):
        own = rows[(rows >= dive.rows.start) & (rows < dive.rows.stop)]
        if own.size:
            found.append((dive.label, int(own[0])))
    return found


def _changed(
    bench: Workbench,
    state: State,
    forms: Mapping[str, Sequence[Sequence[str]]],
    courses: Mapping[str, Course],
    level: float,
    quietly: bool,
    whole: bool,
) -> tuple[str, float, Workbench, State | None]:
    """The path with the most significant changes, the probability of so much evidence, and bench and fit with them.

    forms: the sets of changes that each path may have, by path.  courses: of these changes, by form.

    No fit is made if a regression promises less than chance does with the probability `level`.  whole: whether to
    continue a fit that starts out significant.  Accelerations cost nothing here: both models may have them, so chance
    favours neither.
    """
    problem, changing = copy(bench.problem), copy(bench)
    moving = {form: [p for p, own in forms.items() if any(form in some for some in own)] for form in courses}
    problem.plant = plant = ChangingPlant.of(bench.plant, moving, courses, bench.record)
    problem.index = positions(plant)
    changing.plant, changing.problem = plant, problem
    here = replace_at(plant, {p: value_at(state.plant, p) for p in state.paths})
    near = replace(state.point, vector=here.vector)
    _soon(bench, problem, state, near, moving, courses)
    parts = {
        Candidate(p, tuple(change(form, p) for form in some)): p for p, own in forms.items() for some in own if some
    }
    quiet = problem.quieted(near) if quietly and problem.pushed else None
    bases = (near,) if quiet is None else (near, quiet)
    found = [(one, base) for base in bases for one in screen(problem, base, state.paths, list(parts), 0.0)]
    if not found:
        return next(iter(forms)), 1.0, changing, None

    def by_chance(of: tuple[Screening, Point]) -> tuple[float, float]:
        return float(chi2.sf(of[0].evidence, len(of[0].candidate.paths))), -of[0].evidence

    # fewer changes may explain more beside slow noise than a regression with given noises promises: the best of each
    # number of changes is tried
    counts = {len(one.candidate.paths) for one, _ in found}
    likeliest = [min((f for f in found if len(f[0].candidate.paths) == n), key=by_chance) for n in counts]
    judged: list[tuple[str, float, State | None]] = []
    for best, base in sorted(likeliest, key=by_chance):
        judged.append((parts[best.candidate], *_judged(bench, problem, state, near, best, base, level, whole)))
        if judged[-1][1] < level:
            break
    path, chance, fitted = min(judged, key=lambda one: one[1])
    return path, chance, changing, fitted


def _judged(
    bench: Workbench,
    problem: PredictionErrors,
    state: State,
    near: Point,
    best: Screening,
    base: Point,
    level: float,
    whole: bool,
) -> tuple[float, State | None]:
    """The probability of so much evidence for some changes, and the fit with them, if a regression promises enough.

    near: the point of the state, with changes that are zero.  base: from where the fit begins.
    """
    count = len(best.candidate.paths)
    if best.evidence <= float(chi2.isf(level, count)):
        return float(chi2.sf(best.evidence, count)), None
    free, moves = (*state.paths, *best.candidate.paths), moves_of(best.candidate.paths)
    without, tried = bench.problem.likelihood(state.point, state.paths), list[Point]()

    @cache
    def freedom() -> float:
        return freedom_of(problem, near, lambda point: problem.flattened(problem.columns_of(point, moves)))

    def chance(point: Point) -> float:
        weight = Weight(2.0 * (problem.likelihood(point, free) - without), np.inf, count)
        return weight.chance if weight.chance >= level else replace(weight, freedom=freedom()).chance

    for share in _SHARES:
        vector = problem.moved_vector(base.vector, free, share * np.r_[best.beside, best.estimate])
        tried.append(problem.renewed(problem.point(vector, base.logs, base), state.point.logs, free))
        if chance(tried[-1]) < level:
            break
    fitted = min(tried, key=chance)
    if whole or chance(fitted) >= level:
        fitted = problem.solve(problem.plant_at(fitted, free), free, fitted, ITERATIONS, gain=TRIAL_GAIN)
    if chance(fitted) < level:  # refit the model without changes from the rival's noises, too
        renewed = bench.problem.renewed(state.point, fitted.logs, state.paths)
        without = max(without, bench.problem.likelihood(renewed, state.paths))
    return chance(fitted), State(problem.plant_at(fitted, free), free, fitted)


def _soon(
    bench: Workbench,
    problem: PredictionErrors,
    state: State,
    near: Point,
    moving: Mapping[str, Sequence[str]],
    courses: Mapping[str, Course],
) -> None:
    """Copy the slopes that are known already, and compute those by changes of coefficients from responses, if possible.

    moving: paths by the form in which they change.
    """
    moves = moves_of(state.paths)
    problem.keep_columns(near, moves, bench.problem.columns_of(state.point, moves))
    answered = bench.problem.prepared(state.point, state.paths)
    for form, paths in moving.items():
        # what has added up is no share of a response
        paths = [p for p in paths if p not in bench.plant.family.adding]
        columns = bench.problem.changing_slopes(answered, paths, courses[form].over(problem.rows))
        if columns is None:
            return
        own = [change(form, p) for p in paths]
        scales = [problem.scale(q) / bench.problem.scale(p) for p, q in zip(paths, own, strict=True)]
        problem.keep_columns(near, moves_of(own), columns * np.array(scales)[:, None, None])
