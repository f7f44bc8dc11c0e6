"""The steady motion for linearising each kind of vehicle: one module per kind, each with a `KIND`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auv_gym.kinds import Kinds
from auv_gym.plant import Plant

SMALL = 1e-5  # step of a difference quotient: rounding and curvature errors both stay below 1e-9


@dataclass(frozen=True)
class SteadyKind:
    """The steady motion of a kind of vehicle.

    moves: the family's states that each input moves at first order.  usual: the default inputs of a linear form.
    steady: the family's states and inputs in steady motion.  steps: half the step of each name's difference quotient,
    in its unit.
    """

    moves: Callable[[Plant], dict[str, tuple[str, ...]]]
    usual: Callable[[Plant], Sequence[str]]
    steady: Callable[[Plant], tuple[np.ndarray, np.ndarray]]
    steps: Callable[[Plant, Sequence[str]], np.ndarray]


KINDS: Kinds[SteadyKind] = Kinds("auv_gym.models.linear.kinds", "linearise knows")
