"""One-step errors of A(q) y = B(q) u + C(q) e over records, and their derivatives by filtering with 1/C."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from auv_gym.compiled import compiled
from identification.linear.regressors import SPAN, Series, spans, triangle_of
from identification.linear.structure import KINDS, Row, Structure, Term, blocks

_GONE = 1e-40  # below which an effect of a start is nothing; numbers near the smallest are slow to compute with
_INTERCEPT = 3  # its kind, after those of terms


@dataclass(frozen=True, eq=False)
class Linearised:
    """Least squares about a point: the normal equations of the errors, with a block of starts for each segment.

    value: half the sum of squares.  gradient: (P,), of the free parameters.  matrix: (P, P).  start_gradient: (S, q).
    across: (S, P, q).  start_matrix: (S, q, q).
    """

    value: float
    gradient: np.ndarray
    matrix: np.ndarray
    start_gradient: np.ndarray
    across: np.ndarray
    start_matrix: np.ndarray

    def reduced(self, damping: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Normal matrix and gradient of the parameters with the starts solved for, and what solves for the starts."""
        q = self.start_matrix.shape[1]
        if q == 0:
            return self.matrix + damping * np.eye(len(self.gradient)), self.gradient, np.empty(0)
        right = np.concatenate([np.swapaxes(self.across, 1, 2), self.start_gradient[:, :, None]], axis=2)
        solved = np.linalg.solve(self.start_matrix + damping * np.eye(q), right)
        less = np.einsum("spq,sqr->pr", self.across, solved)
        matrix = self.matrix + damping * np.eye(len(self.gradient)) - less[:, :-1]
        return matrix, self.gradient - less[:, -1], solved

    def step(self, damping: float) -> tuple[np.ndarray, np.ndarray]:
        """The damped Gauss-Newton step of parameters and starts."""
        matrix, gradient, solved = self.reduced(damping)
        change = -np.linalg.solve(matrix, gradient)
        if not solved.size:
            return change, np.zeros_like(self.start_gradient)
        return change, -(solved[:, :, :-1] @ change) - solved[:, :, -1]


@dataclass(frozen=True, eq=False)
class Prediction:
    """The errors of some outputs' equations over all segments, as functions of their free parameters.

    Predictions begin where all lags of inputs and outputs are in the segment. The errors before that, on which the
    first ones depend by C, are unknown: they are estimated as starts and count as errors.  Channels come centred
    (middle) and in units of their spread, so that coefficients are of order one; `free` is of such coefficients, row
    by row, with an intercept at the end of each where there is one.
    """

    structure: Structure
    rows: tuple[Row, ...]
    series: Series
    first: int
    intercept: bool
    outputs_scale: np.ndarray
    inputs_scale: np.ndarray
    outputs_middle: np.ndarray
    inputs_middle: np.ndarray

    @classmethod
    def of(cls, series: Series, structure: Structure, block: Sequence[int], intercept: bool, skip: int) -> Prediction:
        """The errors of a block of outputs; segments too short for one prediction are left out."""
        rows = tuple(structure.rows[i] for i in block)
        first = max(skip, *(row.first for row in rows))
        kept = [k for k, y in enumerate(series.y) if len(y) > first]
        u_all, y_all = np.concatenate(series.u), np.concatenate(series.y)
        middles = [x.mean(axis=0) if intercept else np.zeros(x.shape[1]) for x in (u_all, y_all)]
        scales = [np.sqrt(np.mean((x - middle) ** 2, axis=0)) for x, middle in zip((u_all, y_all), middles)]
        scales = [np.where(scale > 0.0, scale, 1.0) for scale in scales]
        u, y = (
            tuple(np.ascontiguousarray((parts[k] - middle) / scale) for k in kept)
            for parts, middle, scale in zip((series.u, series.y), middles, scales)
        )
        plain = replace(series, u=u, y=y)
        return cls(structure, rows, plain, first, intercept, scales[1], scales[0], middles[1], middles[0])

    @property
    def samples(self) -> int:
        """Predictions of each output."""
        return sum(len(y) - self.first for y in self.series.y)

    @cached_property
    def free(self) -> int:
        """How many parameters are fitted, with the intercepts."""
        return sum(row.free + self.intercept for row in self.rows)

    @cached_property
    def lags(self) -> int:
        """The order of C."""
        numbers = [row.number for row in self.rows]
        return int(self.structure.n_c[np.ix_(numbers, numbers)].max(initial=0))

    def starts(self) -> np.ndarray:
        """Starts of zero, shape (segments, order of C times outputs)."""
        return np.zeros((len(self.series.y), self.lags * len(self.rows)))

    def split(self, free: np.ndarray) -> list[np.ndarray]:
        """The parameters of each row, with its intercept."""
        ends = np.cumsum([row.free + self.intercept for row in self.rows])
        return np.split(free, ends[:-1])

    def terms(self, free: np.ndarray) -> np.ndarray:
        """The values of all terms, row by row, with the intercepts."""
        return self._base + self._mix @ free

    def c(self, values: np.ndarray) -> np.ndarray:
        """C of the values of the terms, (powers, r, r) with the unit matrix first."""
        r = len(self.rows)
        c = np.zeros((self.lags + 1, r, r))
        c[0] = np.eye(r)
        lag, row, error, place = self._of_c
        c[lag, row, error] = values[place]
        return c

    def errors(self, free: np.ndarray, starts: np.ndarray) -> list[np.ndarray]:
        """One-step errors of each segment, (order of C + predictions, r); the first are the starts."""
        return [e.copy() for e in self._errors(free, starts)]

    def value(self, free: np.ndarray, starts: np.ndarray, weight: np.ndarray) -> float:
        """Half the sum of squares of the errors times weight (r, r); infinite where C is not stable."""
        if not self.structure.tied and not is_stable(self.c(self.terms(free))):
            return np.inf
        product = weight @ weight.T
        with np.errstate(over="ignore", invalid="ignore"):
            total = 0.5 * sum(float(np.sum(product * (e.T @ e))) for e in self._errors(free, starts))
        return total if np.isfinite(total) else np.inf

    def linearised(self, free: np.ndarray, starts: np.ndarray, weight: np.ndarray, basis: np.ndarray) -> Linearised:
        """The normal equations of parameters z, free = basis z, about a point."""
        size, q = basis.shape[1], starts.shape[1]
        chain, c = self._mix @ basis, self.c(self.terms(free))
        n = len(chain)
        value, gradient, matrix = 0.0, np.zeros(size), np.zeros((size, size))
        start_gradient = np.zeros((len(starts), q))
        across, start_matrix = np.zeros((len(starts), size, q)), np.zeros((len(starts), q, q))
        for s, e in enumerate(self._errors(free, starts)):
            products, along = np.zeros((n + q, n + q)), np.zeros(n + q)
            errors = (e if len(weight) == 1 else e @ weight).reshape(-1)
            at = 0
            for slopes in self._slopes(s, e, c, q, weight):
                products += slopes.T @ slopes
                along += errors[at : at + len(slopes)] @ slopes
                at += len(slopes)
            value += 0.5 * float(errors @ errors)
            gradient += chain.T @ along[:n]
            matrix += chain.T @ products[:n, :n] @ chain
            start_gradient[s], across[s], start_matrix[s] = along[n:], chain.T @ products[:n, n:], products[n:, n:]
        scale = float(weight[0, 0] ** 2) if len(weight) == 1 else 1.0  # of one output, sums are scaled, not columns
        return Linearised(
            scale * value,
            scale * gradient,
            scale * matrix,
            scale * start_gradient,
            scale * across,
            scale * start_matrix,
        )

    def triangle(self, free: np.ndarray, starts: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """R, (P, P), with R' R the normal matrix of the parameters, the starts solved for; without squaring.

        weight: as in `value`.
        """
        q, n, c = starts.shape[1], len(self._mix), self.c(self.terms(free))

        def own(s: int, e: np.ndarray) -> np.ndarray:
            parts = (
                np.concatenate([slopes[:, n:], slopes[:, :n] @ self._mix], axis=1)
                for slopes in self._slopes(s, e, c, q, weight)
            )
            scale = abs(float(weight[0, 0])) if len(weight) == 1 else 1.0
            return scale * triangle_of(parts)[q:, q:]

        return triangle_of(own(s, e) for s, e in enumerate(self._errors(free, starts)))

    def _slopes(self, s: int, e: np.ndarray, c: np.ndarray, q: int, weight: np.ndarray) -> Iterator[np.ndarray]:
        """Derivatives of a segment's errors by terms and then by starts, some rows at a time; of several, weighted.

        The next ones overwrite them.
        """
        lags, r, width = self.lags, len(self.rows), self._mix.shape[0] + q
        u, y = self.series.u[s], self.series.y[s]
        first = np.zeros((lags, r, width))
        first[:, :, width - q :] = np.eye(q).reshape(lags, r, q)
        if lags:
            yield self._weighted(first, weight)
        buffer = self._buffer
        buffer[:lags] = first
        for span in spans(len(e) - lags):
            slopes = buffer[: lags + span.stop - span.start]
            _slopes(y, u, c, e, self._described, self._late, self.first, span.start, slopes)
            yield self._weighted(slopes[lags:], weight)
            buffer[:lags] = slopes[len(slopes) - lags :].copy()

    def _weighted(self, slopes: np.ndarray, weight: np.ndarray) -> np.ndarray:
        flat = slopes if len(weight) == 1 else np.einsum("tiq,ij->tjq", slopes, weight)
        return flat.reshape(-1, slopes.shape[2])

    @cached_property
    def _buffer(self) -> np.ndarray:
        """Room for slopes; made once, as memory is dear to ask for."""
        r = len(self.rows)
        return np.empty((self.lags + SPAN, r, len(self._mix) + self.lags * r))

    def _errors(self, free: np.ndarray, starts: np.ndarray) -> list[np.ndarray]:
        """As `errors`, in arrays that the next call overwrites."""
        values = self.terms(free)
        c = self.c(values)
        for u, y, start, e in zip(self.series.u, self.series.y, starts, self._scratch):
            e[: self.lags] = start.reshape(self.lags, len(self.rows))
            _one_step_errors(y, u, c, values, self._described, self._numbers, self.first, e)
        return self._scratch

    @cached_property
    def _scratch(self) -> list[np.ndarray]:
        return [np.empty((self.lags + len(y) - self.first, len(self.rows))) for y in self.series.y]

    @cached_property
    def _numbers(self) -> np.ndarray:
        return np.array([row.number for row in self.rows])

    @cached_property
    def _mix(self) -> np.ndarray:
        """The matrix from changes of the parameters to those of the terms, intercepts included."""
        one = np.eye(int(self.intercept))
        return blocks([part for row in self.rows for part in (row.mix, one)])

    @cached_property
    def _base(self) -> np.ndarray:
        return np.concatenate([np.r_[row.base, np.zeros(int(self.intercept))] for row in self.rows])

    @cached_property
    def _listed(self) -> list[tuple[int, Term | None]]:
        """Row in the block and term, in the order of `terms`; None: an intercept."""
        ones = [None] * self.intercept
        return [(i, term) for i, row in enumerate(self.rows) for term in (*row.terms, *ones)]

    @cached_property
    def _errors_of(self) -> list[tuple[int, int, int, int]]:
        """Lag, row, number of the error, and place among the terms, of each that an error's lag is multiplied by."""
        local = {row.number: i for i, row in enumerate(self.rows)}
        kind = "a" if self.structure.tied else "c"
        return [
            (term.lag, i, local[term.number], place)
            for place, (i, term) in enumerate(self._listed)
            if term is not None and term.kind == kind
        ]

    @cached_property
    def _of_c(self) -> tuple[np.ndarray, ...]:
        return tuple(np.array(self._errors_of, dtype=np.int64).reshape(-1, 4).T)

    @cached_property
    def _late(self) -> np.ndarray:
        """The same as an array for compiled code."""
        return np.array(self._errors_of, dtype=np.int64).reshape(-1, 4)

    @cached_property
    def _described(self) -> np.ndarray:
        """Kind (0 a, 1 b, 2 c, 3 an intercept), row in the block, number of the channel and lag of each term."""
        return np.array(
            [
                (_INTERCEPT, i, 0, 0) if term is None else (KINDS.index(term.kind), i, term.number, term.lag)
                for i, term in self._listed
            ],
            dtype=np.int64,
        ).T.copy()

    def in_units(self) -> tuple[np.ndarray, np.ndarray]:
        """Matrix and vector that take the parameters to those of the channels as they are, intercepts included."""
        matrix, shift = np.zeros((self.free, self.free)), np.zeros(self.free)
        at = 0
        for row in self.rows:
            scale = np.array([self._scale(row, term) for term in row.free_terms])
            inside = np.arange(at, at + row.free)
            matrix[inside, inside] = scale
            at += row.free
            if self.intercept:
                # A(1) middle_y - B(1) middle_u joins the intercept, C(1) times nothing does not
                middle = {"a": self.outputs_middle, "b": -self.inputs_middle, "c": np.zeros(len(self.outputs_middle))}
                middles = np.array([middle[term.kind][term.number] for term in row.terms])
                units = np.array([self._scale(row, term) for term in row.terms])
                matrix[at, inside] = (middles * units) @ row.mix
                matrix[at, at] = self.outputs_scale[row.number]
                shift[at] = self.outputs_middle[row.number] + (middles * units) @ row.base
                at += 1
        return matrix, shift

    def _scale(self, row: Row, term: Term) -> float:
        under = self.inputs_scale if term.kind == "b" else self.outputs_scale
        return float(self.outputs_scale[row.number] / under[term.number])


def is_stable(c: np.ndarray) -> bool:
    """Whether all roots of a polynomial matrix, (powers, r, r) with a leading unit matrix, lie inside the circle."""
    return largest_root(c) < 1.0


def largest_root(c: np.ndarray) -> float:
    """The size of the largest root of z^n + c_1 z^(n-1) + ..., 0 where there is none."""
    powers, r = len(c) - 1, c.shape[1]
    if powers == 0:
        return 0.0
    companion = np.zeros((powers * r, powers * r))
    companion[:r] = -np.concatenate(list(c[1:]), axis=1)
    companion[r:, :-r] = np.eye((powers - 1) * r)
    return float(np.abs(np.linalg.eigvals(companion)).max())


@compiled
def _one_step_errors(y, u, c, values, described, numbers, first, e):
    """One-step errors into e, (nc + n - first, r), whose first nc rows are given."""
    n, r, nc = y.shape[0], e.shape[1], c.shape[0] - 1
    for i in range(r):
        for t in range(first, n):
            e[nc + t - first, i] = y[t, numbers[i]]
    for q in range(values.size):
        kind, i, column, lag, value = described[0, q], described[1, q], described[2, q], described[3, q], values[q]
        if kind == 0:
            for t in range(first, n):
                e[nc + t - first, i] += value * y[t - lag, column]
        elif kind == 1:
            for t in range(first, n):
                e[nc + t - first, i] -= value * u[t - lag, column]
        elif kind == 3:
            for t in range(first, n):
                e[nc + t - first, i] -= value
    for row in range(nc, e.shape[0]):
        for k in range(1, nc + 1):
            for i in range(r):
                for j in range(r):
                    e[row, i] -= c[k, i, j] * e[row - k, j]


@compiled
def _slopes(y, u, c, e, described, late, first, begin, slopes):
    """Derivatives of the errors from row `begin` of the predictions on, into slopes, (nc + rows, r, terms + starts).

    The first nc rows of slopes are given, those before.  late: (terms of errors, 4), lag, row, number of the error and
    place of each.
    """
    nc, r, width, terms = c.shape[0] - 1, c.shape[1], slopes.shape[2], described.shape[1]
    rows = slopes.shape[0] - nc
    slopes[nc:] = 0.0
    for q in range(terms):
        kind, i, column, lag = described[0, q], described[1, q], described[2, q], described[3, q]
        at = first + begin - lag
        if kind == 0:
            for t in range(rows):
                slopes[nc + t, i, q] = y[at + t, column]
        elif kind == 1:
            for t in range(rows):
                slopes[nc + t, i, q] = -u[at + t, column]
        elif kind == 3:
            for t in range(rows):
                slopes[nc + t, i, q] = -1.0
    for k in range(late.shape[0]):
        at = nc + begin - late[k, 0]
        for t in range(rows):
            slopes[nc + t, late[k, 1], late[k, 3]] -= e[at + t, late[k, 2]]
    for line in range(nc, nc + rows):
        for k in range(1, nc + 1):
            for i in range(r):
                for j in range(r):
                    factor = c[k, i, j]
                    if factor != 0.0:
                        for q in range(width):
                            slopes[line, i, q] -= factor * slopes[line - k, j, q]
        for i in range(r):
            for q in range(terms, width):
                if abs(slopes[line, i, q]) < _GONE:
                    slopes[line, i, q] = 0.0
