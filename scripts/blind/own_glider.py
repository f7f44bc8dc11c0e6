"""A glider's heading by independent code: equation (11) of Putri et al., with causes outside the library.

Only the coefficients' numbers are shared with the family that it replaces: no compiled physics, no effects.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import ceil, cos, sin

import numpy as np

from auv_gym.plant import Plant
from scripts.blind.disturbances import Sticking, Tripping, lopsided
from scripts.blind.own_forces import stepped

_STEP = 0.2  # s
_GRAVITY = 9.81


@dataclass(frozen=True, eq=False)
class OwnGlider:
    """A glider with the interface that `closed_loop` needs: it steps and reads [heading, yaw rate, north, east].

    State: [psi, r, north, east, time, rudder, whether the drag is tripped].
    """

    given: Plant
    side: float = 0.0  # see `lopsided`
    sticking: Sticking | None = None
    tripping: Tripping | None = None

    def __getattr__(self, name: str):
        if name in ("dt", "hull", "name", "family", "inputs", "outputs"):
            return getattr(self.given, name)
        raise AttributeError(name)

    def initial(self, y0: np.ndarray) -> np.ndarray:
        return np.array([y0[0], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])

    def output(self, x: np.ndarray) -> np.ndarray:
        return x[:4].copy()

    def step(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        x, held = x.copy(), u.copy()
        if self.sticking is not None:
            held[0] = x[5] = self.sticking.position(x[5], u[0], x[4])
        held[0] = lopsided(held[0], self.side)
        count = ceil(self.given.dt / _STEP)
        h = self.given.dt / count
        for _ in range(count):
            if self.tripping is not None:
                x[6] = self.tripping.tripped(bool(x[6]), abs(x[1]))
            y, drag = x[:4], 1.0 if self.tripping is None else self.tripping.factor(bool(x[6]))
            x[:4] = stepped(partial(self._rates, inputs=held, drag=drag), y, h)
            x[4] += h
        return x

    def _rates(self, y: np.ndarray, inputs: np.ndarray, drag: float) -> np.ndarray:
        a = self.given.hull
        rudder, bow, stern, u, w, q, pitch, roll = inputs
        half = 0.5 * a.density * a.length**3
        followed = a.speed + a.speed_scaling * (u - a.speed)
        square = a.speed**2 + a.speed_scaling * (u**2 - a.speed**2)
        damping = a.damping_factor * (half * a.length * (a.n_r * followed + a.n_wr * w) - a.mass * a.x_g * followed)
        moment = (
            drag * damping * y[1]
            + a.rudder_factor * half * square * a.n_delta * rudder
            + a.bow_thruster_arm * bow
            + a.stern_thruster_arm * stern
            + _GRAVITY * (a.y_g * a.mass - a.y_b * a.density * a.volume) * sin(pitch)
            - a.i_xy * q**2
        )
        inertia = a.inertia - half * a.length**2 * a.n_rdot
        yawing = y[1] + a.rudder_heading_rate * rudder
        turning = (q * sin(roll) + yawing * cos(roll)) / cos(pitch)
        ahead, across = u * cos(pitch) + w * sin(pitch) * cos(roll), -w * sin(roll)
        north = ahead * cos(y[0]) - across * sin(y[0])
        east = ahead * sin(y[0]) + across * cos(y[0])
        return np.array([turning, moment / inertia + a.heading_stiffness * y[0], north, east])
