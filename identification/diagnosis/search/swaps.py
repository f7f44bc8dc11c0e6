"""Second thoughts on a forward selection that leaves something: pairs that work only together, and swaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from identification.deciding import HOPEFUL
from identification.diagnosis.log.kinematics import Mismatch
from identification.diagnosis.search.attribution import Round, selected
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate
from identification.diagnosis.search.trials import Trial, gate
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

    def improved(self, state: State, rounds: Sequence[Round]) -> tuple[State, list[Round]]:
        """The state and its rounds after a pair was sought and every effect compared with all others in its place."""
        state, rounds = self._paired(state, list(rounds))
        return self._swapped(state, rounds)

    def _paired(self, state: State, rounds: list[Round]) -> tuple[State, list[Round]]:
        """With two effects more, of which neither passes alone: the best pair that passes as one change and by members.

        Coefficients that were fitted with two effects missing may be so wrong that one of them makes free runs worse;
        beside the other one each must pass.
        """
        if not rounds or rounds[-1].chosen is not None or len(_chosen(rounds)) + 2 > self.most:
            return state, rounds
        last = self._last(state, rounds)
        if last.chosen is not None and last.chosen.state is not None:
            after = last.chosen.state
            return self.bench.fit(after.plant, after.paths, after), [*rounds[:-1], last]
        count, found = len(self.candidates), []
        for first in self._hopeful(last):
            assert first.state is not None
            second = self._selected(first.state, [*_chosen(rounds), first])  # it passes beside the first one
            if second.chosen is None or second.chosen.state is None:
                continue
            after = second.chosen.state
            pair = [(t.candidate, t.screening) for t in (first, second.chosen)]
            if gate(self.bench, state, after, pair, count).objection:
                continue
            if not gate(self.bench, self._without(after, first), after, pair[:1], count).objection:
                found.append((float(self.bench.costs(after).sum()), first, second, after))
        if not found:
            return state, rounds
        _, first, second, after = min(found, key=lambda item: item[0])
        begun = Round(last.trials, first, (), {}, before=state)
        return self.bench.fit(after.plant, after.paths, after), [*rounds[:-1], begun, second]

    def _last(self, state: State, rounds: Sequence[Round]) -> Round:
        """The last round; a new one if what it tried was beside an effect that has been taken out since."""
        beside = {frozenset(t.state.paths) - set(t.candidate.free) for t in rounds[-1].trials if t.state is not None}
        return rounds[-1] if beside <= {frozenset(state.paths)} else self._selected(state, _chosen(rounds))

    def _hopeful(self, last: Round) -> list[Trial]:
        """Trials of the last round with evidence enough that only the parts, or their size, refused."""
        enough = [t for t in last.trials if t.state is not None and t.total >= threshold(len(self.candidates))]
        return enough[:HOPEFUL]

    def _swapped(self, state: State, rounds: list[Round]) -> tuple[State, list[Round]]:
        """Every chosen effect taken out and the best of all candidates, itself included, put in, while that helps.

        A fit that stopped in a valley starts anew by it.
        """
        bar = threshold(len(self.candidates))
        for _ in range(SWEEPS):
            changed = False
            for number, made in _numbered(rounds):
                others = [t for t in _chosen(rounds) if t is not made]
                again = self._selected(self._without(state, made), others)
                if again.chosen is None or again.chosen.state is None:
                    continue
                better = self.bench.gain(state, again.chosen.state) > bar
                # the first one of a pair has no ties yet, since it was never chosen by itself
                unjudged = made.objection != ""
                if better or (unjudged and again.chosen.candidate is made.candidate):
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
