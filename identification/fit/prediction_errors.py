"""The likelihood of a record by the one-step errors of an extended Kalman filter, with noise of sensors and of motion.

Free runs blame the sensors for all that a model does not explain.  Waves, gusts and turbulence push the vehicle, and a
controller steers against them, so that a fit of free runs in closed loop is biased.  Here accelerations of unknown
strength and correlation time push it; where these come to nothing, the filter is a free run, the fit output error.
Sources: Ljung 1999, ch. 7; Harvey 1989, ch. 3; Forssell and Ljung 1999, Automatica 35, pages 1215-1241.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from auv_gym.model import outputs_of
from auv_gym.param import positions, replace_at, spec_at, value_at
from auv_gym.plant import Correction, Plant, Runs
from auv_gym.records.record import Record
from identification.fit.first_readings import RATES
from identification.fit.kalman import Pass, System, run_filter, slopes_of, start_slopes
from identification.fit.residual import noise_floor, resolution
from identification.fit.shooting import REACH, Shooting, at_edge, unknown_states
from identification.fit.validation import head_windows

_PROBE, _SMALL = 1e-4, 1e-6  # change of a state for its slopes, rad, m or m/s; of one in m^3
_WIDE = 3.0  # deviations of a state over the record that it may be off by where a stretch begins
_UNTOLD = (0.3, 0.05)  # of a state that no channel tells: share of its first guess, and the least, in SI units
_SHARED = 100.0  # scales by which a state that nobody knows may be off
_SLOW = 10.0  # s, in which an acceleration would make the velocities of the record; where a search for noises begins
_FIRST_GUESSES = 10.0 ** np.arange(-5.0, 1.5)  # of accelerations, in those
_LEAST_PROCESS = 1e-6  # the least that an acceleration is sought down to, in those
_FAINT = 1e-3  # in those, below which one that would be likelier if it were stronger is sought among the first guesses
_SAME = 0.05  # of the log-likelihood: a linearisation about a better path that changes less is the last
_AS_LINEAR = 0.01  # of the log-likelihood by the linearised filter: a run of the vehicle so near it needs no other one
_LINEARISATIONS, _FIRST_LINEARISATIONS = 8, 12  # from near by, and from what readings say
_SHORTER = 0.3  # of a step to another linearisation that is worse
_FIRST_NOISE_STEPS, _NOISE_STEPS = 40, 6  # to better noises, at first and after each turn
_NOISE_GAIN, _NOISE_REACH = 0.005, 2.0  # of the log-likelihood, the least that a step must bring; the longest, in logs
_FEW_SENSORS = 2  # of a vehicle, up to which the filter follows how far their readings lag behind
_RARER = 1.5  # sample intervals between the readings of a channel from which on some rows hold none
_NO_START = 1e-9  # of the slopes by starts, below which one does nothing
_LOOSE = 0.3  # deviations of a stretch's likeliest start that the filter lets it be off by
_LEAST_LEFT = 1e-10  # of a start's variance, of what a record leaves: less is rounding
_LEAST_NOISE = 0.03  # of a channel, over that of its second differences: simulated readings may have none
_DAMPING = 1e-5  # of the information, so that no step goes far where the record tells next to nothing
_TRIES, _TIGHTER = 6, 30.0  # of a step, and how much more it is damped each time
_QUIETER = 30.0  # times weaker accelerations, with which a fit is tried too
_DESCENTS = 3  # steps of the parameters with the same gains
_NOISE_RANGE = np.log(1e4)
_GAIN = 0.005  # of the log-likelihood that a turn must bring for a fit to go on
_HALVINGS = 6
_SEEN = 5.4  # half the 0.1 % point of chi-square: what an acceleration must add to the log-likelihood to be stated
# scales of a parameter, over which its slopes are taken: more about a corner; else so little that slopes are true to a
# thousandth, since what they are off by moves those estimates far that act nearly alike
STEP, _STEP_ABOUT_CORNERS = 0.01, 0.1
_KINKED = ("deadband", "backlash", "dead_time", "lag", "slowness", "lost_travel")  # what comes last in their paths
_ENOUGH = 10.0  # deviations of the noise by which a free run changes, from which on more counts the same
# correlation time of what pushes a vehicle, s, and deviation of its logarithm: from swell, some seconds, to turbulence
# and changing currents, minutes
_USUAL_TIME = (25.0, 1.0)
_NO_SCALES: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviations of white noise by channel, and of accelerations (m/s^2, rad/s^2) with correlation times, s.

    process: by the velocity that is pushed, as (standard deviation, correlation time); what is absent is zero.
    """

    measurement: Mapping[str, float]
    process: Mapping[str, tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Point:
    """Parameters and noises, and the filter with them.

    vector: (n_parameters,).  logs: (C + 2 D,), logarithms of the noises.  errors: (rows, C), one-step errors over their
    deviations.  scores: (rows,), log-likelihood of each row.  path: (rows, F), filtered states.
    starts: (W, F), the likeliest states where stretches begin; roots: (W, n, n), how far the filter lets them be off.
    """

    vector: np.ndarray
    logs: np.ndarray
    errors: np.ndarray
    scores: np.ndarray
    path: np.ndarray
    gains: np.ndarray
    whiten: np.ndarray
    innovations: np.ndarray
    starts: np.ndarray
    roots: np.ndarray
    system: System | None


class PredictionErrors:
    """Measured outputs of a record over stretches, and the filters of a plant that predict them row by row.

    windows: neighbouring ones are one stretch, which the filter goes through; of vehicles with `stepped` inputs each is
    a stretch.  A channel whose readings are all the same is taken as not measured.
    process: whether accelerations may push the vehicle; without, each window starts anew, as a free run.
    counted: windows whose rows count in the likelihood, by default all; the others are only filtered.
    doubt: standard deviation of the plant's own coefficients, relative, where they have none of their own.
    """

    def __init__(
        self,
        plant: Plant,
        record: Record,
        windows: Sequence[slice],
        *,
        doubt: float = np.inf,
        process: bool = True,
        scales: Mapping[str, float] = _NO_SCALES,
        counted: Sequence[slice] | None = None,
    ):
        self.plant, self.record, self.doubt, self.process = plant, record, doubt, process
        family = plant.family
        windows = sorted(windows, key=lambda w: w.start)
        self.stretches = _joined(windows, record) if process and not family.stepped else list(windows)
        self.runs = Runs.over(plant, record, self.stretches)
        self.rows = np.concatenate([np.arange(w.start, w.stop) for w in self.stretches])
        self.channels = tuple(n for n in plant.outputs if record.has(n) and _varies(record[n][self.rows]))
        if not self.channels:
            raise ValueError(
                f"Plant {plant.name!r} needs at least one of {', '.join(plant.outputs)} in the record, with readings "
                f"that vary, got {', '.join(record.names)}: rename the columns by a mapping."
            )
        self.columns = np.array([plant.outputs.index(name) for name in self.channels])
        lengths = [w.stop - w.start for w in self.stretches]
        self.offsets = np.r_[0, np.cumsum(lengths)[:-1]].astype(int)
        self.every = np.where(self._read(), outputs_of(plant, record)[self.rows], np.nan)
        self.measured = self.every[:, self.columns]
        self.finite = np.isfinite(self.measured)
        self.stretch_of_row = np.repeat(np.arange(len(lengths)), lengths)
        self.counted = self.within(windows if counted is None else counted)
        self.index, self._scales = positions(plant), dict(scales)
        self._by_row = Runs(
            self.rows, self.rows + 1, self.runs.times, self.runs.inputs, self.runs.first, len(self.rows)
        )
        self.durations = self._durations()
        self._size = len(family.states) + len(family.sensors)
        shared = unknown_states(plant)
        self._shared = np.array([name in shared for name in family.states])
        segment = np.searchsorted([s.start for s in record.segments], [w.start for w in self.stretches], side="right")
        self.carried = np.r_[False, segment[1:] == segment[:-1]] & self._shared.any()
        self._kicks()
        self._begin()

    # ---- what does not change --------------------------------------------------------------------------------------

    def _read(self) -> np.ndarray:
        """Which rows hold a reading of each output, (rows, outputs): what lies between readings tells nothing new."""
        read, time = np.ones((len(self.rows), len(self.plant.outputs)), dtype=bool), self.record.time[self.rows]
        for c, name in enumerate(self.plant.outputs):
            if not self.record.has(name) or self.record.interval_of(name) < _RARER * self.record.sample_interval:
                continue
            for w, begin in enumerate(self.offsets):
                own = slice(begin, begin + self.stretches[w].stop - self.stretches[w].start)
                number = np.floor((time[own] - time[begin]) / self.record.interval_of(name) + 1e-6)
                read[own, c] = np.diff(number, prepend=-1.0) > 0.0
        return read

    def _durations(self) -> np.ndarray:
        time = self.record.time
        ahead = np.minimum(self.rows + 1, time.size - 1)
        durations = time[ahead] - time[self.rows]
        return np.where(durations > 0.0, durations, self.plant.dt)

    def _kicks(self) -> None:
        """Which states accelerations push: velocities, or where there are none that count, what moves by itself."""
        family = self.plant.family
        resting = set(family.at_rest) if not any(n in self.channels for n in family.at_rest) else set()
        names = [n for n in family.states if n.endswith(("mps", "radps")) and n not in resting]
        names += [n for n in ("north_m", "east_m") if n in family.states and n in self.channels]
        self.resting = np.array([n in resting for n in family.states])
        self.pushed = tuple(names) if self.process else ()
        self._pushed = np.array([family.states.index(n) for n in self.pushed], dtype=int)
        self.kicks = np.array([[i, 0.5, 0.5] for i in self._pushed]).reshape(-1, 3)

    def _begin(self) -> None:
        """Guess and spread of the states at the stretches' starts, the path along which all begins, and the scales."""
        plant, family = self.plant, self.plant.family
        heads = Shooting(plant, self.record, head_windows(self.record, self.stretches, plant.settle))
        found = heads.solve(plant, ())
        guess = found.starts if np.isfinite(found.cost) else heads.first_guess
        self.starts = np.zeros((len(self.stretches), self._size + len(self.pushed)))
        self.starts[:, : len(family.states)] = guess
        path = self.starts[self.stretch_of_row]
        spread = np.zeros(self._size)
        for s, name in enumerate(family.states):
            told = self._told(name)
            if told is not None:
                path[:, s] = told
                floor = noise_floor(told, self.stretch_of_row)
                spread[s] = max(_WIDE * float(np.std(told)), 10.0 * floor, 1e-6)
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
        self.pushed = tuple(n for n, k in zip(self.pushed, kept, strict=True) if k)
        self._pushed, self.kicks = self._pushed[kept], self.kicks[kept]
        drop = self._size + np.flatnonzero(~kept)
        self.starts, self.first_path = np.delete(self.starts, drop, axis=1), np.delete(path, drop, axis=1)
        self._balance_kicks(np.delete(path, drop, axis=1))
        self.unit = spread[self._pushed] / _SLOW  # of accelerations
        floors = [
            noise_floor(self.measured[seen, c], self.stretch_of_row[seen]) for c, seen in enumerate(self.finite.T)
        ]
        steps = [resolution(self.record[name]) / np.sqrt(12.0) for name in self.channels]
        self.floors, self.steps_of_readings = np.maximum(floors, 1e-8), np.array(steps)
        step = float(np.median(self.durations))
        centre, deviation = np.log(max(_USUAL_TIME[0], 3.0 * step)), _USUAL_TIME[1]
        self.slowness = (centre, deviation, np.log(0.5 * step), centre + 2.0 * deviation)  # slower ones are effects

    def _push_what_lasts(self, lasting: set[int]) -> None:
        """Put a place in the place of a velocity of which nothing is left after a sample, as in quasi-steady motion."""
        names = self.plant.family.states
        told = [n if i in lasting else RATES.get(n, n) for n, i in zip(self.pushed, self._pushed, strict=True)]
        self.pushed, self._pushed = tuple(told), np.array([names.index(n) for n in told], dtype=int)
        self.kicks[:, 0] = self._pushed

    def _told(self, name: str) -> np.ndarray | None:
        """What readings say of a state at every row, or None."""
        family, time = self.plant.family, self.record.time[self.rows]
        of = next((n for n in (name, family.nearly.get(name, "")) if n in self.channels), None)
        angle = RATES.get(name)
        if of is None and angle not in self.channels:
            return None
        values = self.measured[:, self.channels.index(of or angle or "")]
        fine = np.isfinite(values)
        if fine.sum() < 3:
            return None
        filled = np.interp(time, time[fine], values[fine])
        if of is not None:
            return filled
        rate = np.zeros(len(filled))
        for w, begin in enumerate(self.offsets):
            own = slice(begin, begin + self.runs.stop[w] - self.runs.begin[w])
            if own.stop - own.start > 2:
                rate[own] = np.gradient(filled[own], time[own])
        return rate

    def _balance_kicks(self, path: np.ndarray) -> None:
        """Shares of an acceleration before and after a sample, with which one that is held over it acts as it should.

        A velocity that decays to a share f of itself moves by (f - 1) / ln f of what the acceleration alone would do,
        and what it moves by 1/(1 - f) + 1/ln f of what a whole push at the beginning would.
        """
        if not len(self._pushed):
            return
        a = self._slopes(self.plant.vector, path, self._pushed)[0]
        for d in range(len(self._pushed)):
            f = float(np.clip(np.median(a[:, d, d]), 1e-6, 1e6))
            f = f if abs(f - 1.0) > 1e-3 else 1.0 - 1e-3
            before = 1.0 / (1.0 - f) + 1.0 / np.log(f)
            self.kicks[d, 1:] = before, (f - 1.0) / np.log(f) - before * f

    @property
    def shared_values(self) -> tuple[str, ...]:
        """States that nobody knows, once for each segment."""
        return tuple(n for n, shared in zip(self.plant.family.states, self._shared, strict=True) if shared)

    def within(self, windows: Sequence[slice]) -> np.ndarray:
        """1 for the rows in windows of the record, else 0, (rows,)."""
        inside = np.zeros(len(self.record.time))
        for w in windows:
            inside[w] = 1.0
        return inside[self.rows]

    @property
    def count(self) -> int:
        """How many values are counted."""
        return int((self.finite * self.counted[:, None]).sum())

    def scale(self, path: str) -> float:
        """The change of a parameter that counts as one: as given, its probe, or a tenth of its value."""
        if path not in self._scales:
            spec, value = spec_at(self.plant, path), abs(value_at(self.plant, path))
            own = 0.1 * value if path in self.plant.coefficients else 0.0
            self._scales[path] = own or spec.probe or 0.1 * value or 1.0
        return self._scales[path]

    def scaled(self, scales: Mapping[str, float]) -> PredictionErrors:
        """The same problem with other scales of these paths."""
        other = copy(self)
        other._scales = self._scales | dict(scales)
        return other

    def bounds(self, path: str) -> tuple[float, float]:
        """The least and the most that a parameter may be; `REACH` deviations from given where it has one."""
        low, high = spec_at(self.plant, path).bounds
        value, far = value_at(self.plant, path), REACH * self.plant.deviation(path, self.doubt)
        return max(low, value - far), min(high, value + far)

    def pulls(self, vector: np.ndarray, paths: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """How far the paths are from the given plant, in standard deviations of it, and 1 over those, in scales."""
        far = np.array([vector[self.index[p]] - self.plant.vector[self.index[p]] for p in paths]).reshape(len(paths))
        deviations = np.array([self.plant.deviation(p, self.doubt) for p in paths]).reshape(len(paths))
        scales = np.array([self.scale(p) for p in paths]).reshape(len(paths))
        return far / deviations, scales / deviations

    # ---- the filter ------------------------------------------------------------------------------------------------

    def _free(self, gains: np.ndarray, decays: np.ndarray, rows: bool) -> Correction:
        count = len(self.rows) if rows else len(self.stretches)
        carried = np.zeros(count, dtype=bool) if rows else self.carried
        return Correction(self.every, gains, self.kicks, decays, carried, self._shared)

    def _slopes(self, vector: np.ndarray, path: np.ndarray, live: np.ndarray):
        """Slopes of the next row's live states (rows, n, n) and of the channels (rows, C, n), outputs and next states.

        From the states of a path, (rows, F), one row on.
        """
        probes = self._probes(live)
        starts = np.repeat(path[None], len(live) + 1, axis=0)
        for j, (i, probe) in enumerate(zip(live, probes, strict=True), start=1):
            starts[j, :, i] += probe
        none = np.empty((0, path.shape[1], len(self.plant.outputs)))
        decays = np.ones((len(self.rows), len(self.kicks)))
        vectors = np.repeat(vector[None], len(starts), axis=0)
        y, after = self.plant.follow_many(self._by_row, vectors, starts, self._free(none, decays, True), True)
        with np.errstate(over="ignore", invalid="ignore"):  # of one that runs away
            a = ((after[1:] - after[0])[:, :, live] / probes[:, None, None]).transpose(1, 2, 0)
            c = ((y[1:] - y[0])[:, :, self.columns] / probes[:, None, None]).transpose(1, 2, 0)
        return a, c, y[0][:, self.columns], after[0]

    def _probes(self, live: np.ndarray) -> np.ndarray:
        """By how much states are moved for their slopes."""
        names = (*self.plant.family.states, *self.plant.family.sensors)
        return np.array([_SMALL if names[i].endswith("m3") else _PROBE for i in live])

    def _system(self, vector: np.ndarray, path: np.ndarray, starts: np.ndarray, roots: np.ndarray) -> System:
        """The plant linearised along a path of states, with what is assumed of the stretches' starts."""
        live, solid, pushed = self.live, len(self.live), len(self.pushed)
        a, c, y, after = self._slopes(vector, path, live)
        rows = len(self.rows)
        kicked = np.zeros((rows, solid, pushed))
        for d, i in enumerate(self._pushed):
            j = int(np.flatnonzero(live == i)[0])
            kicked[:, :, d] = self.kicks[d, 1] * a[:, :, j]
            kicked[:, j, d] += self.kicks[d, 2]
        kicked *= self.durations[:, None, None]
        for j in np.flatnonzero(live >= len(self._shared)):  # a sensor without a lag has no state that lasts
            if np.median(np.abs(a[:, j, j] - 1.0)) < 1e-9:
                a[:, j], a[:, :, j], c[:, :, j] = 0.0, 0.0, 0.0
        error = np.where(self.finite, self.measured - y, 0.0)
        forcing = np.zeros((rows, solid))
        forcing[:-1] = path[1:, live] - after[:-1, live]
        if pushed:
            forcing += np.einsum("rnd,rd->rn", kicked, path[:, self._size :])
        begin = np.zeros(rows, dtype=np.int64)
        begin[self.offsets] = np.where(self.carried, 2, 1)
        constant = np.zeros(solid + pushed, dtype=bool)
        states = len(self._shared)
        constant[:solid] = [i < states and bool(self._shared[i]) for i in live]
        return System(
            np.ascontiguousarray(np.concatenate([a, kicked], axis=2)),
            np.ascontiguousarray(np.concatenate([c, np.zeros((rows, c.shape[1], pushed))], axis=2)),
            forcing, error, self.finite, begin, constant, self.durations, roots, self._origin(path, starts),
        )  # fmt: skip

    def _origin(self, path: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """The means with which stretches begin, from a path, (W, N); accelerations begin at none."""
        origin = np.zeros((len(self.stretches), len(self.live) + len(self.pushed)))
        origin[:, : len(self.live)] = (starts - path[self.offsets])[:, self.live]
        return origin

    def _fixed(self, stretch: int) -> np.ndarray:
        """Which live states do not begin anew in a stretch."""
        states = len(self._shared)
        return np.array([bool(self.carried[stretch]) and i < states and bool(self._shared[i]) for i in self.live])

    @cached_property
    def _widest(self) -> np.ndarray:
        """Roots of the starts' covariances of which nothing is known but how the states vary over the record."""
        return np.array(
            [np.diag(np.where(self._fixed(w), 0.0, self.spread[self.live])) for w in range(len(self.stretches))]
        )

    def _better_starts(
        self, system: System, made: Pass, logs: np.ndarray, starts: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """The likeliest starts, roots of `_LOOSE` times their deviations, and the most that better starts can gain.

        A filter that begins so keeps near its linearisation.  How wide it begins does not matter: in a linear system
        its likelihood is that of the likeliest start but for a constant, whatever the model.
        """
        telling = self._telling
        slopes = slopes_of(system, made, telling, *self._numbers(logs))
        every = slopes
        if not np.array_equal(telling, self.counted):
            every = slopes_of(system, made, self.counted, *self._numbers(logs))
        starts, roots, solid, promised = starts.copy(), np.zeros_like(system.start), len(self.live), 0.0
        for w in range(len(self.stretches)):
            free = np.flatnonzero(~self._fixed(w))
            own = np.ix_(free, free)
            units = self.spread[self.live][free]
            r = slopes.means[w, :solid][free] * units
            n = np.outer(r, r) - 2.0 * slopes.covariances[w, :solid, :solid][own] * np.outer(units, units)
            root = system.start[w][:, free] / units
            # the covariance R'R becomes R'(I - R N R')R; what that adds to its inverse is the data's information
            values, vectors = np.linalg.eigh(np.eye(len(root)) - root @ n @ root.T)
            cross = (vectors / np.sqrt(np.clip(values, _LEAST_LEFT, 1.0))).T @ root @ n
            values, vectors = np.linalg.eigh(0.5 * (n + n.T) + cross.T @ cross)
            values = np.maximum(values, 0.0)
            data, before = (vectors * values) @ vectors.T, root.T @ root
            told = r + data @ (before @ r)
            away = (self.starts[w][self.live][free] - starts[w][self.live][free]) / units
            step = np.linalg.solve(data + np.eye(len(free)), told + away)
            slope = every.means[w, :solid][free] * units  # other rows tell more, so that there is less to gain
            promised += 0.5 * float(slope @ np.linalg.solve(data + np.eye(len(free)), slope))
            starts[w, self.live[free]] += step * units
            half = vectors * np.minimum(_LOOSE / np.sqrt(values + 1.0), 1.0)
            roots[w][own] = (units[:, None] * half).T
        return starts, roots, promised

    @property
    def _held_first(self) -> np.ndarray:
        """Which stretches begin with rows that do not count, (W,): these alone tell how they begin."""
        return self.counted[self.offsets] == 0.0

    @property
    def _telling(self) -> np.ndarray:
        """1 for the rows that tell where their stretch begins, (rows,): those before the first that counts otherwise.

        Likelihoods of rows given those between, which do not count, tell of a start what these leave.
        """
        turns = np.diff(self.counted, prepend=self.counted[0]) != 0.0
        turns[self.offsets] = False
        turned = np.cumsum(turns)
        return (turned == turned[self.offsets][self.stretch_of_row]).astype(float)

    def _numbers(self, logs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        count, pushed = len(self.channels), len(self.pushed)
        return np.exp(2.0 * logs[:count]), np.exp(logs[count : count + pushed]), np.exp(logs[count + pushed :])

    def point(self, vector: np.ndarray, logs: np.ndarray, near: Point | None = None) -> Point:
        """The filter with parameters and noises, linearised about its own path, sought from that of a point near by."""
        path, starts, roots = (
            (self.first_path, self.starts, self._widest) if near is None else (near.path, near.starts, near.roots)
        )
        best, highest, came, share = None, -np.inf, (path, starts), 1.0
        for _ in range(_LINEARISATIONS if near is not None else _FIRST_LINEARISATIONS):
            found, linear = self._about(vector, logs, path, starts, roots, near is None and best is None)
            total = self.total(found)
            if total > highest:
                gained, best, highest = total - highest, found, total
                came, share = (path, starts), 1.0
                path, starts, roots = found.path, found.starts, found.roots
                if gained < _SAME or abs(total - linear) < _AS_LINEAR:
                    break
            elif best is None or highest - total < _SAME:
                break
            else:  # a step too far: from the linearisation of the best one, less far
                share *= _SHORTER
                path = came[0] + share * (best.path - came[0])
                starts = came[1] + share * (best.starts - came[1])
        return best or self._nowhere(vector, logs)

    def _about(
        self, vector: np.ndarray, logs: np.ndarray, path: np.ndarray, starts: np.ndarray, roots: np.ndarray, anew: bool
    ) -> tuple[Point, float]:
        """The filter linearised about a path, from the likeliest starts, and its log-likelihood if all were linear.

        anew: whether the starts may be far from likely.
        """
        system = self._system(vector, path, starts, roots)
        if not (np.isfinite(system.a).all() and np.isfinite(system.error).all()):
            return self._nowhere(vector, logs), -np.inf
        made = run_filter(system, *self._numbers(logs))
        if not np.isfinite(made.scores).all():
            return self._nowhere(vector, logs), -np.inf
        better, roots, promised = self._better_starts(system, made, logs, starts)
        starts = better if anew else np.where(self._held_first[:, None], better, starts)
        system = replace(system, start=roots, origin=self._origin(path, starts))
        made = run_filter(system, *self._numbers(logs))
        found = self._followed(vector, logs, starts, self._whole(made.gains), made.whiten, system)
        if not (np.isfinite(found.path).all() and np.isfinite(found.scores).all()):
            return self._nowhere(vector, logs), -np.inf
        there = self.descended(found, ()) if anew or promised > _GAIN else found
        if there is not found:
            system = replace(system, origin=self._origin(path, there.starts))
            found, made = replace(there, system=system), run_filter(system, *self._numbers(logs))
        return found, float(self.counted @ made.scores)

    def _nowhere(self, vector: np.ndarray, logs: np.ndarray) -> Point:
        """What is left of a filter that runs away: as unlikely as can be."""
        (rows, count), size = self.finite.shape, self._size + len(self.pushed)
        none, unlikely = np.zeros((rows, count)), np.full(rows, -np.inf)
        gains, whiten = np.zeros((rows, size, count)), np.zeros((rows, count, count))
        first = (self.first_path, gains, whiten, none, self.starts, self._widest)
        return Point(vector, logs, none, unlikely, *first, None)

    def _followed(
        self,
        vector: np.ndarray,
        logs: np.ndarray,
        starts: np.ndarray,
        gains: np.ndarray,
        whiten: np.ndarray,
        system: System,
    ) -> Point:
        """The vehicle itself run with the gains of a filter."""
        y, after = self._follow(vector[None], starts, gains, logs, True)
        innovations = np.where(self.finite, self.measured - y[0], 0.0)
        before = np.empty_like(after[0])
        before[1:] = after[0][:-1]
        first = starts.copy()
        for w in np.flatnonzero(self.carried):
            first[w, : len(self._shared)][self._shared] = before[self.offsets[w], : len(self._shared)][self._shared]
        before[self.offsets] = first
        path = before + np.einsum("rfc,rc->rf", gains, innovations)
        with np.errstate(over="ignore", invalid="ignore"):
            errors, scores = self._scored(whiten, innovations)
        return Point(vector, logs, errors, scores, path, gains, whiten, innovations, starts, system.start, system)

    def _whole(self, gains: np.ndarray) -> np.ndarray:
        """Gains of the live states and the accelerations as those of all, (rows, F, C)."""
        whole = np.zeros((len(self.rows), self._size + len(self.pushed), gains.shape[2]))
        whole[:, np.r_[self.live, self._size + np.arange(len(self.pushed))]] = gains
        return whole

    def _follow(self, vectors: np.ndarray, starts: np.ndarray, gains: np.ndarray, logs: np.ndarray, keep: bool):
        times = self._numbers(logs)[2]
        decays = np.exp(-self.durations[:, None] / times) if len(times) else np.ones((len(self.rows), 0))
        every = np.zeros((*gains.shape[:2], len(self.plant.outputs)))
        every[:, :, self.columns] = gains
        correction = self._free(every, decays, False)
        starts = starts if starts.ndim == 3 else starts[None]
        y, after = self.plant.follow_many(self.runs, vectors, starts, correction, keep)
        return y[:, :, self.columns], after

    def _scored(self, whiten: np.ndarray, innovations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        errors = np.einsum("rmc,rc->rm", whiten, innovations)
        diagonal = np.einsum("rcc->rc", whiten)
        logs = np.log(np.where(self.finite, np.maximum(diagonal, 1e-300), 1.0))
        scores = (logs - 0.5 * errors**2 - 0.5 * np.log(2.0 * np.pi) * self.finite).sum(axis=1)
        return errors, scores

    def total(self, point: Point) -> float:
        """The log-likelihood of the rows that are counted."""
        total = float(point.scores[self.counted > 0.0].sum())
        return total if np.isfinite(total) else -np.inf

    def objective(self, point: Point, paths: Sequence[str]) -> float:
        """The same with what is known of the paths beforehand, and of correlation times."""
        return (
            self.total(point)
            - 0.5 * float((self.pulls(point.vector, paths)[0] ** 2).sum())
            + self._prior(point.logs)[0]
        )

    def columns_of(
        self, point: Point, moves: Sequence[tuple[str, float]], vector: np.ndarray | None = None
    ) -> np.ndarray:
        """Slopes of the predictions, over the errors' deviations, (P, rows, C), for paths moved by steps in scales.

        One call for all: the vehicle is run with the filter's gains and each parameter moved.  vector: one from which
        they are moved that predicts the same as the point's.
        """
        if not moves:
            return np.zeros((0, *self.measured.shape))
        vectors, steps = np.repeat((point.vector if vector is None else vector)[None], len(moves), axis=0), []
        for j, (path, step) in enumerate(moves):
            i, size = self.index[path], step * self.scale(path)
            if not self.bounds(path)[0] <= vectors[j, i] + size <= self.bounds(path)[1]:
                step, size = -step, -size
            vectors[j, i] += size
            steps.append(step)
        return self._changes(point, vectors, point.starts, np.array(steps))

    def _changes(self, point: Point, vectors: np.ndarray, starts: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """By how much predictions change, per step and over the errors' deviations, (S, rows, C)."""
        y, _ = self._follow(vectors, starts, point.gains, point.logs, False)
        with np.errstate(invalid="ignore", over="ignore"):
            change = (y - (self.measured - point.innovations)[None]) / steps[:, None, None]
        change[~(np.isfinite(change) & self.finite)] = 0.0
        return np.einsum("rmc,prc->prm", point.whiten, change)

    def counted_slopes(self, point: Point, paths: Sequence[str]) -> np.ndarray:
        """Slopes by the paths of the errors that count, (P, rows * C)."""
        return self.counted_flat(self.columns_of(point, moves_of(paths)))

    def counted_flat(self, columns: np.ndarray) -> np.ndarray:
        """Columns, (P, rows, C), flat, (P, rows * C), zero in the rows that do not count."""
        return (columns * self._root).reshape(len(columns), self.measured.size)

    def counted_errors(self, point: Point) -> np.ndarray:
        """The errors that count, (rows, C), zero in the other rows."""
        return point.errors * self._root

    @property
    def _root(self) -> np.ndarray:
        return np.sqrt(self.counted)[:, None]

    def without_starts(self, point: Point, slopes: np.ndarray) -> np.ndarray:
        """What the stretches' starts cannot imitate of slopes, (P, rows * C)."""
        basis = self.start_basis(point)
        return slopes - (slopes @ basis) @ basis.T

    def free_sensitivity(self, point: Point, paths: Sequence[str]) -> np.ndarray:
        """By how many deviations of the sensors' noise free runs change for a scale of each path, root sum square."""
        deviations = np.sqrt(self._numbers(point.logs)[0])
        free = replace(
            point,
            gains=np.zeros_like(point.gains),
            innovations=self.measured
            - self._follow(point.vector[None], point.starts, np.zeros_like(point.gains), point.logs, False)[0][0],
            whiten=self.finite[:, :, None] * np.diag(1.0 / deviations),
        )
        columns = self.columns_of(free, moves_of(paths))
        # a free run that is unstable says no more by running away further
        return np.sqrt((np.minimum(np.abs(columns), _ENOUGH) ** 2).sum(axis=(1, 2)))

    def start_basis(self, point: Point) -> np.ndarray:
        """An orthonormal basis, (rows * C, m), of what the stretches' starts can do to the errors that count.

        Starts are fitted: with what they imitate taken out of the slopes of parameters, it makes no difference how far
        the filter lets them be off.
        """
        starts = np.repeat(point.starts[None], len(self.live), axis=0)
        probes = 0.1 * self._probes(self.live)  # as small as the steps of parameters that may act alike
        for j, (i, probe) in enumerate(zip(self.live, probes, strict=True)):
            starts[j, :, i] += probe
        vectors = np.repeat(point.vector[None], len(self.live), axis=0)
        columns, _ = self._by_start(self._changes(point, vectors, starts, probes))
        size = np.linalg.norm(columns, axis=1)
        kept = size > _NO_START * max(float(size.max(initial=0.0)), 1.0)
        if not kept.any():
            return np.zeros((point.errors.size, 0))
        left, values, _ = np.linalg.svd((columns[kept] / size[kept, None]).T, full_matrices=False)
        return left[:, values > 1e-6 * values[0]]

    def _linear_starts(self, point: Point) -> tuple[np.ndarray, list[tuple[np.ndarray, int]]]:
        """Columns of the starts by the linearised filter: true enough for steps, and soon made; see `_by_start`."""
        assert point.system is not None
        own = np.r_[self.live, self._size + np.arange(len(self.pushed))]
        times = self._numbers(point.logs)[2]
        return self._by_start(start_slopes(point.system, point.gains[:, own], point.whiten, times))

    def _by_start(self, columns: np.ndarray) -> tuple[np.ndarray, list[tuple[np.ndarray, int]]]:
        """Columns of errors that count by each start, (m, rows * C), and which stretches and state each is of.

        columns: (n, rows, C), by the live states, each moved where any stretch begins.  A state that nobody knows is
        one for all stretches in which it goes on.
        """
        columns, states = columns * self._root, len(self._shared)
        anew, own = np.cumsum(~self.carried), np.arange(len(self.stretches))
        found, owners = [], []
        for j, i in enumerate(self.live):
            group = anew if i < states and self._shared[i] else own
            for g in np.unique(group):
                mine = (group == g)[self.stretch_of_row]
                found.append(np.where(mine[:, None], columns[j], 0.0).ravel())
                owners.append((np.flatnonzero(group == g), int(i)))
        return np.array(found).reshape(len(owners), self.measured.size), owners

    # ---- noises ----------------------------------------------------------------------------------------------------

    def _prior(self, logs: np.ndarray) -> tuple[float, np.ndarray]:
        """Log-density of correlation times, which a vehicle's time scales bound, and its slope."""
        slope, pushed = np.zeros(logs.size), len(self.pushed)
        if not pushed:
            return 0.0, slope
        centre, deviation, *_ = self.slowness
        far = (logs[-pushed:] - centre) / deviation
        slope[-pushed:] = -far / deviation
        return -0.5 * float(far @ far), slope

    def first_noise(self) -> np.ndarray:
        """Noises to begin with: of channels by their second differences, accelerations of the likeliest shares."""
        logs = np.log(self.floors)
        if not self.pushed:
            return logs
        system = self._system(self.plant.vector, self.first_path, self.starts, self._widest)
        times = np.full(len(self.pushed), self.slowness[0])
        tried = [np.r_[logs, np.log(share * self.unit), times] for share in _FIRST_GUESSES]
        likely = np.array([self._likelihood(system, t) for t in tried])
        if not np.isfinite(likely).any():
            raise ValueError(
                f"The runs of {self.plant.name!r} are not finite from one sample of the record to the next: check its "
                "parameters and the units of the record."
            )
        return self._guessed(system, tried[int(np.nanargmax(likely))], range(len(self.pushed)))

    def _likelihood(self, system: System, logs: np.ndarray) -> float:
        """The log-likelihood of noises by the linearised filter."""
        return float(self.counted @ run_filter(system, *self._numbers(logs)).scores)

    def _without_one(self, logs: np.ndarray, d: int) -> np.ndarray:
        """The noises with one acceleration that is hardly any."""
        less = logs.copy()
        less[len(self.channels) + d] = np.log(_LEAST_PROCESS * self.unit[d])
        return less

    def _guessed(self, system: System, logs: np.ndarray, which: Iterable[int]) -> np.ndarray:
        """The noises, each of these accelerations in turn the likeliest of the first guesses, or as it was."""
        best = self._likelihood(system, logs)
        for d in which:
            strength, time = len(self.channels) + d, len(self.channels) + len(self.pushed) + d
            for share in _FIRST_GUESSES:
                more = logs.copy()
                more[[strength, time]] = np.log(share * self.unit[d]), self.slowness[0]
                reached = self._likelihood(system, more)
                if reached > best:
                    logs, best = more, reached
        return logs

    def better_noise(self, point: Point, steps: int = _NOISE_STEPS) -> np.ndarray:
        """The noises of greatest likelihood for a point's parameters, linearised about its path.

        Sought in units of the precision that the record's length gives each, in which the information is near the unit
        matrix: quasi-Newton steps (Nocedal and Wright 2006, ch. 6), each cut to what is possible.
        """
        if point.system is None:
            return point.logs
        pushed = len(self.pushed)

        def slope_at(logs: np.ndarray) -> tuple[float, np.ndarray]:
            value, slope = self.noise_slopes(point, logs)
            return value, slope / unit

        low = np.log(np.maximum(self.steps_of_readings, _LEAST_NOISE * self.floors))
        bounds = [(a, np.log(f) + _NOISE_RANGE) for a, f in zip(low, self.floors, strict=True)]
        bounds += [(np.log(_LEAST_PROCESS * u), np.log(u) + _NOISE_RANGE) for u in self.unit]
        bounds += [self.slowness[2:]] * pushed
        limits = np.array(bounds)
        periods = float(self.durations.sum()) / np.exp(self.slowness[0])
        unit = np.sqrt(np.r_[2.0 * np.maximum(self.finite.sum(axis=0), 1), np.full(2 * pushed, max(periods, 1.0))])
        logs = np.clip(point.logs, *limits.T)
        (value, slope), inverse = slope_at(logs), np.eye(logs.size)
        back = self._revived(point, logs, slope)
        if back is not logs:
            logs, (value, slope) = back, slope_at(back)
        for _ in range(steps):
            open_ = ~(((logs <= limits[:, 0]) & (slope < 0.0)) | ((logs >= limits[:, 1]) & (slope > 0.0)))
            way = np.where(open_, inverse @ np.where(open_, slope, 0.0), 0.0)
            if float(way @ slope) < _NOISE_GAIN:
                break
            way *= min(1.0, _NOISE_REACH / max(float(np.abs(way / unit).max()), 1e-12))
            for share in (1.0, 0.3, 0.05):
                there = np.clip(logs + share * way / unit, *limits.T)
                reached, new = slope_at(there)
                if reached > value:
                    break
            else:
                break
            moved, turned = (there - logs) * unit, slope - new
            product = float(moved @ turned)
            if product > 1e-8 * np.linalg.norm(moved) * np.linalg.norm(turned):
                left = np.eye(logs.size) - np.outer(moved, turned) / product
                inverse = left @ inverse @ left.T + np.outer(moved, moved) / product
            gained, logs, value, slope = reached - value, there, reached, new
            if gained < _NOISE_GAIN:
                break
        return logs

    def _revived(self, point: Point, logs: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """The noises, accelerations that are hardly there brought back where that is likelier.

        In logarithms the likelihood is flat about them, so that small steps do not: its slope only tells the way.
        """
        first, pushed = len(self.channels), len(self.pushed)
        faint = np.flatnonzero(~self._there(logs, _FAINT) & (slope[first : first + pushed] > 0.0))
        assert point.system is not None
        return self._guessed(point.system, logs, faint) if faint.size else logs

    def _there(self, logs: np.ndarray, least: float = 10.0 * _LEAST_PROCESS) -> np.ndarray:
        """Which accelerations are more than the least, in their units, (D,)."""
        first, pushed = len(self.channels), len(self.pushed)
        return np.exp(logs[first : first + pushed]) > least * np.array(self.unit)

    def noise_slopes(self, point: Point, logs: np.ndarray) -> tuple[float, np.ndarray]:
        """Log-likelihood of noises with their prior, linearised about a point's path, and its slopes, (C + 2 D,)."""
        assert point.system is not None
        numbers = self._numbers(logs)
        made = run_filter(point.system, *numbers)
        prior, pull = self._prior(logs)
        value = float(self.counted @ made.scores) + prior
        if not np.isfinite(value):
            return -np.inf, np.zeros(logs.size)
        return value, slopes_of(point.system, made, self.counted, *numbers).noises + pull

    def with_noise(self, point: Point, logs: np.ndarray) -> Point:
        """A point with other noises, linearised about the same path."""
        assert point.system is not None
        made = run_filter(point.system, *self._numbers(logs))
        gains = self._whole(made.gains)
        return self._followed(point.vector, logs, point.starts, gains, made.whiten, point.system)

    def pushing(self, point: Point) -> list[int]:
        """Which of a point's noises are strengths and correlation times of accelerations that are there."""
        first, pushed = len(self.channels), len(self.pushed)
        strengths = first + np.flatnonzero(self._there(point.logs))
        return [*strengths.tolist(), *(strengths + pushed).tolist()]

    def noise_at(self, point: Point) -> Noise:
        """The noises of a point; accelerations that add nothing to the likelihood are left out."""
        variances, deviations, times = self._numbers(point.logs)
        stated = {}
        if point.system is not None:
            whole = self._likelihood(point.system, point.logs)
            for d, name in enumerate(self.pushed):
                if whole - self._likelihood(point.system, self._without_one(point.logs, d)) > _SEEN:
                    stated[name] = (float(deviations[d]), float(times[d]))
        return Noise(dict(zip(self.channels, np.sqrt(variances).tolist(), strict=True)), stated)

    def logs_of(self, noise: Noise) -> np.ndarray:
        """The logarithms of given noises."""
        process = [
            noise.process.get(n, (_LEAST_PROCESS * u, np.exp(self.slowness[0])))
            for n, u in zip(self.pushed, self.unit, strict=True)
        ]
        values = [noise.measurement[n] for n in self.channels] + [p[0] for p in process] + [p[1] for p in process]
        return np.log(values)

    def standard_errors(self, plant: Plant, paths: Sequence[str], noise: Noise) -> dict[str, float]:
        """Standard error of each path, in its unit, all of them fitted, these noises known; infinite if untold."""
        point = self.point(plant.vector, self.logs_of(noise))
        flat = self.without_starts(point, self.counted_slopes(point, paths))
        normal = flat @ flat.T + np.diag(self.pulls(point.vector, paths)[1] ** 2)
        size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        inverse = np.linalg.pinv(normal / np.outer(size, size), rcond=1e-12, hermitian=True)
        errors = np.sqrt(np.maximum(np.diag(inverse), 0.0)) / size
        return {p: float(e * self.scale(p)) if e > 0.0 else np.inf for p, e in zip(paths, errors, strict=True)}

    # ---- the fit ---------------------------------------------------------------------------------------------------

    def solve(
        self,
        plant: Plant,
        paths: Sequence[str],
        near: Point | None = None,
        iterations: int = 12,
        noise: bool = True,
        gain: float = _GAIN,
    ) -> Point:
        """The point of greatest likelihood over the paths and, with `noise`, the noises, from the plant's values.

        In turns: parameters with the filter's gains held, gains made anew, noises.  It ends where a turn raises the
        log-likelihood by less than `gain`.
        """
        here = self.point(plant.vector, self.first_noise() if near is None else near.logs, near)
        if noise:
            here = self._renewed(here, paths, _FIRST_NOISE_STEPS if near is None else _NOISE_STEPS)
        if noise and paths and self.pushed:
            here = max(here, self._quieter(here, paths), key=lambda p: self.objective(p, paths))
        for _ in range(iterations):
            before = self.objective(here, paths)
            there = self.descended(here, paths)
            for _ in range(_HALVINGS):
                fresh = self.point(there.vector, there.logs, there)
                if self.objective(fresh, paths) > before - gain or not paths:
                    break
                there = self.with_gains(here, here.vector + 0.4 * (there.vector - here.vector))
            else:
                fresh = here
            if noise:
                fresh = self._renewed(fresh, paths, _NOISE_STEPS)
            gained = self.objective(fresh, paths) - before
            here = fresh if gained > 0.0 else here
            if not gained > gain:
                there = self._stilled(here, paths) if noise else here
                if not self.objective(there, paths) > self.objective(here, paths) + gain:
                    break
                here = there
        return here

    def _stilled(self, here: Point, paths: Sequence[str]) -> Point:
        """The point without those accelerations whose absence is likelier: a search in logarithms comes there late.

        Without each as the linearised filter tells, and without any as the vehicle itself does.
        """
        if here.system is None:
            return here
        logs, best, none = here.logs, self._likelihood(here.system, here.logs), here.logs
        for d in range(len(self.pushed)):
            less, none = self._without_one(logs, d), self._without_one(none, d)
            reached = self._likelihood(here.system, less)
            if reached > best:
                logs, best = less, reached
        tried = {tuple(t): t for t in (logs, none) if not np.array_equal(t, here.logs)}
        points = [here, *(self.point(here.vector, t, here) for t in tried.values())]
        return max(points, key=lambda p: self.objective(p, paths))

    def quieted(self, here: Point) -> Point:
        """The same parameters, what pushes the vehicle taken for much weaker."""
        count, pushed = len(self.channels), len(self.pushed)
        logs = here.logs.copy()
        logs[count : count + pushed] -= np.log(_QUIETER)
        return self.point(here.vector, logs, here)

    def renewed(self, point: Point, logs: np.ndarray, paths: Sequence[str]) -> Point:
        """The parameters of a point with the noises that suit them best, sought from some that may."""
        return self._renewed(self.point(point.vector, logs, point), paths, _NOISE_STEPS)

    def _quieter(self, here: Point, paths: Sequence[str]) -> Point:
        """The point that is reached if what pushes the vehicle is taken for much weaker at first.

        Where an effect was missing, accelerations have grown to take its part, and would leave little of it to find.
        """
        there = self.descended(self.quieted(here), paths)
        if there.system is None or not np.isfinite(there.scores).all():
            return here
        return self.renewed(there, here.logs, paths)

    def descended(self, here: Point, paths: Sequence[str], iterations: int = _DESCENTS) -> Point:
        """The point of least squared errors over paths and starts, the filter's gains held; Levenberg and Marquardt."""
        if here.system is None:
            return here
        for _ in range(iterations):
            starts, owners = self._linear_starts(here)
            moving = [k for k, (stretches, _) in enumerate(owners) if not self._held_first[stretches].all()]
            starts, owners, count = starts[moving], [owners[k] for k in moving], len(paths)
            if not count + len(owners):
                break
            every = np.vstack([self.counted_slopes(here, paths), starts])
            whole, right = every @ every.T, every @ self.counted_errors(here).ravel()
            pulled, rates = self.pulls(here.vector, paths)
            whole[:count, :count] += np.diag(rates**2)
            right[:count] -= rates * pulled
            held = at_edge(self, here.vector, paths, right)
            whole[held], whole[:, held], right[held] = 0.0, 0.0, 0.0
            whole[held, held] = 1.0
            size, damping = np.sqrt(np.maximum(np.diag(whole), 1e-300)), _DAMPING
            scaled, before = whole / np.outer(size, size), self.objective(here, paths)
            for _ in range(_TRIES):
                step = np.linalg.solve(scaled + damping * np.eye(len(size)), right / size) / size
                if 0.5 * float(right @ step) < 0.1 * _GAIN:
                    return here
                moved = here.starts.copy()
                for (stretches, i), way in zip(owners, step[count:], strict=True):
                    moved[stretches, i] += way
                there = self.with_gains(here, self.moved(here.vector, paths, step[:count]), moved)
                if self.objective(there, paths) > before:
                    break
                damping *= _TIGHTER
            else:
                return here
            here = there
        return here

    def with_gains(self, point: Point, vector: np.ndarray, starts: np.ndarray | None = None) -> Point:
        """Other parameters, and starts, with the filter's gains of a point."""
        if point.system is None:
            return point
        starts = point.starts if starts is None else starts
        return self._followed(vector, point.logs, starts, point.gains, point.whiten, point.system)

    def _renewed(self, here: Point, paths: Sequence[str], steps: int) -> Point:
        """The point with better noises, or itself."""
        logs = self.better_noise(here, steps)
        if np.array_equal(logs, here.logs):
            return here
        there = self.point(here.vector, logs, here)
        return there if self.objective(there, paths) > self.objective(here, paths) else here

    def moved(self, vector: np.ndarray, paths: Sequence[str], step: np.ndarray) -> np.ndarray:
        """A vector moved by a step in scales, within the bounds."""
        vector = vector.copy()
        for path, size in zip(paths, step, strict=True):
            low, high = self.bounds(path)
            i = self.index[path]
            vector[i] = min(max(vector[i] + size * self.scale(path), low), high)
        return vector

    def plant_at(self, point: Point, paths: Sequence[str]) -> Plant:
        """The plant with the point's values at the paths."""
        return replace_at(self.plant, {p: float(point.vector[self.index[p]]) for p in paths})


def kinked(path: str) -> bool:
    """Whether an effect works in one direction from its neutral value, with a corner there."""
    return path.rpartition(".")[2] in _KINKED


def moves_of(paths: Iterable[str]) -> list[tuple[str, float]]:
    """Each path with the step, in its scales, over which its slopes are taken."""
    return [(p, _STEP_ABOUT_CORNERS if kinked(p) else STEP) for p in paths]


def _varies(readings: np.ndarray) -> bool:
    """Whether any two readings differ."""
    told = readings[np.isfinite(readings)]
    return bool(told.size) and bool(np.ptp(told) > 0.0)


def _joined(windows: Sequence[slice], record: Record) -> list[slice]:
    """Neighbouring windows of a segment as one."""
    begins = {s.start for s in record.segments}
    found: list[slice] = []
    for w in windows:
        if found and found[-1].stop == w.start and w.start not in begins:
            found[-1] = slice(found[-1].start, w.stop)
        else:
            found.append(w)
    return found


def _seen(a: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Which states reach a channel, by themselves or through others: numbers of them."""
    links = np.abs(a).max(axis=0) > 1e-12
    seen = np.abs(c).max(axis=(0, 1)) > 1e-9
    while True:
        more = seen | (links & seen[:, None]).any(axis=0)
        if np.array_equal(more, seen):
            return np.flatnonzero(seen)
        seen = more
