"""A bench, and the states of a search, with the noises that only the residuals of the search can show."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from auv_gym.threads import side_by_side
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.further_noises import begun_beside, further_noises


def with_further_noises(
    bench: Workbench, states: Sequence[State], waves_alone: bool = False
) -> tuple[Workbench, list[State]]:
    """A bench with the noises that make the first of some states likelier, and all of the states on it.

    The bench and the states are unchanged if no noise is likelier.  waves_alone: see `further_noises`.
    """
    first, *others = states
    found = further_noises(bench.problem, first.plant, first.paths, first.point, waves_alone)
    if not found:
        return bench, list(states)
    for one in found:
        bench = bench.with_noises(*one.added)
        others = side_by_side(partial(_begun, bench), others)
    point = found[-1].point
    plant = bench.problem.plant_at(point, first.paths) if first.paths else first.plant
    others = side_by_side(lambda state: bench.fit(state.plant, state.paths, state), others)
    return bench, [State(plant, first.paths, point), *others]


def _begun(bench: Workbench, state: State) -> State:
    """A state of the bench, from one without its last noises: noises fitted, all else held."""
    return State(state.plant, state.paths, begun_beside(bench.problem, state.point, state.paths))
