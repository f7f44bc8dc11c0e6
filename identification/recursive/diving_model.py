"""The diving model of a profiling float, equation (5) of Zhong et al. 2024 divided by its mass, and its regressor.

    z'' + D/M z' + d/M = N3/M x' + N2/M |x| x + N1/M x        z: depth, x: piston

The piston of a record's row is held until the next row.  The paper's x(k) is the piston that acted on the way to z(k),
so here that of row k - 1: a depth does not depend on the piston of its own row.  At the surface, where the waterplane
of a float supports it, the equation does not hold: leave that part of a log out before a fit.
Source: Zhong, Yu, Bai, Zeng and Lian 2024, "Diving dynamics identification and motion prediction for marine crafts
using field data", J. Ocean Eng. Sci. 9(4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, expm1, inf, isfinite
from typing import Literal

import numpy as np

from auv_gym.compiled import compiled
from auv_gym.model import check_finite, inputs_of
from auv_gym.records.record import Record
from identification.fit.validation import head_windows

# theta of equation (8), in order, with units; `unity` multiplies the previous depth, and is 1 by definition.
PARAMETERS = {
    "unity": "1",
    "damping": "1/s",
    "offset": "m/s^2",
    "piston_rate": "1/s",
    "piston_square": "1/(m s^2)",
    "piston": "1/s^2",
}
DEPTH, RATE, PISTON, INTERVAL = range(4)


@compiled
def regress(newer, older, piston, piston_before, h, h_before, row):
    """Write the regressor of equation (8) into row, (6,): the next depth is row @ theta.

    newer, older: the last two depths, h_before s apart.  piston: held over the h s to the next depth.
    On uneven samples the second difference is the divided one,
        z'' = 2 / (h + h_before) ((z - newer) / h - (newer - older) / h_before),
    and z' = (newer - older) / h_before, x' = (piston - piston_before) / h; with h = h_before this is as printed.
    """
    square = 0.5 * h * (h + h_before)
    rate = (newer - older) / h_before
    row[0] = newer + h * rate
    row[1] = -square * rate
    row[2] = -square
    row[3] = square * (piston - piston_before) / h
    row[4] = square * abs(piston) * piston
    row[5] = square * piston


@compiled
def regressors(depth, piston, interval, rows):
    """Write the regressor of equation (8) at each sample into rows, (n, 6); zero without two samples before it.

    piston: the one that acted on the way to the sample.  interval: s since the sample before; 0 begins a segment.
    """
    for k in range(2, depth.size):
        if interval[k] > 0.0 and interval[k - 1] > 0.0:
            regress(depth[k - 1], depth[k - 2], piston[k], piston[k - 1], interval[k], interval[k - 1], rows[k])


@compiled
def decayed(damping, h):
    """exp(-D h), its integral over h s, and the integral of that; for any sign of D, 1/s."""
    if abs(damping * h) < 1e-4:  # the quotients below would lose digits; the series is exact to rounding
        once = h * (1.0 - damping * h / 2.0 + (damping * h) ** 2 / 6.0)
        return exp(-damping * h), once, h * h * (0.5 - damping * h / 6.0 + (damping * h) ** 2 / 24.0)
    once = -expm1(-damping * h) / damping
    return exp(-damping * h), once, (h - once) / damping


@compiled
def dive(x, piston, h, parameters, difference):
    """Advance the state x = [depth, rate, last piston, last interval] in place by h s, with the piston held.

    parameters: [D/M, d/M, N3/M, N2/M, N1/M].  difference: equation (8), in which the rate is the mean over the last
    interval; otherwise equation (5) in closed form.  A last interval of 0 means that there was no sample before: the
    rate is then instantaneous, and the piston has not moved.
    """
    damping, offset, piston_rate, piston_square, piston_gain = parameters
    force = piston_square * abs(piston) * piston + piston_gain * piston - offset
    kick = piston_rate * (piston - x[2]) if x[3] > 0.0 else 0.0
    if difference:
        x[1] += 0.5 * (h + x[3]) * (force - damping * x[1] + kick / h)
        x[0] += h * x[1]
    else:
        left, once, twice = decayed(damping, h)
        rate = x[1] + kick  # the rate responds to a step of the piston at once, by N3
        x[0] += rate * once + force * twice
        x[1] = rate * left + force * once
    x[2], x[3] = piston, h


@compiled
def dives(starts, begin, stop, time, piston, parameters, difference, depth):
    """Write the depths, m, of free runs over windows of rows begin..stop into depth, one window after the other."""
    row = 0
    for w in range(begin.size):
        x = starts[w].copy()
        for k in range(begin[w], stop[w]):
            depth[row] = x[0]
            row += 1
            if k + 1 < stop[w]:
                dive(x, piston[k], time[k + 1] - time[k], parameters, difference)


@dataclass(frozen=True)
class DivingModel:
    """Depth of a float from its piston, as a Model; steps over any interval, so it runs on uneven samples.

    scheme: "exact" solves equation (5) with the piston held, and is stable at any sampling if damping > 0; "difference"
    is equation (8) as printed, stable only below h D/M = 2.  Parameters identified from a noisy log can be beyond that,
    so "exact" is the default.
    The published D/M = 3.95 1/s at h = 0.7 s gives 1 - h D/M = -1.8: equation (8) diverges with it, and table 1 has no
    piston between 0.5 and 0.6 m at which d/M = N2/M |x| x + N1/M x, in metres or in millimetres.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle, simulate
        >>> from identification import RefinedIv, depth_control
        >>> dive = depth_control(load_vehicle("qiandao_float"), [10, 20], rng=np.random.default_rng(0), hold=200)
        >>> model = RefinedIv().fit(dive).model
        >>> round(float(np.std(simulate(model, dive)["depth_m"] - dive["depth_m"])), 2)
        0.03
    """

    damping: float
    offset: float
    piston_rate: float
    piston_square: float
    piston: float
    dt: float = 0.7
    scheme: Literal["exact", "difference"] = "exact"

    def __post_init__(self) -> None:
        for name, value in zip(PARAMETERS, (1.0, *self.parameters)):
            if not isfinite(value):
                raise ValueError(f"DivingModel needs a finite {name}, got {value!r}: fit it to a longer record.")
        if not 0.0 < self.dt < inf:
            raise ValueError(f"DivingModel needs dt > 0 s, got {self.dt!r}.")
        if self.scheme not in ("exact", "difference"):
            raise ValueError(f"DivingModel needs scheme 'exact' or 'difference', got {self.scheme!r}.")

    @property
    def inputs(self) -> tuple[str, ...]:
        return ("piston_m",)

    @property
    def outputs(self) -> tuple[str, ...]:
        return ("depth_m",)

    @property
    def states(self) -> tuple[str, ...]:
        return ("depth_m", "depth_rate_mps", "last piston", "last interval")

    @property
    def parameters(self) -> tuple[float, ...]:
        """[D/M, d/M, N3/M, N2/M, N1/M] in SI."""
        return (self.damping, self.offset, self.piston_rate, self.piston_square, self.piston)

    def initial(self, y0: np.ndarray) -> np.ndarray:
        """The state at rest at a depth, m, with no sample before; see `settled_starts` for a moving float."""
        return np.array([np.asarray(y0, dtype=float)[0], 0.0, 0.0, 0.0])

    def step(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return self.step_over(x, u, self.dt)

    def step_over(self, x: np.ndarray, u: np.ndarray, duration: float) -> np.ndarray:
        """The state `duration` s later."""
        x = np.array(x, dtype=np.float64)
        if x.shape != (4,) or np.shape(u) != (1,):
            raise ValueError(
                f"A step of DivingModel needs a state of shape (4,), as `initial` returns it, and [piston_m]; got "
                f"{x.shape} and {np.shape(u)}."
            )
        dive(x, float(u[0]), float(duration), self.parameters, self.scheme == "difference")
        return x

    def output(self, x: np.ndarray) -> np.ndarray:
        return np.array([x[DEPTH]], dtype=np.float64)

    def correct(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The state at a measured depth; the rate is kept, since one depth does not determine it."""
        x = np.array(x, dtype=np.float64)
        if np.isfinite(y[0]):
            x[DEPTH] = y[0]
        return x

    def run(self, record: Record, windows: Sequence[slice], starts: np.ndarray) -> np.ndarray:
        """Depths of free runs over windows of a record, shape (total rows, 1).

        starts: (n_windows, 4), the states at the windows' first rows.  Raises Diverged.
        """
        begin = np.array([w.start for w in windows], dtype=np.int64)
        stop = np.array([w.stop for w in windows], dtype=np.int64)
        depth = np.empty(int((stop - begin).sum()))
        piston = np.ascontiguousarray(inputs_of(self, record)[:, 0])
        starts = np.ascontiguousarray(starts, dtype=np.float64)
        time = np.ascontiguousarray(record.time)
        dives(starts, begin, stop, time, piston, self.parameters, self.scheme == "difference", depth)
        check_finite(self.outputs, np.concatenate([record.time[w] for w in windows]), depth[:, None])
        return depth[:, None]


def settled_starts(model: DivingModel, record: Record, windows: Sequence[slice], settle: float = 20.0) -> np.ndarray:
    """States at the first rows of windows, (n_windows, 4): depth and rate fitted to the first `settle` s of each.

    For logs that begin in mid-dive; `simulate` starts at the first measured depth and at rest, like a float released at
    the surface.
    """
    heads = head_windows(record, windows, settle)
    starts = np.zeros((len(heads), 4))
    for w, head in enumerate(heads):
        at_zero, moving = np.zeros((1, 4)), np.array([[0.0, 1.0, 0.0, 0.0]])
        forced = model.run(record, [head], at_zero)[:, 0]
        response = model.run(record, [head], moving)[:, 0] - forced
        columns = np.stack([np.ones_like(response), response], axis=1)  # linear in both, so two runs suffice
        starts[w, :2] = np.linalg.lstsq(columns, record["depth_m"][head] - forced, rcond=None)[0]
    return starts
