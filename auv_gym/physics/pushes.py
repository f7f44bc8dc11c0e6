"""Random accelerations that push a vehicle, and errors of readings that last, from one row of a record to the next.

Each is a first-order Gauss-Markov process; those of a swell come in pairs of such processes that turn into each other,
of which the first one pushes.  Source: Harvey 1989, sec. 2.3.5 (stochastic cycle).
Where they act is in `kicks`, (D, 4): the state that one pushes, or -1 less the output that it is added to; the shares
of it that act before and after each sample's interval; and the angular frequency, rad/s, with which it and the one
after it turn into each other, 0 for those that merely fade.
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
    """Accelerations after a duration, s, (D,), in place: all decay, by (D,), and those of a swell turn in pairs."""
    for j in range(push.shape[0]):
        push[j] *= decays[j]
    for j in range(push.shape[0]):
        if kicks[j, 3] != 0.0:
            angle = kicks[j, 3] * duration
            push[j], push[j + 1] = turned(push[j], push[j + 1], np.cos(angle), np.sin(angle))


@compiled
def shove(x, push, kicks, side, duration):
    """What accelerations, (D,), do to the states that they push over a duration, s, in place.

    side: 1 for their share before an interval, 2 for that after it.
    """
    for j in range(push.shape[0]):
        if kicks[j, 0] >= 0.0:
            x[int(kicks[j, 0])] += duration * kicks[j, side] * push[j]


@compiled
def misreads(kick):
    """The output to which an error of readings that lasts is added, by its row of `kicks`; -1 where it is none."""
    return int(-kick[0]) - 1 if kick[0] < 0.0 else -1


@compiled
def misread(y, push, kicks):
    """What errors of readings that last, (D,), add to the outputs, in place."""
    for j in range(push.shape[0]):
        output = misreads(kicks[j])
        if output >= 0:
            y[output] += push[j]


def ways_of(kicks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which noise is the first of each way to push a vehicle, (K,), and which way each has, (D,); -1 for none."""
    way, known = np.full(len(kicks), -1), dict[tuple[float, ...], int]()
    for d, (state, *shares, _) in enumerate(kicks.tolist()):
        if state >= 0.0 and any(shares):
            way[d] = known.setdefault((state, *shares), len(known))
    return np.array([int(np.argmax(way == k)) for k in range(len(known))], dtype=int), way
