"""The beginning of a candidate's fit: its first values, a few steps from there, and what these promise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from auv_gym.param import replace_at, spec_at
from auv_gym.plant import Plant
from identification.diagnosis.search.candidates import Screening
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.parameters import kinked

FIRST_ITERATIONS = 2  # steps for each candidate of the short list


@dataclass(frozen=True, eq=False)
class Begun:
    """A candidate's state after a few steps.

    promise: the evidence for it there, twice the gain in log-likelihood.  quiet: whether it was begun beside less
    process noise than suits the vehicle without it.
    """

    screening: Screening
    state: State
    promise: float
    quiet: bool = False


def rival_of(bench: Workbench, state: State, base: State) -> State:
    """The state without a candidate that a fit of the candidate from a base is compared with.

    It is the state itself, unless the base has other coefficients.  Then it is the likelier of the base after as many
    steps of the parameters fitted so far, which gain much by themselves, and of the state with the base's noises.
    """
    if base is state or base.quiet:
        return state
    problem, paths = bench.problem, state.paths
    point = problem.descended(base.point, paths, FIRST_ITERATIONS)
    there = State(problem.plant_at(point, paths), paths, point)
    here = replace(state, point=problem.point(state.point.vector, base.point.logs, state.point))
    return max((there, here), key=lambda one: problem.objective(one.point, paths))


def begun_from(bench: Workbench, state: State, base: State, screening: Screening, rival: State) -> Begun:
    """The candidate's state after a few steps from its likeliest first values, with the gains of the base.

    rival: the state without the candidate, against which its promise is computed; see `rival_of`.
    """
    problem, candidate = bench.problem, screening.candidate
    paths = (*state.paths, *candidate.free)
    setting = {candidate.setting: screening.setting} if candidate.setting else {}
    vectors = [
        replace_at(base.plant, dict(zip(candidate.paths, values, strict=True)) | setting).vector
        for values in _first_values(base.plant, screening)
    ]
    points = [problem.with_gains(base.point, vector) for vector in vectors]
    if screening.beside.size:  # if its signature is largely imitated, fitted parameters and initial states move too
        moved = replace_at(base.plant, setting).vector
        step = np.r_[screening.beside, screening.estimate]
        vector = problem.moved_vector(moved, (*state.paths, *candidate.paths), step)
        points.append(problem.descended(problem.with_gains(base.point, vector), ()))
    finite = [p for p in points if np.isfinite(p.scores).all()]  # `max` would keep NaN against all later points
    best = max(finite or points[:1], key=lambda p: problem.objective(p, paths))
    point = problem.descended(best, paths, FIRST_ITERATIONS)
    if base.quiet and np.isfinite(point.scores).all():  # the rival has the noises that suit it, and none is missing
        point = problem.renewed(point, rival.point.logs, paths, missing=False)
    first = State(problem.plant_at(point, paths), paths, point)
    return Begun(screening, first, bench.gain(rival, first) if first.finite else -np.inf, base.quiet)


def misjudged(bench: Workbench, base: State) -> float:
    """The factor by which evidence is too large beside a state whose errors are larger than its noises; else 1."""
    if base.suited:
        return 1.0
    squares = float((base.point.errors**2).sum())
    return max(squares / max(bench.problem.count, 1), 1.0)


def _first_values(plant: Plant, screening: Screening) -> list[tuple[float, ...]]:
    """First values for a candidate's fit, one tuple for each start.

    They are one probe off neutral on the side of the screening's estimate, and the estimate itself (1 to 12 probes).
    A single parameter also starts on the other side, since coefficients that were fitted without the effect may turn
    the sign of the estimate, and a fit would stay there.  One with a corner starts five probes further instead.
    In a long record, a probe may be far too large: an estimate below one probe is then another start, except for
    corners, next to which slopes hold no information.  For an effect with jumps, the estimate is the only start.
    """
    if screening.candidate.jumps:
        spec = spec_at(plant, screening.candidate.paths[0])
        return [(float(np.clip(spec.neutral + screening.estimate[0] * spec.probe, *spec.bounds)),)]
    starts = []
    for far in (False, True):
        values = []
        for path, estimate in zip(screening.candidate.paths, screening.estimate, strict=True):
            spec = spec_at(plant, path)
            side = 1.0 if estimate >= 0.0 or spec.bounds[0] >= spec.neutral or kinked(path) else -1.0
            size = np.clip(abs(estimate), 1.0, 12.0) if far else 1.0
            values.append(float(np.clip(spec.neutral + side * size * spec.probe, *spec.bounds)))
        starts.append(tuple(values))
    if screening.candidate.kinked:
        starts.append(
            tuple(
                min(v + 5.0 * spec_at(plant, p).probe, spec_at(plant, p).bounds[1])
                for p, v in zip(screening.candidate.paths, starts[0], strict=True)
            )
        )
    elif len(screening.candidate.paths) == 1:
        spec = spec_at(plant, screening.candidate.paths[0])
        opposite = float(np.clip(2.0 * spec.neutral - starts[0][0], *spec.bounds))
        starts += [(opposite,)] * (opposite != spec.neutral)
    small = np.abs(screening.estimate).max() < 1.0
    if small and not any(kinked(p) for p in screening.candidate.paths):
        specs = [spec_at(plant, path) for path in screening.candidate.paths]
        estimated = zip(specs, screening.estimate, strict=True)
        starts.append(tuple(float(np.clip(s.neutral + e * s.probe, *s.bounds)) for s, e in estimated))
    return list(dict.fromkeys(starts))
