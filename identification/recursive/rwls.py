"""RWLS: recursive weighted least squares for the diving model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.compiled import compiled
from auv_gym.records.record import Record
from identification.recursive.diving_fit import DivingFit, diving_fit, scatter
from identification.recursive.recursion import (
    COUNT,
    Memory,
    absorb,
    begin,
    check_settings,
    checked_weights,
    keep,
    least_squares_row,
    programs,
    started,
    traced,
    updated,
)
from identification.recursive.samples import Samples

UNKNOWN = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@compiled
def _advance(s, depth, piston, h, weight, regressor, instrument):
    """Process a sample in the state s."""
    if h == 0.0 or s.seen == 0.0:
        begin(s, depth)
        return
    if s.seen >= 2.0:
        least_squares_row(s, piston, h, regressor)
        for i in range(COUNT):
            instrument[i] = regressor[i]
        absorb(s, depth, regressor, instrument, weight)
    keep(s, depth, piston, h)


_ONE, _ALL = programs("rwls", _advance)


@dataclass(frozen=True)
class Rwls:
    """Recursive weighted least squares on equation (8); biased by depth noise, see `CorrectedIvls`.

    forgetting: factor on past information per sample; 1 forgets nothing.  initial, spread: theta before the first
    sample and its standard deviation, for all parameters.  known: parameters that keep their initial value; theta_1 is
    free in the paper, and known=("unity",) keeps it at 1.
    Depth noise is in the regressor, too: its second difference outweighs the float's acceleration, and biases the
    estimate of D/M towards 1.5/h. The intervals describe the scatter, not this bias.
    Source: Zhong et al. 2024, equation (20).

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import Rwls, depth_control
        >>> dive = depth_control(load_vehicle("qiandao_float"), [10, 20], rng=np.random.default_rng(0), hold=200)
        >>> fit = Rwls().fit(dive)
        >>> round(fit.model.damping, 2)  # biased by depth noise: RefinedIv gives 0.11
        2.59
    """

    forgetting: float = 1.0
    initial: Sequence[float] = UNKNOWN
    spread: float = 1e6
    known: Sequence[str] = ()

    def __post_init__(self) -> None:
        check_settings("Rwls", self.initial, self.spread, self.known)
        if not 0.0 < self.forgetting <= 1.0:
            raise ValueError(f"Rwls needs 0 < forgetting <= 1, got {self.forgetting!r}.")

    def start(self) -> Memory:
        """The memory before the first sample."""
        return started(self.initial, self.spread, self.known, forgetting=self.forgetting)

    def update(self, memory: Memory, z: float, x: float, h: float, weight: float = 1.0) -> Memory:
        """The memory after a depth z, m, measured h s after the last, while the piston was held at x, m.

        h = 0 starts a segment, at the first sample or after a gap, and keeps theta.  weight: Lambda of this sample.
        """
        return updated(_ONE, memory, z, x, h, weight)

    def fit(self, *records: Record, weights: Sequence[np.ndarray] | None = None) -> DivingFit:
        """Fit over all records, one after the other; weights: Lambda of each sample, an array for each record."""
        samples = Samples.of(records, "Rwls", COUNT - len(self.known))
        weight = checked_weights(weights, samples)
        trace = traced(_ALL, self.start(), samples, weight)
        age = np.arange(weight.size)[::-1]
        instrument = trace.instrument * (weight * self.forgetting**age)[:, None]
        theta = trace.memory.theta
        covariance, noise = scatter(samples, theta, trace.memory.gain, instrument)
        return diving_fit(samples, theta, covariance, noise=noise, known=self.known, history=trace.theta)
