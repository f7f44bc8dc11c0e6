"""What the errors of a fitted filter still hold, which noise would not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from scipy.stats import chi2

from identification.deciding import BLOCKS, CONTENDERS, EXCESS, FEW_STATES, LEFT, MOST_PARTS, SURE
from identification.diagnosis.search.candidates import Candidate, Regression
from identification.diagnosis.search.constancy import steadiness
from identification.diagnosis.search.dependence import CLOCK, Dependence, clock_varies, dependence
from identification.diagnosis.search.gusts import gusts, slow
from identification.diagnosis.search.workbench import State, Workbench
from identification.fit.coloured import coloured_channels
from identification.fit.parameters import moves_of
from identification.fit.validation import whiteness


@dataclass(frozen=True)
class Left:
    """What the filter's errors still hold, which noise would not.

    coloured: channels whose errors are not white.  bursts: those whose errors are large at some times and small at
    others.  gusts: velocities that are pushed harder at some times.  misread: channels whose lasting errors are larger
    at some times.  slow: what noise pushes that lasts longer than noise may.  depends: what they depend on most.
    changes: a coefficient or an effect in which parts of the record contradict each other, or "".  passing: an effect
    that the whole record does not show, but parts of it do, or "".
    """

    coloured: tuple[str, ...] = ()
    bursts: tuple[str, ...] = ()
    gusts: tuple[str, ...] = ()
    misread: tuple[str, ...] = ()
    slow: tuple[str, ...] = ()
    depends: Dependence | None = None
    changes: str = ""
    passing: str = ""

    def __bool__(self) -> bool:
        return any(getattr(self, told.name) for told in fields(self))


def what_is_left(bench: Workbench, state: State) -> Left:
    """What the errors of the filter hold that noise would not.

    Process noise is taken to be random and steady: where it follows speeds, depths, angles or commands, or comes in
    bursts, or lasts longer than any may, it is an effect that nobody knows.  A coefficient that differs from one part
    of the record to the next is none, nor is a clock whose rate does.  Colour, bursts, gusts, slowness, dependence,
    change and clock are a test each, and each sees something in a share `LEFT` of the records without.
    """
    problem, point = bench.problem, state.point
    if not np.isfinite(point.scores).all():  # a filter that is lost explains nothing
        return Left(tuple(problem.channels))
    level = LEFT / len(problem.channels)
    bursts = [
        name
        for c, (name, seen) in enumerate(zip(problem.channels, problem.finite.T, strict=True))
        if comes_in_bursts(point.errors[seen, c], problem.stretch_of_row[seen], level)
    ]
    own, changes = [p for p in state.paths if p in state.plant.doubted], ""
    if own and (least := steadiness(bench, state, own, quietly=False, level=LEFT)).probability < LEFT:
        changes = least.path
    elif clock_varies(bench, state):
        changes = CLOCK
    pushed, misread = gusts(problem, point)
    coloured, depends = coloured_channels(problem, point), dependence(bench, state)
    return Left(coloured, tuple(bursts), pushed, misread, slow(problem, point), depends, changes)


def passing_effect(bench: Workbench, state: State, candidates: Sequence[Candidate]) -> str:
    """An effect of which parts of the record surely have different sizes, though its whole shows none; or "".

    What begins, ends or slips within a record is none of the effects that last, and random accelerations take its
    place: where they have grown for it, weaker ones are tried.  Of a vehicle with many states only the likeliest
    effects are asked for.
    """
    paths = list(dict.fromkeys(p for c in candidates if not c.jumps for p in c.paths if p not in state.paths))
    if not paths or not bench.goes_on("looked for an effect that acts in a part of the log"):
        return ""
    likeliest = paths if bench.followed <= FEW_STATES else likeliest_to_change(bench, state, paths, CONTENDERS)
    least = steadiness(bench, state, likeliest, tried=len(paths), level=LEFT)
    return least.path if least.probability < LEFT else ""


def likeliest_to_change(bench: Workbench, state: State, paths: Sequence[str], count: int) -> list[str]:
    """The paths of which sixths of the record seem to have the most different sizes, so many of them.

    By a regression on what each does throughout, cut where the sixths begin: what it leaves behind there is left out,
    which costs a column a path instead of six.
    """
    problem, point = bench.problem, state.point
    regression = Regression(problem, point, state.paths, 0.0)
    later = np.array([bench.block_of_row >= k * BLOCKS // MOST_PARTS for k in range(1, MOST_PARTS)], dtype=float)
    evidence = {}
    for path, column in zip(paths, problem.columns_of(point, moves_of(paths)), strict=True):
        cut = problem.counted_flat(column * later[:, :, None])
        evidence[path] = regression.evidence_of(cut)
    return sorted(evidence, key=lambda path: -evidence[path])[:count]


def comes_in_bursts(error: np.ndarray, stretch: np.ndarray, level: float) -> bool:
    """Whether a large error is surely followed by large ones more often than by chance, and that would predict squares.

    White errors of steady size have white squares.  A square counts up to `SURE` usual deviations, so that wild
    readings make no burst.  level: probability of a yes where there are none.
    Source: McLeod and Li 1983, Journal of Time Series Analysis 4, pages 269-273.
    """
    usual = max(float(np.median(error**2)), 1e-300) / float(chi2.median(1))
    square = np.minimum(error**2 / usual, SURE**2)
    white = whiteness(square - square.mean(), stretch)
    predicts = float((white.correlation**2).sum()) > EXCESS and float(white.correlation.sum()) > 0.0
    return white.p_value < level and predicts
