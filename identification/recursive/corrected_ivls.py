"""A corrected IVLS: theta_1 kept at 1, rows integrated once, and an instrument that cannot diverge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp

import numpy as np

from auv_gym.compiled import compiled
from auv_gym.param import check_count, check_names
from auv_gym.records.record import Record
from identification.recursive.diving_fit import DivingFit, traced_fit
from identification.recursive.diving_model import decayed
from identification.recursive.recursion import (
    COUNT,
    MOST_LAGS,
    RING,
    Memory,
    absorb,
    begin,
    check_settings,
    keep,
    least_squares_row,
    programs,
    slot,
    started,
    traced,
    updated,
)
from identification.recursive.rwls import UNKNOWN
from identification.recursive.samples import Samples


@compiled
def _smoothed(s, piston, h):
    """Write the piston after two lags of s.smoothing seconds into the ring, at the coming sample."""
    if s.seen == 1.0:
        s.smooth[0] = s.smooth[1] = piston
    share = 1.0 - exp(-h / s.smoothing)
    s.smooth[0] += share * (piston - s.smooth[0])
    s.smooth[1] += share * (s.smooth[0] - s.smooth[1])
    s.past_piston[int(s.seen) % RING] = s.smooth[1]


@compiled
def _steer(s, lagged, before, h):
    """Write the auxiliary model's rate over the coming h s into s.simulated = [rate, mean rate over the interval].

    Its time constant is limited, while its steady rates are those of the estimate: for bounded pistons it is bounded,
    whatever the estimate.
    """
    given = s.auxiliary[1]
    damping = min(max(given, 1.0 / s.slowest), 1.0 / s.fastest)
    scale = damping / given if given > 0.0 else 1.0
    force = scale * (s.auxiliary[4] * abs(lagged) * lagged + s.auxiliary[5] * lagged - s.auxiliary[2])
    rate = s.simulated[0] + scale * s.auxiliary[3] * (lagged - before)
    left, once, twice = decayed(damping, h)
    s.simulated[1] = (rate * once + force * twice) / h
    s.simulated[0] = rate * left + force * once


@compiled
def _advance(s, depth, piston, h, weight, regressor, instrument):
    """Process a sample in the state s."""
    if h == 0.0 or s.seen == 0.0:
        begin(s, depth)
        s.simulated[0] = s.simulated[1] = s.target = 0.0
        for i in range(COUNT):
            s.regressor[i] = s.instrument[i] = 0.0
        return
    _smoothed(s, piston, h)
    lagged, before = s.past_piston[slot(s, s.lag)], s.past_piston[slot(s, s.lag + 1.0)]
    if s.seen >= 2.0:
        least_squares_row(s, piston, h, regressor)
        # row / h is the change of the rate; a leaky sum of such changes telescopes, and so does its noise
        left = exp(-h / s.memory)
        square = 0.5 * (h + s.interval)
        s.target = left * s.target + (depth - regressor[0]) / h
        s.instrument[1] = left * s.instrument[1] - square * s.simulated[1]
        s.instrument[2] = left * s.instrument[2] - square
        s.instrument[3] = left * s.instrument[3] + square * (lagged - before) / h
        s.instrument[4] = left * s.instrument[4] + square * abs(lagged) * lagged
        s.instrument[5] = left * s.instrument[5] + square * lagged
        regressor[0] = 0.0
        for i in range(1, COUNT):
            s.regressor[i] = left * s.regressor[i] + regressor[i] / h
            regressor[i] = s.regressor[i]
            instrument[i] = s.regressor[i] if s.warm_up > 0.0 else s.instrument[i]
        absorb(s, s.target, regressor, instrument, weight)
        if s.warm_up > 0.0:
            s.warm_up -= 1.0
            if s.warm_up <= 0.0:
                for i in range(COUNT):
                    s.auxiliary[i] = s.theta[i]
        else:
            for i in range(COUNT):
                s.auxiliary[i] += s.share * (s.theta[i] - s.auxiliary[i])
    _steer(s, lagged, before, h)
    keep(s, depth, piston, h)


@compiled
def _integrate_backwards(instrument, interval, memory, result):
    """Write the instrument of each row before its integration into result: the leaky sum of the later ones."""
    total = np.zeros(COUNT)
    for k in range(interval.size - 1, -1, -1):
        h = interval[k]
        if h == 0.0:
            total[:] = 0.0
            continue
        for i in range(COUNT):
            total[i] += instrument[k, i]
            result[k, i] = total[i] / h
            total[i] *= exp(-h / memory)


_ONE, _ALL = programs("corrected_ivls", _advance)


@dataclass(frozen=True)
class CorrectedIvls:
    """Instrumental-variable least squares on equation (8), corrected where `Ivls` is biased.

    theta_1 is 1. Rows are integrated once, with a leak of `memory` s: the second difference of depth noise becomes a
    first one. The instrument is the rate of an auxiliary model with a time constant between `fastest` and `slowest` s,
    driven by the piston `lag` samples earlier after two lags of `smoothing` s: this removes the fast reaction of the
    feedback to noise. theta of the auxiliary model is fixed in a pass; `fit` makes the first pass by least squares and
    `passes` more. Sample by sample, it uses least squares for `warm_up` samples and then follows theta by `share` a
    sample.
    In closed loop a bias remains, as the leak remembers noise that the piston answered; in tests 0.5 % of D/M.
    initial, spread, known: see `Rwls`; known=("piston_rate",) steadies a log with little piston travel.
    Source: Young 2011, Recursive Estimation and Time-Series Analysis, ch. 7; Soderstrom and Stoica 1983, ch. 4 to 6.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import CorrectedIvls, depth_control
        >>> dive = depth_control(load_vehicle("qiandao_float"), [10, 20], rng=np.random.default_rng(0), hold=200)
        >>> fit = CorrectedIvls().fit(dive)
        >>> round(fit.model.damping, 2)
        0.11
    """

    lag: int = 4
    memory: float = 5.0
    smoothing: float = 2.0
    slowest: float = 50.0
    fastest: float = 1.0
    passes: int = 6
    warm_up: int = 300
    share: float = 0.002
    initial: Sequence[float] = UNKNOWN
    spread: float = 1e6
    known: Sequence[str] = ()

    def __post_init__(self) -> None:
        check_names("CorrectedIvls: known", self.known)
        check_settings("CorrectedIvls", self.initial, self.spread, self._known)
        if self.initial[0] != 1.0:
            raise ValueError(f"CorrectedIvls keeps unity at 1, got {self.initial[0]!r} as its initial value.")
        for name in ("memory", "smoothing", "fastest"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"CorrectedIvls needs {name} > 0 s, got {getattr(self, name)!r}.")
        if not self.fastest < self.slowest < np.inf:
            raise ValueError(f"CorrectedIvls needs fastest < slowest, got {self.fastest!r} and {self.slowest!r} s.")
        for name, least in (("lag", 0), ("passes", 1), ("warm_up", 1)):
            check_count(f"CorrectedIvls: {name}", getattr(self, name), least)
        if not self.lag < MOST_LAGS:
            raise ValueError(f"CorrectedIvls needs lag < {MOST_LAGS} samples, got {self.lag!r}.")
        if not 0.0 <= self.share <= 1.0:
            raise ValueError(f"CorrectedIvls needs 0 <= share <= 1, got {self.share!r}.")

    @property
    def _known(self) -> tuple[str, ...]:
        return ("unity", *self.known)

    def start(self, auxiliary: Sequence[float] | None = None) -> Memory:
        """The memory before the first sample.

        auxiliary: theta of the auxiliary model, from an earlier record; the recursion then needs no warm-up.
        """
        if auxiliary is not None:
            check_settings("CorrectedIvls", auxiliary, self.spread, self._known)
        return self._started(auxiliary, self.warm_up, self.share)

    def update(self, memory: Memory, z: float, x: float, h: float, weight: float = 1.0) -> Memory:
        """The memory after a depth z, m, h s after the last, with the piston at x, m; see `Rwls.update`."""
        return updated(_ONE, memory, z, x, h, weight)

    def fit(self, *records: Record) -> DivingFit:
        """Fit over all records; the history is that of the last pass."""
        samples = Samples.of(records, "CorrectedIvls", COUNT - len(set(self._known)))
        weights = np.ones(samples.depth.size)
        trace = traced(_ALL, self._started(None, np.inf, 0.0), samples, weights)
        for _ in range(self.passes):
            trace = traced(_ALL, self._started(trace.memory.theta, 0.0, 0.0), samples, weights)
        before_integration = np.zeros_like(trace.instrument)
        _integrate_backwards(trace.instrument, samples.interval, self.memory, before_integration)
        return traced_fit(trace, samples, before_integration, self._known)

    def _started(self, auxiliary: Sequence[float] | np.ndarray | None, warm_up: float, share: float) -> Memory:
        memory = started(
            self.initial,
            self.spread,
            self._known,
            share=share,
            lag=self.lag,
            memory=self.memory,
            smoothing=self.smoothing,
            slowest=self.slowest,
            fastest=self.fastest,
            warm_up=0.0 if auxiliary is not None else warm_up,
        )
        return memory if auxiliary is None else memory.steered_by(auxiliary)
