"""The noises of sensors and of motion that fit a record best."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Self

import numpy as np

from auv_gym.threads import side_by_side
from identification.deciding import COST, LEAST_PROCESS
from identification.fit.adjoint import slopes_of
from identification.fit.filtering import Filter
from identification.fit.followed import Point
from identification.fit.kalman import Pass, System, run_filter
from identification.fit.work import FILTERED

# of accelerations, in their units (`Stretches.unit`): first guesses; and the strength below which these guesses are
# tried again if the slope asks for more
_FIRST_GUESSES, _FAINT = 10.0 ** np.arange(-5.0, 1.5), 1e-3
_DOUBTFUL = 10.0 ** np.arange(-3.0, 0.5, 0.5)  # strengths tried for an acceleration that is not in a fit
_FAR_LESS = 4.0  # of the log-likelihood: chi-square of one degree of freedom exceeds twice this in 0.5 % of cases
_NOISE_GAIN, _NOISE_REACH = 0.005, 2.0  # least gain of a step, in log-likelihood; its longest length, in logs
_LEAST_NOISE = 0.03  # least noise of a channel, over that of its second differences: simulated readings may have none
_NOISE_RANGE = np.log(1e4)
_FADING = 2.0  # gain of log-likelihood for each e-fold less of an acceleration at which it may be too strong


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviations of white noise by channel, and of accelerations (m/s^2, rad/s^2) with correlation times, s.

    process: by the pushed velocity, as (standard deviation, correlation time); absent entries are zero.
    swell: the same, by period, s, for narrow-band accelerations about that period, with the time that they stay in
    phase.
    lasting: lasting sensor errors, by period, s, 0 for those that merely decay, and by channel, in its unit.
    slowest: the longest correlation time of an acceleration that the fit allows, s.
    """

    measurement: Mapping[str, float]
    process: Mapping[str, tuple[float, float]]
    swell: Mapping[float, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    lasting: Mapping[float, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    slowest: float = np.inf

    def told(self, misread: bool, period: float) -> Mapping[str, tuple[float, float]]:
        """Lasting sensor errors, or else accelerations, of a period, s, or of none (0)."""
        if misread:
            return self.lasting.get(period, {})
        return self.swell.get(period, {}) if period else self.process


def _likelihoods(likely: Callable[[np.ndarray], float], tried: Sequence[np.ndarray]) -> dict[int, float]:
    """The likelihoods of the first of some noises, and of those others that were tried to find the peak in their row.

    Three in the middle are tried first, and then the ones beside the best so far.
    """
    found, middle = dict[int, float](), 1 + (len(tried) - 1) // 2
    wanted = [k for k in (0, middle - 1, middle, middle + 1) if k < len(tried)]
    while wanted := sorted(set(wanted) - found.keys()):
        reached = side_by_side(lambda k: likely(tried[k]), wanted)
        found.update({k: r if np.isfinite(r) else -np.inf for k, r in zip(wanted, reached, strict=True)})
        top = max(found.keys() - {0}, key=lambda k: found[k], default=0)
        wanted = [k for k in (top - 1, top + 1) if top and 0 < k < len(tried)]
    return found


class Noises(Filter):
    """A filter whose noises are estimated: of each channel, and of accelerations with their correlation times."""

    def first_noise(self) -> np.ndarray:
        """First guess: noises of channels from second differences, and the likeliest size of accelerations."""
        logs = np.log(self.floors)
        if not self.pushed:
            return logs
        system, times = self._first_system, np.full(len(self.pushed), self.slowness[0])
        guesses = [np.r_[logs, np.log(share * self.unit), times] for share in _FIRST_GUESSES]
        tried = [self._without(guess, np.flatnonzero(self.further).tolist()) for guess in guesses]
        likely = np.array(side_by_side(partial(self.likelihood_of_noises, system), tried))
        if not np.isfinite(likely).any():
            raise ValueError(
                f"The runs of {self.plant.name!r} are not finite from one sample of the record to the next: check its "
                "parameters and the units of the record."
            )
        return tried[int(np.nanargmax(likely))]

    def joined(self, slopes: np.ndarray) -> np.ndarray:
        """Slopes by noises, (..., C + 2 D); those of accelerations with shared noises are added up in the first."""
        joined = slopes.copy()
        for d in np.flatnonzero(~self._leading):
            for first in (len(self.channels), len(self.channels) + len(self.pushed)):
                joined[..., first + self.leads[d]] += slopes[..., first + d]
                joined[..., first + d] = 0.0
        return joined

    def first_point(self, logs: np.ndarray | None = None) -> Point:
        """The plant's values with noises, by default the first guess; gains are those along the first path."""
        logs = self.first_noise() if logs is None else logs
        made = run_filter(self._first_system, *self._numbers(logs))
        return self._followed(self.plant.vector, logs, self.starts, made.gains, made.whiten, self._first_system)

    def follows(self, logs: np.ndarray) -> bool:
        """Whether the filter of the plant with these noises is as likely as the one linearised along the readings."""
        return self.keeps_to_readings(self.point(self.plant.vector, logs))

    def keeps_to_readings(self, here: Point) -> bool:
        """Whether a vehicle with the gains of a point is as likely as the filter linearised along the readings."""
        return self._keeps_to(here, self._first_system)

    @cached_property
    def _first_system(self) -> System:
        return self._system(self.plant.vector, self.first_path, self.starts, self.widest)

    def likelihood_of_noises(self, system: System, logs: np.ndarray) -> float:
        """The log-likelihood of noises in the linearised filter, minus the cost of the accelerations present."""
        made = run_filter(system, *self._numbers(logs), start=self.widest)
        return float(made.scores.sum()) - self._cost(logs)

    def _without(self, logs: np.ndarray, which: Sequence[int]) -> np.ndarray:
        """The noises with some accelerations set to a negligible strength."""
        less = logs.copy()
        less[[len(self.channels) + d for d in which]] = [np.log(LEAST_PROCESS * self.unit[d]) for d in which]
        return less

    def _likeliest(
        self,
        system: System,
        logs: np.ndarray,
        which: Iterable[int],
        guesses: np.ndarray | None = None,
        slowness: float | None = None,
    ) -> np.ndarray:
        """The noises with each of these accelerations in turn the likeliest of none, some guesses, or as it was.

        guesses: (G, D), logarithms of strengths; NaN is none.  slowness: logarithm of their times, by default the usual
        ones.
        """
        best = self.likelihood_of_noises(system, logs)
        for d in (d for d in which if self._leading[d]):
            strength, time = len(self.channels) + d, len(self.channels) + len(self.pushed) + d
            tried = [self._without(logs, [d])]
            for guess in () if guesses is None else guesses[np.isfinite(guesses[:, d]), d]:
                tried.append(logs.copy())
                tried[-1][[strength, time]] = guess, self.usual_times[d] if slowness is None else slowness
            found = _likelihoods(partial(self.likelihood_of_noises, system), tried)
            top = max(found, key=lambda k: found[k])
            if found[top] > best:
                logs, best = tried[top], found[top]
        return logs

    def better_noise(
        self, point: Point, steps: int, inverse: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """The likeliest noises for a point's parameters, linearised about its path, and an inverse of the curvature.

        The search uses units of the precision that the length of the record gives, in which the information is near the
        unit matrix.  It takes quasi-Newton steps (Nocedal and Wright 2006, ch. 6), each cut to the possible range.
        inverse: of the curvature, in these units, from a nearby search; missing accelerations are then not tried again.
        """
        fresh, inverse = inverse is None, np.eye(point.logs.size) if inverse is None else inverse
        if point.system is None:
            return point.logs, inverse
        pushed = len(self.pushed)
        low = np.log(np.maximum(self.steps_of_readings, _LEAST_NOISE * self.floors))
        bounds = [(a, np.log(f) + _NOISE_RANGE) for a, f in zip(low, self.floors, strict=True)]
        bounds += [(np.log(LEAST_PROCESS * u), np.log(u) + _NOISE_RANGE) for u in self.unit]
        bounds += [(self.slowness[2], slowest) for slowest in self.slowest]
        limits = np.array(bounds)
        periods = float(self.durations.sum()) / np.exp(self.slowness[0])
        unit = np.sqrt(np.r_[2.0 * np.maximum(self.finite.sum(axis=0), 1), np.full(2 * pushed, max(periods, 1.0))])
        logs = np.clip(point.logs, *limits.T)
        value, made = self._noise_pass(point, logs, fresh)
        slope = self._noise_slopes(point, logs, made, fresh) / unit
        other = self._faded(point, self._revived(point, logs, slope) if fresh else logs, slope * unit, fresh)
        if other is not logs:
            logs, inverse, (value, made) = other, np.eye(logs.size), self._noise_pass(point, other)
            slope = self._noise_slopes(point, logs, made) / unit
        for _ in range(steps):
            open_ = ~(((logs <= limits[:, 0]) & (slope < 0.0)) | ((logs >= limits[:, 1]) & (slope > 0.0)))
            way = np.where(open_, inverse @ np.where(open_, slope, 0.0), 0.0)
            if float(way @ slope) < _NOISE_GAIN:
                break
            way *= min(1.0, _NOISE_REACH / max(float(np.abs(way / unit).max()), 1e-12))
            for share in (1.0, 0.3, 0.05):
                there = np.clip(logs + share * way / unit, *limits.T)
                reached, made = self._noise_pass(point, there)
                if reached > value:
                    break
            else:
                break
            new = self._noise_slopes(point, there, made) / unit
            moved, turned = (there - logs) * unit, slope - new
            product = float(moved @ turned)
            if product > 1e-8 * np.linalg.norm(moved) * np.linalg.norm(turned):
                left = np.eye(logs.size) - np.outer(moved, turned) / product
                inverse = left @ inverse @ left.T + np.outer(moved, moved) / product
            gained, logs, value, slope = reached - value, there, reached, new
            if gained < _NOISE_GAIN:
                break
        return logs, inverse

    def left_out(self, point: Point) -> np.ndarray:
        """Indices of the accelerations that are absent from a point."""
        return np.flatnonzero(~self._there(point.logs) & self._leading)

    def with_acceleration(self, point: Point, logs: np.ndarray, d: int) -> list[np.ndarray]:
        """The noises with one more acceleration, for each of several strengths that is not far less likely.

        point: one with a system.  d: index of the acceleration.
        """
        assert point.system is not None
        strength, tried = len(self.channels) + d, []
        for share in _DOUBTFUL:
            tried.append(logs.copy())
            tried[-1][[strength, strength + len(self.pushed)]] = np.log(share * self.unit[d]), self.usual_times[d]
        without, *found = side_by_side(partial(self.likelihood_of_noises, point.system), [logs, *tried])
        return [other for other, likely in zip(tried, found, strict=True) if likely + COST > without - _FAR_LESS]

    def _revived(self, point: Point, logs: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """The noises, with negligible accelerations brought back if that is likelier.

        In logarithms the likelihood is flat near such strengths, so small steps would not bring them back: the slope
        only gives the direction.
        """
        first, pushed = len(self.channels), len(self.pushed)
        faint = np.flatnonzero(~self._there(logs, _FAINT) & (slope[first : first + pushed] > 0.0))
        assert point.system is not None
        return self._likeliest(point.system, logs, faint, self._guesses) if faint.size else logs

    def _faded(self, point: Point, logs: np.ndarray, slope: np.ndarray, fresh: bool) -> np.ndarray:
        """The noises without those accelerations whose absence is likelier, among those that would be likelier weaker.

        In a fresh search, weaker strengths are tried before an acceleration that is far too strong is dropped.
        """
        assert point.system is not None
        first, pushed = len(self.channels), len(self.pushed)
        strengths = logs[first : first + pushed]
        which = np.flatnonzero(self._there(logs) & (slope[first : first + pushed] < -_FADING))
        if not which.size:
            return logs
        weaker = np.where(self._guesses < strengths, self._guesses, np.nan) if fresh else None
        return self._likeliest(point.system, logs, which, weaker)

    @property
    def _guesses(self) -> np.ndarray:
        """Logarithms of the first guesses of accelerations, (G, D)."""
        return np.log(np.outer(_FIRST_GUESSES, self.unit))

    def noise_slopes(self, point: Point, logs: np.ndarray) -> tuple[float, np.ndarray]:
        """Log-likelihood of noises with their prior, linearised about a point's path, and its slopes, (C + 2 D,).

        The slopes by negligible accelerations are zero, see `run_filter`.
        """
        value, made = self._noise_pass(point, logs)
        return value, self._noise_slopes(point, logs, made)

    def noise_information(self, point: Point, which: Sequence[int], step: float) -> np.ndarray:
        """The information of the record and the prior on some noises' logarithms, (K, K), by differences of slopes.

        point: one with a system, about whose path the filter is linearised.  step: of the differences.
        """
        own, slope = list(which), self.noise_slopes(point, point.logs)[1]
        found = np.zeros((len(own), len(own)))
        for row, i in zip(found, own, strict=True):
            more = point.logs.copy()
            more[i] += step
            row[:] = (slope - self.noise_slopes(point, more)[1])[own] / step
        return 0.5 * (found + found.T)

    def slopes_in_parts(self, point: Point, parts: int) -> np.ndarray:
        """Slopes by noises of the log-likelihood of equal parts of the rows, without priors, (parts, C + 2 D).

        point: one with a system, about whose path the filter is linearised.
        """
        assert point.system is not None
        numbers, part = self._numbers(point.logs), np.arange(len(self.rows)) * parts // len(self.rows)
        made = run_filter(point.system, *numbers, start=self.widest)
        self.work.add(parts * FILTERED * len(self.rows))
        within = [(part == k).astype(float) for k in range(parts)]
        return self.joined(np.array([slopes_of(point.system, made, weights, *numbers).noises for weights in within]))

    def _noise_pass(self, point: Point, logs: np.ndarray, every: bool = False) -> tuple[float, Pass]:
        """Log-likelihood of noises with their prior, and its pass; every: see `_numbers`."""
        assert point.system is not None
        self.work.add(2 * FILTERED * len(self.rows))  # the pass, and its slopes
        made = run_filter(point.system, *self._numbers(logs, every), start=self.widest)
        value = float(made.scores.sum()) + self._prior(logs)[0]
        return value if np.isfinite(value) else -np.inf, made

    def _noise_slopes(self, point: Point, logs: np.ndarray, made: Pass, every: bool = False) -> np.ndarray:
        assert point.system is not None
        if not np.isfinite(made.scores).all():
            return np.zeros(logs.size)
        slopes = slopes_of(point.system, made, np.ones(len(self.rows)), *self._numbers(logs, every)).noises
        return self.joined(slopes) + self._prior(logs)[1]

    def with_noise(self, point: Point, logs: np.ndarray) -> Point:
        """A point with other noises, linearised about the same path."""
        assert point.system is not None
        made = run_filter(point.system, *self._numbers(logs))
        return self._followed(point.vector, logs, point.starts, made.gains, made.whiten, point.system)

    def pushing(self, point: Point) -> list[int]:
        """Indices of a point's noises that are strengths and correlation times of accelerations that are present."""
        first, pushed = len(self.channels), len(self.pushed)
        strengths = first + np.flatnonzero(self._there(point.logs) & self._leading)
        return [*strengths.tolist(), *(strengths + pushed).tolist()]

    def noise_at(self, point: Point) -> Noise:
        """The noises of a point, without accelerations that add nothing to the likelihood."""
        variances, deviations, times = self._numbers(point.logs)
        process, swell, lasting = {}, {}, {}
        if point.system is not None:
            whole = self.likelihood_of_noises(point.system, point.logs)
            for d in np.flatnonzero(self._there(point.logs) & self._leading):
                if whole > self.likelihood_of_noises(point.system, self._without(point.logs, [int(d)])):
                    period, told = float(self.periods[d]), process
                    if self.misread[d] or period:
                        told = (lasting if self.misread[d] else swell).setdefault(period, {})
                    told[self.pushed[d]] = (float(deviations[d]), float(times[d]))
        measured = dict(zip(self.channels, np.sqrt(variances).tolist(), strict=True))
        return Noise(measured, process, swell, lasting, float(np.exp(self.slowness[0] + 2.0 * self.slowness[1])))

    def with_noises_of(self, noise: Noise) -> Self:
        """The problem with the swell and the lasting sensor errors of the given noises."""
        made = self
        for period in dict.fromkeys([*noise.swell, *noise.lasting]):
            velocities = [self.pushed.index(n) for n in noise.swell.get(period, {}) if n in self.pushed]
            readings = [self.channels.index(n) for n in noise.lasting.get(period, {}) if n in self.channels]
            made = made.with_noises(velocities, readings, period)
        return made

    def logs_of(self, noise: Noise) -> np.ndarray:
        """The logarithms of given noises."""
        process = [
            noise.told(misread, t).get(n, (LEAST_PROCESS * u, np.exp(usual)))
            for n, u, t, misread, usual in zip(
                self.pushed, self.unit, self.periods.tolist(), self.misread, self.usual_times, strict=True
            )
        ]
        values = [noise.measurement[n] for n in self.channels] + [p[0] for p in process] + [p[1] for p in process]
        return np.log(values)
