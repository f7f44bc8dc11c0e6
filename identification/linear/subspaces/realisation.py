"""Matrices of an innovations form with a drift and a level, and the corresponding model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from auv_gym.models.linear import StateSpace
from identification.linear.scaled import Scaled


@dataclass(frozen=True, eq=False)
class Realisation:
    """The innovations form x(t+1) = a x + b u + k e + drift,  y = c x + level + e.

    A drift cannot always be moved into the level: an integrator keeps it.
    integrators: number of leading states that are sums; their rows of `a` are those of the unit matrix.  rest: the
    value of zero input, (m,), if the integrators stay at rest there; None if their drift is free.
    """

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    k: np.ndarray
    drift: np.ndarray
    level: np.ndarray
    integrators: int = 0
    rest: np.ndarray | None = None

    @cached_property
    def predictor(self) -> np.ndarray:
        """The state matrix of the one-step predictor, a - k c."""
        return self.a - self.k @ self.c

    @property
    def parameters(self) -> int:
        """Number of parameters, whatever the choice of states: n (m + 2 p), minus those fixed by integrators."""
        n, m = self.b.shape
        return n * (m + 2 * len(self.c)) - self.integrators * (self.integrators + (self.rest is not None))

    @property
    def summed(self) -> np.ndarray:
        """How strongly the outputs follow the integrators once all else has settled, (p, integrators)."""
        r, rest = self.integrators, len(self.a) - self.integrators
        settled = np.linalg.lstsq(np.eye(rest) - self.a[r:, r:], self.a[r:, :r], rcond=None)[0]
        return self.c[:, :r] + self.c[:, r:] @ settled

    @property
    def settled(self) -> np.ndarray:
        """Which entries are fixed by integrators, (P,): their rows of `a` and, in units, their drift if they rest."""
        fixed = [np.zeros(part.shape, dtype=bool) for part in self.parts]
        fixed[0][: self.integrators] = True
        if self.rest is not None and not self.rest.any():
            fixed[4][: self.integrators] = True
        return np.concatenate([part.ravel() for part in fixed])

    @property
    def vector(self) -> np.ndarray:
        """All entries, matrix by matrix, row by row."""
        return np.concatenate([part.ravel() for part in self.parts])

    @property
    def parts(self) -> tuple[np.ndarray, ...]:
        return self.a, self.b, self.c, self.k, self.drift, self.level

    def at(self, vector: np.ndarray) -> Realisation:
        """The realisation of the same shapes with other entries."""
        ends = np.cumsum([part.size for part in self.parts])[:-1]
        names = ("a", "b", "c", "k", "drift", "level")
        values = (v.reshape(part.shape) for v, part in zip(np.split(vector, ends), self.parts))
        return replace(self, **dict(zip(names, values, strict=True)))

    def in_units(self, scaled: Scaled) -> Realisation:
        """The realisation for the unscaled signals."""
        b = self.b / scaled.input_spread
        return Realisation(
            self.a,
            b,
            scaled.output_spread[:, None] * self.c,
            self.k / scaled.output_spread,
            self.drift - b @ scaled.input_middle,
            scaled.output_spread * self.level + scaled.output_middle,
            self.integrators,
            None if self.rest is None else np.zeros_like(self.rest),
        )

    def turned(self, turn: np.ndarray) -> Realisation:
        """The realisation with states `turn` x; turn: orthonormal."""
        back = turn.T
        return replace(
            self, a=turn @ self.a @ back, b=turn @ self.b, c=self.c @ back, k=turn @ self.k, drift=turn @ self.drift
        )

    def shifted(self, shift: np.ndarray) -> Realisation:
        """The realisation with states measured from `shift`."""
        return replace(self, drift=self.drift + self.a @ shift - shift, level=self.level + self.c @ shift)

    def centred(self, scaled: Scaled) -> tuple[Realisation, np.ndarray, np.ndarray]:
        """The realisation with states measured from an operating point, where drift = -b offset; offset; shift.

        self: in units.  The operating point is the one closest to the signals' middles, in units of their spreads.
        """
        n, m = self.b.shape
        if not scaled.offset:
            return self, np.zeros(m), np.zeros(n)
        # least |(level + c d - middle) / spread|^2 + |(offset - middle) / spread|^2 with (a - 1) d + b offset = -drift
        tall = np.zeros((self.level.size + m, n + m))
        tall[: self.level.size, :n] = self.c / scaled.output_spread[:, None]
        tall[self.level.size :, n:] = np.diag(1.0 / scaled.input_spread)
        wanted = np.concatenate(
            [(scaled.output_middle - self.level) / scaled.output_spread, scaled.input_middle / scaled.input_spread]
        )
        tied = np.concatenate([self.a - np.eye(n), self.b], axis=1)
        system = np.block([[tall.T @ tall, tied.T], [tied, np.zeros((n, n))]])
        size = np.sqrt(np.maximum(np.abs(system).max(axis=1), np.finfo(float).tiny))
        right = np.concatenate([tall.T @ wanted, -self.drift])
        found = np.linalg.lstsq(system / np.outer(size, size), right / size, rcond=1e-14)[0] / size
        shift, offset = found[:n], found[n : n + m]
        return self.shifted(shift), offset, shift

    def model(self, like: StateSpace, offset: np.ndarray) -> StateSpace:
        """The model with the channels of `like`; self: centred, with this input offset."""
        return StateSpace(
            self.a,
            self.b,
            self.c,
            like.inputs,
            like.outputs,
            like.dt,
            k=self.k,
            input_offset=offset,
            output_offset=self.level,
        )
