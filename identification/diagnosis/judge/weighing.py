"""Which of the sets of effects that explain a record is reported, and which other causes are possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.plant import Plant
from identification.deciding import FEW_STATES
from identification.diagnosis.judge.common import Common, common_prediction
from identification.diagnosis.judge.effects import Effect
from identification.diagnosis.judge.holding import Held
from identification.diagnosis.search.attribution import Round, confirmed, selected
from identification.diagnosis.search.explanations import (
    STOPPED,
    Explanation,
    Explanations,
    explanation,
    explanations,
    likeliest,
    tied_rounds,
)
from identification.diagnosis.search.remainder import what_is_left
from identification.diagnosis.search.searching import Searched
from identification.diagnosis.search.survival import Survival, survival
from identification.diagnosis.search.trials import Trial
from identification.diagnosis.search.workbench import State
from identification.fit.validation import FreeRuns


@dataclass(frozen=True, eq=False)
class Weighed:
    """The effects that are reported.

    rounds: the rounds in which each was tried.  survivals: for each, what halves of the record choose.  found: all
    explanations.
    needless: whether the record is explained as well without any effect, according to a fit that started from a rival
    which turned out to be idle.
    """

    state: State
    rounds: tuple[Round, ...]
    survivals: tuple[Survival, ...]
    found: Explanations
    needless: bool = False

    @property
    def tied(self) -> tuple[Round, ...]:
        """The rounds, each with the ties that follow from the probabilities of all explanations."""
        return tied_rounds(self.found, self.rounds, self.survivals) if self.found.sets else self.rounds


def weigh(searched: Searched, held: Held, most: int) -> Weighed:
    """The likeliest set of effects that passes the gate, with ties by the probabilities of all sets.

    held: the effects of the search that hold.  most: largest number of effects in a set.
    """
    bench, nominal, count = searched.known.bench, searched.nominal, len(searched.candidates)
    state, rounds, survivals = held.state, held.rounds, held.survivals
    if not rounds or not bench.goes_on("weighed all sets of effects"):
        return Weighed(state, rounds, survivals, Explanations(()))

    def told(made: Round) -> Survival:
        return survival(bench, made, made.before or nominal, count)

    def search(near: State, beside: Sequence[Trial]) -> Round | None:
        if bench.followed > FEW_STATES or not what_is_left(bench, near):
            return None
        used = {t.candidate for t in beside}
        left = [c for c in searched.candidates if c not in used]
        return selected(bench, near, left, count, searched.kinematics.mismatches)

    def passes(other: Explanation) -> Explanation | None:
        # it is likelier than the chosen set, even if one of its effects is idle; without that effect, it is likelier
        # still
        fitted = bench.fit(other.state.plant, other.state.paths, other.state)
        after, kept = confirmed(bench, nominal, fitted, other.rounds, count)
        if not kept:
            bare.append(explanation(bench, after, ()).cost)
        if not kept or not all(told(made).holds for made in kept):
            return None
        made = explanation(bench, after, kept)
        return None if _overruled(searched, rounds, made) else made

    bare: list[float] = []  # costs of the vehicle without effects, from likelier sets whose effects all proved idle
    found = explanations(bench, state, rounds, survivals, most, search)
    reported, found = likeliest(found, rounds, passes)
    if reported.state is not state:
        rounds, survivals = reported.rounds, tuple(told(made) for made in reported.rounds)
    alone = rounds[0].chosen if len(rounds) == 1 else None
    idle = alone is not None and found.needless(alone.candidate) > 0.5
    needless = idle or min(bare, default=np.inf) < reported.cost - STOPPED
    return Weighed(reported.state, tuple(rounds), survivals, found, needless)


def rounds_told(searched: Searched, held: Sequence[Round], weighed: Weighed) -> tuple[Round, ...]:
    """The rounds of the search with their ties; if another set is reported, its rounds come first."""
    if all(a is b for a, b in zip(held, weighed.rounds, strict=False)) and len(held) == len(weighed.rounds):
        now = {id(made): tied for made, tied in zip(held, weighed.tied, strict=True)}
        return tuple(now.get(id(made), made) for made in searched.rounds)
    return (*weighed.tied, *(made for made in searched.rounds if not any(made is own for own in held)))


def _overruled(searched: Searched, rounds: Sequence[Round], other: Explanation) -> bool:
    """Whether another set lacks a chosen effect that kinematics supports: no force may replace a shown sensor error."""
    shown = {path for m in searched.kinematics.mismatches for path in (m.path, *m.tied)}
    chosen = [r.chosen.candidate for r in rounds if r.chosen is not None]
    return any(not shown.isdisjoint(c.paths) and c not in other.candidates for c in chosen)


def common_predictions(
    effects: Sequence[Effect],
    groups: Sequence[tuple[str, ...]],
    found: Explanations,
    state: State,
    fly: Callable[[Plant], FreeRuns | None],
) -> tuple[Common, ...]:
    """The common prediction of each tie, using for each member the likeliest set that includes it.

    groups: paths, a named effect first.  state: the reported one.  fly: see `common_prediction`.
    """
    named, told = {e.path: e for e in effects}, []
    for group in groups:
        effect = named[group[0]]
        sets = [(m, found.best_with(m.path)) for m in effect.members]
        members = [(m.path, m.probability, made.state.plant) for m, made in sets if made is not None]
        if members:
            told.append(common_prediction([(effect.path, effect.probability or 0.0, state.plant), *members], fly))
    return tuple(told)
