"""The result of fitting a diving model, and the scatter of its parameters under white depth noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.estimate import Estimate
from identification.recursive.diving_model import PARAMETERS, DivingModel, regressors
from identification.recursive.recursion import Trace
from identification.recursive.samples import Samples

_NORMAL_95 = 1.959964


@dataclass(frozen=True, eq=False)
class DivingFit:
    """A diving model, and the uncertainty of its parameters.

    theta: (6,), in the order of `PARAMETERS`; the model leaves `unity` out, as equation (5) does.  covariance: (6, 6),
    None if the method has none; the estimates then say why.  history: theta after each sample, (n, 6), if the method
    has one.  noise: standard deviation of the depth noise, m, that explains the one-step errors; structural errors
    count as noise.  skipped: number of skipped updates.
    """

    model: DivingModel
    theta: np.ndarray
    covariance: np.ndarray | None
    estimates: tuple[Estimate, ...]
    history: np.ndarray | None
    noise: float
    skipped: int = 0

    def __getitem__(self, name: str) -> Estimate:
        """The estimate of a parameter; raises KeyError if there is none of this name."""
        for estimate in self.estimates:
            if estimate.path == name:
                return estimate
        raise KeyError(f"There is no parameter {name!r}; there are {', '.join(PARAMETERS)}")


def diving_fit(
    samples: Samples,
    theta: np.ndarray,
    covariance: np.ndarray | None,
    *,
    noise: float,
    known: Sequence[str] = (),
    reason: str = "",
    history: np.ndarray | None = None,
    skipped: int = 0,
) -> DivingFit:
    """A fit with its estimates; reason: why there is no covariance.  Raises if theta is not finite."""
    if not np.isfinite(theta).all():
        raise ValueError(
            "The recursion left the finite numbers: start nearer to the truth, with a smaller spread, or forget less."
        )
    estimates = []
    for i, (name, unit) in enumerate(PARAMETERS.items()):
        value, word = float(theta[i]), "known in advance, not fitted" if name in known else reason
        error = np.inf if covariance is None else float(np.sqrt(max(covariance[i, i], 0.0)))
        half = 0.0 if name in known else _NORMAL_95 * error
        estimates.append(
            Estimate(name, unit, value, 0.0 if name in known else error, (value - half, value + half), word)
        )
    model = DivingModel(*map(float, theta[1:]), dt=samples.sample_time)
    return DivingFit(model, np.array(theta), covariance, tuple(estimates), history, noise, skipped)


def traced_fit(trace: Trace, samples: Samples, instrument: np.ndarray, known: Sequence[str]) -> DivingFit:
    """The fit at the end of a recursion, with the scatter according to an instrument; see `scatter`."""
    theta, memory = trace.memory.theta, trace.memory
    covariance, noise = scatter(samples, theta, memory.gain, instrument)
    return diving_fit(samples, theta, covariance, noise=noise, known=known, history=trace.theta, skipped=memory.skipped)


def scatter(samples: Samples, theta: np.ndarray, gain: np.ndarray, instrument: np.ndarray) -> tuple[np.ndarray, float]:
    """(covariance of theta, standard deviation of the depth noise, m) under white depth noise v.

    gain: P with theta - truth = P sum of instrument(k) e(k), where instrument, (n, 6), belongs to the error e of
    equation (8), e(k) = v(k) - a v(k-1) + b v(k-2).  The sum is rewritten over v, whose terms are independent, which
    accounts for the correlation of e by differencing.  Biases, by errors in the regressor or of structure, are not
    included.
    Source: Soderstrom and Stoica 1983, Instrumental Variable Methods for System Identification, sec. 4.
    """
    h = samples.interval
    rows = np.zeros((h.size, len(PARAMETERS)))
    regressors(samples.depth, samples.piston, h, rows)
    used = rows[:, 2] != 0.0
    before = np.where(used, np.r_[h[:1], h[:-1]], 1.0)
    carried, damped = h / before, 0.5 * h * (h + before) * theta[1] / before
    last = np.where(used, theta[0] * (1.0 + carried) - damped, 0.0)
    second = np.where(used, theta[0] * carried - damped, 0.0)
    error = np.where(used, samples.depth - rows @ theta, 0.0)
    spread = np.sum(used * (1.0 + last**2 + second**2))
    noise = float(np.sqrt(error @ error / spread))
    of_noise = np.where(used[:, None], instrument, 0.0)
    of_noise[:-1] -= last[1:, None] * np.where(used[1:, None], instrument[1:], 0.0)
    of_noise[:-2] += second[2:, None] * np.where(used[2:, None], instrument[2:], 0.0)
    mapped = noise * of_noise @ gain.T
    return mapped.T @ mapped, noise
