"""Second thoughts on a forward selection that leaves something: pairs that work only together, and swaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from identification.diagnosis.log.kinematics import Mismatch
from identification.diagnosis.search.attribution import Round, selected
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate
from identification.diagnosis.search.pairs import best_pair
from identification.diagnosis.search.trials import Trial
from identification.diagnosis.search.workbench import State, Workbench

SWEEPS = 2  # over all chosen effects, at most


@dataclass(frozen=True, eq=False)
class Reconsidering:
    """A forward selection taken up again: all candidates, how many effects are allowed, and what kinematics says.

    What it finds has yet to be `confirmed`: an effect that it puts in may make another one idle.
    """

    bench: Workbench
    candidates: Sequence[Candidate]
    most: int
    sensors: Sequence[Mismatch]

    def paired(self, state: State, rounds: Sequence[Round]) -> tuple[State, list[Round]]:
        """With two effects more, of which neither passes alone: the likeliest pair, see `best_pair`."""
        chosen = _chosen(rounds)
        if not rounds or len(chosen) + 2 > self.most:
            return state, list(rounds)
        used = {t.candidate for t in chosen}
        left = [c for c in self.candidates if c not in used]
        pair = best_pair(self.bench, state, left, len(self.candidates))
        if pair is None or pair[0].state is None:
            return state, list(rounds)
        after = pair[0].state
        kept = [r for r in rounds if r.chosen is not None]
        trials = rounds[-1].trials
        begun = [Round((t, *trials), t, (), {}, before=state) for t in pair]
        state = self.bench.fit(after.plant, after.paths, after)
        return self.swapped(state, [*kept, *begun], pair)  # which also finds what is tied with each

    def swapped(self, state: State, rounds: Sequence[Round], new: Sequence[Trial] = ()) -> tuple[State, list[Round]]:
        """Every chosen effect taken out and the best of all candidates, itself included, put in, while that helps.

        A fit that stopped in a valley starts anew by it.  new: those that no round has chosen yet; if there are any,
        only these are taken out.
        """
        bar, rounds = threshold(len(self.candidates)), list(rounds)
        for _ in range(SWEEPS):
            changed = False
            for number, made in _numbered(rounds):
                if new and made not in new:
                    continue
                others = [t for t in _chosen(rounds) if t is not made]
                again = self._selected(self._without(state, made), others)
                if again.chosen is None or again.chosen.state is None:
                    continue
                better = self.bench.gain(state, again.chosen.state) > bar
                if better or (made in new and again.chosen.candidate is made.candidate):
                    after = again.chosen.state
                    state = self.bench.fit(after.plant, after.paths, after)
                    rounds = [again if i == number else r for i, r in enumerate(rounds)]
                    changed |= better
            if not changed:
                break
        return state, rounds

    def _selected(self, state: State, chosen: Sequence[Trial]) -> Round:
        used = {t.candidate for t in chosen}
        left = [c for c in self.candidates if c not in used]
        return selected(self.bench, state, left, len(self.candidates), self.sensors)

    def _without(self, state: State, trial: Trial) -> State:
        return self.bench.without(state, [p for p in trial.candidate.free if p in state.paths])


def _numbered(rounds: Sequence[Round]) -> list[tuple[int, Trial]]:
    return [(number, r.chosen) for number, r in enumerate(rounds) if r.chosen is not None]


def _chosen(rounds: Sequence[Round]) -> list[Trial]:
    return [r.chosen for r in rounds if r.chosen is not None]
