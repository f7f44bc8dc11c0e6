"""Evenly sampled signals of records, their lags as the columns of a regression, and its least-squares solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import listed
from auv_gym.records.record import Record, records_of
from identification.linear.polynomials.structure import Row, Term
from identification.linear.triangles import triangle_tall

SAMPLES_PER_COEFFICIENT = 4


@dataclass(frozen=True, eq=False)
class Series:
    """Inputs and outputs of records at even steps, one array for each segment.

    inputs, outputs: channel names.  dt: s.  u, y: of each segment, (n, n_inputs) and (n, n_outputs); angles are
    continuous within a segment and start within half a turn of the start of the first segment.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt: float
    u: tuple[np.ndarray, ...]
    y: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, records: Sequence[Record], inputs: Sequence[str], outputs: Sequence[str], name: str) -> Series:
        """The signals of records; raises, naming the estimator `name`, if they do not suit a linear model."""
        records = records_of(f"{name}.fit", records)
        names = (*inputs, *outputs)
        dt = _plain(records[0].sample_interval)
        parts = []
        for record in records:
            values = record.matrix(names)
            if not np.isfinite(values).all():
                for channel_name in names:
                    _check_finite(record, channel_name, name)
            _check_even(record, dt, name)
            parts += [values[part] for part in record.segments]
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
    """The regression target = matrix @ coefficients + error, over all rows with all their lags in their own segment.

    joint: (N, n + 1), the columns and then the target.  terms: of the columns; the ones of an intercept come after
    them.
    """

    joint: np.ndarray
    terms: tuple[Term, ...]

    @property
    def matrix(self) -> np.ndarray:
        return self.joint[:, :-1]

    @property
    def target(self) -> np.ndarray:
        return self.joint[:, -1]

    @cached_property
    def triangle(self) -> np.ndarray:
        """R of the QR decomposition of `joint`, which holds all of its information."""
        return triangle_tall(self.joint)


class Signals(Protocol):
    """Inputs u and outputs y of each segment, (n, m) and (n, p)."""

    @property
    def u(self) -> tuple[np.ndarray, ...]: ...

    @property
    def y(self) -> tuple[np.ndarray, ...]: ...


def regression(series: Signals, row: Row, start: int = 0, intercept: bool = False) -> Regression:
    """The regression of an output on the negative lags of outputs and the lags of inputs in its equation.

    start: minimum number of samples at the beginning of each segment used only as lags; lags of errors are left out.
    """
    known = [k for k, term in enumerate(row.terms) if term.kind != "c"]
    free = [k for k, term in enumerate(row.free_terms) if term.kind != "c"]
    base, mix = row.base[known], row.mix[np.ix_(known, free)]
    start, width = max(start, row.first), len(known) + intercept
    fixed = base.any() or len(free) < len(known)
    joint = np.ones((sum(max(len(y) - start, 0) for y in series.y), width + 1), order="F")
    at = 0
    for u, y in zip(series.u, series.y, strict=True):
        count = max(len(y) - start, 0)
        for place, k in enumerate(known if count else ()):
            term = row.terms[k]
            signal, sign = (y, -1.0) if term.kind == "a" else (u, 1.0)
            lagged = signal[start - term.lag : len(y) - term.lag, term.number]
            np.multiply(lagged, sign, out=joint[at : at + count, place])
        joint[at : at + count, -1] = y[start:, row.number]
        at += count
    if fixed:
        columns = joint[:, : len(known)]
        joint = np.column_stack([columns @ mix, joint[:, len(known) : width], joint[:, -1] - columns @ base])
    return Regression(joint, tuple(row.free_terms[k] for k in free))


def solve(problem: Regression, name: str, output: str) -> np.ndarray:
    """The least-squares coefficients; raises, naming the estimator `name`, if the data do not determine them."""
    samples, count = len(problem.joint), problem.joint.shape[1] - 1
    triangle = problem.triangle  # its singular values equal those of the columns
    size = np.sqrt(np.sum(triangle[:, :count] ** 2, axis=0))
    size[size == 0.0] = 1.0
    left, values, right = np.linalg.svd(triangle[:count, :count] / size)
    tolerance = 10.0 * np.finfo(float).eps * samples
    if values[-1] <= tolerance * values[0]:
        raise ValueError(_not_told_apart(name, output, problem.terms, right[values <= tolerance * values[0]]))
    return (right.T @ ((left.T @ triangle[:count, -1]) / values)) / size


def _plain(dt: float) -> float:
    """The interval without rounding errors of times, so that it equals the dt of an environment."""
    short = float(f"{dt:.6g}")
    return short if abs(short - dt) <= 1e-7 * dt else dt


def _not_told_apart(name: str, output: str, terms: Sequence[Term], directions: np.ndarray) -> str:
    involved = np.max(np.abs(directions), axis=0) > 0.1
    lags: dict[str, list[str]] = {}
    for term, part in zip(terms, involved):  # an intercept has no term
        if part:
            lags.setdefault(term.channel, []).append(str(term.lag))
    which = listed([f"{c} at lag{'s' * (len(found) > 1)} {listed(found)}" for c, found in lags.items()])
    inputs = [c for c in lags if c != output]
    moved = f"excite {listed(inputs)} with more frequencies" if inputs else "excite the inputs with more frequencies"
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
