"""Robustness of a choice to the data: whether parts of the record alone would lead to the same choice.

Every fitted candidate is refitted to the parts, to second order about its fit, so that hundreds of choices need no run
of the vehicle.
Source: stability selection by complementary halves, Shah and Samworth 2013, J. R. Stat. Soc. B 75.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from identification.deciding import MAJORITY, RIVAL, SEEN_BY_HALF, TIE
from identification.diagnosis.search.acceptance import DIVERGES, LIMITED
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.trials import Trial
from identification.diagnosis.search.workbench import State, Workbench


@dataclass(frozen=True, eq=False)
class Survival:
    """The choices of halves of a record in a round, given the effects of the rounds before.

    frequency: share of the halves that choose the round's effect, or one tied with it.
    instead: share of the halves that choose another effect, by its first path.
    """

    frequency: float
    instead: dict[str, float]

    @property
    def holds(self) -> bool:
        """Whether most halves choose an effect, be it another one."""
        return self.frequency + sum(self.instead.values()) > MAJORITY

    @property
    def rivals(self) -> tuple[str, ...]:
        """The effects that are chosen instead so often that the record cannot decide."""
        return tuple(path for path, share in self.instead.items() if share >= RIVAL)


def halves_of(parts: Sequence[object]) -> list[np.ndarray]:
    """All halves of a record's parts, each as a mask of its parts, (K,) bool."""
    number = len(parts)
    return [np.isin(np.arange(number), part) for part in combinations(range(number), max(number // 2, 1))]


def survival(bench: Workbench, made: Round, before: State, count: int) -> Survival:
    """The choices of all halves of the parts in a round whose trials were fitted beside a state.

    count: number of all candidates, for the threshold.
    """
    halves = halves_of(bench.parts)
    found, instead = 0, dict[str, float]()
    for half in halves:
        best = preferred(bench, made, before, count, half)
        if best is made.chosen:
            found += 1
        elif best is not None:
            path = best.candidate.paths[0]
            instead[path] = instead.get(path, 0.0) + 1.0 / len(halves)
    return Survival(found / len(halves), instead)


def preferred(bench: Workbench, made: Round, before: State, count: int, counted: np.ndarray) -> Trial | None:
    """The trial of a round that some parts, (K,) bool, would choose; None if no effect is detectable in them.

    This is the round's choice unless a trial leads it, and those tied with it, by more than the parts' share of `TIE`:
    parts that distinguish two effects less well than the whole record do not contradict it.
    """
    tried = [t for t in made.trials if t.state is not None and t.objection not in (DIVERGES, LIMITED)]
    if not tried:
        return None
    share, start = float(np.mean(counted)), bench.by_part(before, soon=True).refitted(counted)[1]
    gains = [2.0 * (bench.by_part(_state(t), soon=True).refitted(counted)[1] - start) - t.price for t in tried]
    best = int(np.argmax(gains))
    if gains[best] < SEEN_BY_HALF * share * threshold(count, len(tried[best].candidate.free)):
        return None
    own = max((g for g, t in zip(gains, tried, strict=True) if t is made.chosen or t in made.tied), default=-np.inf)
    return made.chosen if gains[best] - own <= share * TIE else tried[best]


def chosen_without(
    bench: Workbench, nominal: State, state: State, rounds: Sequence[Round], count: int, part: int
) -> State:
    """The state that would have been chosen without a part of the record.

    This is `state` if the other parts agree in all rounds; otherwise it is their choice in the first round in which
    they differ, or the state before that round if they choose nothing.
    """
    counted = np.arange(len(bench.parts)) != part
    reached = nominal
    for made in rounds:
        if made.chosen is None:
            continue
        before = made.before or reached
        best = preferred(bench, made, before, count, counted)
        if best is not made.chosen:
            return before if best is None else _state(best)
        assert best is not None
        reached = _state(best)
    return state


def _state(trial: Trial) -> State:
    assert trial.state is not None
    return trial.state
