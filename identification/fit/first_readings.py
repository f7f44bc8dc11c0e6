"""What a record says of the states in which its windows begin."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from auv_gym.plant import Chart, Plant
from auv_gym.records.attitude import ANGLES
from auv_gym.records.record import Record

RATES = {"r_radps": "heading_rad", "q_radps": "pitch_rad", "p_radps": "roll_rad", "depth_rate_mps": "depth_m"}
LINE, LEAST_LINE = 0.6, 6  # s and samples at a window's start through which a line gives the first guess
RATE_SAMPLES = 4  # at a window's start, from which a rate is guessed


class Windows(Protocol):
    """Windows of a record and the readings in them: logged, signals and finite, (rows, C), of these channels.

    See `identification.fit.shooting.Shooting`.
    """

    plant: Plant
    record: Record
    windows: tuple[slice, ...]
    offsets: np.ndarray
    channels: tuple[str, ...]
    columns: np.ndarray
    chart: Chart
    logged: np.ndarray
    signals: np.ndarray
    finite: np.ndarray


def first_readings(problem: Windows) -> np.ndarray:
    """States at the starts of a problem's windows, shape (W, n_states).

    Measured where they are measured; rates of measured signals from their first samples; else zero.  In a chart, rates
    about the body axes follow from the turns between attitudes, and attitudes are those that the chart has.
    """
    family, chart = problem.plant.family, problem.chart
    starts = np.zeros((len(problem.windows), len(family.states)))
    for w, offset in enumerate(problem.offsets):
        times = problem.record.time[problem.windows[w]]
        past = times - times[0]
        full = np.full(len(family.outputs), np.nan)
        full[problem.columns] = problem.logged[offset]
        starts[w] = problem.plant.initial(full)[: len(family.states)]
        if chart.on:
            starts[w] = chart.seen(starts[[w]], [problem.windows[w].start])[0]
        rows = slice(offset, offset + int(np.searchsorted(past, LINE)))
        for name in family.states:
            told = next((n for n in (name, family.nearly.get(name)) if n in problem.channels), None)
            c = problem.channels.index(told) if told else 0
            fine = problem.finite[rows, c]
            if told and fine.sum() >= LEAST_LINE:
                line = _line(past[: len(fine)][fine], problem.signals[rows, c][fine])
                begun = problem.signals[offset, c] if chart.on and name in ANGLES else 0.0
                starts[w, family.states.index(name)] = line[1] - begun
        head = slice(offset, offset + min(RATE_SAMPLES, len(times)))
        for rate, angle in RATES.items():
            if rate in family.states and rate not in problem.channels and angle in problem.channels:
                values = problem.signals[head, problem.channels.index(angle)]
                starts[w, family.states.index(rate)] = _line(past[: len(values)], values)[0]
    return starts


def _line(t: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope of a straight line through values, by least squares, and its value at t = 0."""
    middle, mean = float(t.mean()), float(y.mean())
    power = float((t - middle) @ (t - middle))
    slope = float((t - middle) @ (y - mean)) / power if power > 0.0 else 0.0
    return slope, mean - slope * middle
