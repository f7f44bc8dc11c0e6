"""A bench with the noises that only what a search leaves can show, and its states beside them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from auv_gym.threads import side_by_side
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.further_noises import begun_beside, further_noises


def with_further_noises(
    bench: Workbench, states: Sequence[State], waves_alone: bool = False
) -> tuple[Workbench, list[State]]:
    """A bench with the noises that make the first of some states likelier, and all of them on it.

    The same bench, and the states as they are, where none is likelier.  waves_alone: see `further_noises`.
    """
    first, *others = states
    for one in further_noises(bench.problem, first.plant, first.paths, first.point, waves_alone):
        bench = bench.with_noises(*one.added)
        plant = bench.problem.plant_at(one.point, first.paths) if first.paths else first.plant
        first = State(plant, first.paths, one.point)
        others = side_by_side(partial(_fitted, bench), others)
    return bench, [first, *others]


def _fitted(bench: Workbench, state: State) -> State:
    """A state of the bench without its last noises, fitted with them."""
    point = begun_beside(bench.problem, state.point, state.paths)
    return bench.fit(state.plant, state.paths, State(state.plant, state.paths, point))
