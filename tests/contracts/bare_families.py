"""Each kind of vehicle without a word about effects, operation by operation: what neutral effects must give."""

from dataclasses import replace
from math import sin

import numpy as np
from auv_gym.vehicles.torpedo import fill_terms
from auv_gym.vehicles.torpedo_derived import N_PARAMETERS, N_TERMS, fill_added_mass, writable_view

from auv_gym.compiled import compiled
from auv_gym.physics.buoyancy import exposed_volume
from auv_gym.physics.frames import compiled_euler_rates, compiled_velocity_ned, rotation_of
from auv_gym.physics.hydrodynamics import angle_of_attack, cross_flow_drag, righting
from auv_gym.physics.propulsion import RADPS_PER_RPM, shaft_law, slipstream_speed, table_thrust
from auv_gym.physics.rigid_body import coriolis_forces, fill_rigid_body_mass, invert
from auv_gym.vehicles.family import Family
from auv_gym.vehicles.glider import GRAVITY
from auv_gym.vehicles.glider import stable_step as glider_stable_step
from auv_gym.vehicles.profiling_float import GRAVITY as FLOAT_GRAVITY
from auv_gym.vehicles.profiling_float import stable_step as float_stable_step
from auv_gym.vehicles.profiling_float import steady_speed


@compiled
def glider_derivative(x, actuators, inputs, p, dx, scratch):
    """Equation (11) with (15)."""
    hull = p.hull
    u = inputs[3]
    d3 = 0.5 * hull.density * hull.length**3
    d4 = d3 * hull.length
    u_damping = hull.speed + hull.speed_scaling * (u - hull.speed)
    u_squared = hull.speed**2 + hull.speed_scaling * (u**2 - hull.speed**2)
    damping = d4 * (hull.n_r * u_damping + hull.n_wr * inputs[4]) - hull.mass * hull.x_g * u_damping
    weight = GRAVITY * (hull.y_g * hull.mass - hull.y_b * hull.density * hull.volume) * sin(inputs[6])
    moment = (
        hull.damping_factor * damping * x[1]
        + hull.rudder_factor * (d3 * u_squared * hull.n_delta * actuators[0])
        + hull.bow_thruster_arm * inputs[1]
        + hull.stern_thruster_arm * inputs[2]
        + weight
        - hull.i_xy * inputs[5] ** 2
    )
    inertia = hull.inertia - 0.5 * hull.density * hull.length**5 * hull.n_rdot
    yawing = x[1] + hull.rudder_heading_rate * actuators[0]
    north, east, _ = compiled_velocity_ned(u, 0.0, inputs[4], inputs[7], inputs[6], x[0])
    _, _, dx[0] = compiled_euler_rates(0.0, inputs[5], yawing, inputs[7], inputs[6])
    dx[1] = moment / inertia + hull.heading_stiffness * x[0]
    dx[2] = north
    dx[3] = east


@compiled
def glider_shape(inputs, memory, p, shaped):
    shaped[0] = min(max(inputs[0], -p.hull.rudder_limit), p.hull.rudder_limit)


@compiled
def no_times(index, p):
    return 0.0, 0.0, 0.0


@compiled
def no_sense(before, x, sensors, duration, p):
    sensors[:] = 0.0


@compiled
def no_settling(x, actuators, sensors, p):
    sensors[:] = 0.0


@compiled
def glider_output(x, actuators, sensors, p, y):
    y[0] = x[0]
    y[1] = x[1] + p.hull.rudder_heading_rate * actuators[0]
    y[2] = x[2]
    y[3] = x[3]


@compiled
def torpedo_derive(vector, derived):
    """Of what the family computes, what the hull alone needs."""
    for i in range(N_PARAMETERS):
        derived[i] = vector[i]
    p = writable_view(derived)
    hull, computed = p.hull, p.computed
    matrix, added = np.empty((6, 6)), np.empty((6, 6))
    fill_rigid_body_mass(hull.mass, hull.x_g, hull.y_g, hull.z_g, hull, computed.rigid_mass)
    fill_added_mass(hull.added_mass, added)
    for i in range(6):
        for j in range(6):
            matrix[i, j] = computed.rigid_mass[i, j] + added[i, j]
            both = 0.5 * hull.coriolis_of_added_mass * (added[i, j] + added[j, i])
            computed.momentum[i, j] = computed.rigid_mass[i, j] + both
    invert(matrix, computed.inverse_mass)


@compiled
def unlimited_step(z, inputs, p):
    return 1.0


@compiled
def polynomial(coefficients, axis, terms):
    """All terms in their order, with |u| times the axis's own velocity in place of u times it."""
    total = 0.0
    for k in range(N_TERMS):
        own = axis > 0 and k == 16 + axis
        total += coefficients[k] * terms[N_TERMS + axis - 1 if own else k]
    return total


@compiled
def drag_of(fin, angle, u, turn, slip):
    return angle * (u * abs(u) * (fin.drag * angle) + u * (fin.drag_rate * turn + fin.drag_slip * slip))


@compiled
def torpedo_derivative(z, actuators, inputs, p, dz, terms):
    """Hull, fins, propeller, weight and buoyancy in still water."""
    u, v, w, roll_rate, q, r = z[0], z[1], z[2], z[3], z[4], z[5]
    hull, computed = p.hull, p.computed
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation_of(z[9], z[10], z[11], z[12])
    fill_terms(u, v, w, roll_rate, q, r, terms)
    x1, x2, x3 = polynomial(hull.surge, 0, terms), polynomial(hull.sway, 1, terms), polynomial(hull.heave, 2, terms)
    x4, x5, x6 = polynomial(hull.roll, 3, terms), polynomial(hull.pitch, 4, terms), polynomial(hull.yaw, 5, terms)
    flow = hull.cross_flow
    drag_y, drag_z = flow.drag_y * flow.height, flow.drag_z * flow.breadth
    sway, heave, pitch, yaw = cross_flow_drag(v, w, q, r, drag_y, drag_z, hull.density, hull.length)
    f1, f2, f3, f4, f5, f6 = coriolis_forces(computed.momentum, u, v, w, roll_rate, q, r)
    g1, g2, g3, g4, g5, g6 = righting(
        hull.mass * hull.gravity, hull.buoyancy,
        hull.x_g, hull.y_g, hull.z_g, hull.x_b, hull.y_b, hull.z_b, r31, r32, r33,
    )  # fmt: skip

    rudder, stern, bow = parts.rudder, parts.stern_plane, parts.bow_plane
    angle_r = angle_of_attack(actuators[0], u, v, r, rudder)
    angle_s = angle_of_attack(actuators[1], u, w, -q, stern)
    angle_b = angle_of_attack(actuators[2], u, w, -q, bow)
    square = u * abs(u)
    x_fins = drag_of(rudder, angle_r, u, r, v) + (drag_of(stern, angle_s, u, q, w) + drag_of(bow, angle_b, u, q, w))
    z_fins = square * (stern.lift * angle_s + bow.lift * angle_b)
    m_fins = square * (stern.moment * angle_s + bow.moment * angle_b)

    law, slip, n = parts.propeller, hull.slipstream, RADPS_PER_RPM * actuators[3]
    thrust = shaft_law(n, u, law.t_nn, law.t_nu) + law.t_cc * actuators[3] * abs(actuators[3])
    thrust += table_thrust(actuators[3], u, law.table)
    torque = shaft_law(n, u, law.q_nn, law.q_nu) + law.torque_arm * thrust
    if slip.c_t1 != 0.0:
        stream = slipstream_speed(n, u, slip.pitch, slip.c_t1)
        x_fins += stream * angle_s * (slip.x_uq_stern * q + slip.x_uw_stern * w + slip.x_uu_stern * u * angle_s)
        z_fins += stream * (slip.z_uq * q + slip.z_uw * w + slip.z_uu_stern * u * angle_s)
        torque += stream * slip.k_up * roll_rate
        m_fins += stream * (slip.m_uq * q + slip.m_uw * w + slip.m_uu_stern * u * angle_s)

    x1 = (x1 + x_fins) + ((f1 + g1) + thrust)
    x2 = (x2 + sway + square * (rudder.lift * angle_r)) + (f2 + g2)
    x3 = (x3 + heave + z_fins) + (f3 + g3)
    x4 = (x4 + torque) + (f4 + g4)
    x5 = (x5 + pitch + m_fins) + (f5 + g5)
    x6 = (x6 + yaw + square * (rudder.moment * angle_r)) + (f6 + g6)
    i = computed.inverse_mass
    for k in range(6):
        dz[k] = (i[k, 0] * x1 + i[k, 1] * x2 + i[k, 2] * x3) + (i[k, 3] * x4 + i[k, 4] * x5 + i[k, 5] * x6)
    dz[6] = r11 * u + r12 * v + r13 * w
    dz[7] = r21 * u + r22 * v + r23 * w
    dz[8] = r31 * u + r32 * v + r33 * w
    e0, e1, e2, e3 = z[9], z[10], z[11], z[12]
    dz[9] = -0.5 * (e1 * roll_rate + e2 * q + e3 * r)
    dz[10] = 0.5 * (e0 * roll_rate - e3 * q + e2 * r)
    dz[11] = 0.5 * (e3 * roll_rate + e0 * q - e1 * r)
    dz[12] = 0.5 * (-e2 * roll_rate + e1 * q + e0 * r)
    dz[13] = 0.0


@compiled
def torpedo_shape(inputs, memory, p, shaped):
    hull = p.hull
    limits = (parts.rudder.limit, parts.stern_plane.limit, parts.bow_plane.limit, parts.propeller.limit)
    for j in range(4):
        shaped[j] = min(max(inputs[j], -limits[j]), limits[j])


@compiled
def torpedo_times(index, p):
    hull = p.hull
    if index == 0:
        return 0.0, parts.rudder.lag, parts.rudder.slowness
    if index == 1:
        return 0.0, parts.stern_plane.lag, parts.stern_plane.slowness
    if index == 2:
        return 0.0, parts.bow_plane.lag, parts.bow_plane.slowness
    return 0.0, parts.propeller.lag, parts.propeller.slowness / parts.propeller.limit


@compiled
def torpedo_output(x, actuators, sensors, p, y):
    y[0], y[1], y[2] = x[9], x[10], x[11]
    y[3], y[4], y[5] = x[3], x[4], x[5]
    for k in range(3):
        y[6 + k] = y[9 + k] = x[k]
        y[12 + k] = x[6 + k]


@compiled
def float_derivative(x, actuators, inputs, p, dx, scratch):
    """Equation (5) in still water of the stated density, or the balance of its drag and lift."""
    hull = p.hull
    piston, neutral = actuators[0], hull.piston_neutral
    square = piston * abs(piston) - neutral * abs(neutral)
    volume = (
        hull.piston_area * (piston - neutral)
        + hull.piston_square / (hull.density * FLOAT_GRAVITY) * square
        + inputs[2]
        + x[2]
        + hull.mass / hull.density * (inputs[3] + inputs[8] * (x[0] - inputs[9]) - hull.density) / hull.density
        - exposed_volume(x[0], hull.waterplane)
    )
    force = -hull.density * FLOAT_GRAVITY * volume
    dx[0] = x[1]
    if hull.quasi_steady != 0.0:
        dx[0] = steady_speed(force, hull.drag_linear, hull.drag_quadratic)
        if x[0] <= 0.0:
            dx[0] = max(dx[0], 0.0)
        dx[1] = (dx[0] - x[1]) / 30.0
    else:
        drag = hull.drag_linear + hull.drag_quadratic * abs(x[1])
        dx[1] = (force - drag * x[1]) / (hull.mass + hull.added_mass)
    dx[2] = 0.0
    dx[3] = 1.0


@compiled
def float_shape(inputs, memory, p, shaped):
    middle = 0.5 * (p.hull.piston_high + p.hull.piston_low)
    half = 0.5 * (p.hull.piston_high - p.hull.piston_low)
    shaped[0] = middle + min(max(inputs[0] - middle, -half), half)
    shaped[1] = inputs[1]


@compiled
def float_times(index, p):
    return 0.0, 0.0, p.hull.piston_slowness if index == 0 else 0.0


@compiled
def float_output(x, actuators, sensors, p, y):
    y[0] = x[0]
    y[1] = x[1]


_HOOKS = {
    "glider": {
        "derivative": glider_derivative,
        "stable_step": glider_stable_step,
        "shape": glider_shape,
        "actuator_times": no_times,
        "output": glider_output,
    },
    "torpedo": {
        "derive": torpedo_derive,
        "derivative": torpedo_derivative,
        "stable_step": unlimited_step,
        "shape": torpedo_shape,
        "actuator_times": torpedo_times,
        "output": torpedo_output,
    },
    "float": {
        "derivative": float_derivative,
        "stable_step": float_stable_step,
        "shape": float_shape,
        "actuator_times": float_times,
        "output": float_output,
    },
}


def bare(family: Family) -> Family:
    """The family without its effects."""
    hooks = {**family.hooks, **_HOOKS[family.kind], "sense": no_sense, "settle_sensors": no_settling}
    return replace(family, name=f"bare_{family.name}", kind=f"bare_{family.kind}", hooks=hooks)
