"""Underwater vehicles in six degrees of freedom: a hull and its parts.

    M dnu/dt = -C(nu) nu + polynomials(nu) + cross-flow drag + parts + weight and buoyancy + loads

nu = [u v w p q r] is the velocity through the water, so that a steady current only moves the frame. States between
samples are [nu | north east depth | roll pitch heading | wave phase]; inside a sample the attitude is a quaternion, so
that a vehicle may pitch through 90 deg.  Source: Fossen 2021, eqs. (6.1), (8.1), (10.150).

`derivative` is a template: `compose` binds the vehicle's parts, from `sums` and `blocks`.
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
from auv_gym.vehicles.body.kinds import Motion
from auv_gym.vehicles.body.learned_hull import ROOM, learned_forces

SYSTEM = N_TERMS + 5 + ROOM
SCRATCH = SYSTEM + 48  # size of a derivative's work array

# Placeholders in the template, bound by `compose`.
ELAPSED = -1  # index of the input with the time since the log began, or -1
forces_with_hull: Any
forces_of_drives: Any
forces_in_wakes: Any
accelerate: Any


@compiled
def stable_step(z, inputs, p):
    """The longest RK4 step, s, that keeps the fastest motion stable, with a margin of two in the limit of 2.78."""
    rates = p.computed.damping
    u = abs(z[0])
    quickest = 1e-12
    for i in range(6):
        quickest = max(quickest, rates[i, 0] + (rates[i, 1] + rates[i, 3] * u) * u + rates[i, 2] * abs(z[i]))
    return 1.4 / quickest


@compiled
def fill_terms(u, v, w, p, q, r, terms):
    """Write the values of TERMS at these velocities, then |u| [v w p q r], into terms, shape (N_TERMS + 5,)."""
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
    """The sum of one axis's coefficients, from start to end, times their terms."""
    total = 0.0
    for i in range(start, end):
        total += computed.coefficients[i] * terms[computed.terms[i]]
    return total


@outlined
def moving_water(north, east, down, depth, phase, p, r11, r12, r13, r21, r22, r23, r31, r32, r33):
    """Velocity over ground with shear and waves, m/s, rate of the waves' phase, their acceleration, and its six forces.

    north, east, down: the velocity without shear and waves.  The vehicle moves through water of varying velocity, which
    takes M_RB times the variation; in addition, where the water accelerates, its pressure gradient pushes the vehicle
    like the water that it displaces.  Source: Fossen 2021, sec. 10.3; Faltinsen 1990, ch. 3 (Froude-Krylov force, long
    waves).
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
        # the water's acceleration as met by the vehicle, and at a fixed point, for the pressure gradient
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

    actuators: positions of the parts' actuators.  terms: scratch, shape (SCRATCH,).
    """
    u, v, w, roll_rate, q, r = z[0], z[1], z[2], z[3], z[4], z[5]
    hull, effects, computed = p.hull, p.effects, p.computed
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation_of(z[9], z[10], z[11], z[12])

    # Contributions are added in pairs at the end: one long sum would be a chain of dependent additions.
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
    sag = 0.0
    if ELAPSED >= 0:
        sag = effects.supply.sag * inputs[ELAPSED]
    motion = Motion(
        u, v, w, roll_rate, q, r, computed.density, water, hull.gravity, z[8],
        r11, r12, r13, r21, r22, r23, r31, r32, r33, sag,
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
    """Convert states with Euler angles, as kept between samples, to integrated states with a quaternion."""
    for i in range(9):
        z[i] = x[i]
    z[9], z[10], z[11], z[12] = quaternion_of(x[9], x[10], x[11])
    z[13] = x[12]


@compiled
def leave(z, x):
    """Convert integrated states back to kept ones, in place; angles continue from those in x without jumps by turns."""
    for i in range(9):
        x[i] = z[i]
    r11, r12, r13, r21, r22, r23, r31, _, _ = rotation_of(z[9], z[10], z[11], z[12])
    roll, pitch, heading = euler_angles_of(r11, r12, r13, r21, r22, r23, r31)
    x[9] += wrapped(roll - x[9])
    x[10] = pitch
    x[11] += wrapped(heading - x[11])
    x[12] = z[13]


@compiled
def accelerate_by_inverse(push, water, actuators, motion, p, dz, scratch):
    """Accelerations of a body without moving masses, into dz; push: the six forces."""
    x_force, y_force, z_force, k_moment, m_moment, n_moment = push
    i = p.computed.inverse_mass
    for k in range(6):
        dz[k] = (i[k, 0] * x_force + i[k, 1] * y_force + i[k, 2] * z_force) + (
            i[k, 3] * k_moment + i[k, 4] * m_moment + i[k, 5] * n_moment
        )
