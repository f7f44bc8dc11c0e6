"""The residual between a record and a model's free runs: its noise floor, and what it correlates with."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.records.record import Record
from identification.fit.validation import FreeRuns


def noise_floor(residual: np.ndarray, window: np.ndarray) -> float:
    """Standard deviation of the white part of a residual, from its second differences within windows.

    A smooth misfit drops out of second differences; white noise of variance s^2 gives them a variance of 6 s^2.  If no
    window holds three values, as for a slow sensor, second differences across windows are used.
    """
    e = np.asarray(residual)
    same = (window[2:] == window[1:-1]) & (window[1:-1] == window[:-2])
    second = e[2:] - 2.0 * e[1:-1] + e[:-2]
    for some in (second[same], second):
        known = some[np.isfinite(some)]
        if known.size:
            return max(float(np.sqrt(np.mean(known**2) / 6.0)), 1e-9)
    return 1e-9


def noise_floors(values: np.ndarray, window: np.ndarray, readings: np.ndarray | None) -> np.ndarray:
    """The noise floor of each channel, (C,), from its readings alone, a mask of the values' shape, (rows, C)."""
    held = np.ones(values.shape, dtype=bool) if readings is None else readings
    return np.array([noise_floor(v[h], window[h]) for v, h in zip(values.T, held.T, strict=True)])


def resolution(values: np.ndarray) -> float:
    """The step of the readings, or 0 if fewer than two in three of them repeat a value on a common grid.

    Steps as fine as a file's last digit give nearly as many values as readings and do not count.
    """
    levels = np.unique(np.round(values[np.isfinite(values)], 9))
    if levels.size < 3 or 3 * levels.size > np.isfinite(values).sum():
        return 0.0
    steps = np.diff(levels)
    step = float(np.median(steps[steps < 1.5 * steps.min()]))
    places = (levels - levels[0]) / step
    return step if np.abs(places - np.round(places)).max() < 0.05 else 0.0


def residual_summary(runs: FreeRuns, record: Record) -> dict[str, dict[str, Any]]:
    """Per channel: size, noise floor, resolution, colour, and the channels that correlate with the residual's rate."""
    result, floors = {}, noise_floors(runs.residual, runs.window, runs.readings).tolist()
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
