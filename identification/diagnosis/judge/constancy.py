"""Whether an effect has one size throughout a record."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from auv_gym.param import positions, replace_at, value_at
from identification.deciding import BLOCKS, MOST_PARTS, UNSTEADY
from identification.diagnosis.search.candidates import Candidate, screen
from identification.diagnosis.search.workbench import ITERATIONS, TRIAL_GAIN, State, Workbench
from identification.fit.changing import ChangingPlant, Course, change


def steadiness(bench: Workbench, state: State, path: str) -> float:
    """Probability of as much difference between sixths of the record in an effect's size, if it is the same in all.

    By a regression on changes from each sixth on, also with weaker accelerations: these grow to explain what does not
    fit, and then hide it.  Only where that promises a difference, it is fitted, with the noises that suit it.
    """
    rows, block = bench.problem.rows, bench.block_of_row
    begins = [int(rows[np.argmax(block >= k * BLOCKS // MOST_PARTS)]) for k in range(1, MOST_PARTS)]
    courses = {f"part{k}": Course((row,), (0.0, 1.0)) for k, row in enumerate(begins, 2)}
    problem = copy(bench.problem)
    problem.plant = plant = ChangingPlant.of(bench.plant, {form: [path] for form in courses}, courses)
    problem.index = positions(plant)
    here = replace_at(plant, {p: value_at(state.plant, p) for p in state.paths})
    near = replace(state.point, vector=here.vector)
    parts = Candidate("", tuple(change(form, path) for form in courses))
    bar, paths = float(chi2.isf(UNSTEADY, len(courses))), (*state.paths, *parts.paths)
    bases = (near, problem.quieted(near)) if problem.pushed else (near,)
    found = [(screen(problem, base, state.paths, [parts], bar)[0], base) for base in bases]
    best, base = max(found, key=lambda f: f[0].evidence)
    if not best.evidence > bar:
        return float(chi2.sf(max(best.evidence, 0.0), len(courses)))
    vector = problem.moved_vector(base.vector, paths, np.r_[best.beside, best.estimate])
    begun = problem.renewed(problem.point(vector, base.logs, base), state.point.logs, paths)
    fitted = problem.solve(problem.plant_at(begun, paths), paths, begun, ITERATIONS, gain=TRIAL_GAIN)
    gain = 2.0 * (problem.objective(fitted, paths) - bench.problem.objective(state.point, state.paths))
    return float(chi2.sf(max(gain, 0.0), len(courses)))
