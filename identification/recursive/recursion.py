"""The common parts of all recursions for theta of equation (8): state, update of theta, and loop over a record."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_gym.compiled import bind, compiled, view_as
from auv_gym.param import check_names, did_you_mean
from identification.recursive.diving_model import PARAMETERS, regress
from identification.recursive.samples import Samples

COUNT = len(PARAMETERS)
MOST_LAGS = 29
RING = MOST_LAGS + 3
LEAST_DENOMINATOR = 1e-6  # least relative denominator of the gain; at zero the update has no solution

# One state type for all recursions, so that one view suffices; unused fields stay zero.
STATE = np.dtype(
    (
        np.record,
        [
            ("theta", np.float64, (COUNT,)),
            ("gain", np.float64, (COUNT, COUNT)),  # P of equation (20)
            ("depth", np.float64, (2,)),  # newest first
            ("piston", np.float64),
            ("interval", np.float64),
            ("seen", np.float64),  # samples since the segment began
            ("skipped", np.float64),
            ("forgetting", np.float64),
            ("share", np.float64),  # alpha of equation (32)
            ("lag", np.float64),
            # instruments
            ("auxiliary", np.float64, (COUNT,)),  # theta*
            ("warm_up", np.float64),
            ("simulated", np.float64, (2,)),  # xi, newest first; or the auxiliary model's rate and its last mean
            ("past_theta", np.float64, (RING, COUNT)),
            ("past_auxiliary", np.float64, (RING, COUNT)),
            ("past_piston", np.float64, (RING,)),
            # integrated rows
            ("memory", np.float64),
            ("smoothing", np.float64),
            ("slowest", np.float64),
            ("fastest", np.float64),
            ("smooth", np.float64, (2,)),
            ("target", np.float64),
            ("regressor", np.float64, (COUNT,)),
            ("instrument", np.float64, (COUNT,)),
        ],
    )
)
view = view_as(STATE, "recursion", writable=True)
advance: Any


@dataclass(frozen=True, eq=False)
class Memory:
    """The state of a recursion after some samples; `update` of its estimator returns the next one.

    theta: (6,), in the order of `PARAMETERS`.  gain: P of equation (20), (6, 6).  skipped: number of updates skipped
    because the gain's denominator was nearly zero.
    """

    vector: np.ndarray

    @property
    def theta(self) -> np.ndarray:
        return self.vector[:COUNT].copy()

    @property
    def gain(self) -> np.ndarray:
        return self.vector[COUNT : COUNT * (COUNT + 1)].reshape(COUNT, COUNT).copy()

    @property
    def skipped(self) -> int:
        return int(self.vector.view(STATE)[0].skipped)

    def steered_by(self, auxiliary: Sequence[float] | np.ndarray) -> Memory:
        """The memory with another theta for the model that simulates its instrument."""
        vector = self.vector.copy()
        vector.view(STATE)[0].auxiliary[:] = auxiliary
        return Memory(vector)


@dataclass(frozen=True, eq=False)
class Trace:
    """A recursion over samples: theta after each, and the instrument of its update, zero if there was none."""

    memory: Memory
    theta: np.ndarray
    instrument: np.ndarray


@compiled
def absorb(s, target, regressor, instrument, weight):
    """Update theta and P by a row: equations (20) and (34), with a forgetting factor.

    With the regressor as instrument this is weighted least squares.  A parameter whose row and column of P are zero
    keeps its value.
    """
    left, right = np.zeros(COUNT), np.zeros(COUNT)
    error, denominator = target, s.forgetting / weight
    for i in range(COUNT):
        error -= regressor[i] * s.theta[i]
        for j in range(COUNT):
            left[i] += s.gain[i, j] * instrument[j]
            right[i] += regressor[j] * s.gain[j, i]
        denominator += regressor[i] * left[i]
    if not abs(denominator) > LEAST_DENOMINATOR * s.forgetting / weight:
        s.skipped += 1.0
        return
    for i in range(COUNT):
        step = left[i] / denominator
        s.theta[i] += step * error
        for j in range(COUNT):
            s.gain[i, j] = (s.gain[i, j] - step * right[j]) / s.forgetting


@compiled
def begin(s, depth):
    """Start a segment at its first sample: past samples are dropped, but the estimates are kept."""
    s.depth[0], s.seen = depth, 1.0


@compiled
def keep(s, depth, piston, h):
    """Store a sample as the newest one."""
    s.depth[1], s.depth[0] = s.depth[0], depth
    s.piston, s.interval = piston, h
    s.seen += 1.0


@compiled
def least_squares_row(s, piston, h, regressor):
    """Write the regressor of equation (8) on the stored samples."""
    regress(s.depth[0], s.depth[1], piston, s.piston, h, s.interval, regressor)


@compiled
def slot(s, age):
    """The ring index of the sample `age` before the coming one, or of the segment's second sample if that is later."""
    return int(max(s.seen - age, 1.0)) % RING


def _update(vector, depth, piston, h, weight, row):
    """Process one sample in the state; row: scratch, (2, 6), for regressor and instrument."""
    advance(view(vector), depth, piston, h, weight, row[0], row[1])  # noqa: F821 - `programs` gives it its meaning


def _over(vector, depth, piston, interval, weight, theta, regressor, instrument):
    """Process all samples in the state, and write theta, regressor and instrument of each."""
    s = view(vector)
    for k in range(depth.size):
        advance(s, depth[k], piston[k], interval[k], weight[k], regressor[k], instrument[k])  # noqa: F821
        for i in range(COUNT):
            theta[k, i] = s.theta[i]


def programs(name: str, advance: Callable[..., Any]) -> tuple[Any, Any]:
    """(one sample, all samples) for a recursion: advance(state, depth, piston, h, weight, regressor, instrument)."""
    return bind(_update, name, advance=advance), bind(_over, name, advance=advance)


def started(initial: Sequence[float], spread: float, known: Sequence[str], **settings: float) -> Memory:
    """A memory before the first sample, with P = spread^2 I, zero for parameters known in advance."""
    vector = np.zeros(STATE.itemsize // 8)
    s: Any = vector.view(STATE)[0]
    s.theta[:] = s.auxiliary[:] = initial
    for i, name in enumerate(PARAMETERS):
        s.gain[i, i] = 0.0 if name in known else spread**2
    for name, value in {"forgetting": 1.0, **settings}.items():
        s[name] = value
    return Memory(vector)


def updated(program: Any, memory: Memory, z: float, x: float, h: float, weight: float) -> Memory:
    """The memory after a sample; raises if the sample is invalid."""
    if not (np.isfinite(z) and np.isfinite(x) and h >= 0.0 and h < np.inf and weight > 0.0):
        raise ValueError(
            f"An update needs a finite depth and piston, h >= 0 s and a weight > 0, got z={z!r}, x={x!r}, h={h!r}, "
            f"weight={weight!r}: leave a missing sample out, and give the next one the time since the last."
        )
    vector = memory.vector.copy()
    program(vector, float(z), float(x), float(h), float(weight), np.zeros((2, COUNT)))
    return Memory(vector)


def traced(program: Any, memory: Memory, samples: Samples, weights: np.ndarray) -> Trace:
    """A recursion over all samples, from a memory that is left unchanged."""
    vector, n = memory.vector.copy(), samples.depth.size
    theta, regressor, instrument = np.empty((n, COUNT)), np.zeros((n, COUNT)), np.zeros((n, COUNT))
    program(vector, samples.depth, samples.piston, samples.interval, weights, theta, regressor, instrument)
    return Trace(Memory(vector), theta, instrument)


def check_settings(name: str, initial: Sequence[float], spread: float, known: Sequence[str]) -> None:
    """Raise if the common settings of recursions are invalid."""
    if np.shape(initial) != (COUNT,) or not np.isfinite(initial).all():
        raise ValueError(f"{name} needs {COUNT} finite initial values ({', '.join(PARAMETERS)}), got {initial!r}.")
    if not 0.0 < spread < np.inf:
        raise ValueError(f"{name} needs spread > 0, got {spread!r}: 1e6 leaves theta to the data.")
    check_names(f"{name}: known", known)
    for parameter in known:
        if parameter not in PARAMETERS:
            raise ValueError(f"{name} has no parameter {parameter!r}. {did_you_mean(parameter, PARAMETERS)}")
    if len(set(known)) == COUNT:
        raise ValueError(f"{name} got all parameters as known: leave at least one to be fitted.")


def checked_weights(weights: Sequence[np.ndarray] | None, samples: Samples) -> np.ndarray:
    """One weight per sample of all records; 1 by default."""
    if weights is None:
        return np.ones(samples.depth.size)
    found = np.concatenate([np.asarray(part, dtype=float).ravel() for part in weights])
    if found.size != samples.depth.size or not (np.isfinite(found) & (found > 0.0)).all():
        raise ValueError(
            f"Rwls.fit needs one positive weight per sample ({samples.depth.size}), an array for each record; got "
            f"{found.size} values, of which {int(np.sum(found > 0.0))} are positive."
        )
    return found
