"""The reported effects: their sizes, their ties, and what they leave unexplained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from identification.diagnosis.judge.effects import Effect
from identification.diagnosis.judge.explained import unsteady_of
from identification.diagnosis.judge.holding import Held
from identification.diagnosis.judge.result import NEEDLESS, VARIES, WORSE
from identification.diagnosis.judge.sizes import Sizes, effects_of
from identification.diagnosis.judge.weighing import Weighed, rounds_told
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.constancy import ByDive, sizes_by_dive
from identification.diagnosis.search.explanations import Explanations
from identification.diagnosis.search.remainder import Left, what_is_left
from identification.diagnosis.search.searching import Searched
from identification.diagnosis.search.workbench import State
from identification.fit.changing import ChangingPlant


@dataclass(frozen=True, eq=False)
class Reported:
    """The reported effects and the numbers that go into the report.

    weighed: the set of effects, and all other sets that explain the record.  told: the rounds of the search, with ties.
    sizes: of all fitted parameters, by path.  effects, tied: see `effects_of`.  dives: the effect whose size differs
    between dives, if there is one.  left: what is still visible in the prediction errors.  dropped: paths of effects
    that are not reported, each with the reason.
    """

    weighed: Weighed
    told: tuple[Round, ...]
    sizes: Sizes
    effects: tuple[Effect, ...]
    tied: tuple[tuple[str, ...], ...]
    dives: ByDive | None
    left: Left
    dropped: Mapping[str, str]

    @property
    def state(self) -> State:
        """The fit with the effects."""
        return self.weighed.state


def reported(searched: Searched, held: Held, weighed: Weighed) -> Reported:
    """The effects of the reported set, with their sizes; held: the effects of the search that hold."""
    bench, state, count = searched.known.bench, weighed.state, len(searched.candidates)
    left = held.left if state is held.state else what_is_left(bench, state)
    # a plant with effects by log already has a path for each
    by_dive = () if isinstance(bench.plant, ChangingPlant) else bench.plant.family.by_dive
    differing = [d for d in (sizes_by_dive(bench, state, p) for p in by_dive) if d is not None]
    dives = next((d for d in differing if d.path in state.paths), None)
    if dives is not None:
        left = what_is_left(dives.bench, dives.state)
    elif differing:  # the search did not find this effect, since its mean does little
        left = replace(left, changes=left.changes or differing[0].path)
    sizes = bench.intervals(state)
    effects, tied = effects_of(bench, state, weighed.tied, sizes, weighed.survivals, count, weighed.found)
    if dives is not None:
        effects = [replace(e, by_dive=dives.sizes) if e.path == dives.path else e for e in effects]
    dropped = {trial.candidate.paths[0]: reason for trial, reason in held.dropped.items()}
    varying = [e.path for e in unsteady_of(effects)] + [path for path, why in dropped.items() if why == VARIES]
    if varying and not left.changes:
        left = replace(left, changes=varying[0])
    told = rounds_told(searched, held.searched, weighed)
    return Reported(weighed, told, sizes, tuple(effects), tuple(tied), dives, left, dropped)


def withdrawn(searched: Searched, one: Reported) -> Reported:
    """The result without its effects: with them, free runs over unseen parts of the record are worse, or no better."""
    bench, nominal = searched.known.bench, searched.nominal
    why = NEEDLESS if one.weighed.needless else WORSE
    worse = {r.chosen.candidate.paths[0]: why for r in one.weighed.rounds if r.chosen is not None}
    weighed = Weighed(nominal, (), (), Explanations(()))
    return replace(
        one,
        weighed=weighed,
        told=rounds_told(searched, (), weighed),
        sizes=bench.intervals(nominal),
        effects=(),
        tied=(),
        left=what_is_left(bench, nominal) or one.left,
        dropped={**one.dropped, **worse},
    )
