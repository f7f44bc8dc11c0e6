"""The sets of effects that explain a record, each with its probability: the ties of a diagnosis.

An effect may need different companions from those of its rival.  So each member of a tie replaces the chosen effect in
the final model, which is refitted from the likeliest of several starts.  Effects that become needless are left out, and
if the set is far behind, although the member was not in its own round, one more round is searched beside it.  An effect
that was behind in its round may be ahead beside the effects found later: such effects are tried, too.
A set weighs exp(-cost / 2), where its cost is minus twice the objective plus `PRICE` for each parameter, with equal
priors (Burnham and Anderson 2002, Model Selection and Multimodel Inference, sec. 2.9).  No set is exactly right, and
the weights of a whole record are then far too certain: half of it may prefer what the other half refutes.  So the
weights are those of each half, with its evidence scaled to the whole record, averaged over all halves.
Source: bagged posteriors, Huggins and Miller 2023, Bayesian Analysis 18, pages 79-104.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.threads import side_by_side
from identification.deciding import ALIKE, FEW_STATES, HOPELESS, LEAST_PROBABLE, PRICE, TIE
from identification.diagnosis.search.acceptance import LIMITED, effect_size
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.candidates import Candidate
from identification.diagnosis.search.survival import Survival, halves_of
from identification.diagnosis.search.ties import imitations, likenesses
from identification.diagnosis.search.trials import Trial, size_in
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.changing import ChangingPlant, changed
from identification.fit.sensitivities import TRIAL_GAIN

_IDLE = 1e-6  # largest deviation from neutral of an idle effect, in probes
STOPPED = 2.0 * TRIAL_GAIN  # difference in cost of trials that is due to early stops of their fits

Search = Callable[[State, Sequence[Trial]], Round | None]


@dataclass(frozen=True, eq=False)
class Explanation:
    """A set of effects, fitted together.

    rounds: in which each was tried.  cost: see above.  halves: (H,), the cost by each half of the record.
    """

    state: State
    rounds: tuple[Round, ...]
    cost: float
    halves: np.ndarray

    @property
    def trials(self) -> tuple[Trial, ...]:
        """The trials of the effects."""
        return tuple(r.chosen for r in self.rounds if r.chosen is not None)

    @property
    def idle(self) -> list[Trial]:
        """The trials whose effects have returned to neutral: the set is equivalent to one without them."""
        plant = self.state.plant

        def gone(path: str) -> bool:
            return effect_size(plant, path).moved <= _IDLE * (spec_at(plant, path).probe or 1.0)

        return [t for t in self.trials if all(gone(path) for path in t.candidate.free)]

    @property
    def candidates(self) -> frozenset[Candidate]:
        """The effects."""
        return frozenset(t.candidate for t in self.trials)


@dataclass(frozen=True, eq=False)
class Explanations:
    """Sets of effects that explain one record, in ascending order of cost."""

    sets: tuple[Explanation, ...]

    @cached_property
    def weights(self) -> np.ndarray:
        """The probability of each set, (n,), with equal priors."""
        cost = np.array([s.halves for s in self.sets])
        weight = np.exp(-0.5 * (cost - cost.min(axis=0)))
        return (weight / weight.sum(axis=0)).mean(axis=1)

    def probability(self, path: str) -> float:
        """The total probability of the sets with an effect at a path."""
        return float(sum(w for s, w in zip(self.sets, self.weights, strict=True) if path in s.state.paths))

    def needless(self, candidate: Candidate) -> float:
        """The probability of the sets in which another effect replaces this one and is idle: they need neither."""
        pairs = zip(self.sets, self.weights, strict=True)
        return float(sum(w for s, w in pairs if s.idle and candidate not in s.candidates))

    def best_with(self, path: str) -> Explanation | None:
        """The likeliest set with an effect at a path."""
        return next((s for s in self.sets if path in s.state.paths), None)

    def without(self, refused: Explanation) -> Explanations:
        """The sets without a refused one."""
        return Explanations(tuple(s for s in self.sets if s is not refused))


UNWEIGHED = Explanations(())


def explanations(
    bench: Workbench,
    state: State,
    rounds: Sequence[Round],
    survivals: Sequence[Survival],
    most: int,
    search: Search,
) -> Explanations:
    """All sets that explain a record nearly as well as the one that rounds have chosen.

    rounds: each has chosen an effect, all fitted together in the state.  survivals: the results of the halves for them.
    most: effects in a set.  search: one round beside a state and its trials; None if it finds nothing.
    """
    first = explanation(bench, state, rounds)
    found = {meaning(state.plant, first.candidates): first}

    def keep(made: Explanation) -> None:
        same = meaning(state.plant, made.candidates)
        known = found.get(same)
        if known is None or (made.cost < known.cost and made.candidates == known.candidates):
            found[same] = made

    singles: list[list[Explanation]] = []
    for number, (made, survived) in enumerate(zip(rounds, survivals, strict=True)):
        followed = number + 1 < len(rounds) and bench.followed <= FEW_STATES  # with more states it takes minutes
        others = [t for t in rivals_of_round(made, survived, followed) if t.candidate not in first.candidates]
        replaced = [s for s in _replaced(bench, first, number, others) if _possible(bench, s, s.trials[number])]
        for own in replaced:
            keep(own)
            for less in _needing_less(bench, own, number, first.cost):
                keep(less)
        singles.append(replaced)
        tied = {t.candidate for t in rivals_of_round(made, survived)}
        for own in _behind([s for s in replaced if s.trials[number].candidate in tied], first, found):
            for other in _searched(bench, own, number, first, most, search):
                keep(other)
    for several in _combined(first, singles, min(s.cost for s in found.values())):
        keep(_joined(bench, several))
    return Explanations(tuple(sorted(found.values(), key=lambda s: s.cost)))


def meaning(plant: Plant, candidates: Collection[Candidate]) -> frozenset:
    """A key of the effects, the same for equivalent sets of them.

    An effect in one of two logs and in the other is equivalent to one in both that has changed.
    """
    if not isinstance(plant, ChangingPlant):
        return frozenset(candidates)
    *begins, _ = sorted({edge for course in plant.courses.values() for edge in course.edges})
    rows, shares = np.array(begins), dict[tuple[str, ...], list[np.ndarray]]()
    for candidate in candidates:
        form = changed(candidate.paths[0])[0]
        own = plant.courses[form].over(rows) if form else np.ones(len(rows))
        shares.setdefault(tuple(changed(p)[1] for p in candidate.paths), []).append(own)
    return frozenset((paths, _span(np.array(own))) for paths, own in shares.items())


def _span(rows: np.ndarray) -> tuple[float, ...]:
    """The projection on the span of some rows, rounded: the same for any rows with the same span."""
    return tuple(np.round(np.linalg.pinv(rows) @ rows, 6).ravel() + 0.0)


def rivals_of_round(made: Round, survived: Survival, followed: bool = False) -> list[Trial]:
    """The fitted trials of a round that may replace the chosen one: tied with it, or chosen by halves instead.

    followed: whether other effects came after it.  Then all that passed are included, and those that failed only by a
    limit of their size, since they were compared without the later effects.
    """
    preferred = [t for t in made.trials if not set(survived.rivals).isdisjoint(t.candidate.paths)]
    passed = [t for t in made.trials if t.objection in ("", LIMITED)] if followed else []
    members = {
        t.candidate: t for t in (*made.tied, *preferred, *passed) if t.state is not None and t is not made.chosen
    }
    return list(members.values())


def likeliest(
    found: Explanations, first: Sequence[Round], passes: Callable[[Explanation], Explanation | None]
) -> tuple[Explanation, Explanations]:
    """The set to report, and all sets that remain: the likeliest that passes the gate, or the chosen one.

    passes: returns the set as it passes the gate, perhaps without its idle effects, or None.  A set does not replace
    the chosen one if it is likelier only by what early stops of fits may cause.
    """
    own = next(s for s in found.sets if s.candidates == {r.chosen.candidate for r in first if r.chosen is not None})
    for other in found.sets:
        if other is own or other.cost >= own.cost - STOPPED:
            break
        passed = passes(other)
        if passed is not None and passed.cost < own.cost - STOPPED:
            rest = [s for s in found.without(other).sets if s.candidates != passed.candidates]
            return passed, Explanations(tuple(sorted((passed, *rest), key=lambda s: s.cost)))
        found = found.without(other)
    return own, found


def tied_rounds(found: Explanations, rounds: Sequence[Round], survivals: Sequence[Survival]) -> tuple[Round, ...]:
    """The rounds, each tied with the trials of a probability of at least `LEAST_PROBABLE` in its effect's place."""
    used, told = {r.chosen.candidate for r in rounds if r.chosen is not None}, []
    for number, (made, survived) in enumerate(zip(rounds, survivals, strict=True), 1):
        others = [t for t in rivals_of_round(made, survived, number < len(rounds)) if t.candidate not in used]
        members = [t for t in others if found.probability(t.candidate.paths[0]) >= LEAST_PROBABLE]
        members = [t for t in members if (best := found.best_with(t.candidate.paths[0])) and t not in best.idle]
        told.append(replace(made, tied=tuple(members)))
    return tuple(told)


def explanation(bench: Workbench, state: State, rounds: Sequence[Round]) -> Explanation:
    """The set of effects that rounds have chosen, as fitted in a state, with its cost."""
    trials = [r.chosen for r in rounds if r.chosen is not None]
    free = sum(p in state.paths for t in trials for p in t.candidate.free)
    price = PRICE * (free + sum(float(np.log(t.screening.tried)) for t in trials))
    halves = halves_of(bench.parts)
    if not state.finite:
        return Explanation(state, tuple(rounds), np.inf, np.full(len(halves), np.inf))
    told = bench.by_part(state)
    parts = [told.refitted(half)[1] - told.known_score for half in halves]
    share = np.mean(halves, axis=1)
    return Explanation(
        state,
        tuple(rounds),
        float(bench.costs(state).sum()) + price,
        price - 2.0 * (np.array(parts) / share + told.known_score),
    )


def _replaced(bench: Workbench, first: Explanation, number: int, others: Sequence[Trial]) -> list[Explanation]:
    """The chosen set with each of the others in one effect's place, refitted."""
    if not others:
        return []
    made, chosen = first.rounds[number], first.trials[number]
    kept = [p for p in first.state.paths if p not in chosen.candidate.free]
    alike = likenesses(bench, replace(chosen, state=first.state), others)

    def fit(other: Trial) -> Explanation:
        assert other.state is not None
        paths = (*kept, *(p for p in other.candidate.free if p not in kept))
        rounds = [*first.rounds]
        rounds[number] = replace(made, chosen=other, tied=(chosen, *(t for t in made.tied if t is not other)))
        if set(other.state.paths) == set(paths):  # no effect came after it: the trial is that set already
            return explanation(bench, other.state, rounds)
        ways = [way for way in alike[other.candidate] if way.cosine >= ALIKE]
        starts = [(plant, first.state) for plant in imitations(replace(chosen, state=first.state), other, ways)]
        beside = {p: value_at(first.state.plant, p) for p in paths if p not in other.state.paths}
        starts.append((replace_at(other.state.plant, beside), other.state))
        own = {p: value_at(other.state.plant, p) for p in other.candidate.free}
        out = {p: spec_at(first.state.plant, p).neutral for p in chosen.candidate.paths}
        starts.append((replace_at(first.state.plant, out | own), first.state))
        return explanation(bench, bench.fit_from(starts, paths, first.state, HOPELESS), rounds)

    return side_by_side(fit, others)


def _possible(bench: Workbench, made: Explanation, trial: Trial) -> bool:
    """Whether an effect is within the limits of its size, if its trial without the later effects was not."""
    own = [p for p in trial.candidate.free if p in made.state.paths] if trial.objection == LIMITED else []
    return not any(size_in(bench, made.state, p).limited for p in own)


def _needing_less(bench: Workbench, own: Explanation, number: int, cost: float) -> Iterator[Explanation]:
    """The set without effects that the one in a round's place makes needless, one after the other.

    Only if the set could then matter.
    """
    while len(own.rounds) > 1 and own.cost - PRICE * len(own.rounds) < cost + TIE:
        keep = own.trials[min(number, len(own.trials) - 1)]
        worth = {}
        for i, trial in enumerate(own.trials):
            free = [p for p in trial.candidate.free if p in own.state.paths]
            if trial is not keep and free:
                worth[i] = bench.worth(own.state, free)
        idle = min(worth, key=lambda i: worth[i], default=None)
        if idle is None or worth[idle] >= TIE:
            return
        out = own.trials[idle].candidate.free
        state = bench.without(own.state, [p for p in out if p in own.state.paths])
        less = explanation(bench, state, [r for i, r in enumerate(own.rounds) if i != idle])
        if less.cost >= own.cost:
            return
        number -= idle < number
        own = less
        yield own


def _behind(replaced: Sequence[Explanation], first: Explanation, found: dict) -> list[Explanation]:
    """Sets whose other effect lost beside the effects found later, although nothing has been searched beside it yet."""
    least = {}
    for made in found.values():
        for candidate in made.candidates - first.candidates:
            least[candidate] = min(made.cost, least.get(candidate, np.inf))
    return [
        s for s in replaced if all(least.get(c, -np.inf) > first.cost + TIE for c in s.candidates - first.candidates)
    ]


def _searched(
    bench: Workbench, own: Explanation, number: int, first: Explanation, most: int, search: Search
) -> Iterator[Explanation]:
    """Sets of what one more round finds beside an effect and the earlier ones, and with later ones that fit in."""
    if number + 1 == len(own.rounds):
        return
    earlier, member = own.rounds[: number + 1], own.trials[number]
    assert member.state is not None
    if set(member.state.paths) & {p for t in first.trials for p in t.candidate.free} != {
        p for t in own.trials[:number] for p in t.candidate.free if p in member.state.paths
    }:
        return  # it was tried beside effects that are no longer there
    again = search(member.state, own.trials[: number + 1])
    if again is None or again.chosen is None or again.chosen.state is None:
        return
    made = explanation(bench, again.chosen.state, [*earlier, again])
    yield made
    while len(made.rounds) < most:
        later = [
            r for r in own.rounds[number + 1 :] if r.chosen is not None and r.chosen.candidate not in made.candidates
        ]
        more = [_joined(bench, [made, replace(first, rounds=(r,))]) for r in later]
        best = min(more, key=lambda s: s.cost, default=made)
        if best.cost >= made.cost:
            return
        made = best
        yield made


def _combined(
    first: Explanation, singles: Sequence[Sequence[Explanation]], least: float
) -> Iterator[list[Explanation]]:
    """Sets with several effects replaced at once, if the sum of their costs is a tie: each set and its ingredients."""
    for choice in product(*([None, *own] for own in singles)):
        taken = [(i, s) for i, s in enumerate(choice) if s is not None]
        if len(taken) < 2 or first.cost + sum(s.cost - first.cost for _, s in taken) > least + TIE:
            continue
        rounds = [*first.rounds]
        for i, s in taken:
            rounds[i] = s.rounds[i]
        if len({r.chosen.candidate for r in rounds if r.chosen is not None}) == len(rounds):
            begun = replace(taken[0][1], rounds=tuple(rounds))
            yield [begun, *(replace(s, rounds=(s.rounds[i],)) for i, s in taken[1:])]


def _joined(bench: Workbench, several: Sequence[Explanation]) -> Explanation:
    """The first set with the effects of the others, each at its value there, fitted together."""
    state, rounds = several[0].state, list(several[0].rounds)
    values: dict[str, float] = {}
    for other in several[1:]:
        values |= {p: value_at(other.state.plant, p) for t in other.trials for p in t.candidate.free}
        known = {r.chosen.candidate for r in rounds if r.chosen is not None}
        rounds += [r for r in other.rounds if r.chosen is not None and r.chosen.candidate not in known]
    trials = [r.chosen for r in rounds if r.chosen is not None]
    wanted = [p for t in trials for p in t.candidate.free]
    gone = [p for p in state.paths if p not in state.plant.coefficients and p not in wanted]
    out = {p: spec_at(state.plant, p).neutral for p in gone}
    paths = tuple(dict.fromkeys([*(p for p in state.paths if p not in out), *wanted]))
    plant: Plant = replace_at(state.plant, out | values)
    return explanation(bench, bench.fit_from([(plant, state)], paths, state, HOPELESS), rounds)
