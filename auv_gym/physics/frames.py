"""Attitude: unit quaternions inside an integration step, Euler angles (roll, pitch, heading) between steps.

Quaternions [eta, e1, e2, e3] rotate body axes into north-east-down.  Source: Fossen 2021, sec. 2.2.  `velocity_ned` and
`euler_rates` convert body velocities and rates with a measured attitude, for floats and arrays alike.
"""

from math import atan2, cos, floor, pi, sin

import numpy as np

from auv_gym.compiled import compiled


def velocity_ned(u, v, w, roll, pitch, heading):
    """A body vector in north, east, down.  Source: Fossen 2021, eq. (2.31)."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    ch, sh = np.cos(heading), np.sin(heading)
    level, athwart, down = cp * u + sp * (sr * v + cr * w), cr * v - sr * w, cp * (sr * v + cr * w) - sp * u
    return ch * level - sh * athwart, sh * level + ch * athwart, down


@compiled
def body_axes_of(north, east, down, roll, pitch, heading):
    """A vector of north, east, down in body axes.  Source: Fossen 2021, eq. (2.31), transposed."""
    cr, sr, cp, sp = cos(roll), sin(roll), cos(pitch), sin(pitch)
    ch, sh = cos(heading), sin(heading)
    level, athwart = ch * north + sh * east, ch * east - sh * north
    below = sp * level + cp * down
    return cp * level - sp * down, cr * athwart + sr * below, cr * below - sr * athwart


def euler_rates(p, q, r, roll, pitch):
    """Rates of roll, pitch and heading, rad/s; infinite at the vertical.  Source: Fossen 2021, eq. (2.40)."""
    cr, sr = np.cos(roll), np.sin(roll)
    turning = sr * q + cr * r
    return p + np.tan(pitch) * turning, cr * q - sr * r, turning / np.cos(pitch)


compiled_velocity_ned = compiled(velocity_ned)
compiled_euler_rates = compiled(euler_rates)


@compiled
def wrapped(angle):
    """The angle in [-pi, pi), rad."""
    return angle - 2.0 * pi * floor((angle + pi) / (2.0 * pi))


@compiled
def quaternion_of(roll, pitch, heading):
    """The unit quaternion of Euler angles in the order heading, pitch, roll.  Source: Fossen 2021, eq. (2.85)."""
    cr, sr = cos(0.5 * roll), sin(0.5 * roll)
    cp, sp = cos(0.5 * pitch), sin(0.5 * pitch)
    ch, sh = cos(0.5 * heading), sin(0.5 * heading)
    return (
        ch * cp * cr + sh * sp * sr,
        ch * cp * sr - sh * sp * cr,
        ch * sp * cr + sh * cp * sr,
        sh * cp * cr - ch * sp * sr,
    )


@compiled
def rotation_of(eta, e1, e2, e3):
    """The nine entries, by rows, of the rotation from body axes to north-east-down; the norm may be slightly off 1.

    Source: Fossen 2021, eq. (2.69), divided by the squared norm, so that an integrator's drift does not stretch it.
    """
    s = 2.0 / (eta * eta + e1 * e1 + e2 * e2 + e3 * e3)
    return (
        1.0 - s * (e2 * e2 + e3 * e3),
        s * (e1 * e2 - e3 * eta),
        s * (e1 * e3 + e2 * eta),
        s * (e1 * e2 + e3 * eta),
        1.0 - s * (e1 * e1 + e3 * e3),
        s * (e2 * e3 - e1 * eta),
        s * (e1 * e3 - e2 * eta),
        s * (e2 * e3 + e1 * eta),
        1.0 - s * (e1 * e1 + e2 * e2),
    )


@compiled
def euler_angles_of(r11, r12, r13, r21, r22, r23, r31):
    """Roll, pitch and heading of a rotation, rad; together they reproduce it even if the bow points straight down.

    In that case heading and roll are about the same axis and each alone is arbitrary: roll is relative to the heading
    found.
    """
    heading = atan2(r21, r11)
    ch, sh = cos(heading), sin(heading)
    pitch = atan2(-r31, ch * r11 + sh * r21)
    roll = atan2(sh * r13 - ch * r23, ch * r22 - sh * r12)
    return roll, pitch, heading
