"""The extended Kalman filter of a vehicle, linearised row by row along the filter's own path.

The gains of a row depend on the path up to it, and the path beyond depends on these gains; so the vehicle is linearised
while the filter runs, in one compiled call.  Source: Jazwinski 1970, sec. 8.3.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_gym.compiled import OPEN, bind, compiled, ready
from auv_gym.param import list_paths
from auv_gym.physics.pushes import fade, misreads
from auv_gym.plant import Plant
from identification.fit.kalman import read_row, to_next_row

# Bound for each family: its programs, and how many numbers it has of each kind.
along: Any = OPEN
move_actuators: Any = OPEN
derive: Any = OPEN
STATES = SENSORS = ACTUATORS = OUTPUTS = DERIVED = 0  # DERIVED: derived quantities, without the parameters themselves


@compiled
def nudge(state, moved, probes, tried):
    """Write the state, and the state with each moved entry, (m,), changed by its probe, into tried, (m + 1, F)."""
    for j in range(tried.shape[0]):
        for i in range(tried.shape[1]):
            tried[j, i] = state[i]
        if j > 0:
            tried[j, moved[j - 1]] += probes[j - 1]


def filtered(
    vectors, until, begin, stop, carried, constant, times, inputs, first, references, longest_step, stride, shares,
    starts, roots, measured, finite, counts, columns, moved, probes, ways, pushed, kicks, durations, decays,
    variances, deviations, correlation, path, a, c, y, after,
):  # fmt: skip
    """Filter the stretches of a record, and write the path and the slopes along it.

    vectors: (E + 1, n_parameters), each acting up to one of the rows `until`, (E,).  begin to shares, starts: see
    `auv_gym.plant.rollout.rollout`; starts (W, F), F = STATES + SENSORS + D.  roots: (W, n, n), transposed, of the
    initial covariances of the live states (n,).  measured: (rows, C), finite, counts: see
    `identification.fit.kalman.System`; columns: (C,), among the outputs.
    moved: the live states, (n,), with a stride of several samples followed by the first acceleration of each way to
    push, (n + K,); probes: their changes.  ways: (D,), the way of each, or -1.  pushed: (D,), the pushed live states,
    see `kicks`.  decays: (rows, D).  variances: (C,); deviations, correlation: (D,), of the accelerations, s.
    path: (rows, F), where the slopes are taken: the filtered states, or with a stride of several samples those before a
    row's readings.  a: (rows, n, n) and c: (rows, C, n), slopes of the next row's live states and of the row's outputs;
    y: (rows, C) and after: (rows, F), from the path itself.
    """
    n, size, count, pushes = times.shape[0], a.shape[1], columns.shape[0], kicks.shape[0]
    live, many = moved[:size], moved.shape[0] + 1
    total, whole = size + pushes, STATES + SENSORS + pushes
    derived = np.empty(DERIVED + vectors.shape[1])
    shaped, positions = np.empty((n, ACTUATORS)), np.empty((n, ACTUATORS))
    last = vectors.shape[0] - 1
    move_actuators(vectors, vectors[last], until, times, inputs, first, derived, shaped, positions)
    piece, row = 0, 0
    derive(vectors[0], derived)
    state, tried, moved_on = np.zeros(whole), np.empty((many, whole)), np.empty((many, whole))
    seen, none, unread = np.empty((many, OUTPUTS)), np.empty((0, whole)), np.empty((0, OUTPUTS))
    free, nothing, held = np.empty((0, 0, 0)), np.empty(0, np.int64), np.ones((many, pushes))
    one, other, anew = np.empty(many, np.int64), np.empty(many, np.int64), np.zeros(many, np.bool_)
    root, wide, mean = np.zeros((total, total)), np.zeros((total + pushes, total)), np.zeros(total)
    error, column, gain, room = np.zeros(count), np.zeros(total), np.zeros(total), np.zeros(total)
    reflector, share_of, forcing = np.zeros(total + pushes), np.zeros(total), np.zeros(size)
    gains, whiten, innovations = np.zeros((total, count)), np.zeros((count, count)), np.zeros(count)
    slopes, onward = np.zeros((count, total)), np.zeros((total, size))
    turns = kicks[:, 3].copy()
    for w in range(begin.shape[0]):
        for i in range(whole):
            if not (carried[w] and i < STATES and constant[i]):
                state[i] = starts[w, i]
        for i in range(total):
            power = 0.0
            for j in range(total):
                power += root[j, i] * root[j, i]
                root[j, i] = roots[w, j, i] if i < size and j < size else 0.0
            if i >= size:
                root[i, i] = deviations[i - size]
            elif carried[w] and live[i] < STATES and constant[live[i]]:
                root[i, i] = np.sqrt(power)
        for k in range(begin[w], stop[w], stride):
            while piece < until.shape[0] and k >= until[piece]:
                piece += 1
                derive(vectors[piece], derived)
            one[:] = k
            other[:] = k + stride
            nudge(state, moved, probes, tried)
            along(
                derived, tried, one, other, anew, constant, times, inputs, first, references, longest_step, stride,
                shares, shaped, positions, unread, free, nothing, nothing, kicks, held, seen,
                none if stride == 1 else moved_on,
            )  # fmt: skip
            for m in range(count):
                error[m] = measured[row, m] - seen[0, columns[m]] if finite[row, m] else 0.0
                for j in range(size):
                    slopes[m, j] = (seen[j + 1, columns[m]] - seen[0, columns[m]]) / probes[j]
                for d in range(pushes):  # an acceleration does not change a single reading
                    j = size + ways[d]
                    if misreads(kicks[d]) >= 0:
                        slopes[m, size + d] = 1.0 if misreads(kicks[d]) == columns[m] else 0.0
                    elif ways[d] >= 0:
                        slopes[m, size + d] = (seen[j + 1, columns[m]] - seen[0, columns[m]]) / probes[j]
            mean[:] = 0.0
            gains[:, :] = 0.0
            whiten[:, :] = 0.0
            innovations[:] = 0.0
            numbers = (slopes, error, finite[row], counts[row], variances)
            read_row(root, mean, *numbers, column, gain, gains, whiten, innovations)
            if stride == 1:
                for i in range(size):
                    state[live[i]] += mean[i]
                for d in range(pushes):
                    state[STATES + SENSORS + d] += mean[size + d]
                nudge(state, moved, probes, tried)
                along(
                    derived, tried, one, other, anew, constant, times, inputs, first, references, longest_step, stride,
                    shares, shaped, positions, unread, free, nothing, nothing, kicks, held, seen, moved_on,
                )  # fmt: skip
                mean[:] = 0.0
            for i in range(whole):
                path[row, i] = state[i]
                after[row, i] = moved_on[0, i]
            for m in range(count):
                y[row, m] = seen[0, columns[m]]
                for j in range(size):
                    c[row, m, j] = (seen[j + 1, columns[m]] - seen[0, columns[m]]) / probes[j]
            for j in range(size):
                for i in range(size):
                    a[row, i, j] = (moved_on[j + 1, live[i]] - moved_on[0, live[i]]) / probes[j]
                    onward[j, i] = a[row, i, j]
            for d in range(pushes):
                j = size + ways[d]
                if ways[d] >= 0:
                    for i in range(size):
                        onward[size + d, i] = (moved_on[j + 1, live[i]] - moved_on[0, live[i]]) / probes[j]
                elif kicks[d, 0] >= 0.0:
                    for i in range(size):
                        onward[size + d, i] = durations[row] * kicks[d, 1] * onward[pushed[d], i]
                    onward[size + d, pushed[d]] += durations[row] * kicks[d, 2]
            for i in range(STATES + SENSORS):
                state[i] = moved_on[0, i]
            for j in range(total):
                for i in range(size):
                    state[live[i]] += mean[j] * onward[j, i]
            for d in range(pushes):
                state[STATES + SENSORS + d] += mean[size + d]
            fade(state[STATES + SENSORS :], decays[row], kicks, durations[row])
            for j in range(size):  # the state of a sensor without a lag does not persist
                if live[j] >= STATES and abs(onward[j, j] - 1.0) < 1e-9:
                    for i in range(size):
                        onward[j, i] = 0.0
                        onward[i, j] = 0.0
            mean[:] = 0.0
            held_for = (durations[row], deviations, correlation, turns)
            to_next_row(root, mean, onward, forcing, *held_for, wide, room, reflector, share_of)
            row += 1


_BOUND: dict[str, Any] = {}


def program_of(plant: Plant) -> Any:
    """The compiled filter of a family, see `filtered`; compiled when first called."""
    family, programs = plant.family, plant.programs
    name = family.program or family.kind
    if name not in _BOUND:
        sizes = {
            "STATES": len(family.states),
            "SENSORS": len(family.sensors),
            "ACTUATORS": len(family.actuators),
            "OUTPUTS": len(family.outputs),
            "DERIVED": family.derived - len(list_paths(family.parameters())),
        }
        used = {"along": programs.along, "move_actuators": programs.move_actuators, "derive": programs.derive}
        meanings: dict[str, Any] = sizes | used
        _BOUND[name] = ready(bind(filtered, name, inline=False, **meanings))
    return _BOUND[name]
