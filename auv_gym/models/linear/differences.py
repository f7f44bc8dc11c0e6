"""Differencing of an integrating output: in records, and in models, whose pole at 1 it cancels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from auv_gym.channels import channel
from auv_gym.models.linear.polynomial import Polynomial
from auv_gym.records.record import Record

_REAL = 1e-6  # imaginary part that rounding may give two equal poles


def rate_of(name: str) -> str:
    """The channel of a signal's rate of change: `depth_rate_mps` for `depth_m`; raises if its unit has none."""
    stem, _, suffix = channel(name).name.rpartition("_")
    return channel(f"{stem}_rate_{suffix}ps").name


def differenced(model: Polynomial, output: str, within: float = 0.1) -> Polynomial:
    """The model with the rate of an output in its place; the pole nearest 1 is cancelled by the difference.

    With A = (1 - p q) A' the output's row A y = B u + C e becomes A' r = (B u + C e) / dt, r = (y(t) - y(t - 1)) / dt.
    Exact for p = 1; a pole near 1 is treated as 1.  Raises without a real pole `within` this distance of 1, and if the
    output occurs in another output's equation, or another one in its own.
    Source: Geng and Zhao 2012, eqs (12) to (15).
    """
    if output not in model.outputs:
        raise ValueError(f"differenced needs an output of the model, {', '.join(model.outputs)}, got {output!r}.")
    i = model.outputs.index(output)
    others = [k for k in range(len(model.outputs)) if k != i]
    if any(matrix[:, i, others].any() or matrix[:, others, i].any() for matrix in (model.a, model.c)):
        raise ValueError(f"differenced needs {output} in an equation of its own, got A or C with others: fit it alone.")
    poles = np.roots(model.a[:, i, i])
    real = poles.real[np.abs(poles.imag) <= _REAL]
    nearest = float(real[np.argmin(np.abs(real - 1.0))]) if real.size else np.inf
    if not abs(nearest - 1.0) <= within:
        found = f"the nearest at {nearest:.4g}" if real.size else "none that is real"
        raise ValueError(
            f"differenced needs a pole of {output} within {within:g} of 1 to cancel, got {found}: fit it integrating."
        )
    a, b, c, offset = model.a.copy(), model.b.copy(), model.c.copy(), model.output_offset.copy()
    for power in range(1, len(a)):
        a[power, i, i] += nearest * a[power - 1, i, i]
    a[-1, i, i] = 0.0  # the remainder of the division is only rounding
    b[:, i] /= model.dt
    offset[i] = 0.0
    rate = rate_of(output)
    outputs = tuple(rate if name == output else name for name in model.outputs)
    return replace(model, a=a, b=b, c=c, outputs=outputs, output_offset=offset)


def with_differences(record: Record, output: str) -> Record:
    """The record with the rate of a channel added: its backward difference over the time since the last sample.

    NaN at the first sample of each segment, which has no predecessor.
    """
    rate = np.full(record.time.size, np.nan)
    for part in record.segments:
        rate[part.start + 1 : part.stop] = np.diff(record[output][part]) / np.diff(record.time[part])
    return record.with_channels({rate_of(output): rate})
