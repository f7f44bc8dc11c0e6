"""The effects of a search that hold: in halves of the record, in all of its parts, and beside one another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import compress

from identification.diagnosis.judge.result import LEANS, RARE, VARIES
from identification.diagnosis.search.attribution import Round, confirmed
from identification.diagnosis.search.constancy import steadiness
from identification.diagnosis.search.remainder import Left, what_is_left
from identification.diagnosis.search.searching import Searched
from identification.diagnosis.search.survival import Survival, survival
from identification.diagnosis.search.trials import Trial
from identification.diagnosis.search.workbench import State, Workbench


@dataclass(frozen=True, eq=False)
class Held:
    """The effects that hold.

    state: the fit with them.  searched: the rounds of the search that chose them.  rounds: the same rounds, confirmed
    beside one another.  survivals: for each, what halves of the record choose.  dropped: the effects that do not hold,
    each with the reason.  left: what is still visible in the prediction errors.
    """

    state: State
    searched: tuple[Round, ...]
    rounds: tuple[Round, ...]
    survivals: tuple[Survival, ...]
    dropped: Mapping[Trial, str]
    left: Left


def what_holds(searched: Searched, varying: bool) -> Held:
    """The effects that most halves of the record choose and whose size is constant, confirmed without the dropped ones.

    varying: keep effects whose sizes contradict each other between parts of the record; the verdict then names no
    constant effect.
    """
    bench, nominal, state, count = searched.known.bench, searched.nominal, searched.state, len(searched.candidates)
    held, survivals, dropped = list[Round](), list[Survival](), dict[Trial, str]()
    for made in searched.rounds:
        if made.chosen is None:
            continue
        found = survival(bench, made, made.before or nominal, count)
        if not found.holds:
            dropped[made.chosen] = RARE
        elif held and not varying and _varies(bench, state, made.chosen):
            dropped[made.chosen] = VARIES  # only beside a stronger effect; the verdict covers the other case
        else:
            held.append(made)
            survivals.append(found)
    if not dropped:
        return Held(state, tuple(held), tuple(held), tuple(survivals), dropped, searched.left)
    state = bench.without(state, [p for t in dropped for p in t.candidate.free if p in state.paths])
    state, rounds = confirmed(bench, nominal, state if held else nominal, held, count)
    kept = {made.chosen.candidate for made in rounds if made.chosen is not None}
    stays = [made.chosen is not None and made.chosen.candidate in kept for made in held]
    dropped |= {made.chosen: LEANS for made, stay in zip(held, stays, strict=True) if made.chosen and not stay}
    left = what_is_left(bench, state)
    return Held(state, tuple(compress(held, stays)), tuple(rounds), tuple(compress(survivals, stays)), dropped, left)


def _varies(bench: Workbench, state: State, trial: Trial) -> bool:
    """Whether parts of the record contradict each other in the size of an effect, other than from dive to dive."""
    own = [p for p in trial.candidate.free if p in state.paths and p not in bench.plant.family.by_dive]
    return bool(own) and steadiness(bench, state, own).varies
