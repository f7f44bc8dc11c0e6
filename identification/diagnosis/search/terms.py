"""The search for one more term: signatures of a library, their stable selection, and fits of the best of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auv_gym.param import replace_at, value_at
from auv_gym.threads import side_by_side
from identification.deciding import BLOCKS, CONTENDERS, KIN, LEAST_BLOCK, NEAR, STABLE, TIE
from identification.diagnosis.search.begun import FIRST_ITERATIONS
from identification.diagnosis.search.stability import Selection, select
from identification.diagnosis.search.workbench import State, Workbench, tried
from identification.fit.intervals import information_of, interval_of
from identification.fit.parameters import moves_of
from identification.fit.prediction_errors import PredictionErrors

TINY = 1e-6  # size of a term, in its unit, for its signature: far below any effect, far above rounding


@dataclass(frozen=True, eq=False)
class Found:
    """A term, fitted together with all else.

    frequency: share of the halves that chose it or a similar one.  alike: those that explain the record as well.
    """

    path: str
    state: State
    frequency: float
    alike: tuple[str, ...]
    scales: Mapping[str, float]


def search(bench: Workbench, state: State, library: Sequence[str], rng: np.random.Generator) -> Found | None:
    """The term that explains most beside the fitted parameters, if one is chosen stably.

    Weaker process noise is tried, too, since noise may have grown to take the term's place.
    """
    best = None
    for base in (state, *bench.with_given(state), *bench.quieted(state)):
        free = replace(base, paths=state.paths)  # coefficients at their given values are as free as fitted ones
        selection, scales = selection_of(bench, free, library, rng)
        found = _best(bench, state, base, library, selection, scales)
        if found and (best is None or bench.gain(best.state, found.state) > 0.0):
            best = found
    return best


def selection_of(
    bench: Workbench, state: State, library: Sequence[str], rng: np.random.Generator
) -> tuple[Selection, dict[str, float]]:
    """The stability selection of the errors on the terms' signatures, and each term's size that shifts by one sigma.

    Signatures are taken at a size far below that of any effect, since the relevant size is not known beforehand.
    """
    problem, point = bench.problem, state.point
    unit = problem.scaled(dict.fromkeys(library, 1.0))
    columns = unit.columns_of(point, [(p, TINY) for p in library])
    total = max(problem.count, 1)
    size = np.sqrt((columns**2).sum(axis=(1, 2)) / total)
    scales = np.where(size > 1e-12, 1.0 / np.maximum(size, 1e-12), 1.0)
    columns = columns * np.where(size > 1e-12, scales, 0.0)[:, None, None]
    nuisance = problem.columns_of(point, moves_of(state.paths))
    errors = point.errors
    blocks = np.repeat(_blocks(bench.block_of_row), errors.shape[1])
    flat = errors.ravel()
    selection = select(
        columns.reshape(len(columns), flat.size), nuisance.reshape(len(nuisance), flat.size), flat, blocks, rng
    )
    return selection, dict(zip(library, scales.tolist(), strict=True))


def term_interval(bench: Workbench, found: Found) -> tuple[float, tuple[float, float]]:
    """Value and 95 % interval of the term."""
    problem, state = bench.problem.scaled(found.scales), found.state
    told = information_of(problem, state.point, state.paths)
    return value_at(state.plant, found.path), interval_of(problem, state.point, state.paths, found.path, told)


def _blocks(window: np.ndarray) -> np.ndarray:
    """The block number of each row: windows, divided if there are few of them.  window: (rows,), in order."""
    _, lengths = np.unique(window, return_counts=True)
    parts = int(np.ceil(BLOCKS / len(lengths)))
    numbers, first = [], 0
    for length in lengths:
        own = max(min(parts, int(length) // LEAST_BLOCK), 1)
        numbers.append(first + np.arange(length) * own // length)
        first += own
    return np.concatenate(numbers)


def _best(
    bench: Workbench, state: State, base: State, library: Sequence[str], selection: Selection, scales
) -> Found | None:
    """The simplest of the terms that explain all windows best, fitted with everything else from a base."""
    stable = np.where(selection.frequency >= STABLE, selection.evidence, 0.0)
    if not stable.max() > 0.0:
        return None
    lead = int(np.argmax(stable))
    order = np.argsort(-np.where(np.abs(selection.cosine[lead]) > KIN, selection.evidence, 0.0))
    kin = [int(k) for k in order if k != lead and abs(selection.cosine[lead, k]) > KIN and selection.evidence[k] > 0.0]
    problem = bench.problem.scaled(scales)
    first: dict[int, State] = {}
    for k in [lead, *kin][:CONTENDERS]:
        begun = _begun(problem, state, base, library[k], float(selection.estimate[k]) * scales[library[k]])
        if begun is not None:
            first[k] = begun
    if not first:
        return None
    gains = {k: bench.gain(base, after) for k, after in first.items()}
    near = max(gains.values()) * (1.0 - NEAR) - TIE
    close = [k for k in first if gains[k] >= near]
    fitted = side_by_side(lambda k: tried(problem, first[k]), close)
    ended = {k: after for k, after in zip(close, fitted, strict=True) if after.finite}
    if not ended:
        return None
    total = {k: bench.gain(state, after) for k, after in ended.items()}
    tied = [k for k in ended if max(total.values()) - total[k] < TIE]
    tied.sort(key=lambda k: (_degree(library[k]), k))
    alike = tuple(library[j] for j in tied[1:])
    return Found(library[tied[0]], ended[tied[0]], float(selection.frequency[tied[0]]), alike, scales)


def _begun(problem: PredictionErrors, state: State, base: State, path: str, size: float) -> State | None:
    """A few steps from a base, gains held, with a term of the size that its signature promises, or less; or None.

    None if the runs are not finite.
    """
    paths = (*state.paths, path)
    plants = [replace_at(base.plant, path, share * size) for share in (1.0, 0.2, 0.02)]
    points = [problem.with_gains(base.point, plant.vector) for plant in plants]
    finite = [p for p in points if np.isfinite(p.scores).all()]
    if not finite:
        return None
    best = max(finite, key=lambda p: problem.objective(p, paths))
    point = problem.descended(best, paths, FIRST_ITERATIONS)
    return State(problem.plant_at(point, paths), paths, point)


def _degree(path: str) -> float:
    """The complexity of a term: the number of its factors, and half of one for a modulus, sine or root."""
    term = path.rpartition(".")[2]
    if term in ("depth", "pitch", "rudder", "elapsed", "temperature", "piston"):
        return 1.0
    if "_" not in term:
        return float(len(term))
    return 1.5 if term.startswith(("sin", "cos", "root")) else 2.5 if term[0] == term[-1] else 2.0
