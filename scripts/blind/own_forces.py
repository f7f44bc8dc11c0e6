"""Forces by independent code, from the numbers of coefficients: on any hull, and on a torpedo's fins and propeller.

Sources: Fossen 2021, eqs. (2.31), (2.39), (3.49), (4.6), (6.1), sec. 9.7; Healey and Lienard 1993 (cross flow,
slipstream).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from math import atan2, cos, pi, sin, sqrt, tan
from typing import Any

import numpy as np

from auv_gym.plant import Plant

_AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
_SYMBOLS = "uvwpqr"
DAMPING = {
    f"hull.{axis}.{term}" for axis, r in zip(_AXES, _SYMBOLS, strict=True) for term in (r, f"{r}_{r}")
}  # of each axis by its own velocity
_STATIONS = np.linspace(-0.5, 0.5, 11)


def stepped(rates: Callable[[np.ndarray], np.ndarray], x: np.ndarray, h: float) -> np.ndarray:
    """A state `h` s later, by the fourth-order Runge-Kutta method."""
    k1 = rates(x)
    k2 = rates(x + 0.5 * h * k1)
    k3 = rates(x + 0.5 * h * k2)
    return x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rates(x + h * k3))


@dataclass(frozen=True, eq=False)
class Hull:
    """A vehicle in numbers: mass matrices (6, 6), polynomials (6, n) over products of two velocities, and the tree."""

    tree: Any
    parts: Any
    inverse: np.ndarray
    momentum: np.ndarray
    coefficients: np.ndarray
    first: np.ndarray
    second: np.ndarray
    bent: np.ndarray  # where the second factor is an absolute value
    linear: np.ndarray  # where there is no second factor
    gravity_at: np.ndarray
    buoyancy_at: np.ndarray

    @classmethod
    def of(cls, plant: Plant) -> Hull:
        tree = plant.hull
        x, y, z = tree.x_g, tree.y_g, tree.z_g
        lever = skew(x, y, z)
        rigid = np.zeros((6, 6))
        rigid[:3, :3] = tree.mass * np.eye(3)
        rigid[:3, 3:], rigid[3:, :3] = -tree.mass * lever, tree.mass * lever
        rigid[3:, 3:] = np.diag([tree.i_xx, tree.i_yy, tree.i_zz])
        for (i, j), value in {(3, 4): tree.i_xy, (3, 5): tree.i_xz, (4, 5): tree.i_yz}.items():
            rigid[i, j] = rigid[j, i] = -value
        added = np.zeros((6, 6))
        for field in fields(tree.added_mass):
            force, motion = field.name[0], field.name[2]
            added["xyzkmn".index(force), _SYMBOLS.index(motion)] = -getattr(tree.added_mass, field.name)
        used = sorted(
            {f.name for axis in _AXES for f in fields(getattr(tree, axis)) if getattr(getattr(tree, axis), f.name)}
        )
        letters = [name.replace("_", "") for name in used]
        return cls(
            tree=tree,
            parts=plant.parts,
            inverse=np.linalg.inv(rigid + added),
            momentum=rigid + 0.5 * tree.coriolis_of_added_mass * (added + added.T),
            coefficients=np.array([[getattr(getattr(tree, axis), name) for name in used] for axis in _AXES]),
            first=np.array([_SYMBOLS.index(name[0]) for name in letters]),
            second=np.array([_SYMBOLS.index(name[-1]) for name in letters]),
            bent=np.array(["_" in name for name in used]),
            linear=np.array([len(name) == 1 for name in letters]),
            gravity_at=np.array([x, y, z]),
            buoyancy_at=np.array([tree.x_b, tree.y_b, tree.z_b]),
        )

    def force(self, nu: np.ndarray, angles: np.ndarray, fins: np.ndarray, drag: float) -> np.ndarray:
        """Force and moment on a torpedo at a velocity ahead through the water, (6,).

        fins: rudder, stern plane, propulsion command.  Otherwise as in `water`.
        """
        return self.water(nu, angles, drag) + self._fins(nu, fins) + self._drive(nu, fins)

    def water(self, nu: np.ndarray, angles: np.ndarray, drag: float = 1.0) -> np.ndarray:
        """Force and moment of water and weight on the hull at a velocity through the water, (6,).

        angles: roll, pitch, heading.  drag: factor of surge damping.
        """
        other = nu[self.second]
        other = np.where(self.linear, 1.0, np.where(self.bent, np.abs(other), other))
        total = self.coefficients @ (nu[self.first] * other)
        if drag != 1.0:
            total[0] += (drag - 1.0) * self.tree.surge.u_u * nu[0] * abs(nu[0])
        moment = self.momentum @ nu
        total[:3] -= cross(nu[3:], moment[:3])
        total[3:] -= cross(nu[3:], moment[3:]) + cross(nu[:3], moment[:3])
        return total + self._weight(angles) + self._cross_flow(nu)

    def _weight(self, angles: np.ndarray) -> np.ndarray:
        t, (roll, pitch, _) = self.tree, angles
        down = np.array([-sin(pitch), cos(pitch) * sin(roll), cos(pitch) * cos(roll)])
        weight = t.mass * t.gravity
        arm = weight * self.gravity_at - t.buoyancy * self.buoyancy_at
        return np.concatenate([(weight - t.buoyancy) * down, cross(arm, down)])

    def _cross_flow(self, nu: np.ndarray) -> np.ndarray:
        flow, density = self.tree.cross_flow, self.tree.density
        if flow.drag_y == 0.0 and flow.drag_z == 0.0:
            return np.zeros(6)
        x = _STATIONS * self.tree.length
        across, down = nu[1] + x * nu[5], nu[2] - x * nu[4]
        speed = np.maximum(np.hypot(across, down), 1e-300)
        share = flow.drag_y * flow.height * across**2 + flow.drag_z * flow.breadth * down**2
        share *= 0.5 * density * (x[1] - x[0]) / speed
        side, lift = share * across, share * down
        return np.array([0.0, -side.sum(), -lift.sum(), 0.0, x @ lift, -(x @ side)])

    def _fins(self, nu: np.ndarray, fins: np.ndarray) -> np.ndarray:
        u, v, w, _, q, r = nu
        total = np.zeros(6)
        for fin, angle, slip, turn, swing in (
            (self.parts.rudder, fins[0], v, r, r),
            (self.parts.stern_plane, fins[1], w, -q, q),
        ):
            if fin.inflow != 0.0:
                flow = fin.inflow * atan2(slip + fin.station * turn, abs(u))
                angle = angle - flow if fin.lift * u > 0.0 else angle + flow
            angle = min(max(angle, -fin.stall), fin.stall)
            square = u * abs(u)
            total[0] += angle * (square * fin.drag * angle + u * (fin.drag_rate * swing + fin.drag_slip * slip))
            at = (1, 5) if fin is self.parts.rudder else (2, 4)
            total[at[0]] += square * fin.lift * angle
            total[at[1]] += square * fin.moment * angle
        return total

    def _drive(self, nu: np.ndarray, fins: np.ndarray) -> np.ndarray:
        law, u, command = self.parts.propeller, nu[0], fins[2]
        n = command * pi / 30.0
        thrust = law.t_nn * n * abs(n) + law.t_nu * abs(n) * u + law.t_cc * command * abs(command)
        torque = law.q_nn * n * abs(n) + law.q_nu * abs(n) * u + law.torque_arm * thrust
        total = np.array([thrust, 0.0, 0.0, torque, 0.0, 0.0])
        slip, plane = law.wake, self.parts.stern_plane.wake
        if slip.c_t1 == 0.0:
            return total
        drive = slip.pitch * n  # u times eta
        loading = sqrt(max(slip.c_t1 * drive * abs(drive) * np.sign(u) + u * u, 0.0))
        stream = -u + np.sign(n) * (loading - abs(u)) / (sqrt(slip.c_t1 + 1.0) - 1.0)
        _, _, w, p, q, _ = nu
        angle = fins[1]
        total[0] += stream * angle * (plane.drag_rate * q + plane.drag_slip * w + plane.drag * u * angle)
        total[2] += stream * (slip.z_uq * q + slip.z_uw * w + plane.lift * u * angle)
        total[3] += stream * slip.k_up * p
        total[4] += stream * (slip.m_uq * q + slip.m_uw * w + plane.moment * u * angle)
        return total


def turned(angles: np.ndarray) -> np.ndarray:
    """Rotation from body to north, east, down at roll, pitch and heading, (3, 3).  Source: Fossen 2021, eq. (2.31)."""
    (a, b, c), (d, e, f) = np.cos(angles), np.sin(angles)
    return np.array(
        [
            [c * b, c * e * d - f * a, c * e * a + f * d],
            [f * b, f * e * d + c * a, f * e * a - c * d],
            [-e, b * d, b * a],
        ]
    )


def angle_rates(angles: np.ndarray, spin: np.ndarray) -> tuple[float, float, float]:
    """Rates of roll, pitch and heading at body rates p, q, r.  Source: Fossen 2021, eq. (2.39)."""
    (roll, pitch, _), (p, q, r) = angles, spin
    return (
        p + (sin(roll) * q + cos(roll) * r) * tan(pitch),
        cos(roll) * q - sin(roll) * r,
        (sin(roll) * q + cos(roll) * r) / cos(pitch),
    )


def skew(x: float, y: float, z: float) -> np.ndarray:
    """The matrix of the cross product with [x y z] from the left, (3, 3)."""
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b, shape (3,), ten times as fast as numpy's own."""
    (a1, a2, a3), (b1, b2, b3) = a.tolist(), b.tolist()
    return np.array([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1])
