"""Confidence intervals of effects that were selected because they are significant.

An effect whose evidence just passes the bar is more often over- than underestimated: with the opposite noise, it would
not have been named.  The interval is therefore conditional on having passed (a truncated normal), and is cut to the
interval that holds for all candidates at once, so that it never contains the neutral value, which the gate has
excluded.
Source: the hybrid interval of Andrews, Kitagawa and McCloskey 2024, Quarterly Journal of Economics 139, pages 305-358.
"""

from __future__ import annotations

import numpy as np
from scipy import optimize, special, stats

from identification.deciding import FALSE_ALARM, MISSED


def selected_interval(
    value: float, neutral: float, limits: tuple[float, float], evidence: float, bar: float
) -> tuple[float, float]:
    """The 95 % interval of an effect that is named because its evidence passed a bar.

    limits: the 95 % interval without selection.  evidence: twice the gain in log-likelihood by the effect.  If the
    noise differs from what was assumed, the limits are wider than the evidence suggests; the bar is then lower by the
    same ratio in standard errors, and no interval reaches beyond neutral.
    """
    usual = float(stats.norm.isf(0.5 * MISSED))
    inner, outer = (limits[0], limits[1]) if value >= neutral else (limits[1], limits[0])
    size = usual * abs(value - neutral) / max(abs(value - inner), 1e-300)
    least = size * float(np.sqrt(bar / max(evidence, bar)))
    low, high = conditional_limits(size, least, float(np.sqrt(bar)))
    near = value - (value - inner) * (size - low) / usual
    far = value + (outer - value) * (high - size) / usual
    return (min(near, far, value), max(near, far, value))


def conditional_limits(size: float, least: float, widest: float) -> tuple[float, float]:
    """Limits of the mean of a unit normal, given the observation `size`, which is reported only beyond `least`.

    A share `FALSE_ALARM` of the miss probability is spent on the interval that holds for all candidates without the
    condition, `widest` to each side; the limits stay inside it and do not cross zero.
    """
    tail = 0.5 * (MISSED - FALSE_ALARM)
    bounds = (max(size - widest, 0.0), size + widest)

    def beyond(mean: float, aim: float) -> float:
        """Probability of an observation beyond `size`, given that it is reported, minus the aim."""
        seen = special.log_ndtr(mean - size)
        passed = np.logaddexp(special.log_ndtr(mean - least), special.log_ndtr(-least - mean))
        return float(np.exp(seen - passed)) - aim

    def limit(aim: float) -> float:
        ends = [beyond(b, aim) for b in bounds]
        if ends[0] * ends[1] > 0.0:
            return bounds[0] if ends[0] > 0.0 else bounds[1]
        return float(optimize.root_scalar(beyond, args=(aim,), bracket=bounds).root)

    return limit(tail), limit(1.0 - tail)
