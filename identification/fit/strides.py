"""Over how many samples the readings of a dense record may be averaged at nearly no loss of what they tell."""

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

# of a fitted parameter's variance, whose standard error grows by an eighth at most, and of that of an effect that is
# sought, by less than a quarter: one that is just seen must then be so much larger, and a search takes half the time
MOST_LOST, MOST_OF_EFFECTS = 0.25, 0.5
# the same for an effect whose probe, the least change that is worth finding, is so many standard errors: evidence of
# a hundred, five times the bar of a hundred candidates
_MOST_OF_PLAIN, _PLAIN = 1.0, 10.0
# of a record, however dense: colour is judged by them; of vehicles with few states, whose fits are soon done, and with
# many, where a filter takes ten times as long for a row
LEAST_ROWS, _LEAST_OF_MANY, _MANY_STATES = 1500, 500, 8
MOST_ROWS = 3000  # of a record, whatever longer ones lose: a filter takes as long as it has rows
_LEAST_OF_WINDOW = 8  # rows
_STRIDES, _REFERENCE = (20, 15, 10, 7, 5, 4, 3), 2
_JUDGED, _PIECES = 1500, 6  # samples by which strides are judged, and the pieces of a longer record that they are in
_ABOUT_CORNERS = 1.0  # scales over which slopes are taken where an effect has a corner: a smaller one does nothing
_SEEN = 1e-4  # share of a parameter's slopes that must remain beside the others' for it to count
_NOTHING = 1e-12  # of squared slopes, below which they are rounding
MOST_MISLED = 0.5  # standard errors by which averages may mislead a fit


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

    By more only where a record is so long that it shows an effect all the same, or of more rows than `MOST_ROWS`, which
    no fit would come to the end of.

    fitted: paths that are fitted together.  others: each beside these.
    Judged by filters with the noises of a fit's first guess: where these take accelerations for stronger than they are,
    more of what a record tells is quick, and rows are shorter.  Variances are compared with those of rows of two
    samples, since filters along single readings are poor ones before a fit.  What these lose themselves is added: as
    much for each sample as longer rows lose, which is more than a smooth signature does.  Rows are also so short that
    the filter of the vehicle as it is, which may be far from its record, keeps to its linearisation within them.
    """
    samples = sum(w.stop - w.start for w in windows)
    shortest = min(w.stop - w.start for w in windows)
    rows = LEAST_ROWS if len(plant.family.states) < _MANY_STATES else _LEAST_OF_MANY
    most = min(samples // rows, shortest // _LEAST_OF_WINDOW)
    tried = [s for s in _STRIDES if s <= most]
    if not tried or not (fitted or others) or Chart.along(plant.family, record).on:  # a chart is of each sample
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
    """The problem in the longest rows, of its own or half as long and so on, that do not mislead the fit of a point.

    A controller knows each reading at once.  Where its commands answer readings of the row that they are in, they tell
    of the vehicle what the filter, which has seen none of that row, does not know, and the errors of prediction are no
    longer independent of them: a fit is then biased (Forssell and Ljung 1999), the more the longer the rows are.
    Rows of single readings, or the shortest that a long record allows, must lead to the same parameters but for what
    longer ones lose of what readings tell (Hausman 1978, Econometrica 46).
    Rows mislead if they surely move a parameter by more than `MOST_MISLED` standard errors.
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
    """Whether a step of a fit leads elsewhere than that of shorter rows, see `_next_step`; not where there is none."""
    if told is None or known is None:
        return False
    chance = np.sqrt(np.maximum(told.variances - known.variances, 0.0))
    return bool(np.any(np.abs(known.ways - told.ways) > MOST_MISLED * np.sqrt(told.variances) + SURE * chance))


def _next_step(problem: PredictionErrors, point: Point, paths: Sequence[str]) -> FirstOrder | None:
    """By how much a point's paths would move in a step of a fit, the noises held, and their variances.

    point: perhaps of other rows.  None where it has noises that the problem has not, or the filter runs away.
    """
    if point.logs.size != len(problem.channels) + 2 * len(problem.pushed):
        return None
    here = problem.point(point.vector, point.logs, replace(point, system=None))  # with responses of its own rows
    if not np.isfinite(here.scores).all():
        return None
    return first_order(problem, here, paths, np.diag(problem.pulls(here.vector, paths)[1] ** 2))


def _least(samples: int, tried: Sequence[int]) -> int:
    """The shortest stride of some with which a record has no more than `MOST_ROWS`, as far as there is one."""
    if samples <= MOST_ROWS * _REFERENCE:
        return 1
    return min((s for s in tried if s * MOST_ROWS >= samples), default=tried[0])


def _least_of(problem: PredictionErrors) -> int:
    """The shortest stride that the record of a problem allows."""
    return _least(len(problem.rows) * problem.stride, _STRIDES)


def _longest(strides: Sequence[int], suits: Callable[[int], bool], least: int) -> int:
    """The longest of strides, shortest first, that suits, by bisection: those that are longer suit no better."""
    low, high = 0, len(strides)
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if suits(strides[middle]) else (low, middle)
    return strides[low - 1] if low else least


def _spread_out(windows: Sequence[slice], samples: int) -> list[slice]:
    """The windows, of many samples only pieces that are spread evenly over them."""
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
    """Variances of the paths, in squared scales, noises known; zero of those that the record cannot tell.

    (fitted and others,): each of the first with all of them fitted, of the others one at a time.
    """
    paths = [*fitted, *others]
    moves = [(p, _ABOUT_CORNERS if kinked(p) else STEP) for p in paths]
    slopes = problem.counted_flat(problem.columns_of(point, moves))
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
