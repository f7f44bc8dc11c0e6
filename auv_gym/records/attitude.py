"""Attitudes as quaternions in records: frames, continuity, interpolation, and the angles that follow from them.

A quaternion (w, x, y, z) turns vectors from the body axes forward, starboard, down to north, east, down.  It has no
singularity: heading and roll are not told apart at a pitch of 90 degrees, the quaternion stays exact there.
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
STEEP = 1.0  # rad of pitch, from which on rates of heading are about twice those of the body, 1/cos(1) = 1.85
_LEAST = 0.5  # norm below which four numbers are no attitude, but a message that was never filled in


def from_enu_flu(quaternion: ArrayLike) -> np.ndarray:
    """The same attitudes, (n, 4), from axes forward, port, up and east, north, up, as ROS has them (REP 103)."""
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
    """Quaternions of norm 1, (n, 4); NaN where the norm is far from it, as in messages that hold none."""
    q = np.array(quaternion, dtype=float)
    norm = np.linalg.norm(q, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where((norm > _LEAST) & (norm < 1.0 / _LEAST), q / norm, np.nan)


def continuous(quaternion: ArrayLike) -> np.ndarray:
    """The same attitudes with signs such that each lies next to the one before; q and -q are one attitude."""
    q = np.array(quaternion, dtype=float)
    known = np.flatnonzero(np.isfinite(q).all(axis=1))
    if known.size > 1:
        turned = np.einsum("ij,ij->i", q[known[1:]], q[known[:-1]]) < 0.0
        sign = np.cumprod(np.r_[1.0, np.where(turned, -1.0, 1.0)])
        q[known] *= sign[:, None]
    return q


def interpolated(at: np.ndarray, time: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Attitudes at other times, (m, 4), along the shortest turn between neighbours; the ends are held."""
    from scipy.spatial.transform import Rotation, Slerp

    if time.size == 1:
        return np.repeat(quaternion, at.size, axis=0)
    between = Slerp(time, Rotation.from_quat(quaternion, scalar_first=True))
    result = between(np.clip(at, time[0], time[-1])).as_quat(scalar_first=True)
    return continuous(result)


def turns_far(roll: np.ndarray, pitch: np.ndarray) -> bool:
    """Whether attitudes, (n,), leave the region in which Euler angles go on smoothly: steep pitch, or roll that jumps.

    Past the vertical roll and heading jump by half a turn, and an angle that is wrapped by a whole one.
    """
    steep = np.abs(wrap(pitch)) > STEEP
    jumps = np.abs(np.diff(roll)) > 0.5 * np.pi
    return bool(steep.any() or jumps.any())


def from_angles(roll: ArrayLike, pitch: ArrayLike, heading: ArrayLike) -> np.ndarray:
    """Quaternions, (n, 4), of roll, pitch and heading, rad, (n,) each; each lies next to the one before."""
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_euler("ZYX", np.column_stack([heading, pitch, roll]))
    return continuous(turned.as_quat(scalar_first=True))


def turns(quaternion: np.ndarray) -> np.ndarray:
    """The turn from each attitude to the next, (n - 1, 3), rad, as rotation vectors about the body axes."""
    from scipy.spatial.transform import Rotation

    attitude = Rotation.from_quat(quaternion, scalar_first=True)
    return (attitude[:-1].inv() * attitude[1:]).as_rotvec()


def unrolled(quaternion: np.ndarray) -> np.ndarray:
    """The sum of all turns up to each attitude, (n, 3), rad: what gyros without errors would integrate to."""
    return np.concatenate([np.zeros((1, 3)), np.cumsum(turns(quaternion), axis=0)])


def interpolated_angles(at: np.ndarray, time: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Roll, pitch and heading, (m, 3), at other times along the shortest turns between rows of a table, (n, 3)."""
    quaternion = interpolated(at, time, from_angles(*table.T))
    return np.unwrap(np.column_stack(angles(quaternion)), axis=0)


def angles(quaternion: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Roll, pitch and heading, rad, (n,) each, of attitudes (n, 4); together they give the attitude back.

    Where the bow points straight up or down, each of roll and heading alone is arbitrary; see
    `auv_gym.physics.frames.euler_angles_of`, of which this is the form for arrays.
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
