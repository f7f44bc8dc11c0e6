"""Underwater vehicles in six degrees of freedom: torpedo-shaped hulls with fins and a propeller.

    M dnu/dt = -C(nu) nu + polynomials(nu) + cross-flow drag + fins + propulsion + weight and buoyancy + loads

nu = [u v w p q r] is the velocity through the water, so that a steady current only moves the frame. States between
samples are [nu | north east depth | roll pitch heading | wave phase]; inside a sample the attitude is a quaternion, and
a vehicle may pitch through 90 deg.  Source: Fossen 2021, eqs. (6.1), (8.1), (10.150).
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt

from auv_gym.compiled import compiled, outlined
from auv_gym.physics.actuators import shape_command, shaped_command
from auv_gym.physics.frames import euler_angles_of, quaternion_of, rotation_of, wrapped
from auv_gym.physics.hydrodynamics import angle_of_attack, cross_flow_drag, righting
from auv_gym.physics.propulsion import (
    RADPS_PER_RPM,
    shaft_law,
    slipstream_speed,
    table_thrust,
)
from auv_gym.physics.rigid_body import coriolis_forces
from auv_gym.physics.water import orbital_velocity
from auv_gym.vehicles.family import Family
from auv_gym.vehicles.learned_hull import ROOM, learned_forces
from auv_gym.vehicles.torpedo_derived import N_DERIVED, N_TERMS, derive, mass_problem, view
from auv_gym.vehicles.torpedo_parameters import TorpedoParameters
from auv_gym.vehicles.torpedo_sensors import SENSORS, output, sense, settle_sensors


@compiled
def stable_step(z, inputs, p):
    """The longest RK4 step, s, that keeps the quickest motion stable, with a margin of two in the limit of 2.78."""
    rates = p.computed.damping
    u = abs(z[0])
    quickest = 1e-12
    for i in range(6):
        quickest = max(quickest, rates[i, 0] + rates[i, 1] * u + rates[i, 2] * abs(z[i]))
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
        total += computed.coefficients[i] * terms[int(computed.terms[i])]
    return total


@compiled
def fin_drag(angle, square, push, turn, slip, fin):
    """Axial force of a pair of fins, N; square: u|u|, push: u, both times the relative density."""
    return angle * (square * (fin.drag * angle) + push * (fin.drag_rate * turn + fin.drag_slip * slip))


@compiled
def fin_angle(position, damage):
    """The angle at which a fin stands, rad, given where its actuator is."""
    return (1.0 - damage.stuck) * position + damage.stuck * damage.stuck_at


@compiled
def thrust_and_torque(command, u, p):
    """Thrust, N, and roll moment, N m, of the propeller at a command in its channel's unit."""
    law = p.hull.propulsion
    n = RADPS_PER_RPM * command
    thrust = shaft_law(n, u, law.t_nn, law.t_nu) + law.t_cc * command * abs(command)
    torque = shaft_law(n, u, law.q_nn, law.q_nu)
    if p.computed.has_table != 0.0:
        thrust += table_thrust(command, u, law.table)
    working = p.computed.density * (1.0 - p.effects.propeller.thrust_loss)
    thrust *= working
    return thrust, working * torque + (law.torque_arm + p.effects.propeller.torque) * thrust


@outlined
def moving_water(north, east, down, depth, phase, p, r11, r12, r13, r21, r22, r23, r31, r32, r33):
    """Velocity over ground with shear and waves, m/s, rate of the waves' phase, and six forces of their acceleration.

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
        px - (m[0, 0] * ax + m[0, 1] * ay + m[0, 2] * az),
        py - (m[1, 0] * ax + m[1, 1] * ay + m[1, 2] * az),
        pz - (m[2, 0] * ax + m[2, 1] * ay + m[2, 2] * az),
        hull.y_b * pz - hull.z_b * py - (m[3, 0] * ax + m[3, 1] * ay + m[3, 2] * az),
        hull.z_b * px - hull.x_b * pz - (m[4, 0] * ax + m[4, 1] * ay + m[4, 2] * az),
        hull.x_b * py - hull.y_b * px - (m[5, 0] * ax + m[5, 1] * ay + m[5, 2] * az),
    )


@outlined
def slipstream(shaft_speed, u, w, p, q, angle, deflected, slip):
    """Surge and heave force, N, roll and pitch moment, N m, of the planes and the hull in the propeller's slipstream.

    angle: of the stern plane, rad; deflected: the same, less what of the plane is lost.
    """
    stream = slipstream_speed(shaft_speed, u, slip.pitch, slip.c_t1)
    return (
        stream * deflected * (slip.x_uq_stern * q + slip.x_uw_stern * w + slip.x_uu_stern * u * angle),
        stream * (slip.z_uq * q + slip.z_uw * w + slip.z_uu_stern * u * deflected),
        stream * slip.k_up * p,
        stream * (slip.m_uq * q + slip.m_uw * w + slip.m_uu_stern * u * deflected),
    )


@compiled
def derivative(z, actuators, inputs, p, dz, terms):
    """State derivative of [u v w p q r | north east depth | quaternion | wave phase] into dz.

    actuators: [rudder, stern plane, bow plane rad, propulsion command].  terms: scratch, shape (N_TERMS + 5 + ROOM,).
    """
    u, v, w, roll_rate, q, r = z[0], z[1], z[2], z[3], z[4], z[5]
    hull, effects, computed = p.hull, p.effects, p.computed
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation_of(z[9], z[10], z[11], z[12])

    # Contributions are kept apart and added in pairs at the end: one long sum would be a chain of waits.
    fill_terms(u, v, w, roll_rate, q, r, terms)
    x_hull = polynomial(computed, 0, int(computed.ends[0]), terms)
    y_hull = polynomial(computed, int(computed.ends[0]), int(computed.ends[1]), terms)
    z_hull = polynomial(computed, int(computed.ends[1]), int(computed.ends[2]), terms)
    k_hull = polynomial(computed, int(computed.ends[2]), int(computed.ends[3]), terms)
    m_hull = polynomial(computed, int(computed.ends[3]), int(computed.ends[4]), terms)
    n_hull = polynomial(computed, int(computed.ends[4]), int(computed.ends[5]), terms)
    if computed.learned != 0.0:
        l1, l2, l3, l4, l5, l6 = learned_forces(p, z, terms[N_TERMS + 5 :])
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

    rudder, stern, bow = hull.rudder, hull.stern_plane, hull.bow_plane
    rudder_there = 1.0 - effects.rudder_fin.lost
    stern_there = 1.0 - effects.stern_plane_fin.lost
    angle_r = angle_of_attack(fin_angle(actuators[0], effects.rudder_fin), u, v, r, rudder)
    angle_s = angle_of_attack(fin_angle(actuators[1], effects.stern_plane_fin), u, w, -q, stern)
    push = computed.density * u
    square = push * abs(u)
    x_rudder = fin_drag(angle_r, square, push, r, v, rudder)
    x_stern = fin_drag(angle_s, square, push, q, w, stern)
    x_bow = z_bow = m_bow = 0.0
    if computed.has_bow_plane != 0.0:
        bow_there = 1.0 - effects.bow_plane_fin.lost
        angle_b = angle_of_attack(fin_angle(actuators[2], effects.bow_plane_fin), u, w, -q, bow)
        x_bow = bow_there * fin_drag(angle_b, square, push, q, w, bow)
        z_bow = bow_there * (bow.lift * angle_b)
        m_bow = bow_there * (bow.moment * angle_b)
    x_fins = rudder_there * x_rudder + (stern_there * x_stern + x_bow)
    y_fins = rudder_there * (square * (rudder.lift * angle_r))
    n_fins = rudder_there * (square * (rudder.moment * angle_r))
    z_fins = square * (stern_there * (stern.lift * angle_s) + z_bow)
    m_fins = square * (stern_there * (stern.moment * angle_s) + m_bow)

    thrust, torque = thrust_and_torque(actuators[3], u, p)
    slip = hull.slipstream
    if slip.c_t1 != 0.0:  # calls, here and below, so that the usual step is short
        n = RADPS_PER_RPM * actuators[3]
        x_slip, z_slip, k_slip, m_slip = slipstream(n, u, w, roll_rate, q, angle_s, stern_there * angle_s, slip)
        x_fins += computed.density * x_slip
        z_fins += computed.density * z_slip
        torque += computed.density * k_slip
        m_fins += computed.density * m_slip

    load = effects.load
    x_force = (x_hull + x_fins) + ((f1 + g1) + (thrust + load.force_x))
    y_force = (y_hull + y_fins) + ((f2 + g2) + load.force_y)
    z_force = (z_hull + z_fins) + ((f3 + g3) + load.force_z)
    k_moment = (k_hull + torque) + ((f4 + g4) + load.moment_x)
    m_moment = (m_hull + m_fins) + ((f5 + g5) + load.moment_y)
    n_moment = (n_hull + n_fins) + ((f6 + g6) + load.moment_z)
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
    dz[13] = 0.0
    if computed.has_moving_water != 0.0:
        north, east, down, dz[13], a1, a2, a3, a4, a5, a6 = moving_water(
            north, east, down, z[8], z[13], p, r11, r12, r13, r21, r22, r23, r31, r32, r33
        )
        x_force += a1
        y_force += a2
        z_force += a3
        k_moment += a4
        m_moment += a5
        n_moment += a6

    i = computed.inverse_mass
    for k in range(6):
        dz[k] = (i[k, 0] * x_force + i[k, 1] * y_force + i[k, 2] * z_force) + (
            i[k, 3] * k_moment + i[k, 4] * m_moment + i[k, 5] * n_moment
        )
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
def shape(inputs, memory, p, shaped):
    """The four commands after their memoryless effects and backlash, into shaped; memory is updated."""
    hull, effects = p.hull, p.effects
    shaped[0], memory[0] = shape_command(inputs[0], memory[0], hull.rudder.limit, effects.rudder)
    shaped[1], memory[1] = shape_command(inputs[1], memory[1], hull.stern_plane.limit, effects.stern_plane)
    shaped[2], memory[2] = shape_command(inputs[2], memory[2], hull.bow_plane.limit, effects.bow_plane)
    propeller, limit = effects.propeller, hull.propulsion.limit
    shaped[3], memory[3] = shaped_command(
        inputs[3],
        memory[3],
        propeller.gain,
        propeller.offset * limit,
        propeller.deadband * limit,
        0.0,
        limit - propeller.lost_travel * limit,
    )


@compiled
def actuator_times(index, p):
    """Dead time s, lag s and slowness (s per unit) of an actuator, the vehicle's own and the effect's together."""
    hull, effects = p.hull, p.effects
    if index == 0:
        return (
            effects.rudder.dead_time,
            hull.rudder.lag + effects.rudder.lag,
            hull.rudder.slowness + effects.rudder.slowness,
        )
    if index == 1:
        fin, effect = hull.stern_plane, effects.stern_plane
        return effect.dead_time, fin.lag + effect.lag, fin.slowness + effect.slowness
    if index == 2:
        fin, effect = hull.bow_plane, effects.bow_plane
        return effect.dead_time, fin.lag + effect.lag, fin.slowness + effect.slowness
    drive, propeller = hull.propulsion, effects.propeller
    return propeller.dead_time, drive.lag + propeller.lag, (drive.slowness + propeller.slowness) / drive.limit


def _family(name: str, propulsion: str, title: str) -> Family:
    commands = ("rudder_rad", "stern_plane_rad", "bow_plane_rad", propulsion)
    return Family(
        name=name,
        kind="torpedo",
        title=title,
        parameters=TorpedoParameters,
        inputs=commands,
        required=("rudder_rad", "stern_plane_rad", propulsion),
        states=(
            *("u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps"),
            *("north_m", "east_m", "depth_m", "roll_rad", "pitch_rad", "heading_rad", "wave_phase_rad"),
        ),
        integrated=14,
        scratch=N_TERMS + 5 + ROOM,
        learns=True,
        actuators=commands,
        sensors=SENSORS,
        outputs=(
            *("roll_rad", "pitch_rad", "heading_rad", "p_radps", "q_radps", "r_radps"),
            *("u_mps", "v_mps", "w_mps", "u_dvl_mps", "v_dvl_mps", "w_dvl_mps", "north_m", "east_m", "depth_m"),
        ),
        coefficients=(
            *("hull.surge.u_u", "hull.sway.uv", "hull.sway.ur", "hull.heave.uw", "hull.heave.uq"),
            *("hull.pitch.uw", "hull.pitch.uq", "hull.yaw.uv", "hull.yaw.ur"),
            *("hull.rudder.moment", "hull.stern_plane.moment"),
        ),
        main_output="heading_rad",
        nearly={f"{axis}_mps": f"{axis}_dvl_mps" for axis in "uvw"},
        at_rest=("roll_rad", "p_radps"),
        twins={"effects.hull.damping_surge": "hull.surge.u_u"},
        derived=N_DERIVED,
        problem=mass_problem,
        view=view,
        hooks={
            "derivative": derivative,
            "stable_step": stable_step,
            "shape": shape,
            "actuator_times": actuator_times,
            "sense": sense,
            "settle_sensors": settle_sensors,
            "output": output,
            "enter": enter,
            "leave": leave,
            "derive": derive,
        },
    )


TORPEDO = _family("torpedo", "propeller_rpm", "six degrees of freedom, propeller by shaft speed")
TORPEDO_VOLTAGE = _family("torpedo_voltage", "propeller_V", "six degrees of freedom, propeller by voltage")
TORPEDO_SPEED = _family("torpedo_speed", "speed_cmd_mps", "six degrees of freedom, thrust for a desired speed")
