"""Second thoughts on a forward selection with remaining errors: pairs that work only together, and swaps."""

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

SWEEPS = 2  # most sweeps over all chosen effects


@dataclass(frozen=True, eq=False)
class Reconsidering:
    """A forward selection to be improved: all candidates, the largest number of effects, and the kinematic findings.

    Its results still have to be `confirmed`: an effect that it adds may make another one idle.
    """

    bench: Workbench
    candidates: Sequence[Candidate]
    most: int
    sensors: Sequence[Mismatch]

    def paired(self, state: State, rounds: Sequence[Round]) -> tuple[State, list[Round]]:
        """Add two effects of which neither passes alone: the likeliest pair, see `best_pair`."""
        if not rounds or len(_chosen(rounds)) + 2 > self.most:
            return state, list(rounds)
        pair = self._best_pair(state, rounds)
        kept = [r for r in rounds if r.chosen is not None]
        return (state, list(rounds)) if pair is None else self._with_pair(state, kept, rounds[-1].trials, pair)

    def paired_instead(self, state: State, rounds: Sequence[Round]) -> tuple[State, list[Round]]:
        """Replace one effect by two, if these are likelier by the bar for one more parameter.

        An effect that a selection finds first may stand for part of two others, neither of which helps beside it.
        """
        best, rounds, count = None, list(rounds), len(self.candidates)
        if len(_chosen(rounds)) + 1 > self.most:
            return state, rounds
        bar = threshold(count * (count - 1) // 2)  # one parameter more, chosen from so many pairs
        for number, made in _numbered(rounds):
            without = self._without(state, made)
            pair = self._best_pair(without, rounds, made.candidate)
            if pair is None or pair[0].state is None:
                continue
            gained = self.bench.gain(state, pair[0].state)
            if gained > bar:
                best, bar = (without, number, pair), gained
        if best is None:
            return state, rounds
        without, number, pair = best
        kept = [r for i, r in enumerate(rounds) if r.chosen is not None and i != number]
        return self._with_pair(without, kept, rounds[number].trials, pair)

    def _best_pair(
        self, state: State, rounds: Sequence[Round], instead: Candidate | None = None
    ) -> tuple[Trial, Trial] | None:
        used, count = {t.candidate for t in _chosen(rounds)}, len(self.candidates)
        return best_pair(self.bench, state, [c for c in self.candidates if c not in used], count, instead)

    def _with_pair(
        self, state: State, kept: Sequence[Round], trials: Sequence[Trial], pair: tuple[Trial, Trial]
    ) -> tuple[State, list[Round]]:
        """A fitted state with a pair, and the rounds with it; trials: of a round, to which the pair is added."""
        after = pair[0].state
        assert after is not None
        begun = [Round((t, *trials), t, (), {}, before=state) for t in pair]
        state = self.bench.fit(after.plant, after.paths, after)
        return self.swapped(state, [*kept, *begun], pair)  # which also finds the ties of each

    def swapped(self, state: State, rounds: Sequence[Round], new: Sequence[Trial] = ()) -> tuple[State, list[Round]]:
        """Replace every chosen effect by the best of all candidates, itself included, while that helps.

        A fit that stopped in a valley starts again in this way.  new: effects that no round has chosen yet; if there
        are any, only these are replaced.
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
