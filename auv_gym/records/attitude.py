"""Attitudes as quaternions in records: frames, continuity, interpolation, and the resulting angles.

A quaternion (w, x, y, z) rotates vectors from the body axes forward, starboard, down to north, east, down.  It has no
singularity: at a pitch of 90 degrees, heading and roll cannot be separated, but the quaternion is exact.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from auv_gym.channels import wrap

ANGLES: Final = ("roll_rad", "pitch_rad", "heading_rad")
QUATERNION: Final = ("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z")
QUATERNION_ENU_FLU: Final = (
    *("quaternion_enu_flu_w", "quaternion_enu_flu_x", "quaternion_enu_flu_y", "quaternion_enu_flu_z"),
)
STEEP = 1.0  # rad of pitch, above which heading rates are about twice the body's rates, 1/cos(1) = 1.85
_LEAST = 0.5  # norm below which four numbers are an unfilled message instead of an attitude


def from_enu_flu(quaternion: ArrayLike) -> np.ndarray:
    """The same attitudes, (n, 4), converted from ROS axes (REP 103): forward, port, up and east, north, up."""
    from scipy.spatial.transform import Rotation

    enu_to_ned = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    frd_to_flu = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    q = proper(quaternion)
    known = np.isfinite(q).all(axis=1)
    result = np.full(q.shape, np.nan)
    if known.any():
        turned = enu_to_ned * Rotation.from_quat(q[known], scalar_first=True) * frd_to_flu
        result[known] = turned.as_quat(scalar_first=True)
    return continuous(result)


def proper(quaternion: ArrayLike) -> np.ndarray:
    """Quaternions of norm 1, (n, 4); NaN if the norm is far from 1, as in messages without an attitude."""
    q = np.array(quaternion, dtype=float)
    norm = np.linalg.norm(q, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where((norm > _LEAST) & (norm < 1.0 / _LEAST), q / norm, np.nan)


def continuous(quaternion: ArrayLike) -> np.ndarray:
    """The same attitudes, with signs chosen so that each is closest to the previous one; q and -q are one attitude."""
    q = np.array(quaternion, dtype=float)
    known = np.flatnonzero(np.isfinite(q).all(axis=1))
    if known.size > 1:
        turned = np.einsum("ij,ij->i", q[known[1:]], q[known[:-1]]) < 0.0
        sign = np.cumprod(np.r_[1.0, np.where(turned, -1.0, 1.0)])
        q[known] *= sign[:, None]
    return q


def interpolated(at: np.ndarray, time: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Attitudes at other times, (m, 4), along the shortest rotation between neighbours; constant beyond the ends."""
    from scipy.spatial.transform import Rotation, Slerp

    if time.size == 1:
        return np.repeat(quaternion, at.size, axis=0)
    between = Slerp(time, Rotation.from_quat(quaternion, scalar_first=True))
    result = between(np.clip(at, time[0], time[-1])).as_quat(scalar_first=True)
    return continuous(result)


def turns_far(roll: np.ndarray, pitch: np.ndarray) -> bool:
    """Whether attitudes, (n,), leave the region of smooth Euler angles: steep pitch, or jumps of roll.

    Beyond the vertical, roll and heading jump by half a turn; a wrapped angle jumps by a whole turn.
    """
    steep = np.abs(wrap(pitch)) > STEEP
    jumps = np.abs(np.diff(roll)) > 0.5 * np.pi
    return bool(steep.any() or jumps.any())


def from_angles(roll: ArrayLike, pitch: ArrayLike, heading: ArrayLike) -> np.ndarray:
    """Quaternions, (n, 4), of roll, pitch and heading, rad, (n,) each; each is closest to the previous one."""
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_euler("ZYX", np.column_stack([heading, pitch, roll]))
    return continuous(turned.as_quat(scalar_first=True))


def turns(quaternion: np.ndarray) -> np.ndarray:
    """The rotation from each attitude to the next, (n - 1, 3), rad, as rotation vectors about the body axes."""
    from scipy.spatial.transform import Rotation

    attitude = Rotation.from_quat(quaternion, scalar_first=True)
    return (attitude[:-1].inv() * attitude[1:]).as_rotvec()


def unrolled(quaternion: np.ndarray) -> np.ndarray:
    """The sum of all rotations up to each attitude, (n, 3), rad: the integral of error-free gyros."""
    return np.concatenate([np.zeros((1, 3)), np.cumsum(turns(quaternion), axis=0)])


def interpolated_angles(at: np.ndarray, time: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Roll, pitch and heading, (m, 3), at other times along the shortest rotations between rows of a table, (n, 3)."""
    quaternion = interpolated(at, time, from_angles(*table.T))
    return np.unwrap(np.column_stack(angles(quaternion)), axis=0)


def angles(quaternion: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Roll, pitch and heading, rad, (n,) each, of attitudes (n, 4); together they define the attitude again.

    If the bow points straight up or down, roll and heading are each arbitrary; this is the array form of
    `auv_gym.physics.frames.euler_angles_of`.
    """
    w, x, y, z = np.array(quaternion, dtype=float).T
    heading = np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    c, s = np.cos(heading), np.sin(heading)
    r11, r21, r31 = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    r12, r22 = 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z)
    r13, r23 = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
    pitch = np.arctan2(-r31, c * r11 + s * r21)
    roll = np.arctan2(s * r13 - c * r23, c * r22 - s * r12)
    return roll, pitch, heading
