"""What the parts of a body add: for each kind a function `..._of_kind`, and a chain of them by `..._then`.

The functions are templates, see `compiled.bind`: COUNT parts lie side by side, with COMMANDS commands each, of which
the first is number FIRST; `compose` binds a chain with a link for each kind.
"""

from __future__ import annotations

from typing import Any

from auv_gym.compiled import compiled
from auv_gym.vehicles.body.kinds import NONE

# Open names of the templates, bound by `compose`.
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
    """The forces of the kinds before, and of one more."""
    x, y, z, k, m, n = before(actuators, inputs, motion, p)
    a, b, c, d, e, f = own(actuators, inputs, motion, p)
    return x + a, y + b, z + c, k + d, m + e, n + f


@compiled
def no_forces(actuators, inputs, motion, p):
    """The forces of no part."""
    return NONE, NONE, NONE, NONE, NONE, NONE


def wake_forces(actuators, motion, p):
    """What all parts do in the wakes of all propellers."""
    return in_wake(wakes(actuators, motion.u, p), actuators, motion, p)


def in_wake_of_kind(wake, actuators, motion, p):
    """The sum of what the parts of one kind do in the wakes of all propellers."""
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
    """What the kinds before do in the wakes, and one more."""
    x, y, z, k, m, n = before(wake, actuators, motion, p)
    a, b, c, d, e, f = own(wake, actuators, motion, p)
    return x + a, y + b, z + c, k + d, m + e, n + f


@compiled
def nothing_in_wakes(wake, actuators, motion, p):
    """The forces of no part."""
    return NONE, NONE, NONE, NONE, NONE, NONE


def wakes_of_kind(actuators, u, p):
    """What all parts of one kind add to the flow at the surfaces, m/s."""
    wake = 0.0
    parts, effects = getattr(p.parts, SLOT), getattr(p.effects.parts, SLOT)
    for i in range(COUNT):
        wake += part_wake(FIRST + i * COMMANDS, actuators, u, parts[i], effects[i])
    return wake


def wakes_then(actuators, u, p):
    """The wakes of the kinds before, and of one more."""
    return before(actuators, u, p) + own(actuators, u, p)


@compiled
def no_wakes(actuators, u, p):
    """The wake of no part."""
    return 0.0


def shape_of_kind(inputs, memory, p, shaped):
    """Commands of one kind after their memoryless effects, backlash and stiction, into shaped; updates memory."""
    parts, effects = getattr(p.parts, SLOT), getattr(p.effects.parts, SLOT)
    for i in range(COUNT):
        for c in range(COMMANDS):
            j = FIRST + i * COMMANDS + c
            shaped[j], memory[j] = part_shape(inputs[j], memory[j], parts[i], effects[i], c)


def shape_then(inputs, memory, p, shaped):
    """The commands of the kinds before, and of one more."""
    before(inputs, memory, p, shaped)
    own(inputs, memory, p, shaped)


@compiled
def no_shapes(inputs, memory, p, shaped):
    """The commands of no part."""
    return


def times_of_kind(index, p):
    """Dead time s, lag s and slowness, s per unit, of an actuator of one kind."""
    k = (index - FIRST) // COMMANDS
    return part_times(getattr(p.parts, SLOT)[k], getattr(p.effects.parts, SLOT)[k], index - FIRST - k * COMMANDS)


def times_then(index, p):
    """The times of an actuator of the kinds before, or of one more."""
    if index >= FIRST:
        return own(index, p)
    return before(index, p)


@compiled
def no_actuator(index, p):
    """The times of an actuator that there is not."""
    return 0.0, 0.0, 0.0


def derive_kind(p):
    """What follows from the parameters of the parts of one kind."""
    parts, effects, derived = getattr(p.parts, SLOT), getattr(p.effects.parts, SLOT), getattr(p.derived, SLOT)
    for i in range(COUNT):
        part_derive(parts[i], effects[i], p.hull, derived[i])


def derive_then(p):
    """What follows from the parameters of the kinds before, and of one more."""
    before(p)
    own(p)


def damping_of_kind(p):
    """The rates at which the parts of one kind damp, for the stable step."""
    parts, effects, derived = getattr(p.parts, SLOT), getattr(p.effects.parts, SLOT), getattr(p.derived, SLOT)
    water = p.hull.density * p.computed.density
    for i in range(COUNT):
        part_damping(parts[i], effects[i], derived[i], water, p.computed.inverse_mass, p.computed.damping)


@compiled
def nothing_derived(p):
    """What follows from the parameters of no part."""
    return
