"""Random accelerations of a vehicle, and lasting sensor errors, from one row of a record to the next.

Each is a first-order Gauss-Markov process; those of a swell come in pairs that rotate into each other, the first of
which acts on the vehicle.  Source: Harvey 1989, sec. 2.3.5 (stochastic cycle).
`kicks`, (D, 4), says where they act: the state that a process accelerates, or -1 minus the output that it is added to;
the shares that act before and after each sample's interval; and the angular frequency, rad/s, with which it and the
next one rotate into each other, 0 for those that only decay.
"""

from __future__ import annotations

import numpy as np

from auv_gym.compiled import compiled


@compiled
def turned(one, other, cosine, sine):
    """Two numbers rotated into each other by an angle."""
    return cosine * one - sine * other, sine * one + cosine * other


@compiled
def fade(push, decays, kicks, duration):
    """Accelerations after a duration, s, (D,), in place: all decay, by (D,), and those of a swell rotate in pairs."""
    for j in range(push.shape[0]):
        push[j] *= decays[j]
    for j in range(push.shape[0]):
        if kicks[j, 3] != 0.0:
            angle = kicks[j, 3] * duration
            push[j], push[j + 1] = turned(push[j], push[j + 1], np.cos(angle), np.sin(angle))


@compiled
def shove(x, push, kicks, side, duration):
    """Apply accelerations, (D,), to their states over a duration, s, in place.

    side: 1 for their share before an interval, 2 for that after it.
    """
    for j in range(push.shape[0]):
        if kicks[j, 0] >= 0.0:
            x[int(kicks[j, 0])] += duration * kicks[j, side] * push[j]


@compiled
def misreads(kick):
    """The output to which a lasting sensor error is added, from its row of `kicks`; -1 if it is not a sensor error."""
    return int(-kick[0]) - 1 if kick[0] < 0.0 else -1


@compiled
def misread(y, push, kicks):
    """Add lasting sensor errors, (D,), to the outputs, in place."""
    for j in range(push.shape[0]):
        output = misreads(kicks[j])
        if output >= 0:
            y[output] += push[j]


def ways_of(kicks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the first noise of each way to push a vehicle, (K,), and the way of each noise, (D,); -1 for none."""
    way, known = np.full(len(kicks), -1), dict[tuple[float, ...], int]()
    for d, (state, *shares, _) in enumerate(kicks.tolist()):
        if state >= 0.0 and any(shares):
            way[d] = known.setdefault((state, *shares), len(known))
    return np.array([int(np.argmax(way == k)) for k in range(len(known))], dtype=int), way
