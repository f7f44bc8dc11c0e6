"""Noises that only the residuals of a fit can show: a swell, and lasting sensor errors.

Accelerations that merely decay and white sensor errors cannot describe a sea: waves have a period, a compass wanders,
and a pressure sensor in waves does not show the full heave of the boat.  If the errors stay coloured, effects that
imitate them, and differences between parts of a record, look more certain than they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from auv_gym.plant import Plant
from auv_gym.threads import side_by_side
from identification.deciding import COST, LEAST_OF_SWELL, MOST_SWELLS
from identification.fit.coloured import coloured_channels
from identification.fit.followed import Point
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.swell import period_of_swell

Added = tuple[Sequence[int], Sequence[int], float]  # arguments of `Stretches.with_noises`


@dataclass(frozen=True, eq=False)
class Noisier:
    """A problem with added noises, and its fitted point."""

    added: Added
    problem: PredictionErrors
    point: Point


def further_noises(
    problem: PredictionErrors, plant: Plant, paths: Sequence[str], point: Point, waves_alone: bool = False
) -> list[Noisier]:
    """The noises that make a fitted point likelier, one kind after the other; see `_kinds`.

    Empty for a vehicle of one velocity, unless internal waves carry it (`Family.carried`): a lasting sensor error could
    not be told from the vehicle's motion.  A swell's period is one more parameter, and costs as much as an
    acceleration.
    plant: of the point, which was fitted over the paths.  waves_alone: only a swell that pushes, no sensor errors;
    empty if the errors remain periodic beside it, as those of an oscillating sensor do.
    """
    found: list[Noisier] = []
    while _waved(problem) and (kinds := _kinds(problem, point, paths, waves_alone)):
        likeliest, most = None, 0.0
        for kind, other in zip(kinds, side_by_side(partial(_pruned, problem, paths, point), kinds), strict=True):
            gain = 0.0 if other is None else _gain(problem, point, other, paths) - COST * (kind[2] > 0.0)
            if other is not None and gain > most:
                likeliest, most = other, gain
        if likeliest is None:
            break
        found.append(likeliest)
        problem, point = likeliest.problem, likeliest.point
    if not found or (waves_alone and period_of_swell(problem, point)):
        return []
    found[-1] = replace(found[-1], point=problem.solve(plant, paths, point))  # what was compared held all else
    return found


def begun_beside(problem: PredictionErrors, point: Point, paths: Sequence[str]) -> Point:
    """A point of the problem, from one without the problem's last noises: noises fitted, all else held."""
    near = problem.begun_with(point)
    return problem.renewed(near, near.logs, paths)


def _kinds(problem: PredictionErrors, point: Point, paths: Sequence[str], waves_alone: bool) -> list[Added]:
    """The noises that may explain the errors of a point.

    If errors are periodic, a swell that pushes two velocities or more, or one that sensors misread; if those of a
    channel are coloured, lasting sensor errors.  For a vehicle carried by internal waves, these waves.
    """
    if problem.plant.family.carried:
        return [] if waves_alone else _internal_waves(problem, point, paths)
    period = period_of_swell(problem, point) if np.unique(problem.periods).size <= MOST_SWELLS else None
    kinds: list[Added] = [(problem.velocities, (), period)] if period else []
    if waves_alone:
        return kinds
    coloured = [problem.channels.index(name) for name in coloured_channels(problem, point)]
    if period and coloured:
        kinds.append(((), coloured, period))
    known = {problem.pushed[d] for d in np.flatnonzero(problem.misread & ~problem.swells)}
    lasting = [c for c in coloured if problem.channels[c] not in known]
    return [*kinds, ((), lasting, 0.0)] if lasting else kinds


def _waved(problem: PredictionErrors) -> list[int]:
    """The accelerations, or the drifts carried by internal waves, to which further noises may be added."""
    if problem.plant.family.carried:
        return np.flatnonzero(~problem.further).tolist()
    return problem.velocities if len(problem.velocities) >= _least(problem) else []


def _least(problem: PredictionErrors) -> int:
    """The least number of velocities that waves push: an oscillating loop may look like waves that push one."""
    return 1 if problem.plant.family.carried else LEAST_OF_SWELL


def _internal_waves(problem: PredictionErrors, point: Point, paths: Sequence[str]) -> list[Added]:
    """Internal waves of the likeliest period, all else held, if the point has random drifts and no waves yet.

    Their spectrum is broad, so the errors without them show no peak, and need not be coloured.
    """
    if problem.periods.any() or not problem.is_pushed(point):
        return []
    kinds: list[Added] = [(_waved(problem), (), period) for period in problem.periods_of_internal_waves]

    def likely(kind: Added) -> float:
        other = problem.with_noises(*kind)
        return other.objective(begun_beside(other, point, paths), paths)

    return [kinds[int(np.argmax(side_by_side(likely, kinds)))]] if kinds else []


def _pruned(problem: PredictionErrors, paths: Sequence[str], point: Point, added: Added) -> Noisier | None:
    """The problem with those of the added noises that are present, and its point, all else held; None if none is."""
    other = problem.with_noises(*added)
    there = Noisier(added, other, other.stilled(begun_beside(other, point, paths), paths))
    pushing, misread = _told(there)
    velocities, readings, period = added
    if not (pushing or misread) or (velocities and len(pushing) < _least(problem)):
        return None
    if len(misread) < len(readings):
        return _pruned(problem, paths, point, (pushing, misread, period))
    return there


def _told(there: Noisier) -> tuple[list[int], list[int]]:
    """The added noises that are present in the point: velocities, and channels."""
    velocities, readings, period = there.added
    problem, noise = there.problem, there.problem.noise_at(there.point)
    pushing = [d for d in velocities if problem.pushed[d] in noise.told(False, period)]
    return pushing, [c for c in readings if problem.channels[c] in noise.told(True, period)]


def _gain(problem: PredictionErrors, point: Point, there: Noisier, paths: Sequence[str]) -> float:
    """The gain in the objective from the added noises, over a point without them."""
    return there.problem.objective(there.point, paths) - problem.objective(point, paths)
