"""A term that no known effect is: which one, over a library of forces, makes free runs agree with held-out data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from scipy import stats

from auv_gym.channels import channel
from auv_gym.param import list_paths, replace_at, spec_at, value_at
from auv_gym.plant import Plant
from identification.diagnosis.stability import Selection, select
from identification.diagnosis.verdict import interval, quantity
from identification.estimate import half_width
from identification.shooting import Point, Shooting, colour, covariance, evidence, whitened
from identification.validation import free_runs

STABLE = 0.8  # share of the halves that must choose a term
MOST_TERMS = 2
BLOCKS, LEAST_BLOCK = 24, 8  # blocks to resample, if they hold as many samples
TINY = 1e-6  # size of a term, in its unit, for its signature: far below any effect, far above rounding
CONTENDERS = 5  # terms that are fitted in earnest, of those whose signature promises most
TIE = 9.0  # evidence below which two terms are not told apart: three standard errors
FALSE_ALARM = 1e-3  # probability of a false term on a log without any, over the library
HELD_LEAST, HELD_SHARE = 6.6, 0.1  # evidence from the held-out windows alone, and as a share of the fitted ones'
MANY_WINDOWS, HELD_RANKS = 8, 0.01  # held-out windows from which on a signed-rank test judges them, and its level
SURE = 3.0  # standard errors by which a term must differ from zero
ITERATIONS = 25  # of a contender's fit
FAR_FROM_GIVEN = 0.1  # change of a coefficient from which on terms are also sought from its given value
_PER = {
    "depth": "metre of depth", "time": "second", "temperature": "kelvin", "pitch": "radian of pitch",
    "the rudder angle": "radian of rudder",
}  # fmt: skip


class Fitted(Protocol):
    """A vehicle with its free parameters fitted in the training windows, and its runs in both sets of windows."""

    @property
    def plant(self) -> Plant: ...
    @property
    def paths(self) -> tuple[str, ...]: ...
    @property
    def train(self) -> Point: ...
    @property
    def held(self) -> Point: ...
    @property
    def colour(self) -> np.ndarray: ...


@dataclass(frozen=True, eq=False)
class _State:
    plant: Plant
    paths: tuple[str, ...]
    train: Point
    held: Point
    colour: np.ndarray


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
        if of in _PER:
            force = "N m" if "moment" in subject else "N"
            size = f"{quantity(self.value, force)} per {_PER[of]}"
        elif self.unit in ("N", "N m"):
            size = f"{quantity(self.value, self.unit)} times {of}"
        else:
            size = f"{quantity(self.value, self.unit)}, times {of}"
        return f"a {subject} of {size}, 95 % interval {interval(self.ci95, self.unit)}"


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
    state: Fitted,
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
    terms, rejected, seen = [], [], {}
    given = state
    for _ in range(MOST_TERMS):
        left = [p for p in library if p not in state.paths]
        ways = []
        for base in (state, _with_given_coefficients(train, state)):
            if base is not None:
                ways.append((base, *_selection(train, base, left, rng)))
                for path, frequency in zip(left, ways[-1][1].frequency, strict=True):
                    seen[path] = max(seen.get(path, 0.0), float(frequency))
        found = [_best(train, held, state, base, left, selection, scales) for base, selection, scales in ways]
        found = [(term, after) for term, after in found if term is not None and after is not None]
        if not found:
            break
        term, after = max(found, key=lambda item: item[0].evidence_train + item[0].evidence_held)
        objection = _objection(held, state, after, term, len(library), settle)
        if objection:
            rejected.append(replace(term, objection=objection))
            break
        terms.append(term)
        state = after
    errors = _errors(held, given.plant, state.plant, settle) if terms else {}
    frequencies = {p: f for p, f in seen.items() if f > 0.0}
    found = (tuple(terms), tuple(rejected), frequencies, errors)
    return Discovery(state.plant, state.paths, state.train, state.held, state.colour, *found)


def _selection(
    train: Shooting, state: Fitted, library: Sequence[str], rng: np.random.Generator
) -> tuple[Selection, dict[str, float]]:
    """The stability selection of the residual on the terms' signatures, and each term's size that shifts by one sigma.

    Signatures are taken at a size far below any effect's, since what size matters is not known before.
    """
    sigma = train.sigma(state.train)
    unit = Shooting(train.plant, train.record, train.windows, dict.fromkeys(library, 1.0))
    linear = unit.linearise(state.train, list(library), sigma, step=TINY)
    size = linear.raw / np.sqrt(max(train.counts.sum(), 1))
    scales = np.where(size > 1e-12, 1.0 / np.maximum(size, 1e-12), 1.0)
    columns = linear.columns * np.where(size > 1e-12, scales, 0.0)[:, None, None]
    columns[(columns**2).sum(axis=(1, 2)) < 1e-5 * train.counts.sum()] = 0.0  # the starts do the same
    nuisance = train.linearise(state.train, list(state.paths), sigma).columns
    residual = whitened(train, state.train.residual / sigma, state.colour)
    spread = np.maximum(np.sqrt((residual**2).sum(axis=0) / np.maximum(train.counts, 1)), 1e-9)

    def flat(values):
        return (whitened(train, values, state.colour) / spread).reshape(len(values), -1)

    blocks = np.repeat(_blocks(train), len(train.channels))
    return select(flat(columns), flat(nuisance), (residual / spread).ravel(), blocks, rng), dict(
        zip(library, scales.tolist(), strict=True)
    )


def _with_given_coefficients(train: Shooting, state: Fitted) -> _State | None:
    """The state with its coefficients as the vehicle was given, if the fit has taken one of them far from there.

    Coefficients that were fitted without the term may be so wrong that its signature at them means nothing.
    """
    given = {p: value_at(train.plant, p) for p in state.paths if p in train.plant.family.coefficients}
    if all(abs(value_at(state.plant, p) - v) <= FAR_FROM_GIVEN * abs(v) for p, v in given.items()):
        return None
    plant = replace_at(state.plant, given)
    point = train.solve(plant, (), state.train.starts, ITERATIONS, 1e-5)
    if not np.isfinite(point.cost):
        return None
    return _State(plant, tuple(state.paths), point, state.held, colour(train, point))


def _blocks(problem: Shooting) -> np.ndarray:
    """The number of each row's block: windows, cut where there are few of them."""
    lengths = problem.runs.stop - problem.runs.begin
    parts = int(np.ceil(BLOCKS / len(lengths)))
    numbers, first = [], 0
    for length in lengths:
        own = max(min(parts, int(length) // LEAST_BLOCK), 1)
        numbers.append(first + np.arange(length) * own // length)
        first += own
    return np.concatenate(numbers)


def _best(
    train: Shooting, held: Shooting, state: Fitted, base: Fitted, library: Sequence[str], selection: Selection, scales
) -> tuple[Term | None, _State | None]:
    """The simplest of the terms that explain all windows best, fitted with everything else from a base."""
    stable = np.where(selection.frequency >= STABLE, selection.evidence, 0.0)
    if not stable.max() > 0.0:
        return None, None
    lead = int(np.argmax(stable))
    order = np.argsort(-np.where(np.abs(selection.cosine[lead]) > 0.5, selection.evidence, 0.0))
    chosen: list[int] = [lead, *(int(k) for k in order if k != lead and selection.evidence[k] > 0.0)][:CONTENDERS]
    found: list[tuple[int, _State]] = []
    for k in chosen:
        after = _fitted(train, held, state, base, library[k], selection.estimate[k], scales)
        if after is not None:
            found.append((k, after))
    if not found:
        return None, None
    best = max(found, key=lambda item: sum(_gains(train, held, state, item[1], item[1].colour)))
    top = sum(_gains(train, held, state, best[1], best[1].colour))
    tied = [
        (k, after)
        for k, after in found
        if after is best[1] or top - sum(_gains(train, held, state, after, best[1].colour)) < TIE
    ]
    tied.sort(key=lambda item: (_degree(library[item[0]]), item[0]))
    k, after = tied[0]
    own = library[k]
    value, half = _interval(train, after, own, scales)
    spec = spec_at(after.plant, own)
    gains = _gains(train, held, state, after, after.colour)
    alike = tuple(library[j] for j, _ in tied[1:])
    limits = (value - half, value + half)
    return Term(own, spec.title, spec.unit, value, limits, float(selection.frequency[k]), *gains, alike), after


def _fitted(
    train: Shooting, held: Shooting, state: Fitted, base: Fitted, path: str, estimate: float, scales
) -> _State | None:
    """A base with a term fitted jointly with all else, from what its signature promises; None if that gains nothing.

    estimate: in the term's scale.
    """
    problem = Shooting(train.plant, train.record, train.windows, scales)
    paths = (*state.paths, path)
    for share in (1.0, 0.2, 0.02):
        plant = replace_at(base.plant, path, float(share * estimate * scales[path]))
        point = problem.solve(plant, paths, base.train.starts, ITERATIONS, 1e-6)
        if np.isfinite(point.cost) and point.cost < state.train.cost:
            fitted = problem.plant_at(point, paths)
            there = held.solve(fitted, (), state.held.starts, ITERATIONS, 1e-6)
            if np.isfinite(there.cost):
                return _State(fitted, paths, point, there, colour(train, point))
    return None


def _gains(train: Shooting, held: Shooting, before: Fitted, after: Fitted, colours: np.ndarray) -> tuple[float, float]:
    """Evidence for the change in the fitted and in the held-out windows."""
    return evidence(train, before.train, after.train, colours), evidence(held, before.held, after.held, colours)


def _interval(train: Shooting, state: _State, path: str, scales) -> tuple[float, float]:
    """Value and half width of the 95 % interval of a fitted term."""
    problem = Shooting(train.plant, train.record, train.windows, scales)
    linear = problem.linearise(state.train, state.paths, problem.sigma(state.train))
    matrix, freedom = covariance(problem, state.train, linear, state.colour)
    k = state.paths.index(path)
    error = float(np.sqrt(max(matrix[k, k], 0.0))) * problem.scale(path)
    return value_at(state.plant, path), half_width(freedom) * error


def _objection(held: Shooting, before: Fitted, after: _State, term: Term, count: int, settle: float) -> str:
    if term.evidence_train + term.evidence_held < float(stats.chi2.isf(FALSE_ALARM / count, 1)):
        return "it is not significant"
    if term.evidence_held < max(HELD_LEAST, HELD_SHARE * term.evidence_train):
        return "it does not hold in the held-out windows"
    if abs(term.value) < SURE / 1.96 * (term.ci95[1] - term.value):
        return "its size is too uncertain"
    better = _squares(held, before.plant, settle) - _squares(held, after.plant, settle)
    better = (better / held.sigma(after.held) ** 2).sum(axis=1)
    if len(better) < MANY_WINDOWS:
        holds = better.sum() > 0.0
    else:
        holds = bool(np.asarray(stats.wilcoxon(better, alternative="greater"))[1] < HELD_RANKS)
    return "" if holds else "free runs in the held-out windows did not improve"


def _squares(held: Shooting, plant: Plant, settle: float) -> np.ndarray:
    """Sums of squared errors of free runs by held-out window and channel, (W, C)."""
    runs = free_runs(plant, held.record, held.windows, settle)
    squares = np.where(np.isfinite(runs.residual) & runs.scored[:, None], runs.residual, 0.0) ** 2
    return np.add.reduceat(squares, held.offsets, axis=0)


def _errors(held: Shooting, before: Plant, after: Plant, settle: float) -> dict[str, tuple[float, float]]:
    found = [free_runs(plant, held.record, held.windows, settle).scores(held.record) for plant in (before, after)]
    return {name: (found[0][name].rmse, found[1][name].rmse) for name in held.channels}


def _degree(path: str) -> float:
    """How far from simple a term is: the number of its factors, and half of one for a modulus, sine or root."""
    term = path.rpartition(".")[2]
    if term in ("depth", "pitch", "rudder", "elapsed", "temperature", "piston"):
        return 1.0
    if "_" not in term:
        return float(len(term))
    return 1.5 if term.startswith(("sin", "cos", "root")) else 2.5 if term[0] == term[-1] else 2.0
