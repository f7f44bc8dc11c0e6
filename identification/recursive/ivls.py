"""IVLS as printed: least squares with an instrument that is simulated by the estimates themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.compiled import compiled
from auv_gym.param import check_count
from auv_gym.records.record import Record
from identification.recursive.diving_fit import DivingFit, traced_fit
from identification.recursive.diving_model import regress
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
def _store(s, piston):
    """Store the past values for equations (31) and (32), under the coming sample's number."""
    place = int(s.seen) % RING
    s.past_piston[place] = piston
    for i in range(COUNT):
        s.past_theta[place, i] = s.theta[i]
        s.past_auxiliary[place, i] = s.auxiliary[i]


@compiled
def _advance(s, depth, piston, h, weight, regressor, instrument):
    """Process a sample in the state s, by equations (31) to (34); s.simulated: xi, newest first."""
    if h == 0.0 or s.seen == 0.0:
        begin(s, depth)
        s.simulated[0] = depth
        return
    xi = depth
    if s.seen >= 2.0:
        least_squares_row(s, piston, h, regressor)
        lagged, before, earlier = slot(s, s.lag), slot(s, s.lag + 1.0), slot(s, s.lag + 2.0)
        past = s.past_piston
        regress(s.simulated[0], s.simulated[1], past[lagged], past[lagged], h, s.interval, instrument)
        # (31) takes the piston's speed one sample earlier than its position
        instrument[3] = 0.5 * (h + s.interval) * (past[before] - past[earlier])
        xi = 0.0
        for i in range(COUNT):
            s.auxiliary[i] = (1.0 - s.share) * s.past_auxiliary[lagged, i] + s.share * s.past_theta[lagged, i]
            xi += instrument[i] * s.auxiliary[i]
        absorb(s, depth, regressor, instrument, weight)
    s.simulated[1], s.simulated[0] = s.simulated[0], xi
    _store(s, piston)
    keep(s, depth, piston, h)


_ONE, _ALL = programs("ivls", _advance)


@dataclass(frozen=True)
class Ivls:
    """Instrumental-variable least squares exactly as printed; use `CorrectedIvls` for results.

    share, lag: alpha and N of equation (32).  initial, spread, known: see `Rwls`.
    On a dive with 0.02 m of depth noise it fails for these reasons.  xi is a double integrator: at theta_1 = 1.0002 it
    is unstable, at 1 it drifts off, and nothing corrects it by the depth.  theta* follows theta over lag / share = 8000
    samples.  If the instrument is out of phase with the regressor, the gain's denominator crosses zero, where theta
    jumps.  And the error of equation (8) is the noise's second difference, ten times the acceleration.
    Source: Zhong et al. 2024, equations (31) to (34).

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import Ivls, depth_control
        >>> dive = depth_control(load_vehicle("qiandao_float"), [10, 20], rng=np.random.default_rng(0), hold=200)
        >>> fit = Ivls().fit(dive)
        >>> round(fit.model.damping, 2)  # biased by depth noise: RefinedIv gives 0.11
        0.28
    """

    share: float = 0.0005
    lag: int = 4
    initial: Sequence[float] = UNKNOWN
    spread: float = 1e6
    known: Sequence[str] = ()

    def __post_init__(self) -> None:
        check_settings("Ivls", self.initial, self.spread, self.known)
        if not 0.0 <= self.share <= 1.0:
            raise ValueError(f"Ivls needs 0 <= share <= 1, got {self.share!r}.")
        check_count("Ivls: lag", self.lag)
        if not self.lag <= MOST_LAGS:
            raise ValueError(f"Ivls needs lag <= {MOST_LAGS} samples, got {self.lag!r}.")

    def start(self) -> Memory:
        """The memory before the first sample."""
        return started(self.initial, self.spread, self.known, share=self.share, lag=self.lag)

    def update(self, memory: Memory, z: float, x: float, h: float, weight: float = 1.0) -> Memory:
        """The memory after a depth z, m, h s after the last, with the piston at x, m; see `Rwls.update`."""
        return updated(_ONE, memory, z, x, h, weight)

    def fit(self, *records: Record) -> DivingFit:
        """Fit over all records; raises if the instrument leaves the finite numbers."""
        samples = Samples.of(records, "Ivls", COUNT - len(self.known))
        trace = traced(_ALL, self.start(), samples, np.ones(samples.depth.size))
        lost = ~np.isfinite(trace.instrument).all(axis=1)
        if lost.any():
            raise ValueError(
                f"The instrument of Ivls left the finite numbers after {int(np.argmax(lost))} of {lost.size} samples: "
                "take CorrectedIvls, whose instrument is bounded."
            )
        with np.errstate(over="ignore", invalid="ignore"):  # the instrument may be close to overflow
            return traced_fit(trace, samples, trace.instrument, self.known)
