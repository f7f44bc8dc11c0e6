"""PID control of a hovering vehicle's pose by a wrench in body axes, with model-based feedforward."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from typing import NamedTuple

import numpy as np

from controllers.allocation import AXES
from controllers.composed.allocated import SHORT
from controllers.controller import check_targets, time_step
from controllers.hovering.dynamics import OVER_GROUND, POSE, RATES, HoverDynamics, rotation, turning
from controllers.hovering.reference import Pace, Way
from controllers.tracking import error_of

_TWO_SAMPLES = 2.0  # over which differences of positions are smoothed if no sensor measures speed


class HoverState(NamedTuple):
    """Memory of a HoverPid: the reference, integrals, and the last pose and its rates.

    force: N, north, east, down; moment: N m, in body axes.  pose, pose_rate: NaN if unknown.
    """

    way: Way
    force: np.ndarray
    moment: np.ndarray
    pose: np.ndarray
    pose_rate: np.ndarray


@dataclass(frozen=True, eq=False)
class HoverGains:
    """Gains of the axes of a body, (6,) each: N/m and N m/rad, per s, and times s; pace: of the reference."""

    proportional: np.ndarray
    integral: np.ndarray
    derivative: np.ndarray
    pace: Pace


@dataclass(frozen=True, eq=False)
class HoverPid:
    """PID in up to six degrees of freedom; errors are rotated into body axes, those of masses and thrusters.

    channels: of a pose; those without a target or a reading are not controlled, nor are their axes.  level: those with
    a default target of 0: a current tilts a vehicle far that only buoyancy rights.
    A reference leads smoothly from the vehicle's pose to each target. The wrench for the reference (mass times
    acceleration, damping at its velocity, weight and buoyancy at its attitude) is fed forward, so that the PID only has
    to compensate for what the model does not include, such as a current; its integral holds that in north, east, down,
    where a current is constant while the vehicle turns.  An uncontrolled roll or pitch is left to buoyancy.
    Integrals are reduced by the allocation's shortfall (`surge_short_N`), over 1 / frequency.
    Source: Fossen 2021, secs. 12.2 and 15.3; Astrom and Hagglund 2006, sec. 3.5 (tracking against windup).
    """

    dynamics: HoverDynamics
    gains: HoverGains
    channels: tuple[str, ...]
    level: tuple[str, ...] = ()

    @property
    def targets(self) -> tuple[str, ...]:
        """The channels that it follows; targets may be missing."""
        return self.channels

    @property
    def commands(self) -> tuple[str, ...]:
        return AXES

    def start(self) -> HoverState:
        unknown = np.full(6, nan)
        return HoverState(self.gains.pace.begin(), np.zeros(3), np.zeros(3), unknown, unknown)

    def act(
        self, state: HoverState, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], HoverState]:
        """The wrench in body axes and the next memory."""
        check_targets(self, target)
        dt, gains = time_step(reading), self.gains
        pose = np.array([reading.get(name, nan) for name in POSE])
        usual = {**dict.fromkeys(POSE, nan), **dict.fromkeys(self.level, 0.0)}
        wanted = np.array([target.get(n, usual[n]) if n in self.channels or n in self.level else nan for n in POSE])
        known = np.where(np.isfinite(pose), pose, np.where(np.isfinite(state.pose), state.pose, 0.0))
        way = gains.pace.advance(state.way, pose, wanted, known, dt)
        steered = way.steered

        turn, spin = rotation(*known[3:]), turning(known[3], known[4])
        pose_rate = self._pose_rate(state, pose, dt)
        moving, rates = self._speeds(reading, turn, spin, pose_rate)
        error = np.array([error_of(n, a, b) for n, a, b in zip(POSE, way.position, known, strict=True)]) * steered
        slip = np.where(steered[:3], way.speed[:3] - moving, 0.0)
        p, i, d = gains.proportional, gains.integral, gains.derivative
        free = steered[3:]
        # in body axes
        off, sliding = turn.T @ error[:3], turn.T @ slip
        tilted = spin @ error[3:]
        spinning = np.where(free, spin @ way.speed[3:] - rates, 0.0)
        forces = p[:3] * off + d[:3] * sliding + turn.T @ state.force
        moments = np.where(free, p[3:] * tilted + d[3:] * spinning + state.moment, 0.0)
        ahead = self._fed_forward(way, known, turn, spin)
        wrench = np.concatenate([forces + ahead[:3], moments + ahead[3:]])

        short = np.array([reading.get(name, 0.0) for name in SHORT])
        back = np.minimum(dt * gains.pace.frequency, 1.0)
        force = state.force + turn @ (dt * i[:3] * off - back[:3] * short[:3])
        moment = state.moment + dt * i[3:] * tilted - back[3:] * short[3:]
        return dict(zip(AXES, wrench.tolist(), strict=True)), HoverState(
            way,
            np.where(steered[:3], force, state.force),
            np.where(free, moment, state.moment),
            np.where(np.isfinite(pose), pose, state.pose),
            pose_rate,
        )

    def _fed_forward(self, way: Way, known: np.ndarray, turn: np.ndarray, spin: np.ndarray) -> np.ndarray:
        """The wrench for the reference, in body axes and the controlled axes, (6,)."""
        velocity = np.concatenate([turn.T @ way.speed[:3], spin @ way.speed[3:]])
        turned = np.cross(velocity[3:], velocity[:3])
        change = np.concatenate([turn.T @ way.acceleration[:3] - turned, spin @ way.acceleration[3:]])
        steered = way.steered
        roll, pitch = np.where(steered[3:5], way.position[3:5], known[3:5]).tolist()
        wrench = self.dynamics.mass @ change + self.dynamics.resistance(velocity, roll, pitch, float(known[2]))
        forces = turn.T @ np.where(steered[:3], turn @ wrench[:3], 0.0)
        return np.concatenate([forces, np.where(steered[3:], wrench[3:], 0.0)])

    def _pose_rate(self, state: HoverState, pose: np.ndarray, dt: float) -> np.ndarray:
        """The rates of the pose from differences of readings, smoothed, (6,); NaN without two readings."""
        before = np.where(np.isfinite(state.pose_rate), state.pose_rate, 0.0)
        moved = np.array([error_of(n, a, b) for n, a, b in zip(POSE, pose, state.pose, strict=True)])
        smooth = _TWO_SAMPLES * dt
        return np.where(np.isfinite(moved), (smooth * before + moved) / (smooth + dt), state.pose_rate)

    def _speeds(
        self, reading: Mapping[str, float], turn: np.ndarray, spin: np.ndarray, pose_rate: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Velocity over ground in north, east, down and body rates: measured, or from the pose; 0 where unknown."""
        slow = np.where(np.isfinite(pose_rate), pose_rate, 0.0)
        over_ground = np.array([reading.get(name, nan) for name in OVER_GROUND])
        moving = turn @ over_ground if np.isfinite(over_ground).all() else slow[:3]
        differences = spin @ slow[3:]
        rates = np.array([reading.get(name, nan) for name in RATES])
        return moving, np.where(np.isfinite(rates), rates, differences)


def placed_gains(
    dynamics: HoverDynamics, frequency: np.ndarray, damping: np.ndarray, slow: float, share: float
) -> HoverGains:
    """Gains that place two poles of each axis at a natural frequency, rad/s, and a damping ratio, and one slower.

    The axis is mass s^2 + damping s + stiffness, of the vehicle near rest; the third pole is at `slow` times the
    frequency.  frequency, damping: (6,).  share: of each axis's authority, for the reference to hold a speed and to
    accelerate.
    Source: Fossen 2021, sec. 15.3.2 (pole placement); Astrom and Murray 2021, sec. 8.2.
    """
    mass, third = np.diag(dynamics.mass), slow * frequency
    return HoverGains(
        proportional=np.maximum(mass * (frequency**2 + 2.0 * damping * frequency * third) - dynamics.stiffness, 0.0),
        integral=mass * frequency**2 * third,
        derivative=np.maximum(mass * (2.0 * damping * frequency + third) - dynamics.damping, 0.0),
        pace=pace_of(dynamics, frequency, share),
    )


def pace_of(dynamics: HoverDynamics, frequency: np.ndarray, share: float) -> Pace:
    """A reference that uses at most a share of each axis's authority to hold a speed, and as much to accelerate.

    North and east use the weaker of surge and sway, as the vehicle may turn.
    """
    hardest, fastest = share * dynamics.authority / np.diag(dynamics.mass), dynamics.fastest(share)
    level = slice(0, 2)
    hardest[level], fastest[level] = hardest[level].min(), fastest[level].min()
    frequency = frequency.copy()
    frequency[level] = frequency[level].min()
    # a faster reference could not brake in time before the target
    return Pace(frequency, np.minimum(fastest, 2.0 * hardest / frequency), hardest)
