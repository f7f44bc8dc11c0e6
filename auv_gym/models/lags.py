"""Lags of outputs and inputs of a difference equation, and the regressors computed from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import did_you_mean


@dataclass(frozen=True)
class Lags:
    """The regressors of an equation: the n_a last values of each output, and n_b of each input from `delay` on.

    An integrating output has its n_a - 1 last increments instead.  delay: samples, at least 1: an output does not
    depend on the input of its own row.
    The memory after a sample is [outputs, outputs before, ..., inputs, inputs before, ...], newest first.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    n_a: int
    n_b: int
    delay: int = 1
    integrating: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in (*self.inputs, *self.outputs):
            channel(name)  # raises if it is unknown
        if len({*self.inputs, *self.outputs}) != len(self.inputs) + len(self.outputs):
            raise ValueError(
                f"Each channel is either an input or an output, and given once; got inputs {', '.join(self.inputs)} "
                f"and outputs {', '.join(self.outputs)}."
            )
        if not self.outputs:
            raise ValueError("An equation needs at least one output, got none: name one, such as heading_rad.")
        for name, least in (("n_a", 0), ("n_b", 0), ("delay", 1)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise ValueError(f"{name} needs a whole number of at least {least}, got {value!r}.")
        for name in self.integrating:
            if name not in self.outputs:
                raise ValueError(
                    f"integrating needs outputs ({', '.join(self.outputs)}), got {name!r}. "
                    f"{did_you_mean(name, self.outputs)}"
                )
        if self.integrating and not self.n_a:
            raise ValueError(f"n_a needs at least 1 for {', '.join(self.integrating)}, which integrate, got 0.")
        if not self.matrix.size:
            raise ValueError(f"An equation needs lags, got n_a {self.n_a} and n_b {self.n_b}: raise one of them.")

    @property
    def outputs_kept(self) -> int:
        """Number of stored samples of the outputs, including the present one."""
        return max(self.n_a, 1)

    @property
    def inputs_kept(self) -> int:
        """Number of stored samples of the inputs, including the present one."""
        return max(self.delay + self.n_b - 1, 1)

    @property
    def first(self) -> int:
        """The first row of a segment with a complete memory."""
        return max(self.outputs_kept, self.inputs_kept) - 1

    @property
    def carried(self) -> np.ndarray:
        """Which outputs integrate: 1 for those, otherwise 0."""
        return np.array([float(name in self.integrating) for name in self.outputs])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of the regressors."""
        kinds = [(f"{name} step" if name in self.integrating else name) for name in self.outputs]
        counts = [self.n_a - (name in self.integrating) for name in self.outputs]
        past = [f"{kind} lag {k + 1}" for kind, count in zip(kinds, counts) for k in range(count)]
        return (*past, *(f"{name} lag {self.delay + k}" for name in self.inputs for k in range(self.n_b)))

    @cached_property
    def matrix(self) -> np.ndarray:
        """The matrix from the memory to the regressors, (d, remembered)."""
        p, m = len(self.outputs), len(self.inputs)
        unit, rows = np.eye(p * self.outputs_kept + m * self.inputs_kept), []
        for i, name in enumerate(self.outputs):
            values = unit[i : i + p * self.n_a : p]
            rows.append(values[:-1] - values[1:] if name in self.integrating else values)
        start = p * self.outputs_kept + m * (self.delay - 1)
        rows += [unit[start + j : start + j + m * self.n_b : m] for j in range(m)]
        return np.concatenate(rows)

    def remembered(self, u: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The memory at the rows of a segment from `first` on, (n - first, remembered)."""
        rows = range(self.first, max(len(y), self.first))
        parts = [y[rows.start - k : rows.stop - k] for k in range(self.outputs_kept)]
        parts += [u[rows.start - k : rows.stop - k] for k in range(self.inputs_kept)]
        return np.concatenate(parts, axis=1)

    def regressors(self, u: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The regressors at the rows of a segment from `first` on, (n - first, d), for the outputs of the next row."""
        return self.remembered(u, y) @ self.matrix.T
