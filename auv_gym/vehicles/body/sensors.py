"""Sensor readings of a six-degree-of-freedom vehicle before sampling: lag, misalignment, scale, bias."""

from __future__ import annotations

from math import cos, sin

from auv_gym.compiled import compiled, outlined
from auv_gym.physics.frames import euler_angles_of, quaternion_of, rotation_of, wrapped
from auv_gym.physics.sensors import compass_reading, deviation, lag_error
from auv_gym.physics.water import orbital_velocity


@compiled
def water_velocity(depth, phase, p, r11, r12, r13, r21, r22, r23, r31, r32, r33):
    """Velocity of the water over ground in body axes, m/s, at a depth and a phase of the waves."""
    current = p.effects.current
    below = depth - current.reference_depth
    north = current.north + current.shear_north * below
    east = current.east + current.shear_east * below
    down = current.down
    if p.computed.has_waves != 0.0:
        waves = p.effects.waves
        along, sinking = orbital_velocity(phase, depth, waves, p.hull.gravity)
        north += along * cos(waves.direction)
        east += along * sin(waves.direction)
        down += sinking
    return (
        r11 * north + r21 * east + r31 * down,
        r12 * north + r22 * east + r32 * down,
        r13 * north + r23 * east + r33 * down,
    )


# Sensor states: lag errors of depth, heading, p q r, velocity over ground, velocity through water.
SENSORS = (
    "depth_lag_m",
    "heading_lag_rad",
    *(f"{name}_lag" for name in ("p", "q", "r", "u_dvl", "v_dvl", "w_dvl", "u", "v", "w")),
)


@compiled
def sense(before, z, sensors, duration, p):
    """Update the lag errors in sensors after the vehicle went from `before` to z (integrated states)."""
    if p.computed.has_lag != 0.0:  # otherwise, as usual, the errors are zero and stay zero
        lag_behind(before, z, sensors, duration, p)


@outlined
def lag_behind(before, z, sensors, duration, p):
    """The part of `sense` for sensors with a lag."""
    effects = p.effects
    sensors[0] = lag_error(sensors[0], z[8] - before[8], effects.depth.lag, duration)
    a11, a12, a13, a21, a22, a23, a31, a32, a33 = rotation_of(before[9], before[10], before[11], before[12])
    b11, b12, b13, b21, b22, b23, b31, b32, b33 = rotation_of(z[9], z[10], z[11], z[12])
    _, _, old = euler_angles_of(a11, a12, a13, a21, a22, a23, a31)
    _, _, new = euler_angles_of(b11, b12, b13, b21, b22, b23, b31)
    compass = effects.compass
    turned = wrapped(new - old) + deviation(new, compass) - deviation(old, compass)
    sensors[1] = lag_error(sensors[1], turned, compass.lag, duration)
    for i in range(3):
        sensors[2 + i] = lag_error(sensors[2 + i], z[3 + i] - before[3 + i], effects.gyros.lag, duration)
        sensors[8 + i] = lag_error(sensors[8 + i], z[i] - before[i], effects.dvl_water.lag, duration)
    if effects.dvl_ground.lag > 0.0:
        x0, y0, z0 = water_velocity(before[8], before[13], p, a11, a12, a13, a21, a22, a23, a31, a32, a33)
        x1, y1, z1 = water_velocity(z[8], z[13], p, b11, b12, b13, b21, b22, b23, b31, b32, b33)
        lag = effects.dvl_ground.lag
        sensors[5] = lag_error(sensors[5], z[0] - before[0] + x1 - x0, lag, duration)
        sensors[6] = lag_error(sensors[6], z[1] - before[1] + y1 - y0, lag, duration)
        sensors[7] = lag_error(sensors[7], z[2] - before[2] + z1 - z0, lag, duration)
    else:
        sensors[5] = sensors[6] = sensors[7] = 0.0


@outlined
def settle_sensors(x, actuators, sensors, p):
    """Set the lag errors of a vehicle that has turned and sunk at its present rates for long (kept states)."""
    effects = p.effects
    for i in range(11):
        sensors[i] = 0.0
    if effects.depth.lag > 0.0:
        sinking = -sin(x[10]) * x[0] + cos(x[10]) * (sin(x[9]) * x[1] + cos(x[9]) * x[2]) + effects.current.down
        sensors[0] = -effects.depth.lag * sinking
    compass = effects.compass
    if compass.lag > 0.0:
        level = cos(x[10])
        level = level if abs(level) > 1e-3 else 1e-3
        rate = (sin(x[9]) * x[4] + cos(x[9]) * x[5]) / level
        sensors[1] = -compass.lag * (rate + deviation(x[11] + rate, compass) - deviation(x[11], compass))


@compiled
def turned_and_scaled(a, b, angle, scale):
    """Two horizontal components in the axes of an instrument rotated about the vertical axis, with its scale error."""
    if angle == 0.0:  # not a 1 * a + 0 * b: neutral must not change any bit
        return (1.0 + scale) * a, (1.0 + scale) * b
    c, s = cos(angle), sin(angle)
    return (1.0 + scale) * (c * a + s * b), (1.0 + scale) * (c * b - s * a)


@compiled
def in_mount(a, b, c, mount):
    """A body vector in the axes of a unit that is mounted with roll, pitch and yaw relative to the body."""
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation_of(*quaternion_of(mount.roll, mount.pitch, mount.yaw))
    return r11 * a + r21 * b + r31 * c, r12 * a + r22 * b + r32 * c, r13 * a + r23 * b + r33 * c


@outlined
def attitude_of_mount(roll, pitch, heading, mount):
    """Roll, pitch and heading of such a unit in a vehicle with these angles, from which they continue without jumps."""
    north = rotation_of(*quaternion_of(roll, pitch, heading))
    own = rotation_of(*quaternion_of(mount.roll, mount.pitch, mount.yaw))
    r11 = north[0] * own[0] + north[1] * own[3] + north[2] * own[6]
    r12 = north[0] * own[1] + north[1] * own[4] + north[2] * own[7]
    r13 = north[0] * own[2] + north[1] * own[5] + north[2] * own[8]
    r21 = north[3] * own[0] + north[4] * own[3] + north[5] * own[6]
    r22 = north[3] * own[1] + north[4] * own[4] + north[5] * own[7]
    r23 = north[3] * own[2] + north[4] * own[5] + north[5] * own[8]
    r31 = north[6] * own[0] + north[7] * own[3] + north[8] * own[6]
    new_roll, new_pitch, new_heading = euler_angles_of(r11, r12, r13, r21, r22, r23, r31)
    return roll + wrapped(new_roll - roll), new_pitch, heading + wrapped(new_heading - heading)


@compiled
def output(x, actuators, sensors, p, y):
    """Write the readings [roll pitch heading | p q r | velocity through water, over ground | position] into y."""
    effects = p.effects
    roll, pitch, heading = x[9], x[10], x[11]
    rate_p, rate_q, rate_r = x[3] + sensors[2], x[4] + sensors[3], x[5] + sensors[4]
    mount = effects.mount
    if mount.roll != 0.0 or mount.pitch != 0.0 or mount.yaw != 0.0:
        roll, pitch, heading = attitude_of_mount(roll, pitch, heading, mount)
        rate_p, rate_q, rate_r = in_mount(rate_p, rate_q, rate_r, mount)
    y[0] = roll + effects.inclinometer.roll_bias
    y[1] = pitch + effects.inclinometer.pitch_bias
    y[2] = compass_reading(heading, sensors[1], effects.compass)
    gyros, water, ground = effects.gyros, effects.dvl_water, effects.dvl_ground
    a, b = turned_and_scaled(rate_p, rate_q, gyros.misalignment, gyros.scale)
    y[3], y[4] = a + gyros.bias_p, b + gyros.bias_q
    y[5] = (1.0 + gyros.scale) * rate_r + gyros.bias_r
    a, b = turned_and_scaled(x[0] + sensors[8], x[1] + sensors[9], water.misalignment, water.scale)
    y[6], y[7] = a + water.bias_u, b + water.bias_v
    y[8] = (1.0 + water.scale) * (x[2] + sensors[10]) + water.bias_w
    current = effects.current
    flowing = p.computed.has_moving_water != 0.0 or current.north != 0.0 or current.east != 0.0 or current.down != 0.0
    cx = cy = cz = 0.0
    if flowing:
        e0, e1, e2, e3 = quaternion_of(x[9], x[10], x[11])
        r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation_of(e0, e1, e2, e3)
        cx, cy, cz = water_velocity(x[8], x[12], p, r11, r12, r13, r21, r22, r23, r31, r32, r33)
    a, b = turned_and_scaled(x[0] + cx + sensors[5], x[1] + cy + sensors[6], ground.misalignment, ground.scale)
    y[9], y[10] = a + ground.bias_u, b + ground.bias_v
    y[11] = (1.0 + ground.scale) * (x[2] + cz + sensors[7]) + ground.bias_w
    y[12], y[13] = x[6], x[7]
    y[14] = (1.0 + effects.depth.scale) * (x[8] + sensors[0]) + effects.depth.bias
