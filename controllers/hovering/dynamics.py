"""Control model of a hovering vehicle: mass, hull resistance, and thruster capability."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import inf

import numpy as np

from auv_gym.plant import Plant, without_effects
from auv_gym.plant.cruise import resting_commands
from controllers.allocation import Allocation

POSE = ("north_m", "east_m", "depth_m", "roll_rad", "pitch_rad", "heading_rad")
RATES = ("p_radps", "q_radps", "r_radps")
OVER_GROUND = ("u_dvl_mps", "v_dvl_mps", "w_dvl_mps")
# s, of the step that gives the acceleration from the change of velocity: rounding error 1e-11, curvature 1e-5
_INSTANT = 1e-5
_SMALL = np.array([0.05, 0.05, 0.05, 0.05, 0.05, 0.05])  # m/s and rad/s, at which damping near rest is computed
_TILT = 0.02  # rad, over which stiffness is computed
_FASTEST = 10.0  # m/s and rad/s


@dataclass(frozen=True, eq=False)
class HoverDynamics:
    """The dynamics of a vehicle without its effects: M dnu/dt = thrusters - resistance(nu, attitude).

    allocation: of its thrusters.
    """

    plant: Plant
    allocation: Allocation

    @cached_property
    def mass(self) -> np.ndarray:
        """Mass and added mass, (6, 6)."""
        return np.array(self._clean.family.view(self._clean.derived).computed.mass)

    def resistance(self, velocity: np.ndarray, roll: float, pitch: float, depth: float = 0.0) -> np.ndarray:
        """The thrusters' wrench that holds a velocity through the water, (6,), at an attitude and a depth.

        It includes damping, Coriolis forces, weight and buoyancy as in the simulator.
        """
        x = self._rest[0].copy()
        x[:6] = velocity
        x[6:12] = 0.0, 0.0, depth, roll, pitch, 0.0
        after = self._clean.step_over(x, self._rest[1], _INSTANT)
        return -self.mass @ (after[:6] - x[:6]) / _INSTANT

    @cached_property
    def damping(self) -> np.ndarray:
        """The damping of each axis near rest, N s/m and N m s, (6,)."""
        sides = [self.resistance(side * step, 0.0, 0.0) for step in np.diag(_SMALL) for side in (1.0, -1.0)]
        slopes = [(sides[2 * i][i] - sides[2 * i + 1][i]) / (2.0 * _SMALL[i]) for i in range(6)]
        return np.maximum(slopes, 0.0)

    @cached_property
    def stiffness(self) -> np.ndarray:
        """The righting moment per angle of each axis, N m/rad, (6,): of roll and pitch."""
        found, still = np.zeros(6), np.zeros(6)
        for i, (roll, pitch) in ((3, (_TILT, 0.0)), (4, (0.0, _TILT))):
            one, other = self.resistance(still, roll, pitch)[i], self.resistance(still, -roll, -pitch)[i]
            found[i] = (one - other) / (2.0 * _TILT)
        return found

    @cached_property
    def authority(self) -> np.ndarray:
        """The largest wrench of the thrusters along each axis alone, in both directions, N and N m, (6,)."""
        low, high = self.allocation.limits
        found = np.zeros(6)
        for i in np.flatnonzero(self.allocation.weights):
            thrusts = self.allocation.inverse(np.eye(6)[i])
            room = np.minimum(np.abs(low), high)
            used = np.abs(thrusts) > 1e-12
            reached = float((self.allocation.matrix @ thrusts)[i])
            found[i] = reached * float((room[used] / np.abs(thrusts[used])).min(initial=inf)) if used.any() else 0.0
        return np.where(np.isfinite(found), found, 0.0)

    def fastest(self, share: float) -> np.ndarray:
        """The velocity along each axis that needs this share of its authority, (6,)."""
        found = np.zeros(6)
        for i in range(6):
            low, high = 0.0, _FASTEST
            for _ in range(40):
                middle = 0.5 * (low + high)
                held = abs(self.resistance(middle * np.eye(6)[i], 0.0, 0.0)[i]) <= share * self.authority[i]
                low, high = (middle, high) if held else (low, middle)
            found[i] = low
        return found

    @cached_property
    def delay(self) -> float:
        """The delay from command to thrust, s: dead time and lag of the slowest thruster."""
        view = self._clean.family.view(self._clean.derived)
        times = [self._clean.family.hooks.actuator_times(i, view) for i in range(len(self._clean.family.actuators))]
        return max(float(dead + lag) for dead, lag, _ in times)

    @cached_property
    def _clean(self) -> Plant:
        return without_effects(self.plant)

    @cached_property
    def _rest(self) -> tuple[np.ndarray, np.ndarray]:
        """A full state at rest, and the inputs there."""
        plant = self._clean
        return plant.initial(np.zeros(len(plant.outputs))), resting_commands(plant)


def rotation(roll: float, pitch: float, heading: float) -> np.ndarray:
    """The rotation matrix from body axes to north, east, down, (3, 3).  Source: Fossen 2021, eq. (2.31)."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    ch, sh = np.cos(heading), np.sin(heading)
    return np.array(
        [
            [ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr],
            [sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def turning(roll: float, pitch: float) -> np.ndarray:
    """The matrix from rates of roll, pitch and heading to body rates, (3, 3).  Source: Fossen 2021, eq. (2.39)."""
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    return np.array([[1.0, 0.0, -sp], [0.0, cr, cp * sr], [0.0, -sr, cp * cr]])
