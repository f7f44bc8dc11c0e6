"""The steady motion about which each kind of vehicle is linear: one module a kind, each with a `KIND`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.kinds import Kinds
from auv_gym.plant import Plant

SMALL = 1e-5  # of a difference quotient: rounding and curvature both stay below 1e-9


@dataclass(frozen=True)
class SteadyKind:
    """The steady motion of a kind of vehicle.

    moves: which of the family's states each input moves at first order.  usual: the inputs that a linear form has by
    default.  steady: the family's states and inputs in steady motion.  steps: half the difference of each name's
    quotient, in its unit.
    """

    moves: Callable[[Plant], dict[str, tuple[str, ...]]]
    usual: Callable[[Plant], Sequence[str]]
    steady: Callable[[Plant], tuple[np.ndarray, np.ndarray]]
    steps: Callable[[Plant, Sequence[str]], np.ndarray]


KINDS: Kinds[SteadyKind] = Kinds("auv_gym.models.linear.kinds", "linearise knows")
