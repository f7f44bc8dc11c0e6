"""A monitor of a vehicle: alarms while it runs, and the cause, found from the data around an alarm."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from auv_gym.model import inputs_of, outputs_of
from auv_gym.param import check_number
from auv_gym.plant import Chart, Plant, check_vehicle
from auv_gym.plant.record_check import described
from auv_gym.records.record import Record, check_record
from identification.changes.forms import Changeable, tied_names, usable_log
from identification.changes.onset import Timeline, find_onsets
from identification.deciding import DOUBT
from identification.diagnosis.log.checking import Asked
from identification.diagnosis.search.attribution import selected
from identification.diagnosis.search.known import Known, fit_known
from identification.diagnosis.search.trials import Progress
from identification.fit.noises import Noise
from identification.fit.online import FilterPlan, OnlineFilter
from identification.fit.prediction_errors import PredictionErrors
from identification.fit.windows import stretches_of
from identification.monitor.bank import CLIP, Bank, bars_for, memories

Values = Mapping[str, float] | np.ndarray
_NOT_FELT = ("north_m", "east_m", "elapsed_s")  # signals that no force depends on
CONSTANT, SCATTER = "constant", "scatter"
# longest memory of the tests, as a share of a clean log's samples: over such a memory, the errors of P fitted
# coefficients add this share times P to the square of z; the filter's memory is longer by the second factor
_OF_CLEAN, _KEPT_ON = 0.05, 2.0
_LONGEST = 1000.0  # samples
_LEAST_CLEAN = 200  # samples of a clean log
_MOST_INTERVALS = 10000  # of a clean log between two samples, through which the filter still goes
_BEHIND, _AFTER = 6.0, 3.0  # in windows of the vehicle: the span before and after an alarm that is diagnosed


@dataclass(frozen=True)
class Alarm:
    """An alarm of a monitor: when, and in which channel, innovations stopped being white noise.

    time: s.  channel: "" if several channels together raise it.  signal: the command or state that the innovations
    correlate with, CONSTANT for a steady offset, SCATTER for more noise.  memory: s, time constant of the test that
    raised it.
    over: its statistic over the bar.
    """

    time: float
    channel: str
    signal: str
    memory: float
    over: float


@dataclass(frozen=True, eq=False)
class Learned:
    """A vehicle as learned from a clean log: its coefficients and noises, and how white its innovations are.

    interval: s, between samples.  unit: (C,), RMS of the innovations.  signals: names, the constant first; columns:
    positions of the others among inputs and states.  clean: (n, J - 1), their values.  present: (n, C), which readings
    the log has.  memories, inflation: see `Bank`.  missing: paths of an effect that the clean log itself shows, and of
    its alternatives; expect no alarm for that effect.
    """

    plant: Plant
    plan: FilterPlan
    interval: float
    unit: np.ndarray
    signals: tuple[str, ...]
    columns: np.ndarray
    clean: np.ndarray
    present: np.ndarray
    memories: np.ndarray
    inflation: np.ndarray
    missing: tuple[str, ...] = ()


class Monitor:
    """A monitor that watches a vehicle sample by sample; `learn` makes one from a clean log.

    The innovations of its Kalman filter are tested as described in `identification.monitor.bank`.  After an alarm the
    tests start again, and the filter continues.  Time and memory per sample are constant; the last samples are kept for
    `stretch`.  time: s; over: the greatest statistic of the last sample, over its bar.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle, replace_at
        >>> from identification import Monitor, closed_loop
        >>> glider = load_vehicle("slocum")
        >>> monitor = Monitor.learn(closed_loop(glider, rng=np.random.default_rng(0), duration=1200), glider)
        >>> bent = replace_at(glider, "effects.rudder.offset", 0.05)
        >>> alarm = monitor.run(closed_loop(bent, rng=np.random.default_rng(1)))[0]
        >>> alarm.channel, alarm.signal
        ('heading_rad', 'constant')
    """

    def __init__(self, learned: Learned, false_alarms_per_hour: float = 0.1):
        check_number("false_alarms_per_hour", false_alarms_per_hour, "1/h", above=0.0)
        self.learned, self.false_alarms_per_hour, self.time, self.over = learned, false_alarms_per_hour, 0.0, 0.0
        self._filter = OnlineFilter(learned.plan)
        self._bank = Bank(learned.memories, learned.columns, len(learned.plan.channels), learned.inflation)
        rate = false_alarms_per_hour * learned.interval / 3600.0
        self.bars = bars_for(self._bank, learned.clean, learned.present, rate, np.random.default_rng(0))
        self._scales, self._shapes = 1.0 / learned.unit, ((len(learned.plant.inputs),), (len(learned.plant.outputs),))
        rows = int((_BEHIND + _AFTER) * learned.plant.window / learned.interval) + 1
        self._kept: deque[tuple[float, np.ndarray, np.ndarray]] = deque(maxlen=rows)

    @classmethod
    def learn(
        cls,
        record: Record,
        plant: Plant,
        *,
        false_alarms_per_hour: float = 0.1,
        steady: bool = False,
        doubt: float = DOUBT,
        noise: Noise | None = None,
        trust: bool = False,
        progress: Progress = lambda fraction, text: None,
    ) -> Monitor:
        """A monitor of a vehicle whose coefficients and noises are first fitted to a clean log, as in a diagnosis.

        steady: use the filter's mean gains over the later half of the clean log, instead of gains for each sample's
        motion.  doubt: as in a diagnosis; 0 holds the coefficients.  noise: a noise estimated before; nothing is fitted
        then.  Innovations that are not quite white in the clean log raise the bars; an effect that it shows is listed
        in `learned.missing`.
        Raises ValueError if the log cannot be used, or if the attitude turns too far for the filter.
        """
        check_vehicle("Monitor.learn", plant)
        check_record("Monitor.learn", record)
        check_number("false_alarms_per_hour", false_alarms_per_hour, "1/h", above=0.0)
        check_number("doubt", doubt, "1", at_least=0.0)
        errors, missing = dict[str, float](), ()
        if noise is None:
            log = usable_log(record, plant, Asked(doubt=doubt, trust=trust), "of the healthy vehicle")
            known = fit_known(log, lambda f, text: progress(0.4 * f, text))
            progress(0.4, "looking for waves and for sensor errors that last")
            known, _ = known.with_further_noises(known.nominal)
            missing = _missing(known, plant, doubt, lambda f, text: progress(0.5 + 0.5 * f, text))
            bench, state, record = known.bench, known.nominal, log.record
            noise, plant = bench.problem.noise_at(state.point), state.plant
            errors = {p: error for p, (_, error, _) in bench.intervals(state).items() if 0.0 < error < np.inf}
        record = described(plant, record)
        if len(record) < _LEAST_CLEAN:
            raise ValueError(f"A clean log needs at least {_LEAST_CLEAN} samples, got {len(record)}: record longer.")
        if Chart.along(plant.family, record).on:
            raise ValueError(
                "A monitor follows Euler angles, and in this log the attitude turns too far for them: take a log "
                "without loops."
            )
        plant = replace(plant, dt=record.sample_interval, deviations={**plant.deviations, **errors})
        problem = PredictionErrors(plant, record, stretches_of(plant, record), doubt=doubt).with_noises_of(noise)
        point = problem.point(plant.vector, problem.logs_of(noise))
        longest = min(_LONGEST, _OF_CLEAN * len(record))
        learned = _learned(record, problem.online(point, _KEPT_ON * longest), memories(longest), steady)
        return cls(replace(learned, missing=missing), false_alarms_per_hour)

    def begin(self, inputs: Values, measured: Values) -> None:
        """Start the filter again at the vehicle's present state, for example after a gap; the tests continue.

        inputs: the commands from now on.
        """
        u, y = self._vectors(inputs, measured)
        self._filter.begin(u, y)
        self._kept.append((self.time, u, y))

    def step(self, inputs: Values, measured: Values, duration: float | None = None) -> Alarm | None:
        """Process a sample `duration` s (default: the usual interval) after the last one; returns an alarm or None.

        inputs: the commands held since the last sample, by channel or in the vehicle's order.  measured: the readings
        at the end, likewise; NaN if there is none.
        """
        u, y = self._vectors(inputs, measured)
        if duration is None:
            return self._step(u, y, self.learned.interval)
        if not 0.0 < duration <= _MOST_INTERVALS * self.learned.interval:
            raise ValueError(
                f"A monitor's step needs the seconds since the last sample, above 0 and at most {_MOST_INTERVALS} of "
                f"its intervals of {self.learned.interval:g} s, got {duration}: after a longer gap, begin again."
            )
        return self._step(u, y, duration)

    def _step(self, u: np.ndarray, y: np.ndarray, duration: float) -> Alarm | None:
        self.time += duration
        self._kept.append((self.time, u, y))
        own = self._filter
        if not own.step(u, y, duration):
            return None
        self._bank.take(own.innovations, self._scales, own.inputs, own.states)
        told, bars = self._bank.told, self.bars
        self.over = max(told.item(0) / bars.pooled, told.item(3) / bars.single)
        return self._alarm() if self.over > 1.0 else None

    def replay(self, record: Record) -> Iterator[Alarm | None]:
        """An alarm or None for each sample of a log except the first after each gap, where the filter starts again."""
        check_record("A monitor", record)
        record = described(self.learned.plant, record)
        inputs, outputs, read, time = _columns(self.learned.plant, record)
        for segment in record.segments:
            self.time = float(time[segment.start])
            self.begin(inputs[segment.start], outputs[segment.start])
            for k in range(segment.start + 1, segment.stop):
                yield self._step(inputs[k - 1], read[k], float(time[k] - time[k - 1]))

    def run(self, record: Record) -> list[Alarm]:
        """The alarms in a log."""
        return [alarm for alarm in self.replay(record) if alarm is not None]

    def stretch(self) -> Record:
        """The last samples, as a record."""
        if len(self._kept) < 2:
            raise ValueError(f"A monitor's stretch needs at least two samples, got {len(self._kept)}: step it first.")
        plant, (time, inputs, outputs) = self.learned.plant, zip(*self._kept, strict=True)
        held = np.array([*inputs[1:], inputs[-1]])  # a row of a record holds the commands from that row on
        columns = dict(zip(plant.inputs, held.T, strict=True))
        columns |= {n: v for n, v in zip(plant.outputs, np.array(outputs).T, strict=True) if np.isfinite(v).any()}
        return Record.from_arrays(np.array(time), columns, attrs={"source": "monitor", "vehicle": plant.name})

    def explain(self, record: Record | None = None, alarm: Alarm | None = None, **options) -> Timeline:
        """The cause and its time, by `find_onsets` over the samples around an alarm (default: the last samples).

        Data from after the alarm is used as well.  options: of `find_onsets`.
        """
        plant = self.learned.plant
        if record is None:
            record = self.stretch()
        elif alarm is not None:
            first = max(alarm.time - _BEHIND * plant.window, float(record.time[0]))  # a log may begin shortly before it
            last = max(alarm.time + _AFTER * plant.window, first + (_BEHIND + _AFTER) * plant.window)
            record = record.select((record.time >= first) & (record.time <= last))
        return find_onsets(record, plant, **options)

    def _vectors(self, inputs: Values, measured: Values) -> tuple[np.ndarray, np.ndarray]:
        """Both as arrays of their own, since they are kept."""
        plant = self.learned.plant
        # whether something is an array is known much faster than whether it is a mapping
        if not isinstance(inputs, np.ndarray) and isinstance(inputs, Mapping):
            inputs = np.array([inputs[n] if n in inputs else plant.constants[n] for n in plant.inputs])
        if not isinstance(measured, np.ndarray) and isinstance(measured, Mapping):
            if measured and not any(n in measured for n in plant.outputs):
                raise ValueError(
                    f"A monitor of {plant.name} needs readings of {', '.join(plant.outputs)}, got "
                    f"{', '.join(measured)}: rename them."
                )
            measured = np.array([measured.get(n, np.nan) for n in plant.outputs])
        u, y = np.array(inputs, np.float64), np.array(measured, np.float64)
        if (u.shape, y.shape) != self._shapes:  # compiled code does not check indices
            names, count = ", ".join((*plant.inputs, *plant.outputs)), (len(plant.inputs), len(plant.outputs))
            raise ValueError(
                f"A monitor of {plant.name} needs {count[0]} inputs and {count[1]} readings ({names}), got arrays of "
                f"shape {u.shape} and {y.shape}."
            )
        return u, y

    def _alarm(self) -> Alarm:
        learned, told, bars = self.learned, self._bank.told, self.bars
        alone = told[3] / bars.single >= told[0] / bars.pooled
        memory, signal = told[4:6].astype(int) if alone else told[1:3].astype(int)
        squares = self._bank.squares[memory, signal]
        most = int(np.argmax(squares))
        name = learned.plan.channels[most] if alone or squares[most] > 0.5 * squares.sum() else ""
        self._bank.clear()
        looks_back = float(learned.memories[memory] * learned.interval)
        return Alarm(self.time, name, (*learned.signals, SCATTER)[signal], looks_back, float(self.over))


def _missing(known: Known, plant: Plant, doubt: float, progress: Progress) -> tuple[str, ...]:
    """The effect that a clean log shows most clearly above the bar of a diagnosis, with its alternatives."""
    effects = Changeable.of(plant, known.bench.record, doubt).effects
    found = selected(known.bench, known.nominal, effects, len(effects), (), progress)
    return () if found.chosen is None else (*found.chosen.candidate.paths, *tied_names([found]))


def _learned(record: Record, plan: FilterPlan, lasting: np.ndarray, steady: bool) -> Learned:
    """The statistics of innovations over a clean log."""
    plant = plan.plant
    names, count = [*plant.inputs, *plant.family.states], len(plan.channels)
    if steady:
        found = [(own.gains.copy(), own.whiten.copy()) for own in _followed(record, plan)]
        late = found[len(found) // 2 :]
        gains, whiten = (np.mean(each, axis=0) for each in zip(*late, strict=True))
        plan = replace(plan, gains=gains, whiten=whiten)
    found = [np.concatenate((own.innovations, own.inputs, own.states)) for own in _followed(record, plan)]
    errors, clean = np.split(np.array(found), [count], axis=1)
    columns = np.array([k for k, n in enumerate(names) if np.std(clean[:, k]) > 1e-9 and n not in _NOT_FELT], dtype=int)
    unit = np.sqrt(np.nanmean(np.minimum(errors**2, CLIP**2), axis=0))
    bank, sums, seen = Bank(lasting, columns, count), np.zeros((len(lasting), 2, count)), np.zeros(len(lasting))
    for k, (e, signals) in enumerate(zip(errors, clean, strict=True)):
        bank.take(e, 1.0 / unit, signals, signals[:0])
        late, squares = k > 2.0 * lasting, bank.squares
        sums[late, 0] += squares[late, :-1].mean(axis=1)
        sums[late, 1] += squares[late, -1]
        seen += late
    inflation = np.maximum(sums / np.maximum(seen, 1.0)[:, None, None], 1.0)
    return Learned(
        plant, plan, float(record.sample_interval), unit, (CONSTANT, *(names[k] for k in columns)), columns,
        np.ascontiguousarray(clean[:, columns]), np.isfinite(errors), lasting, inflation,
    )  # fmt: skip


def _followed(record: Record, plan: FilterPlan) -> Iterator[OnlineFilter]:
    """The filter after each sample of a log whose innovations count."""
    own, (inputs, outputs, read, time) = OnlineFilter(plan), _columns(plan.plant, record)
    for segment in record.segments:
        own.begin(inputs[segment.start], outputs[segment.start])
        for k in range(segment.start + 1, segment.stop):
            if own.step(inputs[k - 1], read[k], float(time[k] - time[k - 1])):
                yield own


def _columns(plant: Plant, record: Record) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The inputs, outputs, readings (the outputs with NaN if filled in) and times of a log."""
    outputs = outputs_of(plant, record)
    held = [record.readings(name) if record.has(name) else np.zeros(len(record), bool) for name in plant.outputs]
    return inputs_of(plant, record), outputs, np.where(np.stack(held, axis=1), outputs, np.nan), record.time
