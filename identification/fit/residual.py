"""The residual between a record and a model's free runs: its noise floor, and what it correlates with."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.records.record import Record
from identification.fit.validation import FreeRuns

_USUAL_SPAN = 1.5  # times the median span of three readings, beyond which they are too far apart to tell noise


def noise_floor(residual: np.ndarray, window: np.ndarray, time: np.ndarray | None = None) -> float:
    """Standard deviation of the white part of a residual, from its distances to the chord of its neighbours.

    A smooth misfit hardly leaves its chord; white noise of variance s^2 does by s^2 (1 + a^2 + b^2), a and b being the
    neighbours' shares.  Neighbours farther apart than usual are left out.  If no window holds three values, as for a
    slow sensor, chords across windows are used.  time: of the values, in any unit; evenly spaced by default.
    """
    e = np.asarray(residual)
    t = np.arange(e.size, dtype=float) if time is None else np.asarray(time, dtype=float)
    same = (window[2:] == window[1:-1]) & (window[1:-1] == window[:-2])
    span = t[2:] - t[:-2]
    with np.errstate(divide="ignore", invalid="ignore"):  # windows may begin at one time
        later = (t[1:-1] - t[:-2]) / span
    even = np.where((later > 0.0) & (later < 1.0), later, 0.5)
    away = e[1:-1] - even * e[2:] - (1.0 - even) * e[:-2]
    squares = away**2 / (1.0 + even**2 + (1.0 - even) ** 2)
    for some in (same, np.ones(same.size, dtype=bool)):
        known = some & np.isfinite(squares)
        if known.any():
            near = known & (span <= _USUAL_SPAN * np.median(span[known]))
            return max(float(np.sqrt(np.mean(squares[near if near.any() else known]))), 1e-9)
    return 1e-9


def noise_floors(
    values: np.ndarray, window: np.ndarray, readings: np.ndarray | None, time: np.ndarray | None = None
) -> np.ndarray:
    """The noise floor of each channel, (C,), from its readings alone, a mask of the values' shape, (rows, C).

    time: of the rows, see `noise_floor`.
    """
    held = np.ones(values.shape, dtype=bool) if readings is None else readings
    t = np.arange(len(values), dtype=float) if time is None else time
    return np.array([noise_floor(v[h], window[h], t[h]) for v, h in zip(values.T, held.T, strict=True)])


def resolution(values: np.ndarray) -> float:
    """The step of the readings, or 0 if fewer than one in three of them repeats a value on a common grid.

    Steps as fine as a file's last digit give nearly as many values as readings and do not count.
    """
    levels = np.unique(np.round(values[np.isfinite(values)], 9))
    if levels.size < 3 or 3 * levels.size > 2 * np.isfinite(values).sum():
        return 0.0
    steps = np.diff(levels)
    step = float(np.median(steps[steps < 1.5 * steps.min()]))
    places = (levels - levels[0]) / step
    return step if np.abs(places - np.round(places)).max() < 0.05 else 0.0


def residual_summary(runs: FreeRuns, record: Record) -> dict[str, dict[str, Any]]:
    """Per channel: size, noise floor, resolution, colour, and the channels that correlate with the residual's rate."""
    result, floors = {}, noise_floors(runs.residual, runs.window, runs.readings, record.time[runs.rows]).tolist()
    for c, name in enumerate(runs.channels):
        held = runs.held(c)
        e, window, rows = runs.residual[held, c], runs.window[held], runs.rows[held]
        rate = np.gradient(e) if e.size > 1 else np.zeros(e.size)
        turns = window[1:] != window[:-1]
        inner = ~(np.r_[True, turns] | np.r_[turns, True])[: e.size]
        goes_with = {}
        for other in record.names:
            signal = record[other][rows][inner]
            signals = {f"sin({other})": np.sin(signal), f"cos({other})": np.cos(signal)}
            if not (channel(other).angle and np.ptp(signal) > np.pi):
                signals = {other: signal}
            for label, values in signals.items():
                if np.std(values) > 0.0 and np.std(rate[inner]) > 0.0:
                    goes_with[label] = float(np.corrcoef(values, rate[inner])[0, 1])
        strongest = dict(sorted(goes_with.items(), key=lambda item: -abs(item[1]))[:4])
        white = runs.white(c)
        result[name] = {
            "rms": float(np.sqrt(np.mean(e**2))),
            "noise_floor": floors[c],
            "resolution": resolution(record[name][record.readings(name)]),
            "lag_1_correlation": float(white.correlation[0]),
            "whiteness_p": white.p_value,
            "rate_correlates_with": strongest,
        }
    return result
