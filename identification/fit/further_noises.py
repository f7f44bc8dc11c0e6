"""Noises that only what a fit leaves can show: a swell, and errors of readings that last.

Accelerations that merely fade and white errors of sensors cannot tell all of a sea: waves have a period, a compass
wanders, and a pressure sensor in waves does not read by how much the boat rises.  Errors that keep a colour make
effects that imitate it, and differences between parts of a record, look more certain than they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from auv_gym.plant import Plant
from auv_gym.threads import side_by_side
from identification.deciding import COST, LEAST_OF_SWELL, MOST_SWELLS
from identification.fit.coloured import coloured_channels
from identification.fit.followed import Point
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.swell import period_of_swell

Added = tuple[Sequence[int], Sequence[int], float]  # as `Stretches.with_noises` takes them


@dataclass(frozen=True, eq=False)
class Noisier:
    """A problem with noises that were added, and the fitted point of it."""

    added: Added
    problem: PredictionErrors
    point: Point


def further_noises(
    problem: PredictionErrors, plant: Plant, paths: Sequence[str], point: Point, waves_alone: bool = False
) -> list[Noisier]:
    """The noises that make a fitted point likelier, one kind after the other; see `_kinds`.

    None for a vehicle of one velocity, unless internal waves carry it (`Family.carried`): nothing tells an error that
    lasts from what moves it.  A swell's period is one parameter more, and costs as much as an acceleration does.
    plant: of the point, which was fitted over the paths.  waves_alone: a swell that pushes, and no errors of sensors;
    nothing where errors keep a period beside it, as those of a sensor do that swings while nothing else moves.
    """
    found: list[Noisier] = []
    while _waved(problem) and (kinds := _kinds(problem, point, paths, waves_alone)):
        likeliest, most = None, 0.0
        for kind, other in zip(kinds, side_by_side(partial(_pruned, problem, plant, paths, point), kinds), strict=True):
            gain = 0.0 if other is None else _gain(problem, point, other, paths) - COST * (kind[2] > 0.0)
            if other is not None and gain > most:
                likeliest, most = other, gain
        if likeliest is None:
            break
        found.append(likeliest)
        problem, point = likeliest.problem, likeliest.point
        plant = problem.plant_at(point, paths) if paths else plant
    return [] if waves_alone and found and period_of_swell(problem, point) else found


def begun_beside(problem: PredictionErrors, point: Point, paths: Sequence[str]) -> Point:
    """A point of the problem without its last noises, with noises that suit it, all else held."""
    near = problem.begun_with(point)
    return problem.renewed(near, near.logs, paths)


def _kinds(problem: PredictionErrors, point: Point, paths: Sequence[str], waves_alone: bool) -> list[Added]:
    """The noises that the errors of a point may be due to.

    Where errors have a period, a swell that pushes two velocities or more, or that sensors misread; where those of a
    channel are coloured, errors of its readings that last.  Of a vehicle that they carry, internal waves.
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
    """Which accelerations, or drifts of what internal waves carry, further noises may come beside."""
    if problem.plant.family.carried:
        return np.flatnonzero(~problem.further).tolist()
    return problem.velocities if len(problem.velocities) >= _least(problem) else []


def _least(problem: PredictionErrors) -> int:
    """How many velocities waves push at the least: a loop that swings may look like waves that push one."""
    return 1 if problem.plant.family.carried else LEAST_OF_SWELL


def _internal_waves(problem: PredictionErrors, point: Point, paths: Sequence[str]) -> list[Added]:
    """Waves of the likeliest period, all else held, beside random drifts without waves.

    Their spectrum is broad, so that errors beside these show no peak, and need not be coloured.
    """
    if problem.periods.any() or not problem.is_pushed(point):
        return []
    kinds: list[Added] = [(_waved(problem), (), period) for period in problem.periods_of_internal_waves]

    def likely(kind: Added) -> float:
        other = problem.with_noises(*kind)
        return other.objective(begun_beside(other, point, paths), paths)

    return [kinds[int(np.argmax(side_by_side(likely, kinds)))]] if kinds else []


def _pruned(
    problem: PredictionErrors, plant: Plant, paths: Sequence[str], point: Point, added: Added
) -> Noisier | None:
    """A problem with those of some noises that come to something beside a point; None where none does."""
    other = problem.with_noises(*added)
    near = Noisier(added, other, begun_beside(other, point, paths))
    if not _gain(problem, point, near, paths) > 0.0:  # with all else held
        return None
    there = Noisier(added, other, other.solve(plant, paths, near.point))
    pushing, misread = _told(there)
    velocities, readings, period = added
    if not (pushing or misread) or (velocities and len(pushing) < _least(problem)):
        return None
    if len(misread) < len(readings):
        return _pruned(problem, plant, paths, point, (pushing, misread, period))
    return there


def _told(there: Noisier) -> tuple[list[int], list[int]]:
    """Those of the noises that were added which have a part in the point: velocities, and channels."""
    velocities, readings, period = there.added
    problem, noise = there.problem, there.problem.noise_at(there.point)
    pushing = [d for d in velocities if problem.pushed[d] in noise.told(False, period)]
    return pushing, [c for c in readings if problem.channels[c] in noise.told(True, period)]


def _gain(problem: PredictionErrors, point: Point, there: Noisier, paths: Sequence[str]) -> float:
    """By how much the log-likelihood with noises that were added is greater than that of a point without."""
    return there.problem.objective(there.point, paths) - problem.objective(point, paths)
