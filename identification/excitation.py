"""Signals that make a system show itself: added to a rudder, given as set points, or disturbing a run slowly."""

from __future__ import annotations

from math import ceil, pi, radians

import numpy as np
from scipy.signal import max_len_seq


def prbs(n: int, hold: int, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """A pseudo-random binary signal of -amplitude and +amplitude, shape (n,), each bit `hold` samples long.

    The shortest maximum-length sequence that does not repeat within n, from a drawn phase.
    Source: Ljung 1999, System Identification, sec. 13.3.
    """
    if n < 1 or hold < 1:
        raise ValueError(f"prbs needs n >= 1 and hold >= 1 samples, got n = {n} and hold = {hold}.")
    bits = max(ceil(n / hold).bit_length(), 2)
    sequence = np.roll(max_len_seq(bits)[0], int(rng.integers(2**bits - 1)))
    lengthened = np.repeat(2.0 * sequence - 1.0, hold)
    start = int(rng.integers(hold)) if lengthened.size - n >= hold else 0
    return amplitude * lengthened[start : start + n]


def set_point_steps(
    time: np.ndarray,
    rng: np.random.Generator,
    *,
    start: float = 0.0,
    hold: tuple[float, float] = (40.0, 90.0),
    step: tuple[float, float] = (radians(20.0), radians(70.0)),
) -> np.ndarray:
    """A set point at each time, shape (n,), that starts at `start` and changes in drawn steps of either sign.

    time: s, rising.  hold: s, range of the time between changes.  step: range of a change's size, in the signal's unit.
    """
    time = np.asarray(time, dtype=float)
    if not 0.0 < hold[0] <= hold[1]:
        raise ValueError(f"set_point_steps needs 0 < hold[0] <= hold[1] in s, got {hold}.")
    values = np.full(time.size, float(start))
    change = time[0] + rng.uniform(0.0, hold[0])
    while change <= time[-1]:
        values[time >= change] += rng.uniform(*step) * (1.0 if rng.random() < 0.5 else -1.0)
        change += rng.uniform(*hold)
    return values


def slow_variation(
    time: np.ndarray, rng: np.random.Generator, *, amplitude: float, periods: tuple[float, float] = (60.0, 200.0)
) -> np.ndarray:
    """A smooth signal around zero whose largest size is `amplitude`, shape (n,): three sines of drawn period and phase.

    time, periods: s.  Periods are drawn evenly in their logarithm.
    """
    time = np.asarray(time, dtype=float)
    angular = 2.0 * pi / np.exp(rng.uniform(*np.log(periods), size=3))
    phases, shares = rng.uniform(0.0, 2.0 * pi, size=3), rng.uniform(0.5, 1.0, size=3)
    waves = shares[:, None] * np.sin(angular[:, None] * time + phases[:, None])
    total = waves.sum(axis=0)
    return amplitude * total / max(float(np.abs(total).max()), 1e-12)
