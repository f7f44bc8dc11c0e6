"""Evenly sampled signals of records, their lags as the columns of a regression, and its least-squares solution."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from auv_gym.channels import channel
from auv_gym.record import Record
from identification.linear.structure import Row, Term

if TYPE_CHECKING:
    from identification.linear.scaled import Scaled

SAMPLES_PER_COEFFICIENT = 4
SPAN = 1024  # rows that are decomposed at a time


@dataclass(frozen=True, eq=False)
class Series:
    """Inputs and outputs of records at even steps, one array for each segment.

    inputs, outputs: channel names.  dt: s.  u, y: of each segment, (n, n_inputs) and (n, n_outputs); angles are
    continuous in a segment and start within half a turn of where the first segment starts.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt: float
    u: tuple[np.ndarray, ...]
    y: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, records: Sequence[Record], inputs: Sequence[str], outputs: Sequence[str], name: str) -> Series:
        """The signals of records; raises, on behalf of the estimator `name`, where a linear model cannot have them."""
        if not records:
            raise ValueError(f"{name}.fit needs at least one record, got none.")
        names = (*inputs, *outputs)
        dt = _plain(records[0].sample_interval)
        for record in records:
            for channel_name in names:
                _check_finite(record, channel_name, name)
            _check_even(record, dt, name)
        parts = [np.array(record.matrix(names)[part]) for record in records for part in record.segments]
        for column, channel_name in enumerate(names):
            if channel(channel_name).angle:
                for part in parts:
                    part[:, column] = np.unwrap(part[:, column])
                    turns = np.round((part[0, column] - parts[0][0, column]) / (2.0 * np.pi))
                    part[:, column] -= 2.0 * np.pi * turns
        m = len(inputs)
        return cls(
            tuple(inputs),
            tuple(outputs),
            dt,
            tuple(part[:, :m] for part in parts),
            tuple(part[:, m:] for part in parts),
        )


@dataclass(frozen=True, eq=False)
class Regression:
    """target = matrix @ coefficients + error, over all rows that have all their lags in their own segment.

    target: (N,).  matrix: (N, n).  terms: of each column.
    """

    target: np.ndarray
    matrix: np.ndarray
    terms: tuple[Term, ...]


def regression(series: Series | Scaled, row: Row, start: int = 0) -> Regression:
    """The regression of an output on -1 times lags of outputs and on lags of inputs, as its equation has them.

    start: samples at the beginning of each segment that serve as lags only, at least; errors' lags are left out.
    """
    known = [k for k, term in enumerate(row.terms) if term.kind != "c"]
    free = [k for k, term in enumerate(row.free_terms) if term.kind != "c"]
    base, mix = row.base[known], row.mix[np.ix_(known, free)]
    start = max(start, row.first)
    targets, matrices = [np.empty(0)], [np.empty((0, len(free)))]
    for u, y in zip(series.u, series.y, strict=True):
        if len(y) > start:
            columns = np.empty((len(y) - start, len(known)), order="F")
            for place, k in enumerate(known):
                term = row.terms[k]
                signal, sign = (y, -1.0) if term.kind == "a" else (u, 1.0)
                np.multiply(signal[start - term.lag : len(y) - term.lag, term.number], sign, out=columns[:, place])
            fixed = base.any()
            targets.append(y[start:, row.number] - columns @ base if fixed else y[start:, row.number])
            matrices.append(columns @ mix if fixed or len(free) < len(known) else columns)
    return Regression(np.concatenate(targets), np.concatenate(matrices), tuple(row.free_terms[k] for k in free))


def solve(problem: Regression, name: str, output: str, intercept: bool = True) -> np.ndarray:
    """The least-squares coefficients, with an intercept last where it is asked for.

    Raises, on behalf of the estimator `name`, where the data do not determine them.
    """
    count = len(problem.terms) + intercept
    samples = problem.target.size
    if samples < SAMPLES_PER_COEFFICIENT * count:
        raise ValueError(
            f"{name} needs at least {SAMPLES_PER_COEFFICIENT} samples per coefficient ({count} coefficients of "
            f"{output}), got {samples} that have all their lags: record longer or ask for fewer lags."
        )
    # centred columns have the intercept solved for, and keep the digits that a large mean would take
    middle = problem.matrix.mean(axis=0) if intercept else np.zeros(len(problem.terms))
    level = float(problem.target.mean()) if intercept else 0.0
    full = np.sqrt(np.einsum("ij,ij->j", problem.matrix, problem.matrix))
    triangle = triangle_of(
        np.column_stack([problem.matrix[rows] - middle, problem.target[rows] - level]) for rows in spans(samples)
    )
    size = np.sqrt(np.sum(triangle[:, : full.size] ** 2, axis=0))
    still = size <= 1e-12 * full
    if still.any():
        idle = dict.fromkeys(term.channel for term, quiet in zip(problem.terms, still) if quiet)
        raise ValueError(
            f"{name} cannot fit {output}: {_and(list(idle))} {'is' if len(idle) == 1 else 'are'} constant throughout. "
            "Use a record in which it moves, or leave it out of the inputs."
        )
    # all that the data tell is in the triangle, whose singular values are those of the columns
    left, values, right = np.linalg.svd(triangle[: size.size, : size.size] / size)
    tolerance = 10.0 * np.finfo(float).eps * max(problem.matrix.shape)
    if values[-1] <= tolerance * values[0]:
        raise ValueError(_not_told_apart(name, output, problem.terms, right[values <= tolerance * values[0]]))
    coefficients = (right.T @ ((left.T @ triangle[: size.size, -1]) / values)) / size
    return np.append(coefficients, level - middle @ coefficients) if intercept else coefficients


def triangle_of(parts: Iterable[np.ndarray]) -> np.ndarray:
    """R of the QR decomposition of parts below one another, square and with zero rows where they have too few."""
    r = np.empty((0, 0))
    for part in parts:
        r = np.asarray(np.linalg.qr(np.concatenate([r.reshape(-1, part.shape[1]), part]), mode="r"))
    return np.concatenate([r, np.zeros((r.shape[1] - r.shape[0], r.shape[1]))])


def spans(count: int) -> list[slice]:
    """Rows in parts small enough to stay in a processor's cache."""
    return [slice(at, min(at + SPAN, count)) for at in range(0, max(count, 1), SPAN)]


def _plain(dt: float) -> float:
    """The interval without the rounding of times that it was taken from, so that it equals the dt of an environment."""
    short = float(f"{dt:.6g}")
    return short if abs(short - dt) <= 1e-7 * dt else dt


def _not_told_apart(name: str, output: str, terms: Sequence[Term], directions: np.ndarray) -> str:
    involved = np.max(np.abs(directions), axis=0) > 0.1
    lags: dict[str, list[str]] = {}
    for term, part in zip(terms, involved, strict=True):
        if part:
            lags.setdefault(term.channel, []).append(str(term.lag))
    which = _and([f"{c} at lag{'s' * (len(found) > 1)} {_and(found)}" for c, found in lags.items()])
    inputs = [c for c in lags if c != output]
    moved = f"excite {_and(inputs)} with more frequencies" if inputs else "excite the inputs with more frequencies"
    return (
        f"{name} cannot fit {output}: this record does not tell {which} apart. Ask for fewer lags, or {moved}, "
        "independent of the feedback."
    )


def _check_finite(record: Record, name: str, estimator: str) -> None:
    bad = ~np.isfinite(record[name])
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(
            f"{estimator} needs a value of {name} in every sample, got none in {int(bad.sum())} of {bad.size}, first "
            f"at {record.time[row]:g} s: leave those out with record.select(numpy.isfinite(record[{name!r}]))."
        )


def _check_even(record: Record, dt: float, estimator: str) -> None:
    if not record.is_uniform():
        raise ValueError(
            f"{estimator} needs even samples, got intervals that differ from the median {record.sample_interval:g} s: "
            f"call record.resample({record.sample_interval:g}) first."
        )
    if abs(record.sample_interval - dt) > 1e-3 * dt:
        raise ValueError(
            f"{estimator} needs one sample interval in all records, got {dt:g} and {record.sample_interval:g} s: "
            f"call record.resample({max(dt, record.sample_interval):g}) first."
        )


def _and(words: Sequence[str]) -> str:
    return " and ".join(part for part in (", ".join(words[:-1]), words[-1]) if part)
