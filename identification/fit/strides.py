"""The number of samples over which readings of a dense record may be averaged with hardly any loss of information."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from auv_gym.plant import Chart, Plant
from auv_gym.records.record import Record
from identification.deciding import SURE
from identification.fit.followed import Point
from identification.fit.intervals import FirstOrder, first_order
from identification.fit.parameters import STEP, kinked
from identification.fit.prediction_errors import PredictionErrors

# largest relative growth of the variance of a fitted parameter, whose standard error grows by an eighth at most, and of
# that of a candidate effect, by less than a quarter: the least visible effect grows by as much; a search is twice as
# fast
MOST_LOST, MOST_OF_EFFECTS = 0.25, 0.5
# the same for an effect whose probe, the least change worth finding, is `_PLAIN` standard errors: evidence of
# a hundred, five times the bar of a hundred candidates
_MOST_OF_PLAIN, _PLAIN = 1.0, 10.0
# least rows of a record, needed to judge whiteness; for vehicles with few states, whose fits are fast, and with
# many states, whose filter takes ten times as long for a row
LEAST_ROWS, _LEAST_OF_MANY, _MANY_STATES = 1500, 500, 8
MOST_ROWS = 3000  # most rows of a record, whatever the loss: a filter's time is proportional to its rows
_LEAST_OF_WINDOW = 8  # least rows of a window
_STRIDES, _REFERENCE = (20, 15, 10, 7, 5, 4, 3), 2
_JUDGED, _PIECES = 1500, 6  # samples by which strides are judged, and the number of pieces for longer records
_ABOUT_CORNERS = 1.0  # step, in scales, for slopes of an effect with a corner: a smaller effect changes nothing
_SEEN = 1e-4  # share of a parameter's slopes that must remain with the others' projected out for it to count
_NOTHING = 1e-12  # squared slopes below this are rounding error
MOST_MISLED = 0.5  # largest bias of a fit by averaging, in standard errors


def stride_for(
    plant: Plant,
    record: Record,
    windows: Sequence[slice],
    fitted: Sequence[str],
    others: Sequence[str] = (),
    *,
    doubt: float = np.inf,
    process: bool = True,
) -> int:
    """The most samples to a row at which no parameter's variance grows by more than `MOST_LOST` or `MOST_OF_EFFECTS`.

    More is lost only if a record is so long that it shows an effect anyway, or has more than `MOST_ROWS` rows, which
    would take too long.  fitted: paths that are fitted together.  others: each beside these.
    Strides are judged by filters with the noises of a fit's first guess: if these overestimate accelerations, more of
    the information is in fast changes, and rows are shorter.  Variances are compared with those of rows of two samples,
    since filters along single readings are poor before a fit.  The loss of these two samples is added: as much for each
    sample as longer rows lose, which is more than for a smooth signature.  Rows are also short enough for the filter of
    the given vehicle, which may be far from its record, to stay near its linearisation.
    """
    samples = sum(w.stop - w.start for w in windows)
    shortest = min(w.stop - w.start for w in windows)
    rows = LEAST_ROWS if len(plant.family.states) < _MANY_STATES else _LEAST_OF_MANY
    most = min(samples // rows, shortest // _LEAST_OF_WINDOW)
    tried = [s for s in _STRIDES if s <= most]
    if not tried or not (fitted or others) or Chart.along(plant.family, record).on:  # a chart refers to single samples
        return 1
    least = _least(samples, tried)
    tried = [s for s in tried if s > least]
    if not tried:
        return least
    pieces = _spread_out(windows, samples)
    judged = sum(w.stop - w.start for w in pieces)
    short = PredictionErrors(plant, record, pieces, doubt=doubt, process=process, stride=_REFERENCE)
    point = short.first_point()
    if not np.isfinite(point.scores).all():
        return least
    told = _variances(short, point, fitted, others)

    def loses_little(stride: int) -> bool:
        problem = PredictionErrors(
            plant, record, pieces, doubt=doubt, process=process, stride=stride, guess=short.guess
        )
        there = problem.first_point(point.logs) if problem.pushed == short.pushed else None
        if there is None or not np.isfinite(there.scores).all() or not problem.follows(point.logs):
            return False
        lost = (_variances(problem, there, fitted, others) - told) * (stride - 1) / (stride - _REFERENCE)
        plain = (told + lost) * judged / samples < (1.0 / _PLAIN) ** 2
        most = np.where(plain, _MOST_OF_PLAIN, MOST_OF_EFFECTS)
        most[: len(fitted)] = MOST_LOST
        return bool(np.all(lost <= most * told))

    return _longest(sorted(tried), loses_little, least)


def in_suited_rows(problem: PredictionErrors, point: Point, paths: Sequence[str]) -> PredictionErrors:
    """The problem in the longest rows, its own or half as long and so on, that do not bias the fit of a point.

    A controller reacts to each reading at once.  If its commands answer readings of their own row, they carry
    information that the filter does not have yet, and the prediction errors are no longer independent of them: the fit
    is biased (Forssell and Ljung 1999), the more the longer the rows are.
    Rows of single readings, or the shortest that a long record allows, must lead to the same parameters, up to the
    information that longer rows lose (Hausman 1978, Econometrica 46).  Rows mislead if they surely move a parameter by
    more than `MOST_MISLED` standard errors.
    """
    finest = in_shortest_rows(problem) if paths else problem
    known = None if finest is problem else _next_step(finest, point, paths)
    while problem is not finest and _misled(_next_step(problem, point, paths), known):
        half = problem.stride // 2
        problem = problem.in_rows_of(half) if half > finest.stride else finest
    return problem


def in_shortest_rows(problem: PredictionErrors) -> PredictionErrors:
    """The problem in rows of single readings, or in the shortest that a long record allows."""
    least = _least_of(problem)
    return problem.in_rows_of(least) if problem.stride > least else problem


def cannot_be_shorter(problem: PredictionErrors) -> bool:
    """Whether rows of several samples are the shortest that a long record allows."""
    return 1 < problem.stride <= _least_of(problem)


def _misled(told: FirstOrder | None, known: FirstOrder | None) -> bool:
    """Whether a step of a fit differs from that of shorter rows, see `_next_step`; False if either is None."""
    if told is None or known is None:
        return False
    chance = np.sqrt(np.maximum(told.variances - known.variances, 0.0))
    return bool(np.any(np.abs(known.ways - told.ways) > MOST_MISLED * np.sqrt(told.variances) + SURE * chance))


def _next_step(problem: PredictionErrors, point: Point, paths: Sequence[str]) -> FirstOrder | None:
    """The next step of a fit in a point's paths, with the noises held, and the variances.

    point: possibly of other rows.  None if it has other noises than the problem, or the filter diverges.
    """
    if point.logs.size != len(problem.channels) + 2 * len(problem.pushed):
        return None
    here = problem.point(point.vector, point.logs, replace(point, system=None))  # with responses of its own rows
    if not np.isfinite(here.scores).all():
        return None
    return first_order(problem, here, paths, np.diag(problem.pulls(here.vector, paths)[1] ** 2))


def _least(samples: int, tried: Sequence[int]) -> int:
    """The shortest of some strides at which a record has at most `MOST_ROWS` rows; the first if none is long enough."""
    if samples <= MOST_ROWS * _REFERENCE:
        return 1
    return min((s for s in tried if s * MOST_ROWS >= samples), default=tried[0])


def _least_of(problem: PredictionErrors) -> int:
    """The shortest stride that the record of a problem allows."""
    return _least(len(problem.rows) * problem.stride, _STRIDES)


def _longest(strides: Sequence[int], suits: Callable[[int], bool], least: int) -> int:
    """The longest suitable stride, by bisection of strides in ascending order; longer ones suit no better."""
    low, high = 0, len(strides)
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if suits(strides[middle]) else (low, middle)
    return strides[low - 1] if low else least


def _spread_out(windows: Sequence[slice], samples: int) -> list[slice]:
    """The windows, or if they have too many samples, pieces that are spread evenly over them."""
    if samples <= _JUDGED:
        return list(windows)
    size, found = _JUDGED // _PIECES, []
    every = np.concatenate([np.arange(w.start, w.stop) for w in windows])
    of = np.repeat(np.arange(len(windows)), [w.stop - w.start for w in windows])
    for middle in (np.arange(_PIECES) + 0.5) / _PIECES * samples:
        own = windows[int(of[int(middle)])]
        start = max(int(every[int(middle)]) - size // 2, own.start, found[-1].stop if found else 0)
        if start + size <= own.stop:
            found.append(slice(start, start + size))
        elif own.start >= (found[-1].stop if found else 0):
            found.append(slice(max(own.start, own.stop - size), own.stop))
    return found


def _variances(problem: PredictionErrors, point: Point, fitted: Sequence[str], others: Sequence[str]) -> np.ndarray:
    """Variances of the paths, in squared scales, noises known; zero if the record does not determine them.

    (fitted and others,): the first all fitted together, the others one at a time beside them.
    """
    paths = [*fitted, *others]
    moves = [(p, _ABOUT_CORNERS if kinked(p) else STEP) for p in paths]
    slopes = problem.flattened(problem.columns_of(point, moves))
    flat = problem.without_starts(point, slopes)
    normal = flat @ flat.T
    normal += np.diag(problem.pulls(point.vector, paths)[1] ** 2)
    count, full = len(fitted), np.maximum((slopes**2).sum(axis=1), 1e-300)
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    normal /= np.outer(size, size)
    inverse = np.linalg.pinv(normal[:count, :count], rcond=1e-12, hermitian=True)
    left = 1.0 / np.maximum(np.diag(inverse), 1e-12)
    cross = normal[count:, :count]
    beside = np.diag(normal)[count:] - np.einsum("ij,jk,ik->i", cross, inverse, cross)
    told = np.r_[left, beside] * size**2
    return np.where(told > np.maximum(_SEEN * full, _NOTHING), 1.0 / np.maximum(told, 1e-300), 0.0)
