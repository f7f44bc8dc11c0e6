"""Signals of a series, centred and scaled by their spreads, in which subspace methods compute."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.linear.regressors import Series

_STILL = 1e-12  # ratio of spread to size below which a channel is constant up to rounding


@dataclass(frozen=True, eq=False)
class Scaled:
    """Inputs u and outputs y of each segment, (n, m) and (n, p), as (signal - middle) / spread.

    offset: whether middles were subtracted; if not, a spread is a root mean square.
    """

    u: tuple[np.ndarray, ...]
    y: tuple[np.ndarray, ...]
    input_middle: np.ndarray
    output_middle: np.ndarray
    input_spread: np.ndarray
    output_spread: np.ndarray
    offset: bool

    @classmethod
    def of(cls, series: Series, offset: bool, name: str) -> Scaled:
        """The scaled signals of a series; raises, naming the estimator `name`, if a channel is constant."""
        middles, spreads, parts = [], [], []
        for what, names, signals in (("input", series.inputs, series.u), ("output", series.outputs, series.y)):
            joined = np.concatenate(signals)
            middle = joined.mean(axis=0) if offset else np.zeros(joined.shape[1])
            spread = np.sqrt(np.mean((joined - middle) ** 2, axis=0))
            for channel, value, size in zip(names, spread, np.abs(joined).max(axis=0)):
                if value <= _STILL * size:
                    why = "; what it does cannot be told from a drift" if what == "input" else ""
                    raise ValueError(
                        f"{name} needs every {what} to move, got {channel} constant throughout: use a record in which "
                        f"it moves, or leave it out of the {what}s{why}."
                    )
            middles.append(middle)
            spreads.append(spread)
            parts.append(tuple((part - middle) / spread for part in signals))
        return cls(parts[0], parts[1], middles[0], middles[1], spreads[0], spreads[1], offset)

    @property
    def joint(self) -> tuple[np.ndarray, ...]:
        """Inputs and outputs side by side, (n, m + p), for each segment."""
        return tuple(np.concatenate([u, y], axis=1) for u, y in zip(self.u, self.y))

    def longer_than(self, count: int) -> Scaled:
        """The signals without segments of at most this many samples."""
        longer = [(u, y) for u, y in zip(self.u, self.y) if len(y) > count]
        return replace(self, u=tuple(u for u, _ in longer), y=tuple(y for _, y in longer))

    def after(self, count: int) -> Scaled:
        """The signals without the first samples of each segment, and without segments of at most this many."""
        longer = [(u[count:], y[count:]) for u, y in zip(self.u, self.y) if len(y) > count]
        return replace(self, u=tuple(u for u, _ in longer), y=tuple(y for _, y in longer))

    @property
    def inputs(self) -> int:
        return self.input_spread.size

    @property
    def outputs(self) -> int:
        return self.output_spread.size
