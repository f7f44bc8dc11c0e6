"""A term that no known effect is: which one, over a library of forces, makes free runs agree with held-out data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from auv_gym.channels import channel
from auv_gym.model import Diverged
from auv_gym.param import list_paths, spec_at, value_at
from auv_gym.plant import Plant
from identification.diagnosis.terms import Found, gains, interval_of, search
from identification.diagnosis.trials import HELD_CHANCE, MANY_WINDOWS, SURE, chance_of_none, threshold
from identification.diagnosis.verdict import quantity
from identification.diagnosis.workbench import State
from identification.shooting import Point, Shooting
from identification.validation import free_runs

MOST_TERMS = 2
HELD_LEAST, HELD_SHARE = 6.6, 0.1  # evidence from the held-out windows alone, and as a share of the fitted ones'
_PER = {
    "depth": "metre of depth", "time": "second", "temperature": "kelvin", "pitch": "radian of pitch",
    "the rudder angle": "radian of rudder",
}  # fmt: skip


@dataclass(frozen=True)
class Term:
    """A term found in data: its coefficient with a 95 % interval, and how it was found.

    frequency: share of the halves of the data that chose it.  alike: paths that explain the record as well.
    objection: why it does not hold, or "".
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
        """The term for people: a heave force of -0.12 N per metre of depth, with its interval."""
        subject, _, of = self.title.removeprefix("discovered ").partition(" from ")
        value, low, high = _digits(self.value, *self.ci95)
        if of in _PER:
            size = f"{value} {'N m' if 'moment' in subject else 'N'} per {_PER[of]}"
        else:
            size = f"{value} {self.unit}{'' if self.unit in ('N', 'N m') else ','} times {of}"
        return f"a {subject} of {size}, 95 % interval {low} to {high} {self.unit}"


@dataclass(frozen=True, eq=False)
class Discovery:
    """What a search for a term found: the plant with the terms that hold, or the one that came in.

    paths: all that is fitted in `plant`, with points in the fitted and the held-out windows.  terms: those that hold.
    rejected: those that were stable but do not.  frequencies: of the terms of which any half chose one alike.
    errors: root mean square of free runs in held-out windows by channel, (before, after).
    """

    plant: Plant
    paths: tuple[str, ...]
    train: Point
    held: Point
    colour: np.ndarray
    terms: tuple[Term, ...] = ()
    rejected: tuple[Term, ...] = ()
    frequencies: dict[str, float] = field(default_factory=dict)
    errors: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def holds(self) -> bool:
        """Whether a term was found that held-out data confirm."""
        return bool(self.terms)

    def summary(self) -> str:
        """The finding in a plain paragraph."""
        if not self.terms:
            text = "No term of the library explains what remains"
            tried = [f"{t.words}, but {t.objection}" for t in self.rejected]
            return f"{text}; nearest comes {' and '.join(tried)}." if tried else f"{text}."
        text = f"What remains looks like {' and '.join(t.words for t in self.terms)}."
        for term in self.terms:
            if term.alike:
                others = ", ".join(spec_at(self.plant, p).title.removeprefix("discovered ") for p in term.alike)
                text += f" The record cannot tell it from: {others}."
        parts = [
            f"{channel(name).label} {quantity(before, channel(name).unit)} before, "
            f"{quantity(after, channel(name).unit)} after"
            for name, (before, after) in self.errors.items()
        ]
        return f"{text} Root mean square error of free runs in held-out windows: {'; '.join(parts)}."


def library_of(plant: Plant) -> tuple[str, ...]:
    """Paths of the discovered terms that a vehicle has and does not use."""
    return tuple(p for p in list_paths(plant) if p.startswith("effects.discovered.") and value_at(plant, p) == 0.0)


def discover(
    train: Shooting,
    held: Shooting,
    state: State,
    library: Sequence[str],
    rng: np.random.Generator,
    settle: float | None = None,
) -> Discovery:
    """At most two terms of the library, chosen stably over halves of the fitted windows and confirmed by the others.

    state: what has been fitted so far (`paths`), in both sets of windows.  settle: s, to which the starts of the free
    runs are fitted; default the vehicle's.  Raises ValueError if the library is empty.
    """
    if not library:
        raise ValueError(f"A search for terms of {state.plant.name} needs some to choose from: see `library_of`.")
    settle = state.plant.settle if settle is None else settle
    terms, rejected, often = [], [], {}
    given = state
    for _ in range(MOST_TERMS):
        found, frequencies = search(train, held, state, [p for p in library if p not in state.paths], rng)
        often = {p: max(f, often.get(p, 0.0)) for p, f in frequencies.items()} | {t.path: t.frequency for t in terms}
        if found is None:
            break
        term = _term(train, held, state, found)
        objection = _objection(held, state, found.state, term, len(library), settle)
        if objection:
            rejected.append(replace(term, objection=objection))
            break
        terms.append(term)
        state = found.state
    errors = _errors(held, given.plant, state.plant, settle) if terms else {}
    often = {p: f for p, f in often.items() if f > 0.0}
    kept = (tuple(terms), tuple(rejected), often, errors)
    return Discovery(state.plant, state.paths, state.train, state.held, state.colour, *kept)


def _digits(*values: float) -> list[str]:
    """The values with as many digits as it takes to see how far the last two are apart, at least two."""
    apart = values[-1] - values[-2]
    for digits in range(2, 9):
        words = [f"{value:.{digits}g}" for value in values]
        if abs(float(words[-1]) - float(words[-2]) - apart) < 0.2 * apart:
            return words
    return [f"{value:.3g}" for value in values]


def _term(train: Shooting, held: Shooting, before: State, found: Found) -> Term:
    spec = spec_at(before.plant, found.path)
    value, limits = interval_of(train, found)
    evidence = gains(train, held, before, found.state, found.state.colour)
    return Term(found.path, spec.title, spec.unit, value, limits, found.frequency, *evidence, found.alike)


def _objection(held: Shooting, before: State, after: State, term: Term, count: int, settle: float) -> str:
    if term.evidence_train + term.evidence_held < threshold(count):
        return "it is not significant"
    if term.evidence_held < max(HELD_LEAST, HELD_SHARE * term.evidence_train):
        return "it does not hold in the held-out windows"
    if abs(term.value) < SURE / 1.96 * (term.ci95[1] - term.value):
        return "its size is too uncertain"
    try:
        better = _squares(held, before.plant, settle) - _squares(held, after.plant, settle)
    except Diverged:
        return "free runs in the held-out windows diverge with it"
    better = (better / held.sigma(after.held) ** 2).sum(axis=1)
    if len(better) < MANY_WINDOWS:
        holds = better.sum() > 0.0
    else:
        holds = chance_of_none(better) < HELD_CHANCE
    return "" if holds else "free runs in the held-out windows did not improve"


def _squares(held: Shooting, plant: Plant, settle: float) -> np.ndarray:
    """Sums of squared errors of free runs by held-out window and channel, (W, C)."""
    runs = free_runs(plant, held.record, held.windows, settle)
    squares = np.where(np.isfinite(runs.residual) & runs.scored[:, None], runs.residual, 0.0) ** 2
    return np.add.reduceat(squares, held.offsets, axis=0)


def _errors(held: Shooting, before: Plant, after: Plant, settle: float) -> dict[str, tuple[float, float]]:
    found = [free_runs(plant, held.record, held.windows, settle).scores(held.record) for plant in (before, after)]
    return {name: (found[0][name].rmse, found[1][name].rmse) for name in held.channels}
