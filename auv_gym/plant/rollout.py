"""Integration of any vehicle family: RK4, one sample interval, and the rollout over windows of a record.

The functions here are templates: `bind_family` supplies the names in capitals, `physics` and `records`. A full state
vector is

    [states | actuator positions | their memories (backlash, stiction) | sensor states | past shaped commands]

with the oldest commands first. Commands are held over a sample. A delayed command switches inside a sample; the
interval is split there, so that the result is smooth in the dead time. Actuators move in closed form, see
`physics.actuators.travel`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from auv_gym.compiled import OPEN, bind, compiled, namespace, ready, view_as
from auv_gym.param import list_paths
from auv_gym.physics.actuators import lag_progress, travel
from auv_gym.physics.pushes import fade, misread, shove
from auv_gym.physics.rotations import into_chart, into_level_chart, out_of_chart
from auv_gym.records.attitude import ANGLES
from auv_gym.vehicles.family import Family, RightHandSide

_ARRIVED = 1e-9  # s before reaching its target; closer than this, an actuator counts as there


@dataclass(frozen=True, eq=False)
class Records:
    """Views of derived parameters and of the work array as named fields."""

    parameters: Callable[[Any], Any]
    work: Callable[[Any], Any]


# Placeholders in the templates, which call each other by name.
physics: RightHandSide = OPEN
records: Records = OPEN
STATES = INTEGRATED = ACTUATORS = SENSORS = OUTPUTS = INPUTS = PARAMETERS = DERIVED = WORK = BLOCK = MOVES = 0
ATTITUDE = SENSED = -1  # index of roll, pitch and heading among the states and among the outputs, or -1


def rk4(h, inputs, p, room):
    """One step of the classical fourth-order Runge-Kutta method on room.z in place.

    room: record of work arrays; room.path has the actuators' positions at start, middle and end of the step.
    Source: Hairer, Norsett and Wanner 1993, sec. II.1, table 1.2.
    """
    z, slope, y, total, terms, path = room.z, room.slope, room.y, room.total, room.terms, room.path
    for i in range(INTEGRATED):
        y[i] = z[i]
        total[i] = 0.0
    for stage in range(4):  # a loop, so that the derivative is compiled only once
        physics.derivative(y, path[(stage + 1) // 2], inputs, p, slope, terms)
        weight = 2.0 if stage == 1 or stage == 2 else 1.0
        reach = 0.5 * h if stage < 2 else h
        for i in range(INTEGRATED):
            total[i] += weight * slope[i]
            y[i] = z[i] + reach * slope[i]
    for i in range(INTEGRATED):
        z[i] += h / 6.0 * total[i]


def interval(x, inputs, shaped, times, first, k, t0, t1, longest_step, p, work):
    """Advance x in place from t0 = times[k] to t1, in equal, stable steps of at most `longest_step` between switchings.

    The stable step is computed again after BLOCK steps.  If masses move in the vehicle (MOVES), steps end when one
    arrives, and `kick` gives the vehicle the jump of velocity with which a mass starts and stops.

    shaped: (n, ACTUATORS) shaped commands, of which rows first..k are known; before row `first` its value is held.
    longest_step: s; 0 moves only the actuators, to find their positions at the start of a window.
    Times are those of the log's clock; a second of the vehicle takes `pace` of its seconds.
    """
    pace, behind = 1.0 + p.effects.clock.rate, p.effects.clock.delay
    position = x[STATES : STATES + ACTUATORS]
    sensors = x[STATES + 2 * ACTUATORS : STATES + 2 * ACTUATORS + SENSORS]
    room = records.work(work)
    z, before, target, path = room.z, room.before, room.target, room.path
    lags, slownesses, decays = room.lags, room.slownesses, room.decays
    physics.enter(x[:STATES], z)
    t = t0
    while t < t1:
        t_next = t1
        for j in range(ACTUATORS):
            dead_time = pace * physics.actuator_times(j, p)[0] + behind
            if dead_time > 0.0:
                i = k
                while i > first and times[i] + dead_time > t:
                    t_next = min(t_next, times[i] + dead_time)
                    i -= 1
                target[j] = shaped[i, j]
            else:
                target[j] = shaped[k, j]
        if MOVES and longest_step > 0.0:
            for j in range(ACTUATORS):
                _, lag, slowness = physics.actuator_times(j, p)
                way = abs(target[j] - position[j]) * slowness
                if lag <= 0.0 and way > _ARRIVED:
                    t_next = min(t_next, t + pace * way)
        pieces = 1
        if longest_step > 0.0:
            # a fit may try coefficients too fast for the vehicle's step; a fifty times shorter step is the limit
            step = max(min(longest_step, physics.stable_step(z, inputs, p)), 0.02 * longest_step)
            pieces = max(ceil((t_next - t) / (pace * step) - 1e-9), 1)
        h = (t_next - t) / pieces
        if pieces > BLOCK:
            pieces = BLOCK
            t_next = t + BLOCK * h
        h /= pace
        for j in range(ACTUATORS):
            _, lags[j], slownesses[j] = physics.actuator_times(j, p)
            decays[j] = lag_progress(lags[j], h)
        for _ in range(pieces):
            for j in range(ACTUATORS):
                mean, slope, last = travel(position[j], target[j], lags[j], slownesses[j], h, decays[j])
                path[0, j] = mean - 0.5 * h * slope
                path[1, j] = mean
                path[2, j] = mean + 0.5 * h * slope
                position[j] = last
            if longest_step > 0.0:
                for i in range(INTEGRATED):
                    before[i] = z[i]
                if MOVES:
                    physics.kick(z, sensors, path, h, p, room.terms)
                rk4(h, inputs, p, room)
                physics.sense(before, z, sensors, h, p)
        t = t_next
    if longest_step > 0.0:
        physics.leave(z, x[:STATES])


def step(x, inputs, times, longest_step, derived, work):
    """Advance the full state x in place by a sample; times: s, of the commands in x, ending at 0, then its end.

    work: scratch, see `scratch_for`.
    """
    p = records.parameters(derived)
    history = times.shape[0] - 1
    oldest = np.int64(0)  # numba would compile `interval` again for a literal 0
    memory = x[STATES + ACTUATORS : STATES + 2 * ACTUATORS]
    past = x[STATES + 2 * ACTUATORS + SENSORS :].reshape((history, ACTUATORS))
    for i in range(history - 1):
        for j in range(ACTUATORS):
            past[i, j] = past[i + 1, j]
    physics.shape(inputs, memory, p, past[history - 1])
    interval(x, inputs, past, times, oldest, history - 1, 0.0, times[history], longest_step, p, work)


def read(x, derived, y):
    """Write the outputs of a full state into y."""
    p = records.parameters(derived)
    sensors = x[STATES + 2 * ACTUATORS : STATES + 2 * ACTUATORS + SENSORS]
    physics.output(x[:STATES], x[STATES : STATES + ACTUATORS], sensors, p, y)


def settle(x, derived):
    """Set the sensors' states in a full state, in place, as after a long time at its present rates."""
    sensors = x[STATES + 2 * ACTUATORS : STATES + 2 * ACTUATORS + SENSORS]
    physics.settle_sensors(x[:STATES], x[STATES : STATES + ACTUATORS], sensors, records.parameters(derived))


def drive(times, inputs, first, begin, stop, x, shaped, positions, p, work):
    """Compute shaped commands and actuator positions at some rows of a record, (n, ACTUATORS), from the commands.

    first: (n,) row at which each row's segment starts; there the actuators are at their commands.
    begin, stop: the rows; x: full state, with the actuators as left by the row before `begin`.
    """
    memory = x[STATES + ACTUATORS : STATES + 2 * ACTUATORS]
    still = True
    for j in range(ACTUATORS):
        dead_time, lag, slowness = physics.actuator_times(j, p)
        still = still and dead_time + p.effects.clock.delay <= 0.0 and lag <= 0.0 and slowness <= 0.0
    for k in range(begin, stop):
        fresh = first[k] == k
        if fresh:
            for j in range(ACTUATORS):
                memory[j] = inputs[k, j]
            physics.shape(inputs[k], memory, p, shaped[k])  # the play starts in its middle
            for j in range(ACTUATORS):
                memory[j] = shaped[k, j]
        physics.shape(inputs[k], memory, p, shaped[k])
        if fresh or still:
            for j in range(ACTUATORS):
                x[STATES + j] = shaped[k, j]
        for j in range(ACTUATORS):
            positions[k, j] = x[STATES + j]
        if not still and k + 1 < times.shape[0] and first[k + 1] != k + 1:
            interval(x, inputs[k], shaped, times, first[k], k, times[k], times[k + 1], 0.0, p, work)


@compiled
def corrected_by(number, gains, row, j, error):
    """The value of a row's j-th state, corrected by gains, (rows, N, C), times errors."""
    for c in range(error.shape[0]):
        number += gains[row, j, c] * error[c]
    return number


def along(
    derived, starts, begin, stop, carried, constant, times, inputs, first, references, longest_step,
    stride, shares, shaped, positions, measured, gains, moved, told, kicks, decays, y, after,
):  # fmt: skip
    """Write the outputs of a vehicle over windows of a record into y, (rows, OUTPUTS), with given actuator positions.

    derived: its parameters and what follows from them.  shaped, positions: (n, ACTUATORS) each, see `drive`.
    starts: (W, F) or (W, STATES).  after: (rows, F), or empty.  All else: see `rollout`.
    """
    n, p = times.shape[0], records.parameters(derived)
    pushed = kicks.shape[0]
    size = STATES + SENSORS
    work = np.empty(WORK)
    x = np.empty(STATES + 2 * ACTUATORS + SENSORS)
    sensors = x[STATES + 2 * ACTUATORS :]
    push = np.empty(pushed)
    error, out = np.empty(told.shape[0]), np.empty(OUTPUTS)
    corrected, single = gains.shape[0] > 0, stride == 1
    charted = ATTITUDE >= 0 and SENSED >= 0 and references.shape[0] > 0  # rows then have one sample
    attitude = x[ATTITUDE : ATTITUDE + 3]  # Euler angles, except while a correction is added in the row's chart
    row = 0
    for w in range(begin.shape[0]):
        k = begin[w]
        start = starts[w]
        for i in range(STATES):
            if not (carried[w] and constant[i]):
                x[i] = start[i]
        if charted:
            out_of_chart(references[k], attitude)
        for j in range(ACTUATORS):
            x[STATES + j] = positions[k, j]
            x[STATES + ACTUATORS + j] = 0.0
        if starts.shape[1] == STATES:
            for i in range(SENSORS):
                sensors[i] = 0.0
            physics.settle_sensors(x[:STATES], positions[k], sensors, p)
        else:
            for i in range(SENSORS):
                sensors[i] = start[STATES + i]
        for j in range(pushed):
            push[j] = start[size + j]
        while k < stop[w]:
            last, chart = k + stride, k
            # a free run ends with its last row
            goes_on = last < n and first[last] != last and (last < stop[w] or after.shape[0] > 0)
            for m in range(k, last if single else last + 1):
                if single:
                    physics.output(x[:STATES], x[STATES : STATES + ACTUATORS], sensors, p, y[row])
                    if charted:
                        into_level_chart(references[k], y[row, SENSED : SENSED + 3])
                        into_chart(references[k], attitude)
                    misread(y[row], push, kicks)
                elif m < last:
                    physics.output(x[:STATES], x[STATES : STATES + ACTUATORS], sensors, p, out)
                    for c in range(OUTPUTS):
                        y[row, c] = shares[m, c] * out[c] + (y[row, c] if m > k else 0.0)
                elif pushed > 0:
                    misread(y[row], push, kicks)
                    fade(push, decays[row], kicks, times[min(last, n - 1)] - times[k])
                if corrected and (single or m == last):
                    for c in range(told.shape[0]):
                        reading = measured[row, told[c]]
                        error[c] = reading - y[row, told[c]] if np.isfinite(reading) else 0.0
                    for j in range(moved.shape[0]):
                        i = moved[j]
                        if i < STATES:
                            x[i] = corrected_by(x[i], gains, row, j, error)
                        elif i < size:
                            sensors[i - STATES] = corrected_by(sensors[i - STATES], gains, row, j, error)
                        else:
                            push[i - size] = corrected_by(push[i - size], gains, row, j, error)
                if m + 1 < last or (m < last and goes_on):
                    duration = times[m + 1] - times[m]
                    shove(x, push, kicks, 1, duration)
                    if charted:
                        out_of_chart(references[k], attitude)
                    interval(x, inputs[m], shaped, times, first[m], m, times[m], times[m + 1], longest_step, p, work)
                    if charted:
                        chart = last
                        into_chart(references[chart], attitude)
                    shove(x, push, kicks, 2, duration)
                    if single and pushed > 0:
                        fade(push, decays[row], kicks, duration)
            if after.shape[0] > 0:
                for i in range(STATES):
                    after[row, i] = x[i]
                for i in range(SENSORS):
                    after[row, STATES + i] = sensors[i]
                for j in range(pushed):
                    after[row, size + j] = push[j]
            if charted:
                out_of_chart(references[chart], attitude)
            row += 1
            k = last


def rollout(
    vectors, starts, begin, stop, carried, constant, times, inputs, first, references, longest_step,
    stride, shares, measured, gains, moved, told, kicks, decays, earlier, until, y, after,
):  # fmt: skip
    """Write outputs of runs over windows of a record, for several parameter vectors, into y; free or corrected runs.

    The state is [states | sensors | accelerations]; the accelerations act through their `kicks` and decay between rows.
    vectors: (S, n_parameters), or longer by a table.  starts: (S or 1, W, F), F = STATES + SENSORS + D; or with states
    alone, (S or 1, W, STATES); sensors then start settled.
    begin, stop: (W,) rows.  times: (n,) s.  inputs: (n, INPUTS).  first: (n,) row at which each row's segment starts.
    references: (n, 4), quaternions relative to which attitudes are given at each row, as rotation vectors, in starts,
    y, after and all corrections; (0, 4) for Euler angles.
    carried: (W,), whether the `constant` states (STATES,) continue from the window before.
    stride: samples of a row; windows are whole multiples of it.  Outputs of a row of several samples are their sums
    weighted by `shares`, (n, OUTPUTS); the row is corrected at its end, where the next row begins.
    measured: (rows, OUTPUTS), NaN without a reading.  gains: (rows, N, C), or empty for free runs, for the `moved`
    states, (N,), and the outputs listed in `told`, (C,).
    kicks: (D, 4), where accelerations or lasting sensor errors act; see `auv_gym.physics.pushes`.
    decays: (rows, D), of these to the next row.
    earlier: (S, E, n_parameters), by which actuators moved in rows up to `until`, (E,), one after the other.
    y: (S, rows, OUTPUTS), before the correction.  after: (S, rows, F), one row later; not filled if S is 0.
    """
    n = times.shape[0]
    derived = np.empty(DERIVED + vectors.shape[1] - PARAMETERS)
    shaped, positions, none = np.empty((n, ACTUATORS)), np.empty((n, ACTUATORS)), np.empty((0, after.shape[2]))
    for s in range(vectors.shape[0]):
        move_actuators(earlier[s], vectors[s], until, times, inputs, first, derived, shaped, positions)
        along(
            derived, starts[min(s, starts.shape[0] - 1)], begin, stop, carried, constant, times, inputs, first,
            references, longest_step, stride, shares, shaped, positions, measured, gains, moved,
            told, kicks, decays, y[s], after[s] if after.shape[0] > 0 else none,
        )  # fmt: skip


def move_actuators(earlier, vector, until, times, inputs, first, derived, shaped, positions):
    """Compute shaped commands and actuator positions at all rows of a record, (n, ACTUATORS) each, see `drive`.

    By parameters `earlier`, (E or more, n_parameters), up to the rows `until`, (E,), and then by `vector`, given by
    `derived`.
    """
    x, work = np.empty(STATES + 2 * ACTUATORS + SENSORS), np.empty(WORK)
    driven = np.int64(0)  # numba would compile `drive` again for a literal 0
    for e in range(until.shape[0]):
        physics.derive(earlier[e], derived)
        last = min(until[e], times.shape[0])  # a change may be beyond the end of the record
        drive(times, inputs, first, driven, last, x, shaped, positions, records.parameters(derived), work)
        driven = last
    physics.derive(vector, derived)
    drive(times, inputs, first, driven, times.shape[0], x, shaped, positions, records.parameters(derived), work)


@dataclass(frozen=True, eq=False)
class Programs:
    """The compiled programs of one kind of vehicle."""

    step: Any
    read: Any
    settle: Any
    rollout: Any
    along: Any
    move_actuators: Any
    derivative: Any
    derive: Any


def scratch_for(family: Family) -> np.ndarray:
    """The work array that `step` needs."""
    return np.empty(_work_type(family).itemsize // 8)


def _work_type(family: Family) -> np.dtype:
    """Work arrays as fields of one record: counting references to each would cost a third of a step's time."""
    states, actuators = family.integrated, max(len(family.actuators), 1)
    rows: dict[str, tuple[int, ...]] = dict.fromkeys(("z", "before", "slope", "y", "total"), (states,))
    # if masses move, the actuators' rates come after their positions
    rows |= {"terms": (max(family.scratch, 1),), "path": (3, 2 * actuators if family.moves else actuators)}
    rows |= dict.fromkeys(("target", "lags", "slownesses", "decays"), (actuators,))
    return np.dtype((np.record, [(name, np.float64, shape) for name, shape in rows.items()]))


def _attitude_in(names: tuple[str, ...]) -> int:
    """Index of roll, pitch and heading, in this order, or -1."""
    at = names.index(ANGLES[0]) if ANGLES[0] in names else -1
    return at if names[at : at + 3] == ANGLES else -1


_BOUND: dict[str, Programs] = {}


def bind_family(family: Family) -> Programs:
    """The programs of a family; each is compiled at its first call and found in the cache afterwards."""
    program = family.program or family.kind
    if program in _BOUND:
        return _BOUND[program]
    sizes = {
        "STATES": len(family.states),
        "INTEGRATED": family.integrated,
        "ACTUATORS": len(family.actuators),
        "SENSORS": len(family.sensors),
        "OUTPUTS": len(family.outputs),
        "INPUTS": len(family.inputs),
        "PARAMETERS": len(list_paths(family.parameters())),
        "DERIVED": family.derived,
        "WORK": scratch_for(family).size,
        "BLOCK": family.block,
        "MOVES": int(family.moves),
        "ATTITUDE": _attitude_in(family.states),
        "SENSED": _attitude_in(family.outputs),
    }
    views = Records(parameters=family.view, work=view_as(_work_type(family), f"{program}_work"))
    known: dict[str, Any] = {**sizes, "physics": namespace(family.hooks), "records": namespace(views)}
    for template in (rk4, interval, drive):  # each comes after those that it calls
        known[template.__name__] = bind(template, program, **known)
    for template in (move_actuators, along):
        known[template.__name__] = bind(template, program, inline=False, **known)
    _BOUND[program] = Programs(
        step=ready(bind(step, program, inline=False, **known)),
        read=ready(bind(read, program, **known)),
        settle=ready(bind(settle, program, **known)),
        rollout=ready(bind(rollout, program, **known)),
        along=known["along"],
        move_actuators=known["move_actuators"],
        derivative=family.hooks.derivative,
        derive=ready(family.hooks.derive),
    )
    return _BOUND[program]
