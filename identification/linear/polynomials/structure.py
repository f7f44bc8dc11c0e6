"""The free coefficients of A(q) y = B(q) u + C(q) e: from orders to the terms of each output's equation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from auv_gym.channels import channel, unit_per

Orders = int | Sequence[int] | Sequence[Sequence[int]]
KINDS = ("a", "b", "c")
FORMS = ("diagonal", "full")


@dataclass(frozen=True)
class Term:
    """A coefficient of a, b or c at a lag in samples, in the equation of an output; number: of its channel."""

    kind: str
    output: str
    channel: str
    number: int
    lag: int

    @property
    def name(self) -> str:
        """The name, as in `a1[depth_m]` or `b1[depth_m, stern_plane_rad]`."""
        other = "" if self.kind != "b" and self.channel == self.output else f", {self.channel}"
        return f"{self.kind}{self.lag}[{self.output}{other}]"

    @property
    def unit(self) -> str:
        return unit_per(self.output, self.channel)


@dataclass(frozen=True, eq=False)
class Row:
    """The equation of an output: its terms have the values base + mix @ free, where free are the fitted coefficients.

    Without a fixed pole, mix is the unit matrix and base is zero.  first: the largest lag, samples.
    """

    output: str
    number: int
    terms: tuple[Term, ...]
    base: np.ndarray
    mix: np.ndarray

    @property
    def first(self) -> int:
        return max((term.lag for term in self.terms if term.kind != "c"), default=0)

    @property
    def free(self) -> int:
        """Number of fitted coefficients, without an intercept."""
        return self.mix.shape[1]

    @cached_property
    def free_terms(self) -> tuple[Term, ...]:
        """The name of each fitted coefficient: the first term that it affects."""
        return tuple(self.terms[int(np.argmax(column != 0.0))] for column in self.mix.T)


@dataclass(frozen=True, eq=False)
class Structure:
    """The orders of a polynomial model, by output and channel, and the resulting equations.

    n_a, n_c: (p, p).  n_b, delay: (p, m).  tied: C equals A, an output-error model.  integrating: by output, whether
    its column of A has a factor 1 - q, counted in n_a.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    n_a: np.ndarray
    n_b: np.ndarray
    n_c: np.ndarray
    delay: np.ndarray
    tied: bool
    integrating: tuple[bool, ...]

    @classmethod
    def of(
        cls,
        name: str,
        inputs: Sequence[str],
        outputs: Sequence[str],
        n_a: Orders,
        n_b: Orders,
        n_c: Orders = 0,
        delay: Orders = 1,
        form: str = "diagonal",
        integrating: Sequence[str] = (),
        tied: bool = False,
    ) -> Structure:
        """The structure for an estimator's settings; raises, naming the estimator `name`, if they are impossible."""
        check_channels(name, inputs, outputs)
        if form not in FORMS:
            raise ValueError(f"{name} needs structure to be one of {', '.join(FORMS)}, got {form!r}.")
        unknown = set(integrating) - set(outputs)
        if isinstance(integrating, str) or unknown:
            raise ValueError(
                f"{name} needs integrating as a list of its outputs ({', '.join(outputs)}), got {integrating!r}."
            )
        p, m = len(outputs), len(inputs)
        square = _diagonal if form == "diagonal" else _matrix
        structure = cls(
            tuple(inputs),
            tuple(outputs),
            square(name, "n_a", n_a, p, p, 0),
            _matrix(name, "n_b", n_b, p, m, 0),
            square(name, "n_a" if tied else "n_c", n_a if tied else n_c, p, p, 0),
            _matrix(name, "delay", delay, p, m, 1),
            tied,
            tuple(output in integrating for output in outputs),
        )
        for i, output in enumerate(outputs):
            if not structure.n_b[i].any() and (form == "diagonal" or not structure.n_b.any()):
                raise ValueError(
                    f"{name} needs n_b of at least 1 for one input of {output}, got {structure.n_b[i].tolist()}."
                )
            if structure.integrating[i] and structure.n_a[i, i] < 1:
                raise ValueError(f"{name} needs n_a of at least 1 for {output}, which integrates, got 0.")
        return structure

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        return tuple(self._row(i) for i in range(len(self.outputs)))

    @property
    def parameters(self) -> int:
        """Number of free coefficients of A, B and C for order criteria, without intercepts and starts."""
        return sum(row.free for row in self.rows)

    def coupled(self) -> list[list[int]]:
        """Numbers of the outputs that are fitted together because their equations share errors."""
        p = len(self.outputs)
        shared = (self.n_c - np.diag(np.diag(self.n_c))).any()
        return [list(range(p))] if shared else [[i] for i in range(p)]

    def arrays(self, values: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """a, b and c in the form of a Polynomial, from the values of each row's terms."""
        p, m = len(self.outputs), len(self.inputs)
        last = int(max((self.delay + self.n_b - 1)[self.n_b > 0], default=0))
        a = np.zeros((int(self.n_a.max(initial=0)) + 1, p, p))
        b = np.zeros((last + 1, p, m))
        c = np.zeros((int(self.n_c.max(initial=0)) + 1, p, p))
        a[0] = c[0] = np.eye(p)
        of = {"a": a, "b": b, "c": c}
        for row, given in zip(self.rows, values, strict=True):
            for term, value in zip(row.terms, given, strict=True):
                of[term.kind][term.lag, row.number, term.number] = value
        return a, b, (a.copy() if self.tied else c)

    def _row(self, i: int) -> Row:
        output = self.outputs[i]
        terms: list[Term] = []
        base: list[float] = []
        parts: list[np.ndarray] = []
        for j, other in enumerate(self.outputs):
            count = int(self.n_a[i, j])
            terms += [Term("a", output, other, j, lag) for lag in range(1, count + 1)]
            if self.integrating[j] and count:
                # a = (1, a'_1, a'_2, ...) (1 - q): a_k = a'_k - a'_(k-1); off the diagonal without the leading 1
                parts.append(np.eye(count, count - 1) - np.eye(count, count - 1, -1))
                base += [-1.0 * (i == j and k == 0) for k in range(count)]
            else:
                parts.append(np.eye(count))
                base += [0.0] * count
        for j, name in enumerate(self.inputs):
            count, first = int(self.n_b[i, j]), int(self.delay[i, j])
            terms += [Term("b", output, name, j, lag) for lag in range(first, first + count)]
            parts.append(np.eye(count))
            base += [0.0] * count
        if not self.tied:
            for j, other in enumerate(self.outputs):
                count = int(self.n_c[i, j])
                terms += [Term("c", output, other, j, lag) for lag in range(1, count + 1)]
                parts.append(np.eye(count))
                base += [0.0] * count
        return Row(output, i, tuple(terms), np.array(base), blocks(parts))


class ByOrders:
    """The equations for the settings that estimators of polynomial models share; the settings: see `Arx`."""

    tied: ClassVar[bool] = False  # whether C equals A

    def __post_init__(self) -> None:
        _ = self.orders

    @cached_property
    def orders(self) -> Structure:
        """The equations for these settings."""
        asked: Any = self
        if not isinstance(asked.offset, bool):
            raise ValueError(f"{type(self).__name__} needs offset to be True or False, got {asked.offset!r}.")
        return Structure.of(
            type(self).__name__,
            asked.inputs,
            asked.outputs,
            asked.n_a,
            asked.n_b,
            getattr(asked, "n_c", 0),
            asked.delay,
            asked.structure,
            asked.integrating,
            self.tied,
        )


def check_channels(name: str, inputs: Sequence[str], outputs: Sequence[str]) -> None:
    """Raise an error, naming the estimator `name`, if these cannot be the channels of a model."""
    for what, names in (("inputs", inputs), ("outputs", outputs)):
        if isinstance(names, str) or not names or len(set(names)) != len(names):
            raise ValueError(f"{name} needs {what} as a list of different channel names, got {names!r}.")
        for channel_name in names:
            channel(channel_name)  # raises if it is unknown
    both = set(inputs) & set(outputs)
    if both:
        raise ValueError(f"{name} got {', '.join(sorted(both))} as input and as output: choose one.")


def blocks(parts: Sequence[np.ndarray]) -> np.ndarray:
    """The block-diagonal matrix of these blocks, which need not be square."""
    result = np.zeros((sum(len(part) for part in parts), sum(part.shape[1] for part in parts)))
    row = column = 0
    for part in parts:
        result[row : row + part.shape[0], column : column + part.shape[1]] = part
        row, column = row + part.shape[0], column + part.shape[1]
    return result


def _is_order(value: object, least: int) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and int(value) >= least


def _diagonal(name: str, what: str, value: Orders, p: int, _: int, least: int) -> np.ndarray:
    """One whole number for each output, on a diagonal."""
    given = tuple(value) if isinstance(value, Sequence) else (value,) * p
    if len(given) != p or not all(_is_order(k, least) for k in given):
        raise ValueError(f"{name} needs {what} >= {least} as one whole number or one for each output, got {value!r}.")
    return np.diag(np.array(given, dtype=int))


def _matrix(name: str, what: str, value: Orders, rows: int, columns: int, least: int) -> np.ndarray:
    """One whole number for each output and channel."""
    given = tuple(value) if isinstance(value, Sequence) else (value,) * rows
    full = tuple(tuple(row) if isinstance(row, Sequence) else (row,) * columns for row in given)
    numbers = [k for row in full for k in row]
    if len(full) != rows or any(len(row) != columns for row in full) or not all(_is_order(k, least) for k in numbers):
        raise ValueError(
            f"{name} needs {what} >= {least} as one whole number, one for each of {rows} outputs, or a list of "
            f"{columns} for each output, got {value!r}."
        )
    return np.array(full, dtype=int).reshape(rows, columns)
