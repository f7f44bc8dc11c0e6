"""Controllers of single degrees of freedom, in north, east, down and body moments, for a vehicle that turns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from typing import Any, NamedTuple

import numpy as np

from controllers.allocation import AXES
from controllers.composed.loops import targets_of
from controllers.controller import Controller, time_step
from controllers.hovering.dynamics import POSE, HoverDynamics, rotation, turning
from controllers.hovering.reference import Pace, Way

WORLD = ("north_N", "east_N", "down_N", "roll_Nm", "pitch_Nm", "yaw_Nm")


class WorldState(NamedTuple):
    """Memory of the controllers, the reference, the feedforward in world axes, (6,), and the last pose."""

    inner: Any
    way: Way
    fed: np.ndarray
    pose: np.ndarray


@dataclass(frozen=True, eq=False)
class InWorldAxes:
    """A controller of `north_N`, `east_N`, `down_N` and body moments, converted to the wrench in body axes.

    A reference leads it to its targets, and the terms that its linear model leaves out along the reference are fed
    forward: weight, buoyancy, and the reference's damping in excess of the damping near rest. The inputs that it reads
    are the thrusters' reached wrench minus this feedforward.  level: channels with a default target of 0.
    """

    controller: Controller
    dynamics: HoverDynamics
    pace: Pace
    level: tuple[str, ...] = ()

    @property
    def targets(self) -> tuple[str, ...]:
        return targets_of(self.controller)

    @property
    def commands(self) -> tuple[str, ...]:
        return AXES

    def start(self) -> WorldState:
        return WorldState(self.controller.start(), self.pace.begin(), np.zeros(6), np.zeros(6))

    def act(
        self, state: WorldState, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], WorldState]:
        pose = np.array([reading.get(name, nan) for name in POSE])
        known = np.where(np.isfinite(pose), pose, state.pose)
        usual = {**dict.fromkeys(POSE, nan), **dict.fromkeys(self.level, 0.0)}
        wanted = np.array([target.get(name, usual[name]) for name in POSE])
        way = self.pace.advance(state.way, pose, wanted, known, time_step(reading))
        turn, before = rotation(*known[3:]), rotation(*state.pose[3:])
        spin = turning(known[3], known[4])
        reached = np.array([reading.get(name, 0.0) for name in AXES])
        given = np.concatenate([before @ reached[:3], reached[3:]]) - state.fed
        told = dict(zip(WORLD, given.tolist(), strict=True))
        led = {name: float(way.position[i]) for i, name in enumerate(POSE) if way.steered[i]}
        command, inner = self.controller.act(state.inner, {**reading, **told}, {**target, **led})
        own = np.array([command.get(name, 0.0) for name in WORLD])
        used = np.array([name in command for name in WORLD])
        velocity = np.concatenate([turn.T @ way.speed[:3], spin @ way.speed[3:]])
        held = self.dynamics.resistance(velocity, float(known[3]), float(known[4]), float(known[2]))
        held -= self.dynamics.damping * velocity
        held[3:] -= self.dynamics.stiffness[3:] * known[3:]  # which the models include
        fed = np.where(used, np.concatenate([turn @ held[:3], held[3:]]), 0.0)
        wrench = np.concatenate([turn.T @ (own + fed)[:3], (own + fed)[3:]])
        reports = {name: value for name, value in command.items() if name not in WORLD}
        return {**reports, **dict(zip(AXES, wrench.tolist(), strict=True))}, WorldState(inner, way, fed, known)
