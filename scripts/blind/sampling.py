"""Logs as recorders leave them: cut at arbitrary times, with quantised sensors of several rates that drop out."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np

from auv_gym.channels import channel
from auv_gym.model import elapsed_over_gaps
from auv_gym.plant import Plant
from auv_gym.plant.record_check import needs_of
from auv_gym.records.merging import merged
from auv_gym.records.record import Record
from auv_gym.records.streams import Stream
from scripts.blind.logs import Conditions

EVEN, REALISTIC = "even", "realistic"
_CUT = 0.1  # largest share of a run that is missing at each end of its log
_SILENT = (0.01, 0.03)  # share of a log, range of the length of the gap in all channels, and of the outage of a sensor
_SHORTEST = 5  # rows of a gap or an outage, more than a record fills in
_LOST = 0.02  # share of a sensor's readings that are lost one by one
_LATE, _OF_INTERVAL = 0.01, 0.05  # s, and share of the shortest interval: a time stamp is late by at most the smaller
_EVERY = (1, 2, 3)  # rows between the readings of a sensor that does not give the times
_RESOLUTION = {  # by the unit in a channel's name; a fifth to a half of the usual noise of most sensors
    "rad": radians(0.1),
    "radps": radians(0.05),
    "mps": 0.005,
    "m": 0.01,
    "C": 0.01,
}
_SENSORS = (  # channels that are read together
    ("roll_rad", "pitch_rad", "heading_rad"),
    ("p_radps", "q_radps", "r_radps"),
    ("u_mps", "v_mps", "w_mps"),
    ("u_dvl_mps", "v_dvl_mps", "w_dvl_mps"),
    ("north_m", "east_m"),
)


def simulated(conditions: Conditions) -> Conditions:
    """The conditions of the run of which a log is a part: it is longer if its ends are cut off."""
    if conditions.sampling == EVEN:
        return conditions
    return replace(conditions, duration=conditions.duration / (1.0 - _CUT))


def recorded(plant: Plant, run: Record, conditions: Conditions, seed: int) -> Record:
    """The log of a run, sampled as the conditions say."""
    return run if conditions.sampling == EVEN else sampled(plant, run, np.random.default_rng([seed, 2]))


def sampled(plant: Plant, run: Record, rng: np.random.Generator) -> Record:
    """A part of a run with a gap in it, in rows with slightly late time stamps.

    Readings are quantised and some are lost.  The sensor with the vehicle's leading channel, the commands and the
    measured inputs of the vehicle are read in each row, and other sensors in every first to third row, each from a row
    of its own on and sometimes a row late.  One of these sensors has an outage.  The missing readings are treated as
    those in a table of a log file.  `elapsed_s` keeps the time since the run began.
    """
    needs = needs_of(plant)
    leading = next(name for name in needs.required if run.has(name))
    if "elapsed_s" in plant.inputs and not run.has("elapsed_s"):
        run = run.with_channels({"elapsed_s": elapsed_over_gaps(run)})
    rows = _rows(len(run), rng)
    late = min(_LATE, _OF_INTERVAL * min(float(np.diff(run.time[s]).min()) for s in run.segments))
    time = run.time[rows] + late * rng.random(rows.size)
    labels = np.repeat(run.labels, [s.stop - s.start for s in run.segments])[rows]
    values = {name: _rounded(name, run[name][rows]) for name in run.names}
    sensors = _sensors_of(run)
    other = [k for k, own in enumerate(sensors) if leading not in own and set(own) & set(plant.outputs)]
    silent = int(rng.choice(other)) if other else -1
    for number, own in enumerate(sensors):
        read = _read(rows.size, int(rng.choice(_EVERY)) if number in other else 1, rng)
        if number == silent:
            read[_stretch(rows.size, rng)] = False
        for name in own:
            values[name][~read] = np.nan
    joined = merged([Stream(time, values, labels=labels)], leading)
    log = Record.from_arrays(
        joined.time, joined.values, joined.segment, run.attrs, required=needs.required or (leading,),
        unread=joined.unread, spare=needs.spare,
    )  # fmt: skip
    return log.with_intervals({n: s for n, s in joined.intervals.items() if log.has(n)}).split_gaps()


def _rows(count: int, rng: np.random.Generator) -> np.ndarray:
    """The rows of a run that its log has."""
    first, last = (int(rng.uniform(0.0, _CUT) * count) for _ in range(2))
    rows = np.arange(first, count - last)
    return np.delete(rows, _stretch(rows.size, rng))


def _stretch(count: int, rng: np.random.Generator) -> slice:
    """A gap or an outage in this many rows."""
    length = max(int(rng.uniform(*_SILENT) * count), _SHORTEST)
    first = int(rng.integers(1, max(count - length, 2)))
    return slice(first, first + length)


def _read(count: int, every: int, rng: np.random.Generator) -> np.ndarray:
    """A mask of the rows, (count,), that hold a reading of a sensor with one reading in `every` rows."""
    own = np.arange(int(rng.integers(every)), count, every)
    if every > 1:
        own = np.minimum(own + rng.integers(2, size=own.size), count - 1)
    read = np.zeros(count, dtype=bool)
    read[own[rng.random(own.size) >= _LOST]] = True
    return read


def _sensors_of(run: Record) -> list[tuple[str, ...]]:
    """The measured channels of a record, those of one sensor together."""
    known = [tuple(name for name in own if run.has(name)) for own in _SENSORS]
    alone = [(name,) for name in run.names if not any(name in own for own in known)]
    return [own for own in (*known, *alone) if own and own != ("elapsed_s",) and not channel(own[0]).held]


def _rounded(name: str, values: np.ndarray) -> np.ndarray:
    step = _RESOLUTION.get(name.rpartition("_")[2], 0.0)
    return np.round(values / step) * step if step and not channel(name).held else values
