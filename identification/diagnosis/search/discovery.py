"""The search for an unknown force: the term of a library by which parts of a record predict each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_gym.param import list_paths, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.threads import side_by_side
from identification.deciding import MOST_TERMS
from identification.diagnosis.search.acceptance import TERM, Claim, effect_size, objection
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.remainder import what_is_left
from identification.diagnosis.search.terms import Found, search, term_interval
from identification.diagnosis.search.workbench import State, Workbench

_PER = {
    "depth": "metre of depth", "time": "second", "temperature": "kelvin", "pitch": "radian of pitch",
    "the rudder angle": "radian of rudder",
}  # fmt: skip


@dataclass(frozen=True)
class Term:
    """A term found in data: its coefficient with a 95 % interval, and how it was found.

    frequency: share of the halves of the data that chose it.  alike: paths that explain the record as well.
    objection: why it is rejected, or "".
    """

    path: str
    title: str
    unit: str
    value: float
    ci95: tuple[float, float]
    frequency: float
    evidence_train: float
    evidence_held: float
    alike: tuple[str, ...] = ()
    objection: str = ""

    @property
    def words(self) -> str:
        """The term in words: a heave force of -0.12 N per metre of depth, with its interval."""
        subject, _, of = self.title.removeprefix("discovered ").partition(" from ")
        value, low, high = _digits(self.value, *self.ci95)
        if of in _PER:
            size = f"{value} {'N m' if 'moment' in subject else 'N'} per {_PER[of]}"
        else:
            size = f"{value} {self.unit}{'' if self.unit in ('N', 'N m') else ','} times {of}"
        return f"a {subject} of {size}, 95 % interval {low} to {high} {self.unit}"


@dataclass(frozen=True, eq=False)
class Discovery:
    """The result of a search for terms: the plant with the accepted terms, or the given one.

    paths: all that is fitted in `plant`.  terms: the accepted ones.  rejected: those chosen stably but rejected.
    """

    plant: Plant
    paths: tuple[str, ...]
    state: State
    terms: tuple[Term, ...] = ()
    rejected: tuple[Term, ...] = ()

    @property
    def holds(self) -> bool:
        """Whether any term was accepted."""
        return bool(self.terms)

    def refused(self, state: State, why: str) -> Discovery:
        """The discovery with its terms rejected, each with this objection, and a state without them."""
        rejected = (*self.rejected, *(replace(term, objection=why) for term in self.terms))
        return replace(self, plant=state.plant, paths=state.paths, state=state, terms=(), rejected=rejected)

    def summary(self) -> str:
        """The finding in a plain paragraph."""
        if not self.terms:
            text = "No term in the library explains the remaining error"
            tried = [f"{t.words} ({t.objection})" for t in self.rejected]
            return f"{text}; the closest is {' and '.join(tried)}." if tried else f"{text}."
        text = f"The remaining error looks like {' and '.join(t.words for t in self.terms)}."
        for term in self.terms:
            if term.alike:
                others = ", ".join(spec_at(self.plant, p).title.removeprefix("discovered ") for p in term.alike)
                text += f" This log cannot tell it from: {others}."
        return text


def library_of(plant: Plant) -> tuple[str, ...]:
    """Paths of the discovered terms that are neutral in a vehicle."""
    return tuple(p for p in list_paths(plant) if p.startswith("effects.discovered.") and value_at(plant, p) == 0.0)


def discover(
    bench: Workbench, state: State, library: Sequence[str], rng: np.random.Generator, settle: float
) -> Discovery:
    """At most two terms of the library, chosen stably over halves of the fitted windows and confirmed by the others.

    A second term is tried only if something is left beside the first.

    state: the fit so far (`paths`).  settle: s, to which the starts of free runs are fitted.
    Raises ValueError if the library is empty.
    """
    if not library:
        raise ValueError(f"A search for terms of {state.plant.name} needs some to choose from: see `library_of`.")
    terms, rejected, scales = [], [], {}
    for _ in range(MOST_TERMS):
        if terms and not what_is_left(bench, state):
            break
        found = search(bench, state, [p for p in library if p not in state.paths], rng)
        if found is None:
            break
        term = _weighed(bench, state, found, len(library), settle)
        if term.objection:
            rejected.append(term)
            break
        terms.append(term)
        state, scales = found.state, scales | dict(found.scales)
    if len(terms) > 1:
        state, terms, failed = _confirmed(bench, state, terms, scales, len(library), settle)
        rejected += failed
    return Discovery(state.plant, state.paths, state, tuple(terms), tuple(rejected))


def _digits(*values: float) -> list[str]:
    """The values with enough digits, at least two, to show the difference of the last two."""
    apart = values[-1] - values[-2]
    for digits in range(2, 9):
        words = [f"{value:.{digits}g}" for value in values]
        if abs(float(words[-1]) - float(words[-2]) - apart) < 0.2 * apart:
            return words
    return [f"{value:.3g}" for value in values]


def _confirmed(
    bench: Workbench, state: State, terms: Sequence[Term], scales: Mapping[str, float], count: int, settle: float
) -> tuple[State, list[Term], list[Term]]:
    """The state with only the terms that hold beside each other, these terms, and the rejected ones, weakest first."""
    kept, failed = list(terms), []
    while kept:
        without = side_by_side(lambda term, state=state: bench.without(state, [term.path]), kept)
        found = [Found(t.path, state, t.frequency, t.alike, scales) for t in kept]
        kept = [_weighed(bench, b, f, count, settle) for b, f in zip(without, found, strict=True)]
        idle = [i for i, term in enumerate(kept) if term.objection]
        if not idle:
            break
        worst = min(idle, key=lambda i: kept[i].evidence_train)
        failed.append(kept.pop(worst))
        state = without[worst]
    return state, kept, failed


def _weighed(bench: Workbench, before: State, found: Found, count: int, settle: float) -> Term:
    """The found term, with the evidence for it and the objection to it, against the state without it."""
    after, spec = found.state, spec_at(before.plant, found.path)
    value, limits = term_interval(bench, found)
    evidence = bench.gains(before, after)
    sizes = [effect_size(after.plant, found.path)]
    claim = Claim(*evidence, threshold(count), sizes, lambda: [limits[1] - value], lambda: bench.flies(after, settle))
    names = (found.path, spec.title, spec.unit)
    return Term(*names, value, limits, found.frequency, *evidence, found.alike, objection(claim, TERM))
