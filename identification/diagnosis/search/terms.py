"""The search for one more term: signatures of a library, their stable selection, and fits of the best of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.param import replace_at, value_at
from identification.diagnosis.search.stability import Selection, select
from identification.diagnosis.search.ties import TIE
from identification.diagnosis.search.workbench import State, given_values
from identification.estimate import half_width
from identification.fit.likelihood import colour, covariance, evidence, whitened
from identification.fit.shooting import Point, Shooting

STABLE = 0.8  # share of the halves that must choose a term
BLOCKS, LEAST_BLOCK = 24, 8  # blocks to resample, if they hold as many samples
TINY = 1e-6  # size of a term, in its unit, for its signature: far below any effect, far above rounding
IMITATED = 1e-5  # share of a signature below which nothing is left beside the initial states
CONTENDERS = 5  # terms that are fitted in earnest, of those whose signature promises most
KIN = 0.5  # cosine to the leading term from which on a term contends with it
FIRST_ITERATIONS, ITERATIONS = 6, 20  # of each contender's fit, and then of those near the best
NEAR = 0.1  # share of the best one's gain in cost within which a contender is fitted to the end


@dataclass(frozen=True, eq=False)
class Found:
    """A term fitted jointly with all else.

    frequency: share of the halves that chose it or one alike.  alike: those that explain the record as well.
    """

    path: str
    state: State
    frequency: float
    alike: tuple[str, ...]
    scales: Mapping[str, float]


def search(
    train: Shooting, held: Shooting, state: State, library: Sequence[str], rng: np.random.Generator
) -> tuple[Found | None, dict[str, float]]:
    """The term that explains most beside what is fitted, if one is chosen stably; and how often each was chosen."""
    best, often = None, dict.fromkeys(library, 0.0)
    bases = [state, *_with_given_coefficients(train, state)]
    for base in bases:
        selection, scales = selection_of(train, base, library, rng)
        often = {p: max(often[p], float(f)) for p, f in zip(library, selection.frequency, strict=True)}
        found = _best(train, held, state, base, library, selection, scales)
        if found and (best is None or sum(gains(train, held, best.state, found.state, found.state.colour)) > 0.0):
            best = found
    return best, often


def selection_of(
    train: Shooting, state: State, library: Sequence[str], rng: np.random.Generator
) -> tuple[Selection, dict[str, float]]:
    """The stability selection of the residual on the terms' signatures, and each term's size that shifts by one sigma.

    Signatures are taken at a size far below any effect's, since what size matters is not known before.
    """
    sigma = train.sigma(state.train)
    unit = train.scaled(dict.fromkeys(library, 1.0))
    linear = unit.linearise(state.train, list(library), sigma, step=TINY)
    total = max(int(train.counts.sum()), 1)
    size = linear.raw / np.sqrt(total)
    scales = np.where(size > 1e-12, 1.0 / np.maximum(size, 1e-12), 1.0)
    columns = linear.columns * np.where(size > 1e-12, scales, 0.0)[:, None, None]
    columns[(columns**2).sum(axis=(1, 2)) < IMITATED * total] = 0.0
    nuisance = train.linearise(state.train, list(state.paths), sigma).columns
    residual = whitened(train, state.train.residual / sigma, state.colour)
    spread = np.maximum(np.sqrt((residual**2).sum(axis=0) / np.maximum(train.counts, 1)), 1e-9)

    def flat(values: np.ndarray) -> np.ndarray:
        return (whitened(train, values, state.colour) / spread).reshape(len(values), residual.size)

    blocks = np.repeat(_blocks(train), len(train.channels))
    selection = select(flat(columns), flat(nuisance), (residual / spread).ravel(), blocks, rng)
    return selection, dict(zip(library, scales.tolist(), strict=True))


def gains(train: Shooting, held: Shooting, before: State, after: State, colours: np.ndarray) -> tuple[float, float]:
    """Evidence for the change in the fitted and in the held-out windows."""
    return evidence(train, before.train, after.train, colours), evidence(held, before.held, after.held, colours)


def interval_of(train: Shooting, found: Found) -> tuple[float, tuple[float, float]]:
    """Value and 95 % interval of the term."""
    problem = train.scaled(found.scales)
    state = found.state
    linear = problem.linearise(state.train, state.paths, problem.sigma(state.train))
    matrix, freedom = covariance(problem, state.train, state.paths, linear, state.colour)
    k = state.paths.index(found.path)
    half = half_width(freedom) * float(np.sqrt(max(matrix[k, k], 0.0))) * problem.scale(found.path)
    value = value_at(state.plant, found.path)
    return value, (value - half, value + half)


def _with_given_coefficients(train: Shooting, state: State) -> list[State]:
    """The state with its coefficients as the vehicle was given, if the fit has taken one of them far from there.

    Coefficients that were fitted without the term may be so wrong that its signature at them means nothing.
    """
    given = given_values(train.plant, state)
    if not given:
        return []
    plant = replace_at(state.plant, given)
    point = train.solve(plant, (), state.train.starts, ITERATIONS, 1e-5)
    if not np.isfinite(point.cost):
        return []
    return [State(plant, tuple(state.paths), point, state.held, colour(train, point))]


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
    train: Shooting, held: Shooting, state: State, base: State, library: Sequence[str], selection: Selection, scales
) -> Found | None:
    """The simplest of the terms that explain all windows best, fitted with everything else from a base."""
    stable = np.where(selection.frequency >= STABLE, selection.evidence, 0.0)
    if not stable.max() > 0.0:
        return None
    lead = int(np.argmax(stable))
    order = np.argsort(-np.where(np.abs(selection.cosine[lead]) > KIN, selection.evidence, 0.0))
    kin = [int(k) for k in order if k != lead and abs(selection.cosine[lead, k]) > KIN and selection.evidence[k] > 0.0]
    problem = train.scaled(scales)
    first: dict[int, Point] = {}
    for k in [lead, *kin][:CONTENDERS]:
        point = _first_fit(problem, state, base, library[k], float(selection.estimate[k]) * scales[library[k]])
        if point is not None:
            first[k] = point
    if not first:
        return None
    least = min(point.cost for point in first.values())
    bar = least + max(NEAR * (state.train.cost - least), TIE)
    ended: dict[int, State] = {}
    for k, point in first.items():
        after = _fitted(problem, held, state, library[k], point) if point.cost <= bar else None
        if after is not None:
            ended[k] = after
    if not ended:
        return None
    colours = min(ended.values(), key=lambda s: s.train.cost).colour
    total = {k: sum(gains(train, held, state, after, colours)) for k, after in ended.items()}
    tied = [k for k in ended if max(total.values()) - total[k] < TIE]
    tied.sort(key=lambda k: (_degree(library[k]), k))
    alike = tuple(library[j] for j in tied[1:])
    return Found(library[tied[0]], ended[tied[0]], float(selection.frequency[tied[0]]), alike, scales)


def _first_fit(problem: Shooting, state: State, base: State, path: str, size: float) -> Point | None:
    """A few iterations from a base with a term of what its signature promises, or less; None if that gains nothing."""
    for share in (1.0, 0.2, 0.02):
        plant = replace_at(base.plant, path, share * size)
        point = problem.solve(plant, (*state.paths, path), base.train.starts, FIRST_ITERATIONS, 1e-5, base.train)
        if np.isfinite(point.cost) and point.cost < state.train.cost:
            return point
    return None


def _fitted(problem: Shooting, held: Shooting, state: State, path: str, near: Point) -> State | None:
    """The state with a term, fitted to the end from a point near by; None without a stable run in held-out windows."""
    paths = (*state.paths, path)
    point = problem.solve(problem.plant_at(near, paths), paths, near.starts, ITERATIONS, 1e-6, state.train)
    plant = problem.plant_at(point, paths)
    there = held.solve(plant, (), state.held.starts, ITERATIONS, 1e-6, state.held)
    return State(plant, paths, point, there, colour(problem, point)) if np.isfinite(there.cost) else None


def _degree(path: str) -> float:
    """How far from simple a term is: the number of its factors, and half of one for a modulus, sine or root."""
    term = path.rpartition(".")[2]
    if term in ("depth", "pitch", "rudder", "elapsed", "temperature", "piston"):
        return 1.0
    if "_" not in term:
        return float(len(term))
    return 1.5 if term.startswith(("sin", "cos", "root")) else 2.5 if term[0] == term[-1] else 2.0
