"""A record in stretches for a filter: its readings, the noises that push the vehicle, and the initial states."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Self

import numpy as np

from auv_gym.model import outputs_of
from auv_gym.plant import Chart, Correction, Plant, Runs
from auv_gym.records.attitude import ANGLES
from auv_gym.records.record import Record
from identification.deciding import LONGEST_INTERNAL_WAVE, SHORTEST_INTERNAL_WAVE
from identification.fit.averaging import Averages
from identification.fit.first_readings import RATES, driven_states
from identification.fit.parameters import Parameters
from identification.fit.residual import noise_floor, noise_floors, resolution
from identification.fit.shooting import Shooting, unknown_states
from identification.fit.sticking import sticking_sizes
from identification.fit.validation import head_windows

_PROBE, _SMALL = 1e-4, 1e-6  # change of a state for its slopes, rad, m or m/s; of one in m^3
_WIDE = 3.0  # initial deviation of a state, over its standard deviation in the record
_UNTOLD = (0.3, 0.05)  # initial deviation of an unmeasured state: share of its first guess, and the least, in SI units
_TURNED = 1.0  # rad about each axis, initial deviation of an attitude in a chart
_SHARED = 100.0  # initial deviation of an unknown constant state, in its scales
_SLOW = 10.0  # s, in which a unit acceleration reaches the record's velocities; where a search for noises begins
_FEW_SENSORS = 2  # most sensors of a vehicle for which the filter estimates the lag errors of the readings
# correlation time of random accelerations, s, and deviation of its logarithm: from swell, some seconds, to turbulence
# and changing currents, minutes
_USUAL_TIME = (25.0, 1.0)
_ROWS_IN_A_WAVE = 8  # least rows in a period of a wave, to tell it from shorter noises
_OF_READINGS = 10.0  # unit of lasting sensor errors, over the noise of their channel


class Stretches(Parameters):
    """Measured outputs of a record over stretches, and the runs of a plant from one row to the next.

    windows: adjacent ones are joined to one stretch, except for vehicles with `stepped` inputs.  A channel whose
    readings are all the same counts as not measured.  For large changes of attitude, its states and readings are
    rotation vectors, see `auv_gym.plant.Chart`.
    States that no channel reveals (`Family.resting`) are not pushed, and only those that commands move
    (`Family.driven`) are followed; the linearised filter leaves out the effects of other states through these.
    process: whether accelerations may push the vehicle; without, each window starts anew, as a free run.
    stride: samples to a row, over which readings, and the model's outputs, are averaged.
    doubt: see `Parameters`.  guess: initial states, (W, n_states), by default those of free runs over the first
    seconds.
    """

    def __init__(
        self,
        plant: Plant,
        record: Record,
        windows: Sequence[slice],
        *,
        doubt: float = np.inf,
        process: bool = True,
        stride: int = 1,
        guess: np.ndarray | None = None,
    ):
        super().__init__(plant, doubt)
        self.record, self.process = record, process
        self._windows = tuple(windows)
        self._added: tuple[tuple[Sequence[int], Sequence[int], float], ...] = ()
        self._sticking: dict[str, tuple[float, ...]] = {}
        family = plant.family
        windows = sorted(windows, key=lambda w: w.start)
        stretches = _joined(windows, record) if process and not family.stepped else list(windows)
        every, self.chart = outputs_of(plant, record), Chart.along(family, record)
        stride = 1 if self.chart.on else stride  # a chart refers to single samples
        means = Averages.of(record, plant.outputs, every, stretches, stride)
        self.stride, self.stretches, self.rows = stride, list(means.stretches), means.rows
        self.runs = Runs.over(plant, record, self.stretches, self.chart, stride, means.shares)
        kept = ANGLES if self.chart.on else ()
        self.channels = tuple(
            n for n in plant.outputs if record.has(n) and (n in kept or _varies(record[n][means.samples]))
        )
        if not self.channels:
            raise ValueError(
                f"Plant {plant.name!r} needs at least one of {', '.join(plant.outputs)} in the record, with readings "
                f"that vary, got {', '.join(record.names)}: rename the columns by a mapping."
            )
        self.columns = np.array([plant.outputs.index(name) for name in self.channels])
        lengths = [(w.stop - w.start) // stride for w in self.stretches]
        self.offsets = np.r_[0, np.cumsum(lengths)[:-1]].astype(int)
        self.signals = self.chart.signals(plant.outputs, means.values, self.rows)[:, self.columns]
        self.every, self._away = self.chart.readings(plant.outputs, means.values), means.away
        # contiguous by rows, as compiled code expects: another memory layout would trigger another compilation
        picked = (values[:, self.columns] for values in (self.every, means.counts))
        self.measured, self.counts = map(np.ascontiguousarray, picked)
        self.finite = np.isfinite(self.measured)
        self.stretch_of_row = np.repeat(np.arange(len(lengths)), lengths)
        self._by_row = replace(self.runs, begin=self.rows, stop=self.rows + stride)
        self.durations = self._durations()
        self._size = len(family.states) + len(family.sensors)
        shared = unknown_states(plant)
        self._shared = np.array([name in shared for name in family.states])
        segment = np.searchsorted([s.start for s in record.segments], [w.start for w in self.stretches], side="right")
        self.carried = np.r_[False, segment[1:] == segment[:-1]] & self._shared.any()
        self._kicks()
        self._begin(every[means.samples][:, self.columns], means.samples, guess)

    def _durations(self) -> np.ndarray:
        time, stride = self.record.time, self.stride
        ahead = np.minimum(self.rows + stride, time.size - 1)
        durations = time[ahead] - time[self.rows]
        if stride > 1:  # the last row of a segment has no successor
            ends = self.runs.first[ahead] != self.runs.first[self.rows]
            ends |= self.rows + stride >= time.size
            durations[ends] = stride * (time[self.rows + 1] - time[self.rows])[ends]
        return np.where(durations > 0.0, durations, self.plant.dt)

    def _kicks(self) -> None:
        """Choose the states that accelerations push: velocities, and measured positions of `Family.drifting`."""
        family = self.plant.family
        resting = family.resting(self.channels)
        names = [n for n in family.states if _is_velocity(n) and n not in resting]
        names += [n for n in family.drifting if n in family.states and n in self.channels]
        self.driven = driven_states(self.plant, self.record, self.chart, self.channels)
        self.resting = np.array([n in resting and n not in self.driven for n in family.states])
        self.pushed = tuple(names) if self.process else ()
        self._pushed = np.array([family.states.index(n) for n in self.pushed], dtype=int)
        self.kicks = np.array([[i, 0.5, 0.5, 0.0] for i in self._pushed]).reshape(-1, 4)

    def _begin(self, readings: np.ndarray, samples: np.ndarray, guess: np.ndarray | None) -> None:
        """Set guess and spread of the initial states, the path of the first linearisation, and the scales.

        readings: (n, C), of all samples of the stretches.
        """
        plant, family = self.plant, self.plant.family
        heads = Shooting(plant, self.record, head_windows(self.record, self.stretches, plant.settle))
        if guess is None:
            found = heads.solve(plant, ())
            guess = found.starts if np.isfinite(found.cost) else heads.first_guess
        self.guess = guess
        self.starts = np.zeros((len(self.stretches), self._size + len(self.pushed)))
        self.starts[:, : len(family.states)] = guess
        path = self.starts[self.stretch_of_row]
        spread = np.zeros(self._size)
        for s, name in enumerate(family.states):
            told = self._told(name)
            if told is not None:
                path[:, s] = told
                floor = noise_floor(told, self.stretch_of_row, self.record.time[self.rows])
                least = _UNTOLD[1] if name in self.driven else 1e-6
                spread[s] = max(_WIDE * float(np.std(told)), 10.0 * floor, least)
                if self.chart.on and name in ANGLES:
                    spread[s] = _TURNED
            elif not self.resting[s] and name not in family.shared:
                spread[s] = max(_UNTOLD[0] * float(np.abs(guess[:, s]).max()), _UNTOLD[1])
            if self._shared[s]:
                spread[s] = _SHARED * dict(heads.shared).get(s, 1.0)
        if len(family.sensors) <= _FEW_SENSORS:
            spread[len(family.states) :] = _UNTOLD[1]
        self.spread = spread
        self.first_path = path
        free = np.flatnonzero(spread > 0.0)
        a, c = self._slopes(plant.vector, path, free)[:2]
        self.live = free[_seen(a, c)]
        self._push_what_lasts(set(self.live.tolist()))
        kept = np.isin(self._pushed, self.live)
        kept &= np.isin(np.arange(len(kept)), np.unique(self._pushed, return_index=True)[1])  # each state once
        self.pushed = tuple(n for n, k in zip(self.pushed, kept, strict=True) if k)
        self._pushed, self.kicks = self._pushed[kept], self.kicks[kept]
        drop = self._size + np.flatnonzero(~kept)
        self.starts, self.first_path = np.delete(self.starts, drop, axis=1), np.delete(path, drop, axis=1)
        self._balance_kicks(np.delete(path, drop, axis=1))
        self.unit = self._units(spread)
        self.leads, self.periods = np.arange(len(self.pushed)), np.zeros(len(self.pushed))
        if self.chart.on:
            readings, held = self.signals, self.finite
        else:
            held = np.stack([self.record.readings(n)[samples] for n in self.channels], axis=1) & np.isfinite(readings)
        times = self.record.time[self.rows if self.chart.on else samples]
        floors = noise_floors(readings, np.repeat(self.stretch_of_row, self.stride), held, times)
        read = [self.record[name][self.record.readings(name)] for name in self.channels]
        steps = [resolution(values) / np.sqrt(12.0) for values in read]
        self.floors, self.steps_of_readings = np.maximum(floors, 1e-8), np.array(steps)
        step = float(np.median(self.durations))
        centre, deviation = np.log(max(_USUAL_TIME[0], 3.0 * step)), _USUAL_TIME[1]
        self.slowness = (centre, deviation, np.log(0.5 * step))

    def with_noises(self, velocities: Sequence[int], readings: Sequence[int], period: float) -> Self:
        """The problem with more noises: accelerations of a swell, and lasting sensor errors.

        velocities: the accelerations to which those of a swell are added.  readings: the channels, by index, whose
        errors may last.  period: s; both kinds then come in pairs, see `identification.fit.kalman`; the second of a
        pair has no effect of its own and shares the noises of the first.  With period 0, sensor errors merely decay.
        """
        other, before, copies = copy(self), len(self.pushed), 2 if period else 1
        states = [*self._pushed[list(velocities)], *[self.live[0]] * len(readings)]
        units = [*self.unit[list(velocities)], *(_OF_READINGS * self.floors[c] for c in readings)]
        kicks = [*self.kicks[list(velocities)], *([-1.0 - self.columns[c], 0.0, 0.0, 0.0] for c in readings)]
        names = [*(self.pushed[d] for d in velocities), *(self.channels[c] for c in readings)]
        other.pushed = (*self.pushed, *(name for name in names for _ in range(copies)))
        other._pushed = np.r_[self._pushed, np.repeat(states, copies)].astype(int)
        other.unit = np.r_[self.unit, np.repeat(units, copies)]
        other.kicks = np.vstack([self.kicks, np.repeat(np.array(kicks), copies, axis=0)])
        added = np.arange(copies * len(names))
        other.leads = np.r_[self.leads, before + added // copies * copies]
        other.periods = np.r_[self.periods, np.full(len(added), period)]
        if period:
            other.kicks[before::2, 3] = 2.0 * np.pi / period
            other.kicks[before + 1 :: 2] = [[state, 0.0, 0.0, 0.0] for state in states]
        none = np.zeros((len(self.first_path), len(added)))
        other.starts = np.hstack([self.starts, none[: len(self.starts)]])
        other.first_path = np.hstack([self.first_path, none])
        for name in ("_first_system", "_kept"):  # these are for fewer noises
            other.__dict__.pop(name, None)
        other._added = (*self._added, (velocities, readings, period))
        return other

    def in_rows_of(self, stride: int) -> Self:
        """The problem with `stride` samples to a row, and with the noises that were added."""
        other = type(self)(
            self.plant,
            self.record,
            self._windows,
            doubt=self.doubt,
            process=self.process,
            stride=stride,
            guess=self.guess,
        )
        for added in self._added:
            other = other.with_noises(*added)
        return other

    def sticking_sizes(self, path: str) -> tuple[float, ...]:
        """The sizes of a stiction worth trying, in probes, see `identification.fit.sticking`; found once."""
        if path not in self._sticking:
            self._sticking[path] = sticking_sizes(self.plant, self.record, path)
        return self._sticking[path]

    @property
    def velocities(self) -> list[int]:
        """Indices of the accelerations that push velocities, without those of `with_noises`."""
        return [d for d in np.flatnonzero(~self.further).tolist() if _is_velocity(self.pushed[d])]

    @property
    def further(self) -> np.ndarray:
        """Which noises `with_noises` has added, (D,): those of a swell, and lasting sensor errors."""
        return self.swells | self.misread

    @property
    def swells(self) -> np.ndarray:
        """Which noises are those of a swell, (D,)."""
        return self.periods > 0.0

    @cached_property
    def periods_of_internal_waves(self) -> list[float]:
        """Periods, s, spaced so that one is near that of any internal wave that a stretch can show."""
        whole = max(float(self.durations[self.stretch_of_row == w].sum()) for w in range(len(self.stretches)))
        least = max(SHORTEST_INTERNAL_WAVE, _ROWS_IN_A_WAVE * float(np.median(self.durations)))
        most = min(LONGEST_INTERNAL_WAVE, 0.5 * whole)
        count = int(np.ceil(np.log(most / least) / np.log(1.5))) + 1 if most > least else 0
        return np.geomspace(least, most, count).tolist() if count else []

    @property
    def usual_times(self) -> np.ndarray:
        """Logarithms of usual correlation times, (D,); waves stay in phase for two periods."""
        return np.maximum(self.slowness[0], np.log(np.maximum(2.0 * self.periods, 1e-9)))

    @property
    def slowest(self) -> np.ndarray:
        """Logarithms of the longest correlation times, (D,); anything slower is an effect."""
        return self.usual_times + 2.0 * self.slowness[1]

    @property
    def misread(self) -> np.ndarray:
        """Which noises are lasting sensor errors, which push nothing, (D,)."""
        return self.kicks[self.leads, 0] < 0.0

    @property
    def _leading(self) -> np.ndarray:
        """Which accelerations have noises of their own, (D,)."""
        return self.leads == np.arange(len(self.leads))

    def _units(self, spread: np.ndarray) -> np.ndarray:
        """Units of accelerations: the pushed state's spread over `_SLOW`; for positions and angles, a speed."""
        units = spread[self._pushed] / _SLOW
        within = np.diff(self.stretch_of_row) == 0
        for d, (name, i) in enumerate(zip(self.pushed, self._pushed, strict=True)):
            if not _is_velocity(name):
                seen = self.chart.on and name in ANGLES
                place = self.chart.turned[self.rows, ANGLES.index(name)] if seen else self.first_path[:, i]
                speed = np.diff(place)[within] / self.durations[:-1][within]
                units[d] = max(float(np.median(np.abs(speed))), 1e-9) if speed.size else units[d]
        return units

    def _push_what_lasts(self, lasting: set[int]) -> None:
        """Push a position or angle instead of its rate, if the rate has no memory, as in quasi-steady motion."""
        names = self.plant.family.states
        told = [n if i in lasting else RATES.get(n, n) for n, i in zip(self.pushed, self._pushed, strict=True)]
        self.pushed, self._pushed = tuple(told), np.array([names.index(n) for n in told], dtype=int)
        self.kicks[:, 0] = self._pushed

    def _told(self, name: str) -> np.ndarray | None:
        """The values of a state at every row according to the readings or the commands, or None."""
        if name in self.driven:
            return self.driven[name][self.rows]
        family, time = self.plant.family, self.record.time[self.rows]
        of = next((n for n in (name, family.nearly.get(name, "")) if n in self.channels), None)
        angle = RATES.get(name)
        if of is None and angle not in self.channels:
            return None
        if of in ANGLES and self.chart.on:
            return np.zeros(len(self.rows))
        values = self.signals[:, self.channels.index(of or angle or "")]
        fine = np.isfinite(values)
        if fine.sum() < 3:
            return None
        step = np.diff(time, prepend=time[0] - 1.0)
        elapsed = np.cumsum(np.where(step > 0.0, step, 1.0))  # each dive of a log may count its time from zero
        filled = np.interp(elapsed, (elapsed + self._away)[fine], values[fine])
        if of is not None:
            return filled
        rate = np.zeros(len(filled))
        for begin, end in pairwise([*self.offsets.tolist(), len(filled)]):
            own = slice(begin, end)
            if own.stop - own.start > 2:
                rate[own] = np.gradient(filled[own], time[own])
        return rate

    def _balance_kicks(self, path: np.ndarray) -> None:
        """Set the shares of an acceleration before and after a sample so that they act like one held over the sample.

        A velocity that decays to a share f of itself changes by (f - 1) / ln f of the change by the acceleration alone,
        and its integral by 1/(1 - f) + 1/ln f of that of a full push at the beginning.
        """
        if not len(self._pushed):
            return
        a = self._slopes(self.plant.vector, path, self._pushed)[0]
        for d in range(len(self._pushed)):
            f = float(np.clip(np.median(a[:, d, d]), 1e-6, 1e6)) ** (1.0 / self.stride)
            f = f if abs(f - 1.0) > 1e-3 else 1.0 - 1e-3
            before = 1.0 / (1.0 - f) + 1.0 / np.log(f)
            self.kicks[d, 1:3] = before, (f - 1.0) / np.log(f) - before * f

    @property
    def _moving(self) -> np.ndarray:
        """Indices of the filtered quantities, live states and accelerations, among all states, (N,)."""
        return np.r_[self.live, self._size + np.arange(len(self.pushed))]

    @property
    def averaged(self) -> float:
        """Seconds over which readings are averaged; 0 if they are not averaged."""
        return self.stride * self.record.sample_interval if self.stride > 1 else 0.0

    @property
    def shared_values(self) -> tuple[str, ...]:
        """The unknown states that are constant within each segment."""
        return tuple(n for n, shared in zip(self.plant.family.states, self._shared, strict=True) if shared)

    def within(self, windows: Sequence[slice]) -> np.ndarray:
        """1 for the rows in windows of the record, else 0, (rows,)."""
        inside = np.zeros(len(self.record.time))
        for w in windows:
            inside[w] = 1.0
        return inside[self.rows]

    @property
    def count(self) -> int:
        """Number of values that count in the likelihood."""
        return int(self.finite.sum())

    def _one_by_one(self) -> Correction:
        """Runs of each row alone, without correction and with constant accelerations."""
        rows, nothing = len(self.rows), np.empty(0, dtype=np.int64)
        corrected = (self.every, np.empty((0, 0, 0)), nothing, nothing)
        return Correction(*corrected, self.kicks, np.ones((rows, len(self.kicks))), np.zeros(rows, bool), self._shared)

    def _slopes(self, vector: np.ndarray, path: np.ndarray, live: np.ndarray, moved: np.ndarray | None = None):
        """Slopes of the next row's live states (rows, n, m) and of the channels (rows, C, m), outputs and next states.

        moved: (m,), indices of the states, sensors and accelerations to differentiate by, by default the live states;
        the runs are over one row, from the states of a path, (rows, F).
        """
        moved = live if moved is None else moved
        probes = self._probes(moved)
        starts = np.repeat(path[None], len(moved) + 1, axis=0)
        for j, (i, probe) in enumerate(zip(moved, probes, strict=True), start=1):
            starts[j, :, i] += probe
        vectors = np.repeat(vector[None], len(starts), axis=0)
        self.work.add(len(vectors) * len(self.rows) * self.stride)
        y, after = self.plant.follow_many(self._by_row, vectors, starts, self._one_by_one(), True)
        with np.errstate(over="ignore", invalid="ignore"):  # a run may diverge
            a = ((after[1:] - after[0])[:, :, live] / probes[:, None, None]).transpose(1, 2, 0)
            c = ((y[1:] - y[0])[:, :, self.columns] / probes[:, None, None]).transpose(1, 2, 0)
        return a, c, y[0][:, self.columns], after[0]

    def _probes(self, moved: np.ndarray) -> np.ndarray:
        """Changes of states for their slopes, and of accelerations that change a state by as much in a row."""
        family, row = self.plant.family, float(np.median(self.durations))
        names = (*family.states, *family.sensors, *self.pushed)
        sizes = [_SMALL if names[i].endswith("m3") else _PROBE for i in moved]
        return np.array(sizes) / np.where(np.asarray(moved) < self._size, 1.0, row)


def _is_velocity(name: str) -> bool:
    """Whether a state is a velocity or an angular rate."""
    return name.endswith(("mps", "radps"))


def _varies(readings: np.ndarray) -> bool:
    """Whether any two readings differ."""
    told = readings[np.isfinite(readings)]
    return bool(told.size) and bool(np.ptp(told) > 0.0)


def _joined(windows: Sequence[slice], record: Record) -> list[slice]:
    """The windows, with adjacent ones of a segment joined."""
    begins = {s.start for s in record.segments}
    found: list[slice] = []
    for w in windows:
        if found and found[-1].stop == w.start and w.start not in begins:
            found[-1] = slice(found[-1].start, w.stop)
        else:
            found.append(w)
    return found


def _seen(a: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Indices of the states that affect a channel, directly or through others."""
    links = np.abs(a).max(axis=0) > 1e-12
    seen = np.abs(c).max(axis=(0, 1)) > 1e-9
    while True:
        more = seen | (links & seen[:, None]).any(axis=0)
        if np.array_equal(more, seen):
            return np.flatnonzero(seen)
        seen = more
