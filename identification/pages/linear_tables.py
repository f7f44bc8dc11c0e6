"""Tables of linear fits for their page and the command line."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, sqrt

import numpy as np

from auv_gym.channels import channel
from auv_gym.models.linear import Polynomial, StateSpace
from identification.estimate import Estimate
from identification.linear.poles import PoleInterval, zeros
from identification.linear.polynomials.orders import CRITERIA, OrderSearch
from identification.order_search import KEYS, remarks
from identification.pages.page import Table, amount, number, percent

_ORDERS = "n: coefficients; error: one sample ahead, over the rows that all orders share."
_POLES = (
    "In square brackets: 95 % intervals; for a complex pair, of its real and imaginary parts. The time constant of a "
    "pair is that of its envelope."
)


def pole_table(poles: Sequence[PoleInterval]) -> Table:
    """Poles as frequency and damping with 95 % intervals, one line each, for the command line."""
    shown = _shown(poles)
    rows = []
    for pole in shown:
        swing = [f"{number(pole.natural_frequency.value)} rad/s", number(pole.damping.value)] if pole.pair else ["", ""]
        rows.append([_owner(pole), complex_words(pole.value), _decay(pole), _limits(pole.time_constant, pole), *swing])
    heads = ["output", "pole", "time constant", "95 %", "frequency", "damping"]
    owned = len({_owner(pole) for pole in shown}) > 1
    kept = [0] * owned + [1, 2, 3] + [4, 5] * any(pole.pair for pole in shown)
    return Table(tuple(heads[k] for k in kept), tuple(tuple(row[k] for k in kept) for row in rows), words=int(owned))


def full_pole_table(poles: Sequence[PoleInterval]) -> Table:
    """Poles in discrete and continuous time, with their meaning, and the 95 % interval of each below it."""
    rows = []
    for pole in _shown(poles):
        frequency, damping, continuous = pole.natural_frequency, pole.damping, complex_words(pole.continuous)
        known = not pole.fixed and not pole.problem  # otherwise, the reason stands once, below the pole itself
        rate, constant = (_limits(e, pole) if known else "" for e in (pole.rate, pole.time_constant))
        swing = [
            (f"{number(frequency.value)} rad/s", _limits(frequency, pole) if known else ""),
            (number(damping.value), _limits(damping, pole) if known else ""),
        ]
        rows.append(
            (
                _owner(pole),
                (complex_words(pole.value), _parts(pole)),
                (continuous, "" if pole.pair else rate),
                (_decay(pole), constant),
                *(swing if pole.pair else ["", ""]),
            )
        )
    delays = sum(pole.delay for pole in poles)
    told = [_POLES, f"{delays} more at 0, each a sample of delay, are left out."] if delays else [_POLES]
    problems = dict.fromkeys(pole.problem for pole in _shown(poles) if pole.problem)
    caption = " ".join([*told, *(f"No interval: {problem}." for problem in problems)])
    heads = ("output", "discrete time", "continuous, 1/s", "time constant", "frequency", "damping")
    return Table(heads, tuple(rows), caption=caption)


def zero_table(model: Polynomial | StateSpace) -> Table:
    """Zeros in discrete time, by output and input; one outside the unit circle gives an inverse response."""
    rows = []
    for output in model.outputs:
        for given in model.inputs:
            found = sorted((z for z in zeros(model, output, given) if np.imag(z) >= 0.0), key=lambda z: -abs(z))
            told = "; ".join(complex_words(complex(z)) for z in found) or "none"
            rows.append((channel(output).label, channel(given).label, told))
    return Table(("output", "input", "zeros in discrete time"), tuple(rows), words=2)


def complex_words(value: complex) -> str:
    """`0.755 ± 0.372j`: a number, or a pair of conjugate ones."""
    real = number(value.real, 4) if abs(value.real) > 1e-9 * abs(value) else "0"
    return real if value.imag == 0.0 else f"{real} ± {number(value.imag, 4)}j"


def _shown(poles: Sequence[PoleInterval]) -> list[PoleInterval]:
    return [pole for pole in poles if not pole.delay]


def _owner(pole: PoleInterval) -> str:
    return ", ".join(channel(name).label for name in pole.outputs) or "all outputs"


def _decay(pole: PoleInterval) -> str:
    constant = pole.time_constant.value
    if not isfinite(constant):
        return "integrates"
    if not pole.pair and not pole.fixed and pole.real.ci95[0] <= 1.0 <= pole.real.ci95[1] and not pole.problem:
        return "may integrate"
    words = f"{number(abs(constant))} s" if constant > 0.0 else f"grows in {number(-constant)} s"
    return f"{words}, alternating" if pole.value.real < 0.0 and not pole.pair else words


def _parts(pole: PoleInterval) -> str:
    if pole.fixed or pole.problem or not pole.pair:
        return _limits(pole.real, pole)
    return f"{_limits(pole.real, pole)}, {_limits(pole.imaginary, pole)}j"


def _limits(estimate: Estimate, pole: PoleInterval) -> str:
    if pole.fixed:
        return "by construction"
    if estimate.problem:
        return "no interval"
    low, high = estimate.ci95
    if not isfinite(low):
        return "any"
    return f"[{number(low)}, {number(high)}]" if isfinite(high) else f"[{number(low)}, ∞]"


def order_table(search: OrderSearch) -> Table:
    """The choice of each criterion, by output; the requested criterion comes first, as chosen.

    Orders with a single value tried are left out.  The caption ends with `remarks`.
    """
    judged = "held_out" in search.criteria
    keys = [key for key in KEYS if len({getattr(cell, key) for cell in search.cells}) > 1]
    rows = []
    for output in search.outputs:
        for name in (search.criterion, *(name for name in search.criteria if name != search.criterion)):
            cell = search.best(output, name)
            row = [output, f"{CRITERIA[name]}, chosen" if name == search.criterion else CRITERIA[name]]
            row += [_order(getattr(cell, key)) for key in keys]
            row += [str(cell.parameters), amount(sqrt(cell.loss), channel(output).unit)]
            rows.append(row + [percent(cell.held_out)] * judged)
    heads = ("output", "criterion", *keys, "n", "RMS error", *["held-out"] * judged)
    return Table(heads, rows, words=2, caption=" ".join([_ORDERS, *remarks(search)]))


def _order(value: int | tuple[int, ...]) -> str:
    """An order; for several inputs, a single number if they all have the same."""
    values = value if isinstance(value, tuple) else (value,)
    return ", ".join(map(str, values[:1] if len(set(values)) == 1 else values))
