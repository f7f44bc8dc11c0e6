"""Moving masses in a body: their inertia, their inertial forces, and the jump with which they start and stop.

The functions are templates, see `compiled.bind`; `compose` binds them for vehicles with such parts. From index SYSTEM
on, the work array has a matrix (6, 6), row by row, a column (6,), and room for a solution.
"""

from __future__ import annotations

from typing import Any

from auv_gym.compiled import compiled
from auv_gym.vehicles.body.dynamics import SYSTEM

# Placeholders in the templates, bound by `compose`.
COUNT = COMMANDS = FIRST = ACTUATORS = RATES_AT = 0
SLOT = ""
load_blocks: Any
exchange_blocks: Any
part_block: Any
before: Any
own: Any


def accelerate_by_elimination(push, water, actuators, motion, p, dz, scratch):
    """Accelerations of a body with moving masses, into dz.

    push: the six forces on the whole body, except the inertial forces of the moving masses; water: acceleration of the
    water, in body axes, m/s^2.
    """
    fill_system(p, scratch)
    for i in range(6):
        scratch[SYSTEM + 36 + i] = push[i]
    load_blocks(actuators, motion, water, p, scratch)
    solve_system(scratch, dz)


@compiled
def fill_system(p, scratch):
    """Write the mass matrix of the hull into the work array."""
    for i in range(6):
        for j in range(6):
            scratch[SYSTEM + 6 * i + j] = p.computed.mass[i, j]


@compiled
def solve_system(scratch, solution):
    """Solve the system in the work array, (6,), by elimination without pivoting; the system is destroyed.

    The matrix has a positive definite symmetric part, so that no pivot vanishes.
    """
    for k in range(6):
        for i in range(k + 1, 6):
            share = scratch[SYSTEM + 6 * i + k] / scratch[SYSTEM + 7 * k]
            for j in range(k + 1, 6):
                scratch[SYSTEM + 6 * i + j] -= share * scratch[SYSTEM + 6 * k + j]
            scratch[SYSTEM + 36 + i] -= share * scratch[SYSTEM + 36 + k]
    for back in range(6):
        k = 5 - back
        total = scratch[SYSTEM + 36 + k]
        for j in range(k + 1, 6):
            total -= scratch[SYSTEM + 6 * k + j] * solution[j]
        solution[k] = total / scratch[SYSTEM + 7 * k]


@compiled
def add_mass(block, scratch):
    """Add the inertia of a moving mass about the body's origin to the matrix.  Source: Fossen 2021, eq. (3.49)."""
    m, x, y, z = block.mass, block.x, block.y, block.z
    at = SYSTEM
    scratch[at] += m
    scratch[at + 7] += m
    scratch[at + 14] += m
    scratch[at + 4] += m * z
    scratch[at + 5] -= m * y
    scratch[at + 9] -= m * z
    scratch[at + 11] += m * x
    scratch[at + 15] += m * y
    scratch[at + 16] -= m * x
    scratch[at + 19] -= m * z
    scratch[at + 20] += m * y
    scratch[at + 24] += m * z
    scratch[at + 26] -= m * x
    scratch[at + 30] -= m * y
    scratch[at + 31] += m * x
    scratch[at + 21] += block.i_xx + m * (y * y + z * z)
    scratch[at + 28] += block.i_yy + m * (x * x + z * z)
    scratch[at + 35] += block.i_zz + m * (x * x + y * y)
    scratch[at + 22] -= m * x * y
    scratch[at + 27] -= m * x * y
    scratch[at + 23] -= m * x * z
    scratch[at + 33] -= m * x * z
    scratch[at + 29] += block.i_yz - m * y * z
    scratch[at + 34] += block.i_yz - m * y * z


@compiled
def add_inertial_force(block, motion, water, scratch):
    """Subtract the inertial forces of a moving mass that do not depend on the body's acceleration from the column.

    Centrifugal, Coriolis and gyroscopic forces, and that of the water's acceleration.  Source: Newton's and Euler's
    laws in rotating axes.
    """
    u, v, w, p, q, r = motion.u, motion.v, motion.w, motion.p, motion.q, motion.r
    x, y, z = block.x, block.y, block.z
    # velocity of the position, plus twice the mass's velocity relative to the body
    a, b, c = (
        u + q * z - r * y + 2.0 * block.v_x,
        v + r * x - p * z + 2.0 * block.v_y,
        w + p * y - q * x + 2.0 * block.v_z,
    )
    f1 = block.mass * (q * c - r * b + water[0])
    f2 = block.mass * (r * a - p * c + block.a_y + water[1])
    f3 = block.mass * (p * b - q * a + block.a_z + water[2])
    # h = I (omega + spin e_x) rotates with the body, and I with the spin
    s, yy, zz, yz = block.spin, block.i_yy, block.i_zz, block.i_yz
    h1, h2, h3 = block.i_xx * (p + s), yy * q + yz * r, yz * q + zz * r
    i2, i3 = -2.0 * yz * q + (yy - zz) * r, 2.0 * yz * r + (yy - zz) * q
    m1 = q * h3 - r * h2
    m2 = r * h1 - p * h3 + s * i2
    m3 = p * h2 - q * h1 + s * i3
    at = SYSTEM + 36
    scratch[at] -= f1
    scratch[at + 1] -= f2
    scratch[at + 2] -= f3
    scratch[at + 3] -= y * f3 - z * f2 + m1
    scratch[at + 4] -= z * f1 - x * f3 + m2
    scratch[at + 5] -= x * f2 - y * f1 + m3


@compiled
def add_momentum(block, sign, scratch):
    """Add the momentum of a mass due to its motion in the body to the column, times a sign."""
    at, m = SYSTEM + 36, sign * block.mass
    p1, p2, p3 = m * block.v_x, m * block.v_y, m * block.v_z
    scratch[at] += p1
    scratch[at + 1] += p2
    scratch[at + 2] += p3
    scratch[at + 3] += block.y * p3 - block.z * p2 + sign * block.i_xx * block.spin
    scratch[at + 4] += block.z * p1 - block.x * p3
    scratch[at + 5] += block.x * p2 - block.y * p1


def kick(z, sensors, path, h, p, scratch):
    """Put the actuators' rates in a step of length h into path, and apply the jump of velocity from their change.

    Momentum is conserved: what a mass gains when it starts, the vehicle loses. The previous rates are the last of the
    sensors' states, and are updated.
    """
    changed = False
    for j in range(ACTUATORS):
        rate = (path[2, j] - path[0, j]) / h
        changed = changed or rate != sensors[RATES_AT + j]
        path[0, ACTUATORS + j] = sensors[RATES_AT + j]
        path[1, ACTUATORS + j] = path[2, ACTUATORS + j] = rate
    if changed:
        fill_system(p, scratch)
        for i in range(6):
            scratch[SYSTEM + 36 + i] = 0.0
        exchange_blocks(path, p, scratch)
        solve_system(scratch, scratch[SYSTEM + 42 : SYSTEM + 48])
        for i in range(6):
            z[i] += scratch[SYSTEM + 42 + i]
    for j in range(ACTUATORS):
        path[0, ACTUATORS + j] = sensors[RATES_AT + j] = path[1, ACTUATORS + j]


def load_blocks_of_kind(actuators, motion, water, p, scratch):
    """Add the inertia and the inertial forces of the moving masses of one kind."""
    parts, effects = getattr(p.parts, SLOT), getattr(p.effects.parts, SLOT)
    for i in range(COUNT):
        at = FIRST + i * COMMANDS
        block = part_block(at, ACTUATORS + at, actuators, parts[i], effects[i])
        add_mass(block, scratch)
        add_inertial_force(block, motion, water, scratch)


def load_blocks_then(actuators, motion, water, p, scratch):
    """The same for the preceding kinds and one more."""
    before(actuators, motion, water, p, scratch)
    own(actuators, motion, water, p, scratch)


@compiled
def no_load(actuators, motion, water, p, scratch):
    """No moving mass."""
    return


def exchange_of_kind(path, p, scratch):
    """Add the inertia of the moving masses of one kind, and the momentum that they lose at the start of a step."""
    parts, effects = getattr(p.parts, SLOT), getattr(p.effects.parts, SLOT)
    for i in range(COUNT):
        at = FIRST + i * COMMANDS
        old = part_block(at, ACTUATORS + at, path[0], parts[i], effects[i])
        add_mass(old, scratch)
        add_momentum(old, 1.0, scratch)
        for c in range(COMMANDS):
            path[0, ACTUATORS + at + c] = path[1, ACTUATORS + at + c]
        add_momentum(part_block(at, ACTUATORS + at, path[0], parts[i], effects[i]), -1.0, scratch)


def exchange_then(path, p, scratch):
    """The same for the preceding kinds and one more."""
    before(path, p, scratch)
    own(path, p, scratch)


@compiled
def no_exchange(path, p, scratch):
    """No moving mass."""
    return
