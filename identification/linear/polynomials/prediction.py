"""One-step errors of A(q) y = B(q) u + C(q) e over records, and their derivatives by filtering with 1/C."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from identification.linear.polynomials.filtering import INTERCEPT, Problem, fill_c, fill_errors, fill_slopes
from identification.linear.polynomials.structure import KINDS, Row, Structure, Term, blocks
from identification.linear.regressors import Regression, regression
from identification.linear.scaled import Scaled
from identification.linear.triangles import spans, triangle_of


@dataclass(frozen=True, eq=False)
class Prediction:
    """The errors of some outputs' equations over all segments, as functions of their free parameters.

    Predictions begin where all lags of inputs and outputs are in the segment. The first ones depend, through C, on
    unknown earlier errors; these are estimated as starts and count as errors.  Channels are scaled, so that
    coefficients are of order one; `free` holds these coefficients row by row, each row ending with its intercept.
    """

    structure: Structure
    rows: tuple[Row, ...]
    scaled: Scaled
    first: int

    @classmethod
    def of(cls, scaled: Scaled, structure: Structure, block: Sequence[int], skip: int) -> Prediction:
        """The errors of a block of outputs; segments too short for one prediction are left out."""
        rows = tuple(structure.rows[i] for i in block)
        first = max(skip, *(row.first for row in rows))
        return cls(structure, rows, scaled.longer_than(first), first)

    @property
    def intercept(self) -> bool:
        """Whether each equation has an intercept: if middles were subtracted."""
        return self.scaled.offset

    @property
    def samples(self) -> int:
        """Number of predictions of each output."""
        return sum(len(y) - self.first for y in self.scaled.y)

    @cached_property
    def free(self) -> int:
        """Number of fitted parameters, including intercepts."""
        return sum(row.free + self.intercept for row in self.rows)

    @cached_property
    def lags(self) -> int:
        """The order of C."""
        numbers = [row.number for row in self.rows]
        return int(self.structure.n_c[np.ix_(numbers, numbers)].max(initial=0))

    def starts(self) -> np.ndarray:
        """Starts of zero, shape (segments, order of C times outputs)."""
        return np.zeros((len(self.scaled.y), self.lags * len(self.rows)))

    def split(self, free: np.ndarray) -> list[np.ndarray]:
        """The parameters of each row, including its intercept."""
        ends = np.cumsum([row.free + self.intercept for row in self.rows])
        return np.split(free, ends[:-1])

    def terms(self, free: np.ndarray) -> np.ndarray:
        """The values of all terms, row by row, including the intercepts."""
        return self._base + self._mix @ free

    def c(self, free: np.ndarray) -> np.ndarray:
        """C for these parameters, (powers, r, r) with the unit matrix first."""
        c = np.zeros((self.lags + 1, len(self.rows), len(self.rows)))
        fill_c(self.terms(free), self.problem.late, c)
        return c

    def errors(self, free: np.ndarray, starts: np.ndarray) -> list[np.ndarray]:
        """One-step errors of each segment, (order of C + predictions, r); the first are the starts."""
        problem, c = self.problem, self.c(free)
        joined = np.empty((problem.rows, len(self.rows)))
        fill_errors(problem, self.terms(free), c, starts, joined)
        return np.split(joined, problem.at[1:-1])

    def triangle(self, free: np.ndarray, starts: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """R, (P, P), with R' R the normal matrix of the parameters without the starts; it is not formed by squaring.

        weight: (r, r), applied to the errors of a sample.
        """
        n, c = len(self.problem.mix), self.c(free)
        return triangle_of(self._segment_triangle(s, e, c, n, weight) for s, e in enumerate(self.errors(free, starts)))

    def _segment_triangle(self, s: int, e: np.ndarray, c: np.ndarray, n: int, weight: np.ndarray) -> np.ndarray:
        problem, r, q = self.problem, len(self.rows), self.lags * len(self.rows)

        def parts() -> Iterator[np.ndarray]:
            last = np.zeros((self.lags, r, n + q + 1))
            last[:, :, n:-1] = np.eye(q).reshape(self.lags, r, q)
            if self.lags:
                yield mixed(last)
            for span in spans(len(e) - self.lags):
                slopes = np.concatenate([last, np.zeros((span.stop - span.start, r, n + q + 1))])
                fill_slopes(problem, s, c, e, span.start, slopes)
                yield mixed(slopes[self.lags :])
                last = slopes[len(slopes) - self.lags :]

        def mixed(slopes: np.ndarray) -> np.ndarray:
            flat = slopes if r == 1 else np.einsum("tiq,ij->tjq", slopes, weight)
            flat = flat.reshape(-1, n + q + 1)
            return np.concatenate([flat[:, n:-1], flat[:, :n] @ problem.mix], axis=1)

        scale = abs(float(weight[0, 0])) if r == 1 else 1.0
        return scale * triangle_of(parts())[q:, q:]

    @cached_property
    def regressions(self) -> tuple[Regression, ...]:
        """Each row's regression on measured signals, see `regression`."""
        return tuple(regression(self.scaled, row, self.first, self.intercept) for row in self.rows)

    @cached_property
    def problem(self) -> Problem:
        """The same problem for compiled code."""
        local = {row.number: i for i, row in enumerate(self.rows)}
        listed, late = [], []
        kind = "a" if self.structure.tied else "c"
        for i, row in enumerate(self.rows):
            for term in row.terms:
                if term.kind == kind:
                    late.append((term.lag, i, local[term.number], len(listed)))
                listed.append((KINDS.index(term.kind), i, term.number, term.lag))
            listed += [(INTERCEPT, i, 0, 0)] * self.intercept
        counts = [len(y) for y in self.scaled.y]
        return Problem(
            np.concatenate(self.scaled.y),
            np.concatenate(self.scaled.u),
            np.concatenate([[0], np.cumsum(counts)]),
            np.concatenate([[0], np.cumsum([count - self.first + self.lags for count in counts])]),
            self.first,
            np.array(listed, dtype=np.int64).reshape(-1, 4).T.copy(),
            np.array(late, dtype=np.int64).reshape(-1, 4),
            np.array([row.number for row in self.rows]),
            self._base,
            self._mix,
        )

    @cached_property
    def _mix(self) -> np.ndarray:
        """The matrix from changes of the parameters to changes of the terms, including intercepts."""
        one = np.eye(int(self.intercept))
        return blocks([part for row in self.rows for part in (row.mix, one)])

    @cached_property
    def _base(self) -> np.ndarray:
        return np.concatenate([np.r_[row.base, np.zeros(int(self.intercept))] for row in self.rows])

    def in_units(self) -> tuple[np.ndarray, np.ndarray]:
        """Matrix and vector that convert the parameters to those of the unscaled channels, including intercepts."""
        matrix, shift = np.zeros((self.free, self.free)), np.zeros(self.free)
        at = 0
        for row in self.rows:
            scale = np.array([self._scale(row, term) for term in row.free_terms])
            inside = np.arange(at, at + row.free)
            matrix[inside, inside] = scale
            at += row.free
            if self.intercept:
                # A(1) middle_y - B(1) middle_u is added to the intercept; C adds nothing, as errors have no middle
                outputs, inputs = self.scaled.output_middle, self.scaled.input_middle
                middle = {"a": outputs, "b": -inputs, "c": np.zeros(outputs.size)}
                middles = np.array([middle[term.kind][term.number] for term in row.terms])
                units = np.array([self._scale(row, term) for term in row.terms])
                matrix[at, inside] = (middles * units) @ row.mix
                matrix[at, at] = self.scaled.output_spread[row.number]
                shift[at] = self.scaled.output_middle[row.number] + (middles * units) @ row.base
                at += 1
        return matrix, shift

    def _scale(self, row: Row, term: Term) -> float:
        under = self.scaled.input_spread if term.kind == "b" else self.scaled.output_spread
        return float(self.scaled.output_spread[row.number] / under[term.number])
