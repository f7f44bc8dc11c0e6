"""Causality check: whether outputs respond before their inputs move, as happens if columns or clocks are shifted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.linalg import norm
from scipy import stats

from auv_gym.channels import excitation_of
from auv_gym.records.record import Record
from identification.linear.regressors import Series

LONGEST = 20  # samples looked ahead
CHANCE = 1e-6  # probability of a false finding at one shift; tens of shifts and pairs are tested
_BY_JUMPS = 1e-10  # the same for jumps, before each of which the effects of earlier moves can repeat
_LAGS = ((1, 2, 3, 4, 6, 8, 12, 16, 24, 32), (1, 2, 3, 4, 6, 8), (1, 2, 3))  # of the predictors, longest first
_ROWS_PER_LAG = 3.0
_REPEATED = 0.05  # of the readings; with more repeated values, they count as coarse
_LONG = 4 * LONGEST  # samples after which a move has no effect left
_FEWEST = 8.0  # moves of an input; fewer are not tested
_JUMP = 6.0  # in standard deviations of the usual moves


@dataclass(frozen=True)
class Lead:
    """An output that moves `samples` samples before an input does; 0: in the same sample.

    chance: probability of so strong a correlation if nothing is shifted.
    """

    input: str
    output: str
    samples: int
    chance: float


@dataclass(frozen=True, eq=False)
class _Moves:
    """Moves of an input that are not caused by feedback.

    row: where, rising.  size: sizes, levels or signs.  rest: rows since the previous move.  drawn: whether they cannot
    be predicted from the past; otherwise they are jumps, whose signs alternate.  picked: whether noise that is fed back
    may decide which of them are large.
    """

    row: np.ndarray
    size: np.ndarray
    rest: np.ndarray
    drawn: bool = False
    picked: bool = False


def check_causality(records: Sequence[Record], inputs: Sequence[str], outputs: Sequence[str]) -> tuple[str, ...]:
    """Warnings for each input and output where the output moves before the input or with it; empty if there is none.

    See `leads` for what can be detected.  Raises for records that no linear model can be fitted to.
    """
    words = []
    for lead in leads(records, inputs, outputs):
        when = f"in the same sample as {lead.input}, and can at the earliest one sample later"
        if lead.samples:
            seconds = lead.samples * records[0].sample_interval
            when = f"{lead.samples} sample{'s' * (lead.samples > 1)} ({seconds:.3g} s) before {lead.input}"
        words.append(f"{lead.output} moves {when}: check the clock or the alignment of the columns.")
    return tuple(words)


def leads(records: Sequence[Record], inputs: Sequence[str], outputs: Sequence[str]) -> tuple[Lead, ...]:
    """Inputs and outputs where the output certainly moves ahead of the input.

    Under feedback, inputs follow the noise of outputs, so a correlation of an output with later inputs proves nothing.
    Moves that feedback does not cause are the excitation at an input, if the record has it, and jumps far beyond the
    input's usual moves, of a PRBS or of a set point.  The prediction error of an output, given the past, must not
    correlate with such moves in the future.  Nothing is detected without either kind of move, nor if a response drowns
    in noise within the shift.  Leads of less than two samples, and leads of coarse readings, are detected only with a
    logged excitation or in open loop.
    """
    series = Series.of(records, inputs, outputs, "check_causality")
    signals = len(series.inputs) + len(series.outputs)
    for lags in _LAGS:
        kept = [k for k, u in enumerate(series.u) if len(u) > lags[-1] + 1]
        rows = sum(len(series.u[k]) - lags[-1] for k in kept)
        if kept and rows >= _ROWS_PER_LAG * (len(lags) * signals + 1):
            break
    else:
        return ()
    u, y = [series.u[k] for k in kept], [series.y[k] for k in kept]
    surprises = _surprises(y, [np.concatenate(pair, axis=1) for pair in zip(u, y, strict=True)], lags)
    begins = np.cumsum([0] + [len(part) - lags[-1] for part in u])
    first = np.repeat(begins[:-1], np.diff(begins))
    before = np.concatenate([part[lags[-1] - 1 : -1] for part in u])
    before = (before - before.mean(axis=0)) / np.where(np.ptp(before, axis=0) > 0.0, before.std(axis=0), 1.0)
    found = []
    for i, name in enumerate(series.inputs):
        own = [part[:, [i]] for part in u]
        moves = _moves(own, _excitation(records, name, kept), lags)
        if moves is None:
            continue
        for j, output in enumerate(series.outputs):
            coarse = float(np.mean([np.mean(np.diff(part[:, j]) == 0.0) for part in y])) > _REPEATED
            if moves.picked and coarse:
                continue  # steps of a coarse reading make the input jump, too
            chances = _chances(surprises[:, j], moves, first, before)
            if chances.min() < (CHANCE if moves.drawn else _BY_JUMPS):
                found.append(Lead(name, output, int(np.argmin(chances)), float(chances.min())))
    return tuple(found)


def _chances(surprise: np.ndarray, moves: _Moves, first: np.ndarray, before: np.ndarray) -> np.ndarray:
    """The p-values, for shifts of 1 to `LONGEST` samples, of the correlation between errors and later moves.

    first: row where the segment of each begins.  before: the inputs a sample before each row.
    Student's test on products of the moves with sums of the prediction errors just before them.  For unpredictable
    moves, the part of the sums that correlates with earlier inputs is removed; for jumps, only those long after the
    previous one count.
    """
    totals = np.concatenate([np.zeros(1), np.cumsum(surprise)])
    shifts, row = np.arange(1, LONGEST + 1), moves.row[:, None]
    # noise of this sample may have triggered a jump and, by differencing, that of the sample before
    end = row + 1 - 2 * moves.picked
    begin = np.minimum(np.maximum(row + 1 - shifts, first[row]), end)
    sums = totals[end] - totals[begin]
    if moves.drawn:
        known = before[moves.row]
        sums -= known @ np.linalg.lstsq(known, sums, rcond=1e-9)[0]
        size = np.repeat(moves.size[:, None], LONGEST, axis=1)
    else:
        size = np.where(moves.rest[:, None] > 3 * shifts, moves.size[:, None], 0.0)
    score = _score(size * sums)
    count = np.array([_count(column) for column in size.T])
    enough = count >= _FEWEST
    count = np.where(enough, count, _FEWEST)
    spread = np.maximum(count - score**2, 1e-3 * count)  # products of unequal size can exceed this limit
    return np.where(enough, 2.0 * stats.t.sf(np.abs(score) * np.sqrt((count - 1.0) / spread), count - 1.0), 1.0)


def _score(products: np.ndarray) -> np.ndarray:
    """Sums over the first axis in standard deviations of sums of independent products around zero."""
    power = np.sum(products**2, axis=0)
    return np.sum(products, axis=0) / np.sqrt(np.where(power > 0.0, power, 1.0))


def _moves(own: Sequence[np.ndarray], excitation: Sequence[np.ndarray] | None, lags: Sequence[int]) -> _Moves | None:
    """The moves to test of an input: those of its excitation, where the input follows it, or the input's own."""
    surprise = _surprises(own, own, lags)[:, 0]
    if excitation is not None:
        added = _surprises(excitation, excitation, lags)[:, 0]
        moves = _sudden(excitation, added, lags[-1]) or _drawn(np.arange(added.size), added)
        after = _delay(added, surprise)
        inside = (moves.row + after >= 0) & (moves.row + after < added.size)
        moves = _Moves(moves.row[inside] + after, moves.size[inside], moves.rest[inside], moves.drawn)
        answer = surprise[moves.row]
        # a logged excitation may belong to another input, or may never have reached it
        if _count(moves.size) >= _FEWEST and abs(moves.size @ answer) > 0.2 * norm(moves.size) * norm(answer):
            return moves
    return _sudden(own, surprise, lags[-1])


def _sudden(signal: Sequence[np.ndarray], surprise: np.ndarray, start: int) -> _Moves | None:
    """Sudden moves of a signal: levels drawn by a clock, or jumps; None if there are few.

    signal: by segment; its prediction errors begin at the sample `start`.
    """
    size = np.abs(surprise)
    if float(np.median(size)) > _JUMP * _deviation(size):  # a new level at each sample
        return _drawn(np.arange(size.size), np.sign(surprise))
    change = np.concatenate([np.diff(part[start - 1 :, 0]) for part in signal])
    row = np.flatnonzero(np.abs(change) > max(_JUMP * _deviation(change), 1e-6 * float(np.abs(change).max())))
    if row.size < _FEWEST:
        return None
    clock = int(np.gcd.reduce(np.diff(row)))
    picked = clock == 1 or int(np.count_nonzero(change)) > row.size  # the input never rests in between
    if not picked:
        level = np.concatenate([part[start:, 0] for part in signal])
        row = np.arange(row[0] % clock, change.size, clock)
        return _drawn(row, level[row] - level[row].mean())
    return _Moves(row, np.sign(change[row]), np.diff(row, prepend=-_LONG), picked=picked)


def _drawn(row: np.ndarray, size: np.ndarray) -> _Moves:
    """Moves that cannot be predicted from the past."""
    return _Moves(row, size, np.full(row.size, _LONG), drawn=True)


def _delay(signal: np.ndarray, response: np.ndarray) -> int:
    """The delay, in samples, at which a response correlates with a signal most."""
    padded = np.pad(response, LONGEST)
    ties = [abs(float(signal @ padded[at : at + signal.size])) for at in range(2 * LONGEST + 1)]
    return int(np.argmax(ties)) - LONGEST


def _surprises(targets: Sequence[np.ndarray], known: Sequence[np.ndarray], lags: Sequence[int]) -> np.ndarray:
    """Errors of linear predictions of the targets from lags of the known signals, (rows with all lags, n_targets)."""
    start = lags[-1]
    target = np.concatenate([part[start:] - part[0] for part in targets])
    matrix = np.concatenate([_columns(part - part[0], lags) for part in known])
    size = np.sqrt(np.mean(matrix**2, axis=0))
    matrix /= np.where(size > 0.0, size, 1.0)
    product = matrix.T @ matrix
    # signals may be constant, or linearly dependent
    product[np.diag_indices_from(product)] += 1e-10 * len(matrix)
    return target - matrix @ np.linalg.solve(product, matrix.T @ target)


def _columns(signals: np.ndarray, lags: Sequence[int]) -> np.ndarray:
    """A one, each signal's last value, and its changes between lags (the lags themselves would be nearly collinear)."""
    start, n = lags[-1], len(signals)
    earlier = [signals[start - lag : n - lag] for lag in lags]
    changes = [late - early for late, early in pairwise(earlier)]
    return np.concatenate([np.ones((n - start, 1)), earlier[0], *changes], axis=1)


def _excitation(records: Sequence[Record], name: str, kept: Sequence[int]) -> list[np.ndarray] | None:
    """The excitation added at an input, in the kept segments; None if a record has none or it is constant."""
    channel = excitation_of(name)
    if not all(record.has(channel) for record in records):
        return None
    parts = [record[channel][part][:, None] for record in records for part in record.segments]
    chosen = [parts[k] for k in kept]
    values = np.concatenate(chosen)
    return chosen if np.isfinite(values).all() and np.ptp(values) > 0.0 else None


def _count(size: np.ndarray) -> float:
    """The number of moves of equal size with the same information."""
    return float(np.sum(size**2) ** 2 / max(float(np.sum(size**4)), 1e-300))


def _deviation(values: np.ndarray) -> float:
    """Robust standard deviation, from the bulk of the values."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))
