"""ARX: linear models in discrete time by least squares, each output by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from auv_gym.channels import channel
from auv_gym.linear import Polynomial
from auv_gym.record import Record
from identification.estimate import Estimate
from identification.linear.regressors import Series, Solution, Term, regression, solve


@dataclass(frozen=True, eq=False)
class ArxFit:
    """A polynomial model, and how sure its coefficients are.

    estimates: a_j of `a1[depth_m]`, b_j of `b1[depth_m, stern_plane_rad]`, and what stands for the operating point,
    `intercept[depth_m]`.  covariance: (P, P), in their order; outputs are fitted apart, so that none is taken between
    them.  noise: standard deviation of the one-step error, by output.  samples: rows of the regression, by output.
    """

    model: Polynomial
    estimates: tuple[Estimate, ...]
    covariance: np.ndarray
    noise: dict[str, float]
    samples: dict[str, int]

    def __getitem__(self, name: str) -> Estimate:
        """The estimate of this name; raises KeyError where there is none."""
        for estimate in self.estimates:
            if estimate.path == name:
                return estimate
        raise KeyError(f"There is no coefficient {name!r}; there are {', '.join(e.path for e in self.estimates)}")


@dataclass(frozen=True)
class Arx:
    """Least-squares ARX, A(q) y = B(q) u + intercept + e, with a diagonal A: each output by itself.

    n_a: lags of an output.  n_b: lags of an input, from `delay` on; 0 where it does not act.  delay: samples, at least
    1, as an output does not see the input of its own row.  One number serves all outputs, a list has one for each, a
    list of lists one for each output and input.  offset: whether an operating point is estimated.
    Where e is not white, as with noise on a measured output, the coefficients are biased at any length of record, and
    the intervals do not hold this bias: fewer lags or faster samples make it worse.  Source: Ljung 1999, sec. 4.2, 7.3.
    """

    inputs: Sequence[str]
    outputs: Sequence[str]
    n_a: int | Sequence[int] = 2
    n_b: int | Sequence[int] | Sequence[Sequence[int]] = 2
    delay: int | Sequence[int] | Sequence[Sequence[int]] = 1
    offset: bool = True

    def __post_init__(self) -> None:
        for what in ("inputs", "outputs"):
            names = getattr(self, what)
            if isinstance(names, str) or not names or len(set(names)) != len(names):
                raise ValueError(f"Arx needs {what} as a list of different channel names, got {names!r}.")
            for name in names:
                channel(name)
        both = set(self.inputs) & set(self.outputs)
        if both:
            raise ValueError(f"Arx got {', '.join(sorted(both))} as input and as output: choose one.")
        p, m = len(self.outputs), len(self.inputs)
        _vector("n_a", self.n_a, p, 0)
        _matrix("delay", self.delay, p, m, 1)
        for name, row in zip(self.outputs, _matrix("n_b", self.n_b, p, m, 0), strict=True):
            if not any(row):
                raise ValueError(f"Arx needs n_b of at least 1 for one input of {name}, got {list(row)}.")

    def fit(self, *records: Record) -> ArxFit:
        """Fit over all segments of all records, each with its own lags; raises if the data cannot tell all of them."""
        series = Series.of(records, self.inputs, self.outputs, "Arx")
        p, m = len(series.outputs), len(series.inputs)
        orders = _vector("n_a", self.n_a, p, 0)
        counts, delays = _matrix("n_b", self.n_b, p, m, 0), _matrix("delay", self.delay, p, m, 1)
        last = max(first + count - 1 for f, c in zip(delays, counts) for first, count in zip(f, c) if count)
        a, b, intercepts = np.zeros((max(orders) + 1, p, p)), np.zeros((last + 1, p, m)), np.zeros(p)
        a[0] = np.eye(p)
        estimates, covariances, noise, samples = [], [], {}, {}
        for i, name in enumerate(series.outputs):
            problem = regression(series, i, orders[i], counts[i], delays[i])
            found = solve(problem, "Arx", name, self.offset)
            for term, value in zip(problem.terms, found.coefficients):
                if term.channel == name:
                    a[term.lag, i, i] = value
                else:
                    b[term.lag, i, series.inputs.index(term.channel)] = value
            intercepts[i] = found.coefficients[-1] if self.offset else 0.0
            estimates += _estimates(name, problem.terms, found)
            covariances.append(found.covariance)
            noise[name], samples[name] = found.error, problem.target.size
        input_offset, output_offset = np.zeros(m), np.zeros(p)
        if self.offset:
            input_offset, output_offset = _operating_point(series, a, b, intercepts)
        model = Polynomial(
            a=a,
            b=b,
            c=np.eye(p)[None],
            inputs=series.inputs,
            outputs=series.outputs,
            dt=series.dt,
            input_offset=input_offset,
            output_offset=output_offset,
        )
        return ArxFit(model, tuple(estimates), _block_diagonal(covariances), noise, samples)


def _operating_point(
    series: Series, a: np.ndarray, b: np.ndarray, intercepts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Offsets of inputs and outputs with A(1) y - B(1) u = intercepts, as near to the means of the data as can be.

    Near in units of the signals' spread: an integrating output, whose A(1) is zero, leaves its part to the inputs.
    """
    u, y = np.concatenate(series.u), np.concatenate(series.y)
    means, spreads = np.r_[y.mean(axis=0), u.mean(axis=0)], np.r_[y.std(axis=0), u.std(axis=0)]
    gains = np.concatenate([a.sum(axis=0), -b.sum(axis=0)], axis=1)
    moved = np.linalg.lstsq(gains * spreads, intercepts - gains @ means, rcond=None)[0]
    offsets = means + spreads * moved
    p = len(series.outputs)
    return offsets[p:], offsets[:p]


def _estimates(output: str, terms: Sequence[Term], found: Solution) -> list[Estimate]:
    width = float(stats.t.ppf(0.975, found.freedom))
    unit = channel(output).unit
    heads = [
        (f"a{term.lag}[{output}]", "1")
        if term.channel == output
        else (f"b{term.lag}[{output}, {term.channel}]", _per(unit, channel(term.channel).unit))
        for term in terms
    ]
    if found.coefficients.size > len(terms):
        heads.append((f"intercept[{output}]", unit))
    errors = np.sqrt(np.diag(found.covariance))
    return [
        Estimate(head, of, float(value), float(error), (float(value - width * error), float(value + width * error)))
        for (head, of), value, error in zip(heads, found.coefficients, errors, strict=True)
    ]


def _per(unit: str, other: str) -> str:
    if unit == other:
        return "1"
    over, under = (f"({u})" if "/" in u or " " in u else u for u in (unit, other))
    return f"{over}/{under}" if other else unit


def _block_diagonal(blocks: Sequence[np.ndarray]) -> np.ndarray:
    size = sum(len(block) for block in blocks)
    result, at = np.zeros((size, size)), 0
    for block in blocks:
        result[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    return result


def _vector(name: str, value: int | Sequence[int], outputs: int, least: int) -> tuple[int, ...]:
    """One whole number for each output."""
    given = tuple(value) if isinstance(value, Sequence) else (value,) * outputs
    if len(given) != outputs or any(isinstance(k, bool) or not isinstance(k, int) or k < least for k in given):
        raise ValueError(f"Arx needs {name} >= {least} as one whole number or one for each output, got {value!r}.")
    return given


def _matrix(
    name: str, value: int | Sequence[int] | Sequence[Sequence[int]], outputs: int, inputs: int, least: int
) -> tuple[tuple[int, ...], ...]:
    """One whole number for each output and input."""
    rows = tuple(value) if isinstance(value, Sequence) else (value,) * outputs
    full = tuple(tuple(row) if isinstance(row, Sequence) else (row,) * inputs for row in rows)
    numbers = [k for row in full for k in row]
    if (
        len(full) != outputs
        or any(len(row) != inputs for row in full)
        or any(isinstance(k, bool) or not isinstance(k, int) or k < least for k in numbers)
    ):
        raise ValueError(
            f"Arx needs {name} >= {least} as one whole number, one for each of {outputs} outputs, or a list of "
            f"{inputs} for each output, got {value!r}."
        )
    return full
