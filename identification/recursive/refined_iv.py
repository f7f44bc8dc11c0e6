"""Refined instrumental variables, off line: the diving model in continuous time, as accurate as its noise allows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.compiled import compiled
from auv_gym.param import check_names
from auv_gym.records.record import Record
from identification.recursive.corrected_ivls import CorrectedIvls
from identification.recursive.diving_fit import DivingFit, diving_fit
from identification.recursive.diving_model import PARAMETERS, decayed
from identification.recursive.recursion import COUNT, check_settings
from identification.recursive.rwls import UNKNOWN
from identification.recursive.samples import Samples

_SETTLED = 1e-6  # relative change of the damping at which the iteration ends


@compiled
def _responses(piston, interval, damping, columns):
    """Write the depths that each term of equation (5) alone gives, from rest, into columns (n, 4): d, N3, N2, N1."""
    rate = np.zeros(4)
    for k in range(piston.size):
        h = interval[k]
        if h == 0.0:
            rate[:] = 0.0
            columns[k] = 0.0
            continue
        kick = piston[k] - piston[k - 1] if interval[k - 1] > 0.0 else 0.0
        left, once, twice = decayed(damping, h)
        for j in range(4):
            force = 0.0
            if j == 0:
                force = -1.0
            elif j == 1:
                rate[j] += kick
            elif j == 2:
                force = abs(piston[k]) * piston[k]
            else:
                force = piston[k]
            columns[k, j] = columns[k - 1, j] + rate[j] * once + force * twice
            rate[j] = rate[j] * left + force * once


@compiled
def _lagged(depth, interval, damping, result):
    """Write 1 / (s + D) of a depth, linear between samples, from zero at the start of each segment, into result."""
    for k in range(depth.size):
        h = interval[k]
        if h == 0.0:
            result[k] = 0.0
            continue
        left, once, twice = decayed(damping, h)
        slope = (depth[k] - depth[k - 1]) / h
        result[k] = left * result[k - 1] + depth[k - 1] * once + slope * twice


@compiled
def _released(interval, damping, result):
    """Write the depth, m, that a rate of 1 m/s at the start of each segment gives into result."""
    rate = 1.0
    for k in range(interval.size):
        h = interval[k]
        if h == 0.0:
            rate, result[k] = 1.0, 0.0
            continue
        left, once, _ = decayed(damping, h)
        result[k] = result[k - 1] + rate * once
        rate *= left


@dataclass(frozen=True)
class RefinedIv:
    """Simplified refined instrumental variables for equation (5), iterated over whole records.

    With the filter 1 / (s (s + D)) of the last iteration, white depth noise is white in the equation.  With the model's
    depth instead of the measured one as instrument, there is no bias and the scatter is minimal.  Depth and rate at the
    start of each segment are fitted, too.  The method works in closed loop if depth noise is white, because the piston
    reacts only to past noise.
    slowest, fastest: s, limits of the time constant M/D.  initial, known: parameters in known keep their initial value.
    Source: Young and Jakeman 1980, Int. J. Control 31(4), 741-764; Young 2011, Recursive Estimation and Time-Series
    Analysis, ch. 8.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import RefinedIv, depth_control
        >>> dive = depth_control(load_vehicle("qiandao_float"), [10, 20], rng=np.random.default_rng(0), hold=200)
        >>> fit = RefinedIv().fit(dive)
        >>> round(fit.model.damping, 2)
        0.11
    """

    slowest: float = 100.0
    fastest: float = 1.0
    max_iterations: int = 60
    initial: Sequence[float] = UNKNOWN
    known: Sequence[str] = ()

    def __post_init__(self) -> None:
        check_names("RefinedIv: known", self.known)
        check_settings("RefinedIv", self.initial, 1.0, self._known)
        if not 0.0 < self.fastest < self.slowest < np.inf:
            raise ValueError(f"RefinedIv needs 0 < fastest < slowest, got {self.fastest!r} and {self.slowest!r} s.")
        if self.max_iterations < 1:
            raise ValueError(f"RefinedIv needs at least 1 iteration, got {self.max_iterations!r}.")

    @property
    def _known(self) -> tuple[str, ...]:
        return ("unity", *self.known)

    def fit(self, *records: Record) -> DivingFit:
        """Fit over all records; raises if the iteration does not converge, or converges to a limit."""
        free = np.array([i for i, name in enumerate(PARAMETERS) if name not in self._known])
        samples = Samples.of(records, "RefinedIv", free.size)
        theta = np.array(self.initial, dtype=float)
        if 1 in free:
            first = CorrectedIvls(known=tuple(self.known), initial=self.initial).fit(*records)
            theta[1] = self._within(first.theta[1])
        model = samples.depth  # the first pass is least squares
        for iteration in range(self.max_iterations):
            step = 1.0 if iteration < self.max_iterations // 3 else 0.5  # full steps may oscillate about the solution
            damping = theta[1]
            theta, starts, instrument = self._pass(samples, theta, free, model, step)
            columns, released = _columns(samples, theta[1])
            model = columns[:, 1:] @ theta[2:] + released @ starts
            if iteration > 0 and abs(theta[1] - damping) <= _SETTLED * damping:
                break
        else:
            raise ValueError(
                f"RefinedIv did not settle in {self.max_iterations} iterations, at a damping of {theta[1]:.3g} 1/s: "
                'record a dive with a return, or keep a parameter, such as known=("piston_rate",).'
            )
        if 1 in free and theta[1] in (1.0 / self.slowest, 1.0 / self.fastest):
            raise ValueError(
                f"RefinedIv found a time constant M/D at its limit of {1.0 / theta[1]:g} s: leave out what the float "
                "spent at the surface, where equation (5) does not hold, or set slowest and fastest further apart."
            )
        error = samples.depth - model
        noise = float(np.sqrt(error @ error / (error.size - instrument.shape[1])))
        root = np.linalg.inv(np.linalg.qr(instrument)[1])[: free.size]
        covariance = np.zeros((COUNT, COUNT))
        covariance[np.ix_(free, free)] = noise**2 * root @ root.T
        return diving_fit(samples, theta, covariance, noise=noise, known=self._known)

    def _pass(
        self, samples: Samples, theta: np.ndarray, free: np.ndarray, model: np.ndarray, step: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Next theta, depths and rates at the starts of segments, and the instruments; model: depths of the last pass.

        z = D / (s + D) z + s / (s + D) z: with the filter's D, the coefficient of the damping's column is its change.
        """
        columns, released = _columns(samples, theta[1])
        held = np.setdiff1d(np.arange(2, COUNT), free)
        regressor = np.concatenate([columns[:, free - 1], released], axis=1)
        instrument = regressor.copy()
        if 1 in free:
            instrument[:, 0] = -_filtered(model, samples, theta[1])
        target = samples.depth - columns[:, held - 1] @ theta[held]
        # an orthogonal basis of the instruments gives the same solution, without squaring the spread of the columns
        basis = np.linalg.qr(instrument / np.sqrt(np.sum(instrument**2, axis=0)))[0]
        found = np.linalg.solve(basis.T @ regressor, basis.T @ target)
        result = theta.copy()
        result[free] = found[: free.size]
        if 1 in free:
            result[1] = self._within(theta[1] + step * found[0])
        return result, found[free.size :], instrument

    def _within(self, damping: float) -> float:
        return float(min(max(damping, 1.0 / self.slowest), 1.0 / self.fastest))


def _columns(samples: Samples, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """Columns of [D, d, N3, N2, N1], and of depth and rate at the start of each segment."""
    n = samples.depth.size
    columns, released = np.zeros((n, COUNT - 1)), np.zeros(n)
    terms = np.zeros((n, COUNT - 2))
    _responses(samples.piston, samples.interval, damping, terms)
    columns[:, 0], columns[:, 1:] = -_filtered(samples.depth, samples, damping), terms
    _released(samples.interval, damping, released)
    begins = samples.interval == 0.0
    member = np.cumsum(begins)[:, None] == np.arange(1, begins.sum() + 1)
    return columns, np.concatenate([member, member * released[:, None]], axis=1)


def _filtered(depth: np.ndarray, samples: Samples, damping: float) -> np.ndarray:
    result = np.zeros(depth.size)
    _lagged(depth, samples.interval, damping, result)
    return result
