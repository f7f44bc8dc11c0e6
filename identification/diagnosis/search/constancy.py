"""Whether parameters have one size throughout a record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from auv_gym.param import positions, replace_at, value_at
from identification.deciding import BLOCKS, MOST_PARTS, UNSTEADY
from identification.diagnosis.search.candidates import Candidate, screen
from identification.diagnosis.search.workbench import ITERATIONS, TRIAL_GAIN, State, Workbench
from identification.fit.changing import ChangingPlant, Course, change
from identification.fit.filtering import Point
from identification.fit.parameters import moves_of
from identification.fit.prediction_errors import PredictionErrors


@dataclass(frozen=True)
class Steadiness:
    """The parameter in which sixths of a record contradict each other most.

    probability: of as much difference in any of those asked for, if each is the same in all parts.
    """

    path: str
    probability: float


def steadiness(bench: Workbench, state: State, paths: Sequence[str], quietly: bool = True) -> Steadiness:
    """The parameter, of those of a state, that is least surely the same in all sixths of the record.

    By a regression on changes from each sixth on; with `quietly` also with weaker accelerations: these grow to explain
    what does not fit, and then hide it.  Only where that promises a difference, it is fitted, with noises that suit it.
    """
    rows, block = bench.problem.rows, bench.block_of_row
    begins = [int(rows[np.argmax(block >= k * BLOCKS // MOST_PARTS)]) for k in range(1, MOST_PARTS)]
    courses = {f"part{k}": Course((row,), (0.0, 1.0)) for k, row in enumerate(begins, 2)}
    problem = copy(bench.problem)
    problem.plant = plant = ChangingPlant.of(bench.plant, {form: list(paths) for form in courses}, courses)
    problem.index = positions(plant)
    here = replace_at(plant, {p: value_at(state.plant, p) for p in state.paths})
    near = replace(state.point, vector=here.vector)
    _soon(bench, problem, state, near, paths, courses)
    parts = {Candidate(p, tuple(change(form, p) for form in courses)): p for p in paths}
    bar, count = float(chi2.isf(UNSTEADY / len(paths), len(courses))), len(courses)
    bases = (near, problem.quieted(near)) if quietly and problem.pushed else (near,)
    found = [(screen(problem, base, state.paths, list(parts), bar)[0], base) for base in bases]
    best, base = max(found, key=lambda f: f[0].evidence)
    evidence = best.evidence
    if evidence > bar:
        free = (*state.paths, *best.candidate.paths)
        vector = problem.moved_vector(base.vector, free, np.r_[best.beside, best.estimate])
        begun = problem.renewed(problem.point(vector, base.logs, base), state.point.logs, free)
        fitted = problem.solve(problem.plant_at(begun, free), free, begun, ITERATIONS, gain=TRIAL_GAIN)
        evidence = 2.0 * (problem.objective(fitted, free) - bench.problem.objective(state.point, state.paths))
    chance = len(paths) * float(chi2.sf(max(evidence, 0.0), count))
    return Steadiness(parts[best.candidate], min(chance, 1.0))


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
        row = int(np.searchsorted(problem.rows, course.edges[0]))
        columns = bench.problem.slopes_from(answered, paths, row)
        if columns is None:
            return
        own = [change(form, p) for p in paths]
        scales = [problem.scale(q) / bench.problem.scale(p) for p, q in zip(paths, own, strict=True)]
        problem.keep_columns(near, moves_of(own), columns * np.array(scales)[:, None, None])
