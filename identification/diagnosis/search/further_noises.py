"""Noises that only what a search leaves can show: a swell, and errors of readings that last.

Accelerations that merely fade and white errors of sensors cannot tell all of a sea: waves have a period, a compass
wanders, and a pressure sensor in waves does not read by how much the boat rises.  Errors that keep a colour make
effects that imitate it, and differences between parts of a record, look more certain than they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from auv_gym.threads import side_by_side
from identification.deciding import COST, LEAST_OF_SWELL, MOST_SWELLS
from identification.diagnosis.search.remainder import coloured_channels
from identification.diagnosis.search.swell import period_of_swell
from identification.diagnosis.search.workbench import State, Workbench

_Added = tuple[Sequence[int], Sequence[int], float]  # as `Stretches.with_noises` takes them


def with_further_noises(
    bench: Workbench, states: Sequence[State], waves_alone: bool = False
) -> tuple[Workbench, list[State]]:
    """A bench with the noises that make the first of some states likelier, one kind at a time, and all of them on it.

    Where errors have a period, a swell that pushes two velocities or more, or that sensors misread; where those of a
    channel are coloured, errors of its readings that last.  The same bench, and the states as they are, where none is
    likelier, and for a vehicle of one velocity: nothing tells there an error that lasts from what moves the vehicle.
    A swell's period is one parameter more, and costs as much as an acceleration does.
    waves_alone: a swell that pushes, and no errors of sensors.
    """
    found = list(states)
    while len(bench.problem.velocities) >= LEAST_OF_SWELL and (kinds := _kinds(bench, found[0], waves_alone)):
        likeliest, most = None, 0.0
        for kind, other in zip(kinds, side_by_side(partial(_pruned, bench, found[0]), kinds), strict=True):
            gain = 0.0 if other is None else _gain(bench, found[0], *other) - COST * (kind[2] > 0.0)
            if other is not None and gain > most:
                likeliest, most = other, gain
        if likeliest is None:
            break
        bench, first = likeliest
        found = [first, *side_by_side(partial(_fitted, bench), found[1:])]
    return bench, found


def _kinds(bench: Workbench, state: State, waves_alone: bool) -> list[_Added]:
    """The noises that the errors of a state may be due to."""
    problem, kinds = bench.problem, list[_Added]()
    coloured = [problem.channels.index(name) for name in coloured_channels(bench, state)]
    if np.unique(problem.periods).size <= MOST_SWELLS and (period := period_of_swell(problem, state.point)):
        kinds += [(problem.velocities, (), period), *([((), coloured, period)] if coloured else [])]
    if waves_alone:
        return kinds[:1]
    known = {problem.pushed[d] for d in np.flatnonzero(problem.misread & ~problem.swells)}
    lasting = [c for c in coloured if problem.channels[c] not in known]
    return [*kinds, ((), lasting, 0.0)] if lasting else kinds


def _pruned(bench: Workbench, state: State, added: _Added) -> tuple[Workbench, State] | None:
    """A bench with those of some noises that come to something beside a state, and the state; None where none does."""
    other = bench.with_noises(*added)
    near = _begun(other, state)
    if not _gain(bench, state, other, near) > 0.0:  # with all else held
        return None
    there = other.fit(state.plant, state.paths, near)
    pushing, misread = _told(other, there, added)
    velocities, readings, period = added
    if not (pushing or misread) or (velocities and len(pushing) < LEAST_OF_SWELL):
        return None
    if len(misread) < len(readings):
        return _pruned(bench, state, (pushing, misread, period))
    return other, there


def _told(bench: Workbench, state: State, added: _Added) -> tuple[list[int], list[int]]:
    """Those of the noises that were added last which have a part in a state: velocities, and channels."""
    velocities, readings, period = added
    problem, noise = bench.problem, bench.problem.noise_at(state.point)
    pushing = [d for d in velocities if problem.pushed[d] in noise.told(False, period)]
    return pushing, [c for c in readings if problem.channels[c] in noise.told(True, period)]


def _gain(bench: Workbench, state: State, other: Workbench, there: State) -> float:
    """By how much the log-likelihood of a state on another bench is greater."""
    return other.problem.objective(there.point, there.paths) - bench.problem.objective(state.point, state.paths)


def _begun(bench: Workbench, state: State) -> State:
    """A state of the bench without its last noises, with noises that suit it, all else held."""
    problem, near = bench.problem, bench.problem.begun_with(state.point)
    return State(state.plant, state.paths, problem.renewed(near, near.logs, state.paths))


def _fitted(bench: Workbench, state: State) -> State:
    """The same, fitted with them."""
    return bench.fit(state.plant, state.paths, _begun(bench, state))
