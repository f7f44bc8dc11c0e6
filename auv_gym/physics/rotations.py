"""Rotation vectors about body axes, and attitudes relative to a reference attitude.

A rotation vector, rad, points along the axis of a rotation and its length is the angle.  Relative to a reference R, an
attitude A is the rotation vector of R^T A: near R, its components are small rotations about the bow, starboard and
downward axes, wherever the bow points.  Errors of attitude sensors are about the level axes and the vertical.
Quaternions are [eta, e1, e2, e3] as in `frames`.
Source: Sola 2017, "Quaternion kinematics for the error-state Kalman filter", eqs. (101) and (105).
"""

from math import atan2, cos, sin, sqrt

from auv_gym.compiled import compiled, outlined
from auv_gym.physics.frames import euler_angles_of, quaternion_of, rotation_of


@compiled
def turned(e0, e1, e2, e3, a, b, c):
    """The attitude of a quaternion after a rotation by a vector [a b c] about its own axes."""
    half = 0.5 * sqrt(a * a + b * b + c * c)
    share = 0.5 * sin(half) / half if half > 0.0 else 0.5
    f0, f1, f2, f3 = cos(half), share * a, share * b, share * c
    return (
        e0 * f0 - e1 * f1 - e2 * f2 - e3 * f3,
        e0 * f1 + e1 * f0 + e2 * f3 - e3 * f2,
        e0 * f2 - e1 * f3 + e2 * f0 + e3 * f1,
        e0 * f3 + e1 * f2 - e2 * f1 + e3 * f0,
    )


@compiled
def turn_between(e0, e1, e2, e3, f0, f1, f2, f3):
    """The rotation vector, of at most half a turn, from the first attitude to the second."""
    d0 = e0 * f0 + e1 * f1 + e2 * f2 + e3 * f3
    d1 = e0 * f1 - e1 * f0 - e2 * f3 + e3 * f2
    d2 = e0 * f2 + e1 * f3 - e2 * f0 - e3 * f1
    d3 = e0 * f3 - e1 * f2 + e2 * f1 - e3 * f0
    if d0 < 0.0:  # q and -q are one attitude
        d0, d1, d2, d3 = -d0, -d1, -d2, -d3
    size = sqrt(d1 * d1 + d2 * d2 + d3 * d3)
    scale = 2.0 * atan2(size, d0) / size if size > 0.0 else 2.0
    return scale * d1, scale * d2, scale * d3


@outlined
def into_chart(reference, attitude):
    """Convert roll, pitch and heading, (3,), to the rotation vector from a reference quaternion, (4,), in place."""
    f0, f1, f2, f3 = quaternion_of(attitude[0], attitude[1], attitude[2])
    e0, e1, e2, e3 = reference[0], reference[1], reference[2], reference[3]
    attitude[0], attitude[1], attitude[2] = turn_between(e0, e1, e2, e3, f0, f1, f2, f3)


@outlined
def into_level_chart(reference, attitude):
    """Like `into_chart`, but about the level axes ahead and to starboard of the reference, and about the vertical.

    An inclinometer measures the first two of these and a compass the third, however far the vehicle is tilted.
    """
    into_chart(reference, attitude)
    r11, r12, r13, r21, r22, r23, r31, r32, r33 = rotation_of(reference[0], reference[1], reference[2], reference[3])
    a, b, c = attitude[0], attitude[1], attitude[2]
    north, east = r11 * a + r12 * b + r13 * c, r21 * a + r22 * b + r23 * c
    heading = atan2(r21, r11)
    ch, sh = cos(heading), sin(heading)
    attitude[0], attitude[1] = ch * north + sh * east, ch * east - sh * north
    attitude[2] = r31 * a + r32 * b + r33 * c


@outlined
def out_of_chart(reference, attitude):
    """Convert a rotation vector from a reference quaternion, (4,), to roll, pitch and heading, in place."""
    e0, e1, e2, e3 = reference[0], reference[1], reference[2], reference[3]
    f0, f1, f2, f3 = turned(e0, e1, e2, e3, attitude[0], attitude[1], attitude[2])
    r11, r12, r13, r21, r22, r23, r31, _, _ = rotation_of(f0, f1, f2, f3)
    attitude[0], attitude[1], attitude[2] = euler_angles_of(r11, r12, r13, r21, r22, r23, r31)
