"""Nonlinear discrete-time models: the next outputs as Gaussian radial basis functions of lagged outputs and inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from auv_gym.compiled import compiled
from auv_gym.model import check_finite, check_interval, inputs_of, outputs_of
from auv_gym.models.lags import Lags
from auv_gym.physics.radial import BITS, LANES, radial_blocks, radial_distances, radial_sums
from auv_gym.records.record import Record

_SHAPES = {
    "support": "nd",
    "middle": "d",
    "spread": "d",
    "sigma": "g",
    "coefficients": "gnp",
    "slopes": "dp",
    "bias": "p",
    "rest": "r",
    "sway": "r",
}


@dataclass(frozen=True, eq=False)
class Narx:
    """A Model whose next outputs are a function of its `Lags` z, a linear part plus Gaussian radial basis functions:

        f(z) = bias + slopes' (z - middle) + sum_gj coefficients[g, j] exp(-|(z - support[j]) / (spread sigma[g])|^2)

    f is the next value of an output, or its next increment if it is integrating.
    support: (n, d).  middle, spread: (d,).  sigma: (g,), in spreads.  coefficients: (g, n, p).  slopes: (d, p).
    bias: (p,).  rest: (p + m,), outputs and inputs that a start leaves open; sway: (p + m,), typical change of the
    outputs in a sample and distance of the inputs from rest.  reach: distance from the nearest support, in spreads,
    beyond which z is outside of the training data.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt: float
    n_a: int
    n_b: int
    delay: int
    integrating: tuple[str, ...]
    support: np.ndarray
    middle: np.ndarray
    spread: np.ndarray
    sigma: np.ndarray
    coefficients: np.ndarray
    slopes: np.ndarray
    bias: np.ndarray
    rest: np.ndarray
    sway: np.ndarray
    reach: float

    def __post_init__(self) -> None:
        for name in ("inputs", "outputs", "integrating"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for name in ("dt", "reach"):
            object.__setattr__(self, name, float(getattr(self, name)))
            if not 0.0 < getattr(self, name) < np.inf:
                raise ValueError(f"Narx needs a finite {name} > 0, got {getattr(self, name)!r}.")
        for name in _SHAPES:
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=np.float64, order="C"))
        p, m, d = len(self.outputs), len(self.inputs), len(self.lags.matrix)
        sizes = {"n": len(self.support), "d": d, "g": self.sigma.size, "p": p, "r": p + m}
        for name, letters in _SHAPES.items():
            array, shape = getattr(self, name), tuple(sizes[letter] for letter in letters)
            if array.shape != shape or not np.isfinite(array).all():
                raise ValueError(f"Narx with {d} regressors needs finite {name} of shape {shape}, got {array.shape}.")
        for name in ("spread", "sigma", "sway"):
            if not (getattr(self, name) > 0.0).all():
                raise ValueError(f"Narx needs {name} > 0, got others: leave out what is constant.")

    @cached_property
    def lags(self) -> Lags:
        """The lags that the model stores, and its regressors."""
        return Lags(self.inputs, self.outputs, self.n_a, self.n_b, self.delay, self.integrating)

    @property
    def states(self) -> tuple[str, ...]:
        """The states: the outputs, the outputs before, and the inputs before, newest first."""
        return self._states

    @cached_property
    def _states(self) -> tuple[str, ...]:
        outputs, lags = self.outputs, self.lags
        before = [f"{name} lag {k}" for k in range(1, lags.outputs_kept) for name in outputs]
        return (*outputs, *before, *(f"{name} lag {k}" for k in range(1, lags.inputs_kept) for name in self.inputs))

    def initial(self, y0: np.ndarray) -> np.ndarray:
        """The state after these outputs have been constant for long, inputs at rest; NaN leaves an output at rest."""
        p, lags = len(self.outputs), self.lags
        y = np.where(np.isfinite(y0), np.asarray(y0, dtype=float), self.rest[:p])
        return np.concatenate([np.tile(y, lags.outputs_kept), np.tile(self.rest[p:], lags.inputs_kept - 1)])

    @property
    def start_spread(self) -> np.ndarray:
        """Typical distance of the states of a moving system from `initial`, (n_states,)."""
        p, lags = len(self.outputs), self.lags
        outputs = np.outer(np.arange(1, lags.outputs_kept + 1), self.sway[:p]).ravel()
        return np.concatenate([outputs, np.tile(self.sway[p:], lags.inputs_kept - 1)])

    def step(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The state one sample later, shape (n_states,)."""
        past = self._past(x)
        _advance(past, np.ascontiguousarray(u, dtype=np.float64)[None], np.empty((1, self.bias.size)), *self._function)
        return past[: len(self.states)]

    def output(self, x: np.ndarray) -> np.ndarray:
        """The outputs in a state, shape (n_outputs,)."""
        return np.array(x[: len(self.outputs)], dtype=np.float64)

    def correct(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The state with the outputs measured; an output that is NaN counts as predicted."""
        p, x = len(self.outputs), np.array(x, dtype=np.float64)
        x[:p] = np.where(np.isfinite(y), y, x[:p])
        return x

    def run(self, record: Record, windows: Sequence[slice], starts: np.ndarray) -> np.ndarray:
        """Outputs of free runs over windows of a record, shape (total rows, n_outputs).

        starts: (n_windows, n_states), the states at the windows' first rows.  Raises for another sample interval, and
        Diverged.
        """
        for window in windows:
            check_interval(self, record.time[window])
        if np.shape(starts) != (len(windows), len(self.states)):
            raise ValueError(
                f"run needs starts of shape {(len(windows), len(self.states))}, one state a window, got "
                f"{np.shape(starts)}."
            )
        inputs, p = inputs_of(self, record), len(self.outputs)
        y, row = np.empty((sum(w.stop - w.start for w in windows), p)), 0
        for window, start in zip(windows, starts):
            y[row] = start[:p]
            after = y[row + 1 : row + window.stop - window.start]
            _advance(self._past(start), inputs[window.start : window.stop - 1], after, *self._function)
            row += 1 + len(after)
        check_finite(self.outputs, np.concatenate([record.time[w] for w in windows]), y)
        return y

    def free(self, remembered: np.ndarray, inputs: np.ndarray) -> np.ndarray:
        """Outputs, (n, p), after each row of inputs (n, m), from the memory of `Lags`; they may be non-finite."""
        kept, m = len(self.outputs) * self.lags.outputs_kept, len(self.inputs)
        past = np.concatenate([remembered[:kept], remembered[kept + m :], np.zeros(m)])
        after = np.empty((len(inputs), len(self.outputs)))
        _advance(past, np.ascontiguousarray(inputs, dtype=np.float64), after, *self._function)
        return after

    def distance(self, record: Record) -> np.ndarray:
        """Distance of the regressors of a record's samples from the training data, relative to `reach`.

        Above 1 means outside.  One value per sample with all its lags present in its own segment.  The outputs are the
        record's: use `simulate(model, record)` for those of a free run.
        """
        u, y = inputs_of(self, record), outputs_of(self, record)
        z = np.concatenate([self.lags.regressors(u[part], y[part]) for part in record.segments])
        z = z[np.isfinite(z).all(axis=1)]
        out = np.empty(len(z))
        radial_distances((z - self.middle) / self.spread * BITS, self._nearest, out)
        return out / self.reach

    def outside(self, record: Record) -> float:
        """The share of a record's samples outside of the training data; see `distance`."""
        found = self.distance(record)
        return float(np.mean(found > 1.0)) if found.size else 0.0

    @cached_property
    def _function(self) -> Any:
        """The arguments of `_advance` between the inputs and the output arrays."""
        rates = 1.0 / (self.spread * self.sigma[:, None])
        blocks = [radial_blocks(self.support - self.middle, r, c) for r, c in zip(rates, self.coefficients)]
        shape = (0, 0, self.spread.size + 1 + self.bias.size, LANES)
        stacked = np.stack(blocks) if blocks else np.zeros(shape)
        kept, matrix, carried = len(self.outputs) * self.lags.outputs_kept, self.lags.matrix, self.lags.carried
        return kept, matrix, self.middle, self.slopes, carried, self.bias, rates * BITS, stacked

    @cached_property
    def _nearest(self) -> np.ndarray:
        return radial_blocks(self.support - self.middle, 1.0 / self.spread, np.zeros((len(self.support), 0)))

    def _past(self, x: np.ndarray) -> np.ndarray:
        """The memory in a state, with room for one more sample of the inputs, in the form for `_run`."""
        if np.shape(x) != (len(self.states),):
            raise ValueError(
                f"A state of this model has shape ({len(self.states)},), got {np.shape(x)}: see `initial`."
            )
        return np.concatenate([x, np.zeros(len(self.inputs))])


@compiled
def _next(past, lags, middle, slopes, carried, bias, rates, blocks, z, scaled, room, part, out):
    """Write the outputs one sample later into out (p,)."""
    d, p = lags.shape[0], out.shape[0]
    for i in range(d):
        total = -middle[i]
        for j in range(past.shape[0]):
            total += lags[i, j] * past[j]
        z[i] = total
    for o in range(p):
        total = bias[o] + carried[o] * past[o]
        for i in range(d):
            total += slopes[i, o] * z[i]
        out[o] = total
    for g in range(blocks.shape[0]):
        for i in range(d):
            scaled[i] = z[i] * rates[g, i]
        radial_sums(scaled, blocks[g], room, part)
        for o in range(p):
            out[o] += part[o]


@compiled
def _advance(past, inputs, after, kept, lags, middle, slopes, carried, bias, rates, blocks):
    """Write the outputs after each row of inputs (n, m) into after (n, p), and update the memory.

    past: stored values of outputs, newest first, then those of the earlier inputs, and room for the present ones.
    """
    (n, p), m, d, size = after.shape, inputs.shape[1], lags.shape[0], past.shape[0]
    z, scaled, room, part = np.empty(d), np.empty(d), np.empty((2 + p, blocks.shape[3])), np.empty(p)
    for t in range(n):
        for i in range(size - 1, kept + m - 1, -1):
            past[i] = past[i - m]
        for i in range(m):
            past[kept + i] = inputs[t, i]
        _next(past, lags, middle, slopes, carried, bias, rates, blocks, z, scaled, room, part, after[t])
        for i in range(kept - 1, p - 1, -1):
            past[i] = past[i - p]
        for o in range(p):
            past[o] = after[t, o]
