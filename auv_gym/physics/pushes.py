"""Random accelerations that push a vehicle, from one row of a record to the next.

Each is a first-order Gauss-Markov process; those of a swell come in pairs of such processes that turn into each other,
of which the first one pushes.  Source: Harvey 1989, sec. 2.3.5 (stochastic cycle).
"""

from __future__ import annotations

import numpy as np

from auv_gym.compiled import compiled


@compiled
def turned(one, other, cosine, sine):
    """Two numbers turned into each other by an angle."""
    return cosine * one - sine * other, sine * one + cosine * other


@compiled
def fade(push, decays, kicks, duration):
    """Accelerations after a duration, s, (D,), in place: all decay, and those of a swell turn in pairs as they do.

    decays: (D,).  kicks: (D, 4), see `auv_gym.plant.rollout.rollout`.
    """
    for j in range(push.shape[0]):
        push[j] *= decays[j]
    for j in range(push.shape[0]):
        if kicks[j, 3] != 0.0:
            angle = kicks[j, 3] * duration
            push[j], push[j + 1] = turned(push[j], push[j + 1], np.cos(angle), np.sin(angle))
