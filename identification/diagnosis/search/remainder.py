"""Tests of whether the errors of a fitted filter hold more than noise."""

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
from identification.fit.coloured import coloured_channels, of_rounding
from identification.fit.parameters import moves_of
from identification.fit.validation import whiteness


@dataclass(frozen=True)
class Left:
    """What the filter's errors hold beyond noise.

    coloured: channels whose errors are not white.  bursts: channels whose errors are large at some times and small at
    others.  gusts: velocities that are pushed harder at some times.  misread: channels whose lasting errors are larger
    at some times.  slow: states pushed by noise that lasts too long.  depends: the strongest dependence on a signal.
    changes: a coefficient or an effect in which parts of the record contradict each other, or "".  passing: an effect
    that parts of the record show but the whole does not, or "".
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
    """What the errors of the filter hold beyond noise.

    Process noise is assumed to be random and steady: if it follows speeds, depths, angles or commands, comes in bursts,
    or lasts too long, it is an unknown effect.  A coefficient that differs between parts of the record is no constant,
    nor is a clock whose rate does.  Whiteness, bursts, gusts, slowness, dependence, change and clock are one test each,
    with a false-alarm probability of `LEFT`.
    """
    problem, point = bench.problem, state.point
    if not np.isfinite(point.scores).all():  # a filter that diverged explains nothing
        return Left(tuple(problem.channels))
    level, rounding = LEFT / len(problem.channels), of_rounding(problem, point)
    bursts = [
        name
        for c, (name, seen) in enumerate(zip(problem.channels, problem.finite.T, strict=True))
        if not rounding[c] and comes_in_bursts(point.errors[seen, c], problem.stretch_of_row[seen], level)
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
    """An effect whose size surely differs between parts of the record, although the whole shows none; or "".

    Something that begins, ends or slips within a record is not a lasting effect, and random accelerations replace it:
    weaker ones are tried, too.  For a vehicle with many states, only the likeliest effects are tested.
    """
    paths = list(dict.fromkeys(p for c in candidates if not c.jumps for p in c.paths if p not in state.paths))
    if not paths or not bench.goes_on("looked for an effect that acts in a part of the log"):
        return ""
    likeliest = paths if bench.followed <= FEW_STATES else likeliest_to_change(bench, state, paths, CONTENDERS)
    least = steadiness(bench, state, likeliest, tried=len(paths), level=LEFT)
    return least.path if least.probability < LEFT else ""


def likeliest_to_change(bench: Workbench, state: State, paths: Sequence[str], count: int) -> list[str]:
    """The `count` paths whose sizes seem to differ most between sixths of the record.

    The regression uses the response to each path throughout, cut where the sixths begin.  It leaves out later
    consequences of the earlier sixths, and costs one column a path instead of six.
    """
    problem, point = bench.problem, state.point
    regression = Regression(problem, point, state.paths, 0.0)
    later = np.array([bench.block_of_row >= k * BLOCKS // MOST_PARTS for k in range(1, MOST_PARTS)], dtype=float)
    evidence = {}
    for path, column in zip(paths, problem.columns_of(point, moves_of(paths)), strict=True):
        cut = problem.flattened(column * later[:, :, None])
        evidence[path] = regression.evidence_of(cut)
    return sorted(evidence, key=lambda path: -evidence[path])[:count]


def comes_in_bursts(error: np.ndarray, stretch: np.ndarray, level: float) -> bool:
    """Whether large errors surely follow each other more often than by chance, enough to predict squared errors.

    White errors of steady size have white squares.  A square is limited to `SURE` usual deviations, so that outliers
    make no burst.  level: probability of a false alarm.
    Source: McLeod and Li 1983, Journal of Time Series Analysis 4, pages 269-273.
    """
    usual = max(float(np.median(error**2)), 1e-300) / float(chi2.median(1))
    square = np.minimum(error**2 / usual, SURE**2)
    white = whiteness(square - square.mean(), stretch)
    predicts = float((white.correlation**2).sum()) > EXCESS and float(white.correlation.sum()) > 0.0
    return white.p_value < level and predicts
