"""Sums over the parts of a body: for each kind a function `..._of_kind`, chained by `..._then`.

The functions are templates, see `compiled.bind`: COUNT parts are adjacent, with COMMANDS commands each, the first of
which is number FIRST; `compose` binds a chain with a link for each kind.
"""

from __future__ import annotations

from typing import Any

from auv_gym.compiled import compiled
from auv_gym.vehicles.body.kinds import NONE

# Placeholders in the templates, bound by `compose`.
COUNT = COMMANDS = FIRST = SHARED = 0
SLOT = ""
wakes: Any
in_wake: Any
part_force: Any
part_wake: Any
part_in_wake: Any
part_shape: Any
part_times: Any
part_derive: Any
part_damping: Any
before: Any
own: Any


def forces_of_kind(actuators, inputs, motion, p):
    """The sum of the forces of all parts of one kind: X, Y, Z in N and K, M, N in N m."""
    x = y = z = k = m = n = NONE
    parts, effects, derived = getattr(p.parts, SLOT), getattr(p.effects.parts, SLOT), getattr(p.derived, SLOT)
    for i in range(COUNT):
        at = FIRST + i * COMMANDS
        a, b, c, d, e, f = part_force(at, actuators, inputs, SHARED, motion, parts[i], effects[i], derived[i])
        x += a
        y += b
        z += c
        k += d
        m += e
        n += f
    return x, y, z, k, m, n


def forces_then(actuators, inputs, motion, p):
    """The forces of the preceding kinds and one more."""
    x, y, z, k, m, n = before(actuators, inputs, motion, p)
    a, b, c, d, e, f = own(actuators, inputs, motion, p)
    return x + a, y + b, z + c, k + d, m + e, n + f


@compiled
def no_forces(actuators, inputs, motion, p):
    """No forces."""
    return NONE, NONE, NONE, NONE, NONE, NONE


def wake_forces(actuators, motion, p):
    """The forces of all parts in the wakes of all propellers."""
    return in_wake(wakes(actuators, motion.u, p), actuators, motion, p)


def in_wake_of_kind(wake, actuators, motion, p):
    """The sum of the forces of the parts of one kind in the wakes of all propellers."""
    x = y = z = k = m = n = NONE
    parts, effects = getattr(p.parts, SLOT), getattr(p.effects.parts, SLOT)
    for i in range(COUNT):
        a, b, c, d, e, f = part_in_wake(FIRST + i * COMMANDS, actuators, wake, motion, parts[i], effects[i])
        x += a
        y += b
        z += c
        k += d
        m += e
        n += f
    return x, y, z, k, m, n


def in_wake_then(wake, actuators, motion, p):
    """The wake forces of the preceding kinds and one more."""
    x, y, z, k, m, n = before(wake, actuators, motion, p)
    a, b, c, d, e, f = own(wake, actuators, motion, p)
    return x + a, y + b, z + c, k + d, m + e, n + f


@compiled
def nothing_in_wakes(wake, actuators, motion, p):
    """No wake forces."""
    return NONE, NONE, NONE, NONE, NONE, NONE


def wakes_of_kind(actuators, u, p):
    """The speed that all parts of one kind add to the flow at the surfaces, m/s."""
    wake = 0.0
    parts, effects = getattr(p.parts, SLOT), getattr(p.effects.parts, SLOT)
    for i in range(COUNT):
        wake += part_wake(FIRST + i * COMMANDS, actuators, u, parts[i], effects[i])
    return wake


def wakes_then(actuators, u, p):
    """The wakes of the preceding kinds and one more."""
    return before(actuators, u, p) + own(actuators, u, p)


@compiled
def no_wakes(actuators, u, p):
    """No wake."""
    return 0.0


def shape_of_kind(inputs, memory, p, shaped):
    """Write commands of one kind after their memoryless effects, backlash and stiction into shaped; updates memory."""
    parts, effects = getattr(p.parts, SLOT), getattr(p.effects.parts, SLOT)
    for i in range(COUNT):
        for c in range(COMMANDS):
            j = FIRST + i * COMMANDS + c
            shaped[j], memory[j] = part_shape(inputs[j], memory[j], parts[i], effects[i], c)


def shape_then(inputs, memory, p, shaped):
    """Shape the commands of the preceding kinds and one more."""
    before(inputs, memory, p, shaped)
    own(inputs, memory, p, shaped)


@compiled
def no_shapes(inputs, memory, p, shaped):
    """No commands."""
    return


def times_of_kind(index, p):
    """Dead time s, lag s and slowness, s per unit, of an actuator of one kind."""
    k = (index - FIRST) // COMMANDS
    return part_times(getattr(p.parts, SLOT)[k], getattr(p.effects.parts, SLOT)[k], index - FIRST - k * COMMANDS)


def times_then(index, p):
    """The times of an actuator of the preceding kinds or one more."""
    if index >= FIRST:
        return own(index, p)
    return before(index, p)


@compiled
def no_actuator(index, p):
    """The times for a chain without actuators."""
    return 0.0, 0.0, 0.0


def derive_kind(p):
    """Derive the numbers of the parts of one kind."""
    parts, effects, derived = getattr(p.parts, SLOT), getattr(p.effects.parts, SLOT), getattr(p.derived, SLOT)
    for i in range(COUNT):
        part_derive(parts[i], effects[i], p.hull, derived[i])


def derive_then(p):
    """Derive the numbers of the preceding kinds and one more."""
    before(p)
    own(p)


def damping_of_kind(p):
    """Add the damping rates of the parts of one kind, for the stable step."""
    parts, effects, derived = getattr(p.parts, SLOT), getattr(p.effects.parts, SLOT), getattr(p.derived, SLOT)
    water = p.hull.density * p.computed.density
    for i in range(COUNT):
        part_damping(parts[i], effects[i], derived[i], water, p.computed.inverse_mass, p.computed.damping)


@compiled
def nothing_derived(p):
    """Derive nothing."""
    return
