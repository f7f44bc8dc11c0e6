"""How one row's outputs and the next row's states move with parameters.

A filter's errors move with a parameter as the vehicle does from each row to the next, and as gains correct it there.
The first needs the vehicle, and hardly changes while a fit goes on; the second (`driven.py`) is linear, and is soon
made anew for other gains and noises.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Responses:
    """Slopes by parameters from the states of a path, without what they have done before.

    paths: (P,) names.  onward: (rows, N - D, P), of the next row's live states.  seen: (rows, C, P), of outputs.
    """

    paths: tuple[str, ...]
    onward: np.ndarray
    seen: np.ndarray

    def of(self, paths: Sequence[str]) -> Responses:
        """Those of some of the paths."""
        return self if tuple(paths) == self.paths else self.at([self.paths.index(p) for p in paths])

    def at(self, own: Sequence[int]) -> Responses:
        """Some of them, by their numbers."""
        paths = tuple(self.paths[k] for k in own)
        return replace(self, paths=paths, onward=self.onward[:, :, own], seen=self.seen[:, :, own])


def together(some: Sequence[Responses]) -> Responses:
    """Several as one, in their order."""
    onward, seen = (np.concatenate([getattr(r, name) for r in some], axis=2) for name in ("onward", "seen"))
    return Responses(tuple(p for r in some for p in r.paths), onward, seen)
