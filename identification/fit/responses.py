"""Responses of one row's outputs and of the next row's states to parameters.

The slope of a filter's errors by a parameter has two parts: the vehicle's response from row to row, and the corrections
by the gains.  The first needs the vehicle, and hardly changes during a fit; the second (`driven.py`) is linear, and is
quickly recomputed for other gains and noises.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Responses:
    """Slopes by parameters over one row, from the states of a path, without the parameters' effects on earlier rows.

    paths: (P,) names.  onward: (rows, N - D, P), of the next row's live states.  seen: (rows, C, P), of outputs.
    """

    paths: tuple[str, ...]
    onward: np.ndarray
    seen: np.ndarray

    def of(self, paths: Sequence[str]) -> Responses:
        """The responses to some of the paths."""
        return self if tuple(paths) == self.paths else self.at([self.paths.index(p) for p in paths])

    def at(self, own: Sequence[int]) -> Responses:
        """The responses to some of the paths, by index."""
        paths = tuple(self.paths[k] for k in own)
        return replace(self, paths=paths, onward=self.onward[:, :, own], seen=self.seen[:, :, own])


def together(some: Sequence[Responses]) -> Responses:
    """Concatenate responses, in their order."""
    onward, seen = (np.concatenate([getattr(r, name) for r in some], axis=2) for name in ("onward", "seen"))
    return Responses(tuple(p for r in some for p in r.paths), onward, seen)
