"""A vehicle with thrusters at rest and level: the thrusts that hold it there, and the speeds that they can give it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from auv_gym.plant import Plant, without_effects
from auv_gym.plant.cruise import resting_commands
from auv_gym.plant.thrusters import AXES, Thrusters, allocation, find_thrusters, served_axes

_DEPTH = 1e3  # m; depth at which it hovers, far below any wave
_MOMENT = 1e-6  # s, over which accelerations are computed: they change little in it, and their rounding error is 1e-10
_HELD = 1e-6  # tolerance for the remaining force, in largest thrusts, or moment, in largest thrusts at the longest arm
_ROUNDING = 1e-9  # of the largest thrust; smaller thrusts would only put a thruster at the edge of its dead zone
_FASTEST = 50.0  # m/s or rad/s, above every attainable speed


@dataclass(frozen=True, eq=False)
class Hover:
    """A vehicle that its thrusters hold at rest and level, without effects.

    state: the family's states, position zero, heading north.  commands: the family's inputs.  thrusts: N, (n,).
    axes: those that the thrusters serve, see `served_axes`.  allocation: (n, axes), thrusts per wrench.  largest: by
    axis, the largest wrench, N or N m, that they can add in both directions.  speeds: by axis, m/s or rad/s, at that
    wrench.
    """

    state: np.ndarray
    commands: np.ndarray
    thrusters: Thrusters
    thrusts: np.ndarray
    axes: tuple[str, ...]
    allocation: np.ndarray
    largest: Mapping[str, float]
    speeds: Mapping[str, float]

    @property
    def wrench(self) -> np.ndarray:
        """The wrench of the holding thrusts, N and N m, by axis, (axes,)."""
        return self.thrusters.wrench[[AXES.index(axis) for axis in self.axes]] @ self.thrusts

    @property
    def speed(self) -> float:
        """The attainable speed ahead or, without thrust ahead, along the first axis that the thrusters serve."""
        return next(iter(self.speeds.values()))


def find_hover(plant: Plant) -> Hover:
    """The hover of a plant; raises if its thrusters cannot hold it at rest and level."""
    clean, thrusters = without_effects(plant), find_thrusters(plant)
    axes = served_axes(thrusters.wrench)
    shares = allocation(thrusters.wrench)
    mass = clean.family.view(clean.derived).computed.mass
    states = clean.family.states
    state, commands = np.zeros(len(states)), resting_commands(clean)
    state[states.index("depth_m")] = _DEPTH

    def wrench(thrusts: np.ndarray, velocity: np.ndarray | None = None) -> np.ndarray:
        """The remaining wrench with these thrusts, at rest or at a velocity in body axes."""
        told, x = commands.copy(), state.copy()
        told[thrusters.at] = thrusters.commands(thrusts)
        if velocity is not None:
            x[:6] = velocity
        start = clean.settled(x, told)
        return mass @ (clean.step_over(start, told, _MOMENT) - start)[:6] / _MOMENT

    thrusts = np.zeros(thrusters.at.size)
    served = [AXES.index(axis) for axis in axes]
    for _ in range(10):  # once would do, if the acceleration did not change over the interval
        thrusts = thrusts - shares @ wrench(thrusts)[served]
        if (thrusts < thrusters.least).any() or (thrusts > thrusters.most).any():
            break
    thrusts[np.abs(thrusts) < _ROUNDING * np.abs([thrusters.least, thrusters.most]).max()] = 0.0
    _check_held(plant, thrusters, thrusts, wrench(thrusts))
    commands[thrusters.at] = thrusters.commands(thrusts)
    held = state.copy()
    held[states.index("depth_m")] = 0.0
    largest = {axis: _largest(thrusters, thrusts, share) for axis, share in zip(axes, shares.T, strict=True)}
    speeds = {}
    for axis, share in zip(axes, shares.T, strict=True):
        i, pushed = AXES.index(axis), thrusts + largest[axis] * share
        low, high = 0.0, _FASTEST
        for _ in range(40):
            middle = 0.5 * (low + high)
            faster = wrench(pushed, middle * np.eye(6)[i])[i] > 0.0
            low, high = (middle, high) if faster else (low, middle)
        speeds[axis] = low
    return Hover(held, commands, thrusters, thrusts, axes, shares, largest, speeds)


def _largest(thrusters: Thrusters, about: np.ndarray, share: np.ndarray) -> float:
    """The largest wrench along an axis, N or N m, that can be added both ways; share: thrusts per its unit."""
    much = 1e9
    return much * min(thrusters.share_within(side * much * share, about) for side in (1.0, -1.0))


def _check_held(plant: Plant, thrusters: Thrusters, thrusts: np.ndarray, left: np.ndarray) -> None:
    for name, thrust, least, most in zip(thrusters.channels, thrusts, thrusters.least, thrusters.most, strict=True):
        if not least <= thrust <= most:
            raise ValueError(
                f"{plant.name!r} cannot hold itself at rest and level: {name} would have to give {thrust:.3g} N, and "
                f"gives {least:.3g} to {most:.3g} N: check weight, buoyancy and their centres."
            )
    strongest = float(np.abs([thrusters.least, thrusters.most]).max())
    arm = float(np.abs(thrusters.wrench[3:]).max())
    limits = _HELD * strongest * np.array([1.0, 1.0, 1.0, arm, arm, arm])
    worst = int(np.argmax(np.abs(left) / np.maximum(limits, 1e-300)))
    if not abs(left[worst]) <= limits[worst]:
        unit = "N" if worst < 3 else "N m"
        raise ValueError(
            f"{plant.name!r} cannot hold itself at rest and level: its thrusters leave {left[worst]:.3g} {unit} in "
            f"{AXES[worst]}: check weight, buoyancy and their centres, or add a thruster that pushes there."
        )
