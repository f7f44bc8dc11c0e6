"""First guesses, from a record's readings, of the states in which its windows begin."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Protocol

import numpy as np

from auv_gym.model import outputs_of
from auv_gym.plant import Chart, Correction, Plant, Runs
from auv_gym.records.attitude import ANGLES
from auv_gym.records.record import Record

RATES = {"r_radps": "heading_rad", "q_radps": "pitch_rad", "p_radps": "roll_rad", "depth_rate_mps": "depth_m"}
LINE, LEAST_LINE = 0.6, 6  # s and samples at a window's start; a line through them gives the first guess
RATE_SAMPLES = 4  # samples at a window's start from which a rate is guessed
_RATE_SHARE = 0.3  # of an angle's error after a sample, added to its rate: a memory of some samples


class Windows(Protocol):
    """Windows of a record with their readings: logged, signals and finite, (rows, C), of these channels.

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

    Measured states are read off, rates of measured signals come from their first samples, and the rest are zero.  In a
    chart, rates about the body axes follow from the rotations between attitudes, and attitudes are those of the chart.
    """
    family, chart = problem.plant.family, problem.chart
    starts = np.zeros((len(problem.windows), len(family.states)))
    moving = driven_states(problem.plant, problem.record, chart, problem.channels)
    for w, offset in enumerate(problem.offsets):
        times = problem.record.time[problem.windows[w]]
        past = times - times[0]
        full = np.full(len(family.outputs), np.nan)
        full[problem.columns] = problem.logged[offset]
        starts[w] = problem.plant.initial(full)[: len(family.states)]
        if chart.on:
            starts[w] = chart.seen(starts[[w]], [problem.windows[w].start])[0]
        for name, values in moving.items():
            starts[w, family.states.index(name)] = values[problem.windows[w].start]
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


def driven_states(plant: Plant, record: Record, chart: Chart, channels: Collection[str]) -> dict[str, np.ndarray]:
    """The `Family.driven` states that none of these channels measures, along a record, (n,) by name.

    They come from the vehicle's model under the logged commands, from rest where a segment begins, with all measured
    states set to their readings: a slightly wrong model in such a long free run would soon point elsewhere.
    """
    family = plant.family
    found = [name for name in family.states if name in family.driven & family.resting(channels)]
    if not found:
        return {}
    runs = Runs.over(plant, record, record.segments, chart)
    measured = chart.readings(plant.outputs, outputs_of(plant, record))
    count = len(family.states)
    gains = np.zeros((len(measured), count + len(family.sensors), len(plant.outputs)))
    for s, name in enumerate(family.states):
        if name in channels:
            gains[:, s, plant.outputs.index(name)] = 1.0
        elif RATES.get(name) in channels:
            gains[:, s, plant.outputs.index(RATES[name])] = _RATE_SHARE / plant.dt
    correction = replace(
        Correction.none(plant, runs), measured=measured, gains=gains, decays=np.ones((len(measured), 0))
    )
    first = np.zeros((len(runs.begin), gains.shape[1]))
    begun = np.array([plant.initial(y)[:count] for y in outputs_of(plant, record)[runs.begin]])
    first[:, :count] = chart.seen(begun, runs.begin)
    after = plant.follow_many(runs, plant.vector[None], first[None], correction, True)[1][0]
    after[runs.stop - 1] = 0.0  # a segment does not begin with the last state of the one before
    moved = np.roll(np.where(np.isfinite(after), after, 0.0), 1, axis=0)
    return {name: moved[:, family.states.index(name)] for name in found}


def _line(t: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope of a least-squares straight line through values, and its value at t = 0."""
    middle, mean = float(t.mean()), float(y.mean())
    power = float((t - middle) @ (t - middle))
    slope = float((t - middle) @ (y - mean)) / power if power > 0.0 else 0.0
    return slope, mean - slope * middle
