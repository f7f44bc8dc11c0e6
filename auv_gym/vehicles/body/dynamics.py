"""Underwater vehicles in six degrees of freedom: a hull and its parts.

    M dnu/dt = -C(nu) nu + polynomials(nu) + cross-flow drag + parts + weight and buoyancy + loads

nu = [u v w p q r] is the velocity through the water, so that a steady current only moves the frame. States between
samples are [nu | north east depth | roll pitch heading | wave phase]; inside a sample the attitude is a quaternion, and
a vehicle may pitch through 90 deg.  Source: Fossen 2021, eqs. (6.1), (8.1), (10.150).

`derivative` and the functions below it are templates: what parts a vehicle has is bound by `compose`.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Any

from auv_gym.compiled import compiled, outlined
from auv_gym.physics.frames import euler_angles_of, quaternion_of, rotation_of, wrapped
from auv_gym.physics.hydrodynamics import cross_flow_drag, righting
from auv_gym.physics.rigid_body import coriolis_forces
from auv_gym.physics.water import orbital_velocity
from auv_gym.vehicles.body.derived import N_TERMS
from auv_gym.vehicles.body.kinds import NONE, Motion
from auv_gym.vehicles.body.learned_hull import ROOM, learned_forces

SYSTEM = N_TERMS + 5 + ROOM
SCRATCH = SYSTEM + 48  # numbers that a derivative works with

# Open names of the templates, bound by `compose`.
COUNT = COMMANDS = FIRST = SHARED = ACTUATORS = RATES_AT = 0
SLOT = ""
forces_with_hull: Any
forces_of_drives: Any
forces_in_wakes: Any
wakes: Any
in_wake: Any
accelerate: Any
load_blocks: Any
exchange_blocks: Any
part_force: Any
part_wake: Any
part_in_wake: Any
part_shape: Any
part_times: Any
part_derive: Any
part_damping: Any
part_block: Any
before: Any
own: Any


@compiled
def stable_step(z, inputs, p):
    """The longest RK4 step, s, that keeps the quickest motion stable, with a margin of two in the limit of 2.78."""
    rates = p.computed.damping
    u = abs(z[0])
    quickest = 1e-12
    for i in range(6):
        quickest = max(quickest, rates[i, 0] + (rates[i, 1] + rates[i, 3] * u) * u + rates[i, 2] * abs(z[i]))
    return 1.4 / quickest


@compiled
def fill_terms(u, v, w, p, q, r, terms):
    """The values of TERMS at these velocities, then |u| [v w p q r], into terms, shape (N_TERMS + 5,)."""
    terms[0], terms[1], terms[2], terms[3], terms[4], terms[5] = u, v, w, p, q, r
    terms[6], terms[7], terms[8] = u * abs(u), v * abs(v), w * abs(w)
    terms[9], terms[10], terms[11] = p * abs(p), q * abs(q), r * abs(r)
    terms[12], terms[13], terms[14], terms[15], terms[16] = v * v, w * w, p * p, q * q, r * r
    terms[17], terms[18], terms[19], terms[20], terms[21] = u * v, u * w, u * p, u * q, u * r
    terms[22], terms[23], terms[24], terms[25] = v * w, v * p, v * q, v * r
    terms[26], terms[27], terms[28] = w * p, w * q, w * r
    terms[29], terms[30], terms[31] = p * q, p * r, q * r
    ahead = abs(u)
    terms[32], terms[33], terms[34], terms[35], terms[36] = ahead * v, ahead * w, ahead * p, ahead * q, ahead * r


@compiled
def polynomial(computed, start, end, terms):
    """The sum of one axis's coefficients, which stand from start to end, times their terms."""
    total = 0.0
    for i in range(start, end):
        total += computed.coefficients[i] * terms[computed.terms[i]]
    return total


@outlined
def moving_water(north, east, down, depth, phase, p, r11, r12, r13, r21, r22, r23, r31, r32, r33):
    """Velocity over ground with shear and waves, m/s, rate of the waves' phase, their acceleration, and its six forces.

    north, east, down: the velocity without them.  The vehicle moves through water whose velocity it sees change, which
    takes M_RB times that change; and where the water itself accelerates, its pressure gradient pushes as it would push
    the water displaced.  Source: Fossen 2021, sec. 10.3; Faltinsen 1990, ch. 3 (Froude-Krylov force, long waves).
    """
    hull, current, computed = p.hull, p.effects.current, p.computed
    below = depth - current.reference_depth
    north += current.shear_north * below
    east += current.shear_east * below
    a_along = a_down = push_along = push_down = encounter = 0.0
    c_dir, s_dir = 1.0, 0.0
    if computed.has_waves != 0.0:
        waves = p.effects.waves
        along, sinking = orbital_velocity(phase, depth, waves, hull.gravity)
        c_dir, s_dir = cos(waves.direction), sin(waves.direction)
        north += along * c_dir
        east += along * s_dir
        down += sinking
        omega = 2.0 * pi / waves.period
        wavenumber = omega * omega / hull.gravity
        encounter = omega - wavenumber * (north * c_dir + east * s_dir)
        decay = wavenumber * down if depth > 0.0 else 0.0
        # the water's acceleration as the vehicle meets it, and at a fixed point, where the pressure gradient is
        a_along = -encounter * sinking - decay * along
        a_down = encounter * along - decay * sinking
        push_along, push_down = -omega * sinking, omega * along
    a_north = a_along * c_dir + current.shear_north * down
    a_east = a_along * s_dir + current.shear_east * down
    ax = r11 * a_north + r21 * a_east + r31 * a_down
    ay = r12 * a_north + r22 * a_east + r32 * a_down
    az = r13 * a_north + r23 * a_east + r33 * a_down
    displaced = computed.buoyancy / hull.gravity
    px = displaced * (r11 * push_along * c_dir + r21 * push_along * s_dir + r31 * push_down)
    py = displaced * (r12 * push_along * c_dir + r22 * push_along * s_dir + r32 * push_down)
    pz = displaced * (r13 * push_along * c_dir + r23 * push_along * s_dir + r33 * push_down)
    m = computed.rigid_mass
    return (
        north,
        east,
        down,
        encounter,
        ax,
        ay,
        az,
        px - (m[0, 0] * ax + m[0, 1] * ay + m[0, 2] * az),
        py - (m[1, 0] * ax + m[1, 1] * ay + m[1, 2] * az),
        pz - (m[2, 0] * ax + m[2, 1] * ay + m[2, 2] * az),
        hull.y_b * pz - hull.z_b * py - (m[3, 0] * ax + m[3, 1] * ay + m[3, 2] * az),
        hull.z_b * px - hull.x_b * pz - (m[4, 0] * ax + m[4, 1] * ay + m[4, 2] * az),
        hull.x_b * py - hull.y_b * px - (m[5, 0] * ax + m[5, 1] * ay + m[5, 2] * az),
    )


def derivative(z, actuators, inputs, p, dz, terms):
    """State derivative of [u v w p q r | north east depth | quaternion | wave phase] into dz.

    actuators: where the parts' commands have moved them.  terms: scratch, shape (SCRATCH,).
    """
    u, v, w, roll_rate, q, r = z[0], z[1], z[2], z[3], z[4], z[5]
    hull, effects, computed = p.hull, p.effects, p.computed
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation_of(z[9], z[10], z[11], z[12])

    # Contributions are kept apart and added in pairs at the end: one long sum would be a chain of waits.
    fill_terms(u, v, w, roll_rate, q, r, terms)
    x_hull = polynomial(computed, computed.ends[0], computed.ends[1], terms)
    y_hull = polynomial(computed, computed.ends[1], computed.ends[2], terms)
    z_hull = polynomial(computed, computed.ends[2], computed.ends[3], terms)
    k_hull = polynomial(computed, computed.ends[3], computed.ends[4], terms)
    m_hull = polynomial(computed, computed.ends[4], computed.ends[5], terms)
    n_hull = polynomial(computed, computed.ends[5], computed.ends[6], terms)
    if computed.learned != 0.0:
        l1, l2, l3, l4, l5, l6 = learned_forces(p, z, terms[N_TERMS + 5 : SYSTEM])
        x_hull += l1
        y_hull += l2
        z_hull += l3
        k_hull += l4
        m_hull += l5
        n_hull += l6
    if computed.has_environment != 0.0:
        heading = sqrt(max(r11 * r11 + r21 * r21, 1e-12))
        values = (z[8], r21 / heading, r11 / heading)
        e = computed.environment
        for i in range(len(values)):
            x_hull += e[i, 0] * values[i]
            y_hull += e[i, 1] * values[i]
            z_hull += e[i, 2] * values[i]
            k_hull += e[i, 3] * values[i]
            m_hull += e[i, 4] * values[i]
            n_hull += e[i, 5] * values[i]
    if computed.has_cross_flow != 0.0:
        sway, heave, pitch, yaw = cross_flow_drag(
            v, w, q, r, computed.cross_y, computed.cross_z, hull.density * computed.density, hull.length
        )
        y_hull += sway
        z_hull += heave
        m_hull += pitch
        n_hull += yaw

    f1, f2, f3, f4, f5, f6 = coriolis_forces(computed.momentum, u, v, w, roll_rate, q, r)
    g1, g2, g3, g4, g5, g6 = righting(
        computed.weight,
        computed.buoyancy,
        computed.x_g,
        computed.y_g,
        computed.z_g,
        hull.x_b,
        hull.y_b,
        hull.z_b,
        r31,
        r32,
        r33,
    )

    water = hull.density * computed.density
    motion = Motion(
        u, v, w, roll_rate, q, r, computed.density, water, hull.gravity, z[8],
        r11, r12, r13, r21, r22, r23, r31, r32, r33,
    )  # fmt: skip
    x_flow, y_flow, z_flow, k_flow, m_flow, n_flow = forces_with_hull(actuators, inputs, motion, p)
    x_drive, y_drive, z_drive, k_drive, m_drive, n_drive = forces_of_drives(actuators, inputs, motion, p)
    load = effects.load
    x_force = (x_hull + x_flow) + ((f1 + g1) + (x_drive + load.force_x))
    y_force = (y_hull + y_flow) + ((f2 + g2) + (y_drive + load.force_y))
    z_force = (z_hull + z_flow) + ((f3 + g3) + (z_drive + load.force_z))
    k_moment = ((k_hull + k_flow) + k_drive) + ((f4 + g4) + load.moment_x)
    m_moment = ((m_hull + m_flow) + m_drive) + ((f5 + g5) + load.moment_y)
    n_moment = ((n_hull + n_flow) + n_drive) + ((f6 + g6) + load.moment_z)
    if computed.has_wake != 0.0:
        a1, a2, a3, a4, a5, a6 = forces_in_wakes(actuators, motion, p)
        x_force += a1
        y_force += a2
        z_force += a3
        k_moment += a4
        m_moment += a5
        n_moment += a6
    if computed.has_tether != 0.0:
        drag = load.tether_drag * sqrt(u * u + v * v + w * w)
        tx = r11 * load.tether_north + r21 * load.tether_east + r31 * load.tether_down - drag * u
        ty = r12 * load.tether_north + r22 * load.tether_east + r32 * load.tether_down - drag * v
        tz = r13 * load.tether_north + r23 * load.tether_east + r33 * load.tether_down - drag * w
        x_force += tx
        y_force += ty
        z_force += tz
        m_moment -= load.tether_station * tz
        n_moment += load.tether_station * ty

    # motion over ground
    current = effects.current
    north = r11 * u + r12 * v + r13 * w + current.north
    east = r21 * u + r22 * v + r23 * w + current.east
    down = r31 * u + r32 * v + r33 * w + current.down
    dz[13] = ax = ay = az = 0.0
    if computed.has_moving_water != 0.0:
        north, east, down, dz[13], ax, ay, az, a1, a2, a3, a4, a5, a6 = moving_water(
            north, east, down, z[8], z[13], p, r11, r12, r13, r21, r22, r23, r31, r32, r33
        )
        x_force += a1
        y_force += a2
        z_force += a3
        k_moment += a4
        m_moment += a5
        n_moment += a6

    push = x_force, y_force, z_force, k_moment, m_moment, n_moment
    accelerate(push, (ax, ay, az), actuators, motion, p, dz, terms)
    dz[6], dz[7], dz[8] = north, east, down
    # quaternion rates, Fossen 2021, eq. (2.76)
    e0, e1, e2, e3 = z[9], z[10], z[11], z[12]
    dz[9] = -0.5 * (e1 * roll_rate + e2 * q + e3 * r)
    dz[10] = 0.5 * (e0 * roll_rate - e3 * q + e2 * r)
    dz[11] = 0.5 * (e3 * roll_rate + e0 * q - e1 * r)
    dz[12] = 0.5 * (-e2 * roll_rate + e1 * q + e0 * r)


@compiled
def enter(x, z):
    """States as they are kept, with Euler angles, into states as they are integrated, with a quaternion."""
    for i in range(9):
        z[i] = x[i]
    z[9], z[10], z[11], z[12] = quaternion_of(x[9], x[10], x[11])
    z[13] = x[12]


@compiled
def leave(z, x):
    """Integrated states back into kept ones, in place; angles go on from those in x without a jump of a turn."""
    for i in range(9):
        x[i] = z[i]
    r11, r12, r13, r21, r22, r23, r31, _, _ = rotation_of(z[9], z[10], z[11], z[12])
    roll, pitch, heading = euler_angles_of(r11, r12, r13, r21, r22, r23, r31)
    x[9] += wrapped(roll - x[9])
    x[10] = pitch
    x[11] += wrapped(heading - x[11])
    x[12] = z[13]


@compiled
def by_inverse(push, water, actuators, motion, p, dz, scratch):
    """Accelerations of a body whose masses do not move, into dz; push: the six forces."""
    x_force, y_force, z_force, k_moment, m_moment, n_moment = push
    i = p.computed.inverse_mass
    for k in range(6):
        dz[k] = (i[k, 0] * x_force + i[k, 1] * y_force + i[k, 2] * z_force) + (
            i[k, 3] * k_moment + i[k, 4] * m_moment + i[k, 5] * n_moment
        )


# Masses that move in the body. The work array has, from SYSTEM on, a matrix (6, 6), row by row, and a column (6,).


def by_elimination(push, water, actuators, motion, p, dz, scratch):
    """Accelerations of a body in which masses move, into dz.

    push: the six forces on all of it but what the moving masses' inertia takes; water: acceleration of the water, in
    body axes, m/s^2.
    """
    fill_system(p, scratch)
    for i in range(6):
        scratch[SYSTEM + 36 + i] = push[i]
    load_blocks(actuators, motion, water, p, scratch)
    solve_system(scratch, dz)


@compiled
def fill_system(p, scratch):
    """The mass matrix of the hull into the work array."""
    for i in range(6):
        for j in range(6):
            scratch[SYSTEM + 6 * i + j] = p.computed.mass[i, j]


@compiled
def solve_system(scratch, solution):
    """The solution, (6,), of the system in the work array, which is used up; by elimination without pivots.

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
    """The inertia of a moving mass about the body's origin, added to the matrix.  Source: Fossen 2021, eq. (3.49)."""
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
    """What a moving mass takes beside its share of the accelerations: centrifugal, Coriolis and gyroscopic, and the
    water's acceleration; subtracted from the column.  Source: Newton's and Euler's laws in turning axes.
    """
    u, v, w, p, q, r = motion.u, motion.v, motion.w, motion.p, motion.q, motion.r
    x, y, z = block.x, block.y, block.z
    # velocity of the place, and of the mass against it twice
    a, b, c = (
        u + q * z - r * y + 2.0 * block.v_x,
        v + r * x - p * z + 2.0 * block.v_y,
        w + p * y - q * x + 2.0 * block.v_z,
    )
    f1 = block.mass * (q * c - r * b + water[0])
    f2 = block.mass * (r * a - p * c + block.a_y + water[1])
    f3 = block.mass * (p * b - q * a + block.a_z + water[2])
    # h = I (omega + spin e_x), which turns with the body, and I with the spin
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
    """The momentum that a mass has because it moves in the body, added to the column, times a sign."""
    at, m = SYSTEM + 36, sign * block.mass
    p1, p2, p3 = m * block.v_x, m * block.v_y, m * block.v_z
    scratch[at] += p1
    scratch[at + 1] += p2
    scratch[at + 2] += p3
    scratch[at + 3] += block.y * p3 - block.z * p2 + sign * block.i_xx * block.spin
    scratch[at + 4] += block.z * p1 - block.x * p3
    scratch[at + 5] += block.x * p2 - block.y * p1


def kick(z, sensors, path, h, p, scratch):
    """The rates of the actuators in a step of length h into path, and the jump of velocity that their change gives.

    Momentum stays: what a mass gains as it starts, the vehicle loses. The rates before are the last of the sensors'
    states, and are renewed.
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
    """The inertia and the inertial forces of the moving masses of one kind."""
    parts, effects = getattr(p.parts, SLOT), getattr(p.effects.parts, SLOT)
    for i in range(COUNT):
        at = FIRST + i * COMMANDS
        block = part_block(at, ACTUATORS + at, actuators, parts[i], effects[i])
        add_mass(block, scratch)
        add_inertial_force(block, motion, water, scratch)


def load_blocks_then(actuators, motion, water, p, scratch):
    """Those of the kinds before, and of one more."""
    before(actuators, motion, water, p, scratch)
    own(actuators, motion, water, p, scratch)


@compiled
def no_load(actuators, motion, water, p, scratch):
    """The inertia of no moving mass."""
    return


def exchange_of_kind(path, p, scratch):
    """The inertia of the moving masses of one kind, and the momentum that they lose at the start of a step."""
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
    """Those of the kinds before, and of one more."""
    before(path, p, scratch)
    own(path, p, scratch)


@compiled
def no_exchange(path, p, scratch):
    """The momentum of no moving mass."""
    return


# What the parts add, kind by kind: for each kind a function of the form `_..._of_kind`, and a chain of them by `_then`.


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
    """The commands of one kind after their memoryless effects and backlash, into shaped; memory is updated."""
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
