"""What the errors of a fitted filter still hold, which noise would not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.deciding import EXCESS, WHITE
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import Candidate, screen
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.linearised import at_once
from identification.fit.validation import whiteness


@dataclass(frozen=True)
class Left:
    """What the filter's errors still hold, which noise would not.

    coloured: channels whose errors are not white.  depends: the term of the library on which they depend most, or "".
    """

    coloured: tuple[str, ...]
    depends: str

    def __bool__(self) -> bool:
        return bool(self.coloured or self.depends)


def what_is_left(bench: Workbench, state: State, library: Sequence[str]) -> Left:
    """What the errors of the filter hold that noise would not: colour, or dependence on what the vehicle does.

    Process noise is taken to be random: where it follows speeds, depths or angles, it is an effect that nobody knows.
    """
    problem, point = bench.problem, state.point
    fitted = bench.fitted_basis(state)
    coloured = [
        name
        for c, (name, seen) in enumerate(zip(problem.channels, problem.finite.T, strict=True))
        if is_coloured(point.errors[seen, c], problem.stretch_of_row[seen], fitted[seen, c])
    ]
    depends = ""
    if library:
        terms = [Candidate(path, (path,)) for path in library]
        unit, moves = problem.scaled(dict.fromkeys(library, 1.0)), [(p, 1e-6) for p in library]
        columns = (unit.columns_of(point, moves[some]) for some in at_once(len(moves), problem.measured.size))
        size = np.sqrt(np.concatenate([(own**2).sum(axis=(1, 2)) for own in columns]))
        scales = {p: 1.0 / max(float(s), 1e-9) for p, s in zip(library, size, strict=True)}
        best = screen(problem.scaled(scales), point, state.paths, terms, threshold(len(library)))
        if best and best[0].evidence > threshold(len(library)):
            depends = best[0].candidate.paths[0]
    return Left(tuple(coloured), depends)


def is_coloured(error: np.ndarray, stretch: np.ndarray, fitted: np.ndarray | None = None) -> bool:
    """Whether errors are surely not white, and their colour would predict more than `EXCESS` of them.

    fitted: (n, q), orthonormal columns of what was fitted.
    """
    white = whiteness(error, stretch, fitted=fitted)
    return white.p_value < WHITE and float((white.correlation**2).sum()) > EXCESS
