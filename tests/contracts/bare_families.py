"""Each kind of vehicle without a word about effects, operation by operation: what neutral effects must give."""

from collections.abc import Callable
from dataclasses import replace
from math import cos, exp, sin, sqrt
from typing import Any

import numpy as np

from auv_gym.compiled import bind, compiled, view_as
from auv_gym.param import list_paths
from auv_gym.physics.buoyancy import exposed_volume
from auv_gym.physics.frames import compiled_euler_rates, compiled_velocity_ned, rotation_of
from auv_gym.physics.hydrodynamics import angle_of_attack, cross_flow_drag, righting
from auv_gym.physics.polar import steady_glide
from auv_gym.physics.propulsion import RADPS_PER_RPM, shaft_law, slipstream_speed, table_thrust
from auv_gym.physics.rigid_body import coriolis_forces, fill_rigid_body_mass, invert
from auv_gym.vehicles.body.derived import COMPUTED, N_TERMS, fill_added_mass
from auv_gym.vehicles.body.dynamics import fill_terms
from auv_gym.vehicles.family import Family
from auv_gym.vehicles.glider import GRAVITY, stable_step as glider_stable_step
from auv_gym.vehicles.profiling_float import GRAVITY as FLOAT_GRAVITY, stable_step as float_stable_step, steady_speed


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


# What differs between bodies: the numbers of parameters and of planes or thrusters, how these are commanded, and the
# view of the parameters.
N_PARAMETERS = PLANES = 0
SLOT, MIDDLE, HALF = "", 0.0, 1.0
parameters_view: Any = None
computed_view = view_as(COMPUTED, "bare_computed", writable=True)


def body_derive(vector, derived):
    """Of what the family computes, what the hull alone needs."""
    for i in range(N_PARAMETERS):
        derived[i] = vector[i]
    hull, computed = parameters_view(derived).hull, computed_view(derived[N_PARAMETERS:])
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
def wake_of(fin, stream, angle, u, turn, slip):
    """Axial and cross force and moment of a fin in the wake."""
    law = fin.wake
    axial = stream * angle * (law.drag_rate * turn + law.drag_slip * slip + law.drag * u * angle)
    return axial, stream * (law.lift * u * angle), stream * (law.moment * u * angle)


def body_derivative(z, actuators, inputs, p, dz, terms):
    """Hull, a rudder, planes, a propeller, weight and buoyancy in still water."""
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

    rudder, square = p.parts.surface_yaw[0], u * abs(u)
    angle_r = angle_of_attack(actuators[0], u, v, r, rudder)
    x_planes = z_planes = m_planes = 0.0
    for k in range(PLANES):
        plane = p.parts.surface_pitch[k]
        angle = angle_of_attack(actuators[1 + k], u, w, -q, plane)
        x_planes += drag_of(plane, angle, u, q, w)
        z_planes += square * (plane.lift * angle)
        m_planes += square * (plane.moment * angle)

    law, command = p.parts.propeller[0], actuators[1 + PLANES]
    n = RADPS_PER_RPM * command
    thrust = shaft_law(n, u, law.t_nn, law.t_nu) + law.t_cc * command * abs(command)
    thrust += table_thrust(command, u, law.table)
    torque = shaft_law(n, u, law.q_nn, law.q_nu) + law.torque_arm * thrust

    x1 = (x1 + (drag_of(rudder, angle_r, u, r, v) + x_planes)) + ((f1 + g1) + thrust)
    x2 = (x2 + sway + square * (rudder.lift * angle_r)) + (f2 + g2)
    x3 = (x3 + heave + z_planes) + (f3 + g3)
    x4 = (x4 + torque) + (f4 + g4)
    x5 = (x5 + pitch + m_planes) + (f5 + g5)
    x6 = (x6 + yaw + square * (rudder.moment * angle_r)) + (f6 + g6)
    if law.wake.c_t1 != 0.0:
        stream = slipstream_speed(n, u, law.wake.pitch, law.wake.c_t1)
        x_wake, y_wake, n_wake = wake_of(rudder, stream, angle_r, u, r, v)
        x_planes = z_planes = m_planes = 0.0
        for k in range(PLANES):
            plane = p.parts.surface_pitch[k]
            x_plane, z_plane, m_plane = wake_of(
                plane, stream, angle_of_attack(actuators[1 + k], u, w, -q, plane), u, q, w
            )
            x_planes += x_plane
            z_planes += z_plane
            m_planes += m_plane
        x1 += x_wake + x_planes
        x2 += y_wake
        x3 += z_planes + stream * (law.wake.z_uq * q + law.wake.z_uw * w)
        x4 += stream * law.wake.k_up * roll_rate
        x5 += m_planes + stream * (law.wake.m_uq * q + law.wake.m_uw * w)
        x6 += n_wake
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
def curve_at(share, curve):
    """Linear between the 41 points of a curve, from a command of -1 to 1."""
    at = 20.0 * (share + 1.0)
    i = min(int(at), 39)
    return curve[i] + (at - i) * (curve[i + 1] - curve[i])


def hover_derivative(z, actuators, inputs, p, dz, terms):
    """Hull, thrusters, weight and buoyancy in still water."""
    u, v, w, roll_rate, q, r = z[0], z[1], z[2], z[3], z[4], z[5]
    hull, computed = p.hull, p.computed
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation_of(z[9], z[10], z[11], z[12])
    fill_terms(u, v, w, roll_rate, q, r, terms)
    x1, x2, x3 = polynomial(hull.surge, 0, terms), polynomial(hull.sway, 1, terms), polynomial(hull.heave, 2, terms)
    x4, x5, x6 = polynomial(hull.roll, 3, terms), polynomial(hull.pitch, 4, terms), polynomial(hull.yaw, 5, terms)
    f1, f2, f3, f4, f5, f6 = coriolis_forces(computed.momentum, u, v, w, roll_rate, q, r)
    g1, g2, g3, g4, g5, g6 = righting(
        hull.mass * hull.gravity, hull.buoyancy,
        hull.x_g, hull.y_g, hull.z_g, hull.x_b, hull.y_b, hull.z_b, r31, r32, r33,
    )  # fmt: skip
    t1 = t2 = t3 = t4 = t5 = t6 = -0.0
    parts = getattr(p.parts, SLOT)
    for k in range(PLANES):
        part, share = parts[k], actuators[k]
        thrust = curve_at(share, part.curve) if abs(share) > part.dead_zone else 0.0
        if part.power != 0.0:
            thrust *= (inputs[PLANES] / part.voltage) ** part.power
        size = sqrt(part.to_x * part.to_x + part.to_y * part.to_y + part.to_z * part.to_z)
        x, y, z_ = part.to_x / size, part.to_y / size, part.to_z / size
        t1 += thrust * x
        t2 += thrust * y
        t3 += thrust * z_
        t4 += thrust * (part.y * z_ - part.z * y + part.torque_arm * x)
        t5 += thrust * (part.z * x - part.x * z_ + part.torque_arm * y)
        t6 += thrust * (part.x * y - part.y * x + part.torque_arm * z_)
    x1, x2, x3 = x1 + ((f1 + g1) + t1), x2 + ((f2 + g2) + t2), x3 + ((f3 + g3) + t3)
    x4, x5, x6 = (x4 + t4) + (f4 + g4), (x5 + t5) + (f5 + g5), (x6 + t6) + (f6 + g6)
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


def hover_shape(inputs, memory, p, shaped):
    for k in range(PLANES):
        limit = getattr(p.parts, SLOT)[k].limit
        shaped[k] = min(max((inputs[k] - MIDDLE) / HALF, -limit), limit)


def hover_times(index, p):
    return 0.0, getattr(p.parts, SLOT)[index].lag, getattr(p.parts, SLOT)[index].slowness


def body_shape(inputs, memory, p, shaped):
    shaped[0] = min(max(inputs[0], -p.parts.surface_yaw[0].limit), p.parts.surface_yaw[0].limit)
    for k in range(PLANES):
        limit = p.parts.surface_pitch[k].limit
        shaped[1 + k] = min(max(inputs[1 + k], -limit), limit)
    limit = p.parts.propeller[0].limit
    shaped[1 + PLANES] = min(max(inputs[1 + PLANES], -limit), limit)


def body_times(index, p):
    if index == 0:
        return 0.0, p.parts.surface_yaw[0].lag, p.parts.surface_yaw[0].slowness
    if index <= PLANES:
        return 0.0, p.parts.surface_pitch[index - 1].lag, p.parts.surface_pitch[index - 1].slowness
    return 0.0, p.parts.propeller[0].lag, p.parts.propeller[0].slowness / p.parts.propeller[0].limit


@compiled
def body_output(x, actuators, sensors, p, y):
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


@compiled
def glide_derivative(x, actuators, inputs, p, dx, scratch):
    hull = p.hull
    pressure = hull.density * FLOAT_GRAVITY * max(x[0], 0.0)
    warmer = actuators[1] - hull.temperature
    volume = (
        hull.volume
        + hull.volume * (exp(hull.expansion * warmer - hull.compressibility * pressure) - 1.0)
        + actuators[0]
        + x[4]
        - exposed_volume(x[0], hull.waterplane)
    )
    force = FLOAT_GRAVITY * (inputs[4] * volume - hull.mass)
    polar = (hull.area, hull.drag_0, hull.drag_power, hull.drag_2, hull.lift_1)
    speed, path, _ = steady_glide(force, inputs[2], inputs[4], *polar)
    dx[0] = -speed * sin(path)
    if x[0] <= 0.0:
        dx[0] = max(dx[0], 0.0)
    dx[1] = (dx[0] - x[1]) / 30.0
    dx[2] = speed * cos(path) * cos(inputs[3])
    dx[3] = speed * cos(path) * sin(inputs[3])
    dx[4] = 0.0
    dx[5] = 1.0


@compiled
def glide_shape(inputs, memory, p, shaped):
    rest = p.hull.engine_neutral
    shaped[0] = min(max(rest + (inputs[0] - rest), p.hull.engine_low), p.hull.engine_high)
    shaped[1] = inputs[1]


@compiled
def glide_times(index, p):
    return 0.0, 0.0, p.hull.engine_slowness if index == 0 else 0.0


@compiled
def glide_output(x, actuators, sensors, p, y):
    y[0] = x[0]
    y[1] = x[2]
    y[2] = x[3]


_HOOKS = {
    "glide": {
        "derivative": glide_derivative,
        "shape": glide_shape,
        "actuator_times": glide_times,
        "output": glide_output,
    },
    "glider": {
        "derivative": glider_derivative,
        "stable_step": glider_stable_step,
        "shape": glider_shape,
        "actuator_times": no_times,
        "output": glider_output,
    },
    "float": {
        "derivative": float_derivative,
        "stable_step": float_stable_step,
        "shape": float_shape,
        "actuator_times": float_times,
        "output": float_output,
    },
}


def body_hooks(family: Family) -> dict[str, Callable[..., Any]]:
    """Of a body of one rudder, planes and one propeller."""
    assert family.body is not None
    kinds = [part.found.slot for part in family.body.parts]
    planes = kinds.count("surface_pitch")
    assert kinds == ["surface_yaw", *["surface_pitch"] * planes, "propeller"]
    sizes = {"PLANES": planes, "N_PARAMETERS": len(list_paths(family.parameters()))}
    templates = {
        "derive": body_derive,
        "derivative": body_derivative,
        "shape": body_shape,
        "actuator_times": body_times,
    }
    known = {**sizes, "parameters_view": family.view}
    bound = {hook: bind(template, f"bare_{family.program}", **known) for hook, template in templates.items()}
    return {**bound, "stable_step": unlimited_step, "output": body_output}


def hover_hooks(family: Family) -> dict[str, Callable[..., Any]]:
    """Of a body of thrusters of one form."""
    assert family.body is not None
    (slot,) = {part.found.slot for part in family.body.parts}
    middle, half = (1500.0, 400.0) if slot == "thruster_us" else (0.0, 1.0)
    known = {"PLANES": len(family.body.parts), "SLOT": slot, "MIDDLE": middle, "HALF": half}
    known |= {"N_PARAMETERS": len(list_paths(family.parameters())), "parameters_view": family.view}
    templates = {
        "derive": body_derive,
        "derivative": hover_derivative,
        "shape": hover_shape,
        "actuator_times": hover_times,
    }
    bound = {hook: bind(template, f"bare_{family.program}", **known) for hook, template in templates.items()}
    return {**bound, "stable_step": unlimited_step, "output": body_output}


COMPOSED = {"body": body_hooks, "hover": hover_hooks}


def bare(family: Family) -> Family:
    """The family without its effects."""
    own = COMPOSED[family.kind](family) if family.kind in COMPOSED else _HOOKS[family.kind]
    hooks = replace(family.hooks, **own, sense=no_sense, settle_sensors=no_settling)
    program = f"bare_{family.program or family.kind}"
    return replace(family, name=f"bare_{family.name}", kind=f"bare_{family.kind}", program=program, hooks=hooks)
