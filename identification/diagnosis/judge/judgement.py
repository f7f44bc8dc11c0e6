"""How well a diagnosis explains its record: the share of the error that goes, what is left, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.diagnosis.judge.verdict import Stage, Verdict
from identification.diagnosis.search.acceptance import MANY_WINDOWS, threshold
from identification.diagnosis.search.candidates import Candidate, screen
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.residual import noise_floors
from identification.fit.validation import whiteness

WHITE = 1e-4  # p value of the whiteness test below which a residual is coloured
EXCESS = 0.01  # of the variance: colour that predicts less of it is left to the noise
EXPLAINED = 0.5  # share of the excess error that named effects must remove to count as the explanation


@dataclass(frozen=True)
class Left:
    """What the filter's errors still hold, which noise would not.

    coloured: channels whose errors are not white.  depends: the term of the library on which they depend most, or "".
    """

    coloured: tuple[str, ...]
    depends: str

    def __bool__(self) -> bool:
        return bool(self.coloured or self.depends)


def explained_share(before: Stage, after: Stage, many: bool) -> float:
    """Share of the squared error above the measurement noise that the effects remove.

    Of free runs in the held-out windows; where these are not `many`, of runs from fitted states in all windows.
    """
    fitted, excess = after.fitted, {}
    floors = noise_floors(fitted.residual, fitted.window, fitted.readings)
    for name, stage in (("before", before), ("after", after)):
        runs = stage.held if many else stage.fitted
        total = 0.0
        for c in range(len(runs.channels)):
            squares = runs.residual[runs.scored, c] ** 2
            total += max(float(np.nanmean(squares)) / floors[c] ** 2 - 1.0, 0.0)
        excess[name] = total
    return 1.0 - excess["after"] / excess["before"] if excess["before"] > 0.0 else 0.0


def many_windows(held: Sequence[slice], steady: bool) -> bool:
    """Whether free runs over the held-out windows say enough."""
    return len(held) >= MANY_WINDOWS and steady


def verdict_of(effects, tied, explained: float, left: bool, refit_is_all: bool, wrong: bool) -> Verdict:
    """Where something is left, effects must explain most of the excess error; a refit alone does not do."""
    if left and (refit_is_all or explained < EXPLAINED):
        return "unexplained"
    if effects:
        return "tied" if tied else "named"
    return "coefficients" if wrong else "none"


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
        size = np.sqrt(
            (problem.scaled(dict.fromkeys(library, 1.0)).columns_of(point, [(p, 1e-6) for p in library]) ** 2).sum(
                axis=(1, 2)
            )
        )
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
