"""Heading dynamics of an underwater glider: yaw by a rudder and two tunnel thrusters.

Source: Putri, Latifa, Trilaksono and Hidayat, "Modelling and Identification of Underwater Glider for Heading Angle
Correction": equations (1), (2), (11), (14), (15).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

from auv_gym.compiled import compiled, view_as
from auv_gym.effects import GliderEffects
from auv_gym.param import list_paths, param, part, record_type
from auv_gym.physics.actuators import shape_command
from auv_gym.physics.discovered import N_YAW, any_term, discovered_yaw_moment
from auv_gym.physics.frames import compiled_euler_rates, compiled_velocity_ned
from auv_gym.physics.sensors import compass_reading, deviation, lag_error
from auv_gym.vehicles.family import Family, RightHandSide, copied, registered


@dataclass(frozen=True)
class GliderHull:
    """Coefficients of equation (11), made nondimensional by D_n = rho L^n / 2, and of its correction (15)."""

    density: float = param(1000.0, "kg/m^3", "water density", bounds=(900.0, 1100.0))
    length: float = param(2.0, "m", "length", bounds=(0.1, 20.0))
    mass: float = param(92.8, "kg", "mass", bounds=(1.0, 1e4))
    inertia: float = param(26.574, "kg m^2", "yaw inertia I_z", bounds=(0.01, 1e5))
    n_rdot: float = param(7.275e-4, "1", "added yaw inertia N_rdot", bounds=(-0.1, 0.1))
    n_r: float = param(-0.0170, "1", "yaw damping N_r", bounds=(-0.1, -1e-6), probe=1e-3)
    n_delta: float = param(-0.0158, "1", "rudder effectiveness N_dr", bounds=(-1.0, 1.0), probe=1e-3)
    n_wr: float = param(0.0, "1", "yaw damping from heave N_wr", bounds=(-2.0, 2.0))
    speed: float = param(0.3, "m/s", "nominal forward speed", bounds=(0.01, 5.0))
    speed_scaling: float = param(
        1.0, "1", "share of rudder and damping that follows the measured speed", bounds=(0.0, 1.0)
    )
    bow_thruster_arm: float = param(0.917, "m", "lever of the bow thruster L_t1", bounds=(-10.0, 10.0))
    stern_thruster_arm: float = param(0.748, "m", "lever of the stern thruster L_t2", bounds=(-10.0, 10.0))
    rudder_limit: float = param(0.5236, "rad", "rudder stop", bounds=(0.01, 1.6))
    x_g: float = param(0.0, "m", "centre of gravity, forward x_G", bounds=(-5.0, 5.0))
    y_g: float = param(0.0, "m", "centre of gravity, starboard y_G", bounds=(-1.0, 1.0))
    y_b: float = param(0.0, "m", "centre of buoyancy, starboard y_B", bounds=(-1.0, 1.0))
    volume: float = param(0.0928, "m^3", "displaced volume V_v", bounds=(1e-4, 100.0))
    i_xy: float = param(0.0, "kg m^2", "product of inertia I_xy", bounds=(-1e3, 1e3))
    heading_stiffness: float = param(0.0, "1/s^2", "K_y1 of equation (15)", bounds=(-1.0, 1.0))
    damping_factor: float = param(1.0, "1", "K_y2 of equation (15)", bounds=(0.0, 100.0))
    rudder_heading_rate: float = param(0.0, "1/s", "K_y3 of equation (15)", bounds=(-10.0, 10.0))
    rudder_factor: float = param(1.0, "1", "K_y4 of equation (15)", bounds=(-100.0, 100.0))


@dataclass(frozen=True)
class GliderParameters:
    """The parameter tree of a glider's heading."""

    hull: GliderHull = part(GliderHull)
    effects: GliderEffects = part(GliderEffects)


GRAVITY = 9.81


@compiled
def yaw_inertia(hull):
    """Yaw inertia I_z - D5 N_rdot, kg m^2; the minus with a positive N_rdot is printed so in the paper."""
    return hull.inertia - 0.5 * hull.density * hull.length**5 * hull.n_rdot


@compiled
def linear_yaw_coefficients(hull):
    """The two coefficients of the linear form (14): damping of r, 1/s, and rudder, 1/s^2, at the nominal speed."""
    d3 = 0.5 * hull.density * hull.length**3
    d4 = d3 * hull.length
    inertia = yaw_inertia(hull)
    return d4 * hull.n_r * hull.speed / inertia, d3 * hull.n_delta * hull.speed**2 / inertia


@compiled
def yaw_rate(r, rudder, hull):
    """Body yaw rate, rad/s, as a gyro measures it: r, and with (15) also a rudder term."""
    return r + hull.rudder_heading_rate * rudder


@compiled
def linear_damping(inputs, p):
    """The factor of r in equation (11), N m s, with K_y2 of (15)."""
    hull = p.hull
    u = hull.speed + hull.speed_scaling * (inputs[3] - hull.speed)
    d4 = 0.5 * hull.density * hull.length**3 * hull.length
    return hull.damping_factor * (d4 * (hull.n_r * u + hull.n_wr * inputs[4]) - hull.mass * hull.x_g * u)


@compiled
def stable_step(x, inputs, p):
    """The longest RK4 step, s, that keeps the damped yaw rate stable with a margin of two in the limit of 2.78."""
    damping = abs(linear_damping(inputs, p)) + 2.0 * p.effects.yaw.quadratic_damping * abs(x[1])
    return 1.4 * yaw_inertia(p.hull) / (damping + 1e-12)


@compiled
def derivative(x, actuators, inputs, p, dx, scratch):
    """State derivative of [psi, r, north, east] into dx: equations (1), (2), (11), and (15) if its factors are set.

    inputs: [rudder_rad, F_t1 N, F_t2 N, u m/s, w m/s, q rad/s, theta rad, phi rad], held over a sample, so the term m
    y_G du/dt of (11) vanishes. u is through the water along the body's axis; `hull.speed_scaling` sets its influence in
    (11).  Roll is zero in (11); the effect `yaw.roll_moment` adds the influence of a roll angle.
    Equations (1) and (2) are for a level glider; a pitched or rolled one moves and turns by the full rotation.
    """
    hull = p.hull
    yaw = p.effects.yaw
    psi = x[0]
    r = x[1]
    rudder = actuators[0]
    u = inputs[3]
    d3 = 0.5 * hull.density * hull.length**3
    u_squared = hull.speed**2 + (hull.speed_scaling + yaw.speed_squared) * (u**2 - hull.speed**2)
    rudder_moment = d3 * u_squared * hull.n_delta * rudder
    weight_moment = GRAVITY * (hull.y_g * hull.mass - hull.y_b * hull.density * hull.volume)
    if weight_moment != 0.0:  # the usual case is zero, without trigonometry
        weight_moment *= sin(inputs[6])
    moment = (
        linear_damping(inputs, p) * r
        + hull.rudder_factor * rudder_moment
        + hull.bow_thruster_arm * inputs[1]
        + hull.stern_thruster_arm * inputs[2]
        + weight_moment
        - hull.i_xy * inputs[5] ** 2
        + yaw.moment
        + yaw.roll_moment * inputs[7]
        - yaw.quadratic_damping * abs(r) * r
    )
    found = p.effects.discovered.yaw
    if any_term(found, N_YAW):
        moment += discovered_yaw_moment(found, psi, r, rudder, inputs)
    turning = yaw_rate(r, rudder, hull)
    if inputs[6] == 0.0 and inputs[7] == 0.0:  # level, as without a measured attitude: without trigonometry
        north, east = u * cos(psi), u * sin(psi)
    else:
        north, east, _ = compiled_velocity_ned(u, 0.0, inputs[4], inputs[7], inputs[6], psi)
        _, _, turning = compiled_euler_rates(0.0, inputs[5], turning, inputs[7], inputs[6])
    dx[0] = turning
    dx[1] = moment / yaw_inertia(hull) + hull.heading_stiffness * psi
    dx[2] = north + p.effects.current.north
    dx[3] = east + p.effects.current.east


@compiled
def shape(inputs, memory, p, shaped):
    """Write the rudder command after its memoryless effects, backlash and stiction into shaped; updates memory."""
    shaped[0], memory[0] = shape_command(inputs[0], memory[0], p.hull.rudder_limit, p.effects.rudder)


@compiled
def actuator_times(index, p):
    """Dead time s, lag s and slowness s/rad of an actuator; there is one, the rudder."""
    rudder = p.effects.rudder
    return rudder.dead_time, rudder.lag, rudder.slowness


@compiled
def sense(before, x, sensors, duration, p):
    """Update the sensors' states [compass lag error] after the vehicle went from `before` to `x`."""
    compass = p.effects.compass
    if compass.lag <= 0.0:  # the usual case, without trigonometry
        sensors[0] = 0.0
        return
    change = x[0] + deviation(x[0], compass) - (before[0] + deviation(before[0], compass))
    sensors[0] = lag_error(sensors[0], change, compass.lag, duration)


@compiled
def settle_sensors(x, actuators, sensors, p):
    """Set the sensors' states of a level vehicle that has turned at its present rate for long."""
    compass = p.effects.compass
    rate = yaw_rate(x[1], actuators[0], p.hull)
    change = deviation(x[0] + rate, compass) - deviation(x[0], compass) + rate
    sensors[0] = -compass.lag * change


@compiled
def output(x, actuators, sensors, p, y):
    """Write the outputs [compass heading, yaw rate, north, east] into y."""
    y[0] = compass_reading(x[0], sensors[0], p.effects.compass)
    y[1] = yaw_rate(x[1], actuators[0], p.hull)
    y[2] = x[2]
    y[3] = x[3]


def inertia_problem(parameters: GliderParameters) -> str:
    """The problem of the yaw inertia, or nothing."""
    hull = parameters.hull
    if hull.inertia <= 0.5 * hull.density * hull.length**5 * hull.n_rdot:
        return "hull.inertia minus the added inertia D5 N_rdot must be positive"
    return ""


GLIDER = Family(
    name="glider",
    kind="glider",
    title="heading of an underwater glider",
    parameters=GliderParameters,
    inputs=(
        "rudder_rad",
        "bow_thruster_N",
        "stern_thruster_N",
        "u_mps",
        "w_mps",
        "q_radps",
        "pitch_rad",
        "roll_rad",
    ),
    constants={"u_mps": "hull.speed"},
    required=("rudder_rad",),
    states=("heading_rad", "r_radps", "north_m", "east_m"),
    integrated=4,
    derived=len(list_paths(GliderParameters())),
    problem=inertia_problem,
    actuators=("rudder_rad",),
    sensors=("heading_lag_rad",),
    outputs=("heading_rad", "r_radps", "north_m", "east_m"),
    coefficients=("hull.n_r", "hull.n_delta"),
    twins={"effects.rudder.gain": "hull.n_delta"},
    view=view_as(record_type(GliderParameters), "glider"),
    hooks=RightHandSide(
        derivative=derivative,
        stable_step=stable_step,
        shape=shape,
        actuator_times=actuator_times,
        sense=sense,
        settle_sensors=settle_sensors,
        output=output,
        enter=copied,
        leave=copied,
        derive=copied,
    ),
)
registered(GLIDER)
