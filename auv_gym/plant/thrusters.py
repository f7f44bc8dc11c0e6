"""The thrusters of a vehicle: the wrench of their thrusts, and the commands for given thrusts.

Everything refers to the vehicle's own numbers, without effects, at the supply voltage that these state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auv_gym.compiled import compiled
from auv_gym.plant import Plant, without_effects

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")  # of a wrench: X, Y, Z in N, then K, M, N in N m
_ORDER = (0, 1, 2, 5, 3, 4)  # in which axes are selected, as long as the thrusters can serve them independently
_DEPENDENT = 1e-6  # of the largest arm or share of a force; an axis served by less depends on the others


@dataclass(frozen=True, eq=False)
class Thrusters:
    """The thrusters of a plant, in the order of its inputs.

    channels: their commands, and `at`, their indices among the inputs.  wrench: (6, n), body axes about the origin, per
    N of each thrust.  curves: (n, m, 2), thrust in N and command in the channel's unit, both rising; a thrust of 0
    appears at both edges of a dead zone, and rows at an end may repeat.  idle: (n,), the commands of zero thrust.
    """

    channels: tuple[str, ...]
    at: np.ndarray
    wrench: np.ndarray
    curves: np.ndarray
    idle: np.ndarray

    @property
    def least(self) -> np.ndarray:
        """The largest thrust astern of each, N, (n,)."""
        return self.curves[:, 0, 0]

    @property
    def most(self) -> np.ndarray:
        """The largest thrust of each, N, (n,)."""
        return self.curves[:, -1, 0]

    def commands(self, thrusts: np.ndarray) -> np.ndarray:
        """The commands, in the channels' units, that give thrusts, N, (n,); limited to the ends of the curves.

        Of commands with the same thrust, the one nearest to idle is used. A thrust inside the jump at a dead zone gets
        the command of its edge.  Raises ValueError for another number of thrusts, or one that is not finite.
        """
        pairs = zip(self._one_each(thrusts, "thrusts in N").tolist(), self.curves, self.idle.tolist(), strict=True)
        return np.array([command_of_thrust(thrust, curve, idle) for thrust, curve, idle in pairs])

    def thrusts(self, commands: np.ndarray) -> np.ndarray:
        """The thrusts, N, (n,), of commands in the channels' units; zero inside a dead zone.  Raises as `commands`."""
        found = np.empty(len(self.channels))
        for i, command in enumerate(self._one_each(commands, "commands")):
            thrust, at = self.curves[i].T
            zero = thrust == 0.0
            inside = zero.any() and at[zero].min() <= command <= at[zero].max()
            found[i] = 0.0 if inside else np.interp(command, at, thrust)
        return found

    def _one_each(self, values: np.ndarray, what: str) -> np.ndarray:
        """The values, one for each thruster, as an array; raises ValueError if their number is wrong."""
        given, count = np.asarray(values, dtype=float), len(self.channels)
        if given.shape != (count,) or not np.isfinite(given).all():
            came = f"shape {given.shape}" if given.shape != (count,) else str(given.tolist())
            raise ValueError(
                f"Thrusters need {count} finite {what}, one for each of {', '.join(self.channels)}; got {came}."
            )
        return given

    def share_within(self, thrusts: np.ndarray, about: np.ndarray | float = 0.0) -> float:
        """The largest share, at most 1, of `thrusts` that all thrusters can add to their present thrusts `about`."""
        return float(share_within(np.asarray(thrusts, float), about + np.zeros(self.at.size), self.least, self.most))


@compiled
def command_of_thrust(thrust, curve, idle):
    """The command for a thrust, by a curve (m, 2) of thrusts and commands, both rising; limited to its ends."""
    rows = curve.shape[0]
    if thrust == 0.0:
        return idle
    if thrust > 0.0:
        low, high = 0, rows - 1  # the first row whose thrust is not smaller
        if thrust >= curve[high, 0]:
            thrust = curve[high, 0]
        while low < high:
            middle = (low + high) // 2
            if curve[middle, 0] < thrust:
                low = middle + 1
            else:
                high = middle
        at = low
        if at == 0:
            return curve[0, 1]
        return _between(thrust, curve[at - 1, 0], curve[at, 0], curve[at - 1, 1], curve[at, 1])
    low, high = 0, rows - 1  # the last row whose thrust is not larger
    if thrust <= curve[0, 0]:
        thrust = curve[0, 0]
    while low < high:
        middle = (low + high + 1) // 2
        if curve[middle, 0] > thrust:
            high = middle - 1
        else:
            low = middle
    at = low
    if at == rows - 1:
        return curve[at, 1]
    return _between(thrust, curve[at + 1, 0], curve[at, 0], curve[at + 1, 1], curve[at, 1])


@compiled
def _between(thrust, thrust0, thrust1, command0, command1):
    return command0 + (thrust - thrust0) / (thrust1 - thrust0) * (command1 - command0)


@compiled
def share_within(thrusts, about, least, most):
    """The largest share, at most 1, of thrusts that keeps about + share thrusts from least to most, all (n,), N."""
    share = 1.0
    for i in range(thrusts.shape[0]):
        if thrusts[i] > 0.0:
            share = min(share, (most[i] - about[i]) / thrusts[i])
        elif thrusts[i] < 0.0:
            share = min(share, (least[i] - about[i]) / thrusts[i])
    return max(share, 0.0)


def wrench_matrix(plant: Plant) -> np.ndarray:
    """The wrench of thrusts, (6, n): X, Y, Z in N and K, M, N in N m about the origin, per N of each thruster."""
    derived = plant.family.view(without_effects(plant).derived).derived
    columns, places = [], {}
    for part in _parts(plant):
        slot = part.found.slot
        numbers = getattr(derived, slot)[places.setdefault(slot, 0)]
        places[slot] += 1
        columns.append([float(getattr(numbers, name)) for name in part.found.numbers[:6]])
    return np.array(columns).reshape(-1, 6).T


def find_thrusters(plant: Plant) -> Thrusters:
    """The thrusters of a plant; raises if it has none."""
    parts = _parts(plant)
    if not parts:
        raise ValueError(
            f"An allocation needs thrusters, which {plant.name!r} has not: its inputs are "
            f"{', '.join(plant.inputs) or 'none'}."
        )
    tables = []
    for part in parts:
        own = getattr(plant.parts, part.name)
        commands, thrusts = part.found.thrusts(own)
        tables.append(_rising(thrusts * part.found.thrust_share(own, plant.constants), commands))
    rows = max(len(table) for table in tables)
    curves = np.array([np.vstack([table, np.repeat(table[-1:], rows - len(table), axis=0)]) for table in tables])
    channels = tuple(part.channel(0) for part in parts)
    return Thrusters(
        channels=channels,
        at=np.array([plant.inputs.index(name) for name in channels]),
        wrench=wrench_matrix(plant),
        curves=curves,
        idle=np.array([part.found.commands[0].idle for part in parts]),
    )


def served_axes(wrench: np.ndarray) -> tuple[str, ...]:
    """The axes that thrusters with this matrix, (6, n), can serve independently: surge, sway, heave, yaw, roll, pitch.

    Of axes that the thrusters can only serve together, the earlier ones count.
    """
    size = np.abs(wrench).max(axis=1)
    largest = np.where(np.arange(6) < 3, size[:3].max(), size[3:].max())
    kept: list[int] = []
    for axis in _ORDER:
        rows = wrench[[*kept, axis]] / np.maximum(largest[[*kept, axis]], 1e-300)[:, None]
        if size[axis] > 0.0 and np.linalg.svd(rows, compute_uv=False)[-1] > _DEPENDENT and len(rows) <= rows.shape[1]:
            kept.append(axis)
    return tuple(AXES[axis] for axis in kept)


def allocation(wrench: np.ndarray) -> np.ndarray:
    """The thrusts, N, per N or N m of a wrench along `served_axes`, (n, axes), with the smallest sum of squares.

    The effect on other axes is left free.
    """
    return np.linalg.pinv(wrench[[AXES.index(axis) for axis in served_axes(wrench)]])


def _parts(plant: Plant) -> tuple:
    body = plant.family.body
    return body.thrusters if body is not None else ()


def _rising(thrusts: np.ndarray, commands: np.ndarray) -> np.ndarray:
    """Rows of thrust and command with rising thrusts; of equal thrusts, those nearest to zero thrust, (m, 2)."""
    ahead, astern = thrusts > 0.0, thrusts < 0.0
    zero = ~(ahead | astern)
    ahead[1:] &= thrusts[1:] > thrusts[:-1]
    astern[:-1] &= thrusts[:-1] < thrusts[1:]
    edges = np.flatnonzero(zero)
    zero[edges[1:-1]] = False
    kept = ahead | astern | zero
    return np.column_stack([thrusts[kept], commands[kept]])
