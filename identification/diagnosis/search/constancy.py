"""Whether parameters have one size throughout a record, or another in each dive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.stats import chi2

from auv_gym.param import positions, replace_at, spec_at, value_at
from auv_gym.records.record import Record
from identification.deciding import BLOCKS, MOST_PARTS, SLIGHTLY, UNSTEADY
from identification.diagnosis.search.beside_noise import Weight, freedom_of
from identification.diagnosis.search.candidates import Candidate, screen
from identification.diagnosis.search.workbench import ITERATIONS, TRIAL_GAIN, State, Workbench
from identification.fit.changing import ChangingPlant, Course, change
from identification.fit.filtering import Point
from identification.fit.parameters import moves_of
from identification.fit.prediction_errors import PredictionErrors

_SHARES = (1.0, 0.2)  # of the step that a regression promises, from which a fit begins: far from a log it is too long


@dataclass(frozen=True)
class Steadiness:
    """The parameter in which sixths of a record contradict each other most.

    probability: of as much difference in any of those asked for, if each is the same in all parts.
    apart: of a sixth from the whole record, at the most, as a share of the size there; infinite where it is not known.
    """

    path: str
    probability: float
    apart: float = np.inf

    @property
    def varies(self) -> bool:
        """Whether it is surely not the same in all parts, and by more than little."""
        return varies(self.probability, self.apart)


def varies(probability: float, apart: float) -> bool:
    """Whether a size is surely not the same in all parts, and by more than little; see `Steadiness`."""
    return probability < UNSTEADY and apart > SLIGHTLY


@dataclass(frozen=True)
class OfDive:
    """The size that an effect has in one dive, with its 95 % interval, in the parameter's unit."""

    dive: str
    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True, eq=False)
class ByDive:
    """An effect with another size in each dive of a record; bench, state: the fit with all of these sizes."""

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
    """The parameter, of some paths, that is least surely the same in all sixths of the record.

    By a regression on changes from each sixth on; with `quietly` also with weaker accelerations: these grow to explain
    what does not fit, and then hide it.  Only where that promises a difference, it is fitted, with noises that suit it,
    and no farther than is sure enough: the probability is then an upper bound.  Of paths that are not fitted, the first
    sixth has a size of its own, too: what acts until a time is then none of the later ones.
    tried: from how many paths these were chosen; by default they are all.  level: the probability that is asked for;
    one above it takes noises for known exactly.
    """
    count = len(paths) if tried is None else tried
    rows, block = bench.problem.rows, bench.block_of_row
    first = int(not set(paths).isdisjoint(state.paths))
    begins = [int(rows[np.argmax(block >= k * BLOCKS // MOST_PARTS)]) for k in range(first, MOST_PARTS)]
    courses = {f"part{k}": Course((row,), (0.0, 1.0)) for k, row in enumerate(begins, first + 1)}
    best, chance, _, found = _changed(bench, state, paths, courses, level / count, quietly, False)
    return Steadiness(best, min(count * chance, 1.0), _apart(state, found, best, list(courses)))


def _apart(state: State, found: State | None, path: str, forms: Sequence[str]) -> float:
    """How far the sizes of a path along a record are from that of the whole, see `Steadiness`.

    found: a fit with its changes, each of which lasts from where it begins.
    """
    size = value_at(state.plant, path) - spec_at(state.plant, path).neutral
    if found is None or path not in state.paths or not size:
        return np.inf
    sizes = value_at(found.plant, path) + np.cumsum([0.0, *(value_at(found.plant, change(f, path)) for f in forms)])
    return float(np.abs(sizes - value_at(state.plant, path)).max() / abs(size))


def sizes_by_dive(bench: Workbench, state: State, path: str) -> ByDive | None:
    """The size of an effect in each dive, if the dives of the record surely contradict each other in it.

    Each dive costs a parameter, but for the first where the effect is fitted already: so much evidence for as many must
    have a chance of less than 0.1 %.
    """
    dives = dives_of(bench.record, bench.problem.rows)
    if len(dives) < 2:
        return None
    begins, fitted = [*(begin for _, begin in dives), np.iinfo(np.int64).max], path in state.paths
    courses = {
        f"dive{k + 1}": Course((begins[k], begins[k + 1]), (0.0, 1.0, 0.0)) for k in range(int(fitted), len(dives))
    }
    _, chance, by_dive, found = _changed(bench, state, [path], courses, UNSTEADY, True, True)
    if found is None or chance >= UNSTEADY:
        return None
    sizes, limits, common = [], spec_at(found.plant, path).bounds, {path: 1.0} if fitted else {}
    for k, (dive, _) in enumerate(dives, 1):
        shares = common | ({change(f"dive{k}", path): 1.0} if f"dive{k}" in courses else {})
        value, half = sum(value_at(found.plant, p) for p in shares), by_dive.half_width_of(found, shares)
        value, low, high = np.clip([value, value - half, value + half], *limits).tolist()
        sizes.append(OfDive(dive, value, (low, high)))
    return ByDive(path, tuple(sizes), by_dive, found)


def own_of_logs(bench: Workbench, state: State, path: str) -> ByDive | None:
    """The size of an effect in each log of a record, if they surely contradict each other, and the halves of none."""
    found = sizes_by_dive(bench, state, path)
    if found is None:
        return None
    rows = bench.problem.rows
    begins = [*(begin for _, begin in dives_of(bench.record, rows)), int(rows[-1]) + 1]
    halves = {
        f"half{k}": Course((int(np.median(rows[(rows >= first) & (rows < last)])), last), (0.0, 1.0, 0.0))
        for k, (first, last) in enumerate(pairwise(begins), 1)
    }
    _, chance, _, _ = _changed(found.bench, found.state, [path], halves, UNSTEADY, True, False)
    return found if chance >= UNSTEADY else None


def dives_of(record: Record, rows: np.ndarray) -> list[tuple[str, int]]:
    """The dives of a record, which are its segments of one label, each with the first of some rows that lies in it."""
    found: list[tuple[str, int]] = []
    for label, segment in zip(record.labels, record.segments, strict=True):
        own = rows[(rows >= segment.start) & (rows < segment.stop)]
        if own.size and (not found or found[-1][0] != label):
            found.append((label, int(own[0])))
    return found


def _changed(
    bench: Workbench,
    state: State,
    paths: Sequence[str],
    courses: Mapping[str, Course],
    level: float,
    quietly: bool,
    whole: bool,
) -> tuple[str, float, Workbench, State | None]:
    """The path that changes in these courses are likeliest of, the chance of as much, and bench and fit with them.

    No fit where a regression promises less than what chance has with the probability `level`.  whole: whether the fit
    goes on when its beginning is less probable than that.  Accelerations cost nothing here: of two models that may both
    have them, chance prefers neither.
    """
    problem, changing = copy(bench.problem), copy(bench)
    problem.plant = plant = ChangingPlant.of(bench.plant, {form: list(paths) for form in courses}, courses)
    problem.index = positions(plant)
    changing.plant, changing.problem = plant, problem
    here = replace_at(plant, {p: value_at(state.plant, p) for p in state.paths})
    near = replace(state.point, vector=here.vector)
    _soon(bench, problem, state, near, paths, courses)
    parts = {Candidate(p, tuple(change(form, p) for form in courses)): p for p in paths}
    bar = float(chi2.isf(level, len(courses)))
    quiet = problem.quieted(near) if quietly and problem.pushed else None
    bases = (near,) if quiet is None else (near, quiet)
    found = [(screen(problem, one, state.paths, list(parts), bar)[0], one) for one in bases]
    best, base = max(found, key=lambda f: f[0].evidence)
    path = parts[best.candidate]
    if best.evidence <= bar:
        return path, float(chi2.sf(best.evidence, len(courses))), changing, None
    free, moves = (*state.paths, *best.candidate.paths), moves_of(best.candidate.paths)
    without, tried = bench.problem.likelihood(state.point, state.paths), list[Point]()

    @cache
    def freedom() -> float:
        return freedom_of(problem, near, lambda point: problem.counted_flat(problem.columns_of(point, moves)))

    def chance(point: Point) -> float:
        weight = Weight(2.0 * (problem.likelihood(point, free) - without), np.inf, len(courses))
        return weight.chance if weight.chance >= level else replace(weight, freedom=freedom()).chance

    for share in _SHARES:
        vector = problem.moved_vector(base.vector, free, share * np.r_[best.beside, best.estimate])
        tried.append(problem.renewed(problem.point(vector, base.logs, base), state.point.logs, free))
        if chance(tried[-1]) < level:
            break
    fitted = min(tried, key=chance)
    if whole or chance(fitted) >= level:
        fitted = problem.solve(problem.plant_at(fitted, free), free, fitted, ITERATIONS, gain=TRIAL_GAIN)
    if chance(fitted) < level:  # at the noises of the rival, too, without a change
        renewed = bench.problem.renewed(state.point, fitted.logs, state.paths)
        without = max(without, bench.problem.likelihood(renewed, state.paths))
    return path, chance(fitted), changing, State(problem.plant_at(fitted, free), free, fitted)


def _soon(
    bench: Workbench,
    problem: PredictionErrors,
    state: State,
    near: Point,
    paths: Sequence[str],
    courses: Mapping[str, Course],
) -> None:
    """Slopes that are known already, and those by changes of coefficients as far as responses give them."""
    moves = moves_of(state.paths)
    problem.keep_columns(near, moves, bench.problem.columns_of(state.point, moves))
    answered = bench.problem.prepared(state.point, state.paths)
    for form, course in courses.items():
        shares = np.array([course.at(int(row)) for row in problem.rows])
        columns = bench.problem.changing_slopes(answered, paths, shares)
        if columns is None:
            return
        own = [change(form, p) for p in paths]
        scales = [problem.scale(q) / bench.problem.scale(p) for p, q in zip(paths, own, strict=True)]
        problem.keep_columns(near, moves_of(own), columns * np.array(scales)[:, None, None])
