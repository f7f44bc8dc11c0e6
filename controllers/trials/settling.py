"""Step response measures: rise time, settling time, overshoot, remaining error and oscillation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Step(NamedTuple):
    """Measures of a step response.

    rise_time: 10 to 90 %, s; settling_time: until it stays within the band, s; inf if it did not get there.  overshoot;
    steady_error and swing: mean and half range of the error in the last fifth; in units of the channel.
    """

    rise_time: float
    settling_time: float
    overshoot: float
    steady_error: float
    swing: float


def step_response(time: np.ndarray, values: np.ndarray, target: float, band: float) -> Step:
    """The quantities of a response that starts at the first sample; band: either side of the target, in its unit.

    Angles must be continuous.  Raises where target and first value are the same.

    Example:

        >>> import numpy as np
        >>> from controllers import step_response
        >>> time = np.arange(0.0, 30.0, 0.1)
        >>> step = step_response(time, 1 - np.exp(-time / 2), target=1.0, band=0.05)
        >>> round(float(step.rise_time), 1), round(float(step.settling_time), 1)
        (4.4, 6.0)
    """
    start = float(values[0])
    if target == start:
        raise ValueError(f"A step response needs a target apart from the first value, got {target:g} for both.")
    done = (values - start) / (target - start)
    outside = np.flatnonzero(np.abs(values - target) > band)
    settled = 0 if outside.size == 0 else int(outside[-1]) + 1
    low, high = (np.flatnonzero(done >= share) for share in (0.1, 0.9))
    tail = (values - target)[-max(values.size // 5, 1) :]
    return Step(
        rise_time=float(time[high[0]] - time[low[0]]) if high.size else float("inf"),
        settling_time=float(time[settled] - time[0]) if settled < values.size else float("inf"),
        overshoot=float(max(done.max() - 1.0, 0.0) * abs(target - start)),
        steady_error=float(tail.mean()),
        swing=float(0.5 * np.ptp(tail)),
    )
