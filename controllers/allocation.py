"""Control allocation: from a wanted wrench to the thrust of each thruster, within its limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from auv_gym.param import did_you_mean
from auv_gym.plant import Plant
from auv_gym.plant.thrusters import Thrusters, find_thrusters, served_axes
from controllers.predictive.program import solver

AXES = ("surge_N", "sway_N", "heave_N", "roll_Nm", "pitch_Nm", "yaw_Nm")
# Weight of full thrust, squared, relative to a full wrench: an error of a thousandth of the thrusters' capability costs
# as much as one thruster at full thrust, so that effort only decides among thrusts of the same wrench.
_EFFORT = 1e-6
_BEYOND = 1e-6  # of the thrust at the edge of a dead zone: small, but a command that differs from the edge's
_RANK = 1e-9  # of the largest singular value; smaller ones are rounding


class Shared(NamedTuple):
    """Thrusts, N, (n,); the wrench that they reach, (6,); whether this is the wanted one up to rounding."""

    thrusts: np.ndarray
    reached: np.ndarray
    exact: bool


@dataclass(frozen=True, eq=False)
class Allocation:
    """Allocation of a wrench to n thrusters: least weighted error of the wrench, then least effort.

    matrix: (6, n), the wrench of 1 N of each thruster, N and N m in body axes.  lowest, highest: (n,), thrusts, N.
    dead_low, dead_high: (n,), the thrusts at the edges of the dead zone; between them, a thruster can only give 0.
    left: (n,), the remaining share of each thruster's thrust, 0 for a lost one; default 1.
    counts: which axes count; an axis that the thrusters cannot move independently must not.  axis_weights: (6,), of
    errors, default 1 over the thrusters' capability in each axis.
    Source: Johansen and Fossen 2013, Control allocation: a survey, Automatica 49(5), secs. 2.2 and 2.4.
    """

    matrix: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    dead_low: np.ndarray | None = None
    dead_high: np.ndarray | None = None
    left: np.ndarray | None = None
    counts: Sequence[str] = AXES
    axis_weights: np.ndarray | None = None

    def __post_init__(self) -> None:
        n = self.matrix.shape[-1]
        if self.matrix.shape != (6, n) or not np.isfinite(self.matrix).all():
            raise ValueError(f"Allocation needs a finite matrix of shape (6, n), got shape {self.matrix.shape}.")
        low, high = self.lowest, self.highest
        if low.shape != (n,) or high.shape != (n,) or not ((low <= 0.0) & (high >= 0.0) & (low < high)).all():
            raise ValueError(
                f"Allocation needs {n} lowest thrusts of at most 0 N and as many highest ones of at least 0 N, got "
                f"{low.tolist()} and {high.tolist()}."
            )
        for name, values in (("dead_low", self.dead_low), ("dead_high", self.dead_high), ("left", self.left)):
            if values is not None and values.shape != (n,):
                raise ValueError(f"Allocation needs {n} numbers as {name}, got shape {values.shape}.")
        start, end = self._dead
        if not ((low <= start) & (start <= 0.0) & (end >= 0.0) & (end <= high)).all():
            raise ValueError(
                "Allocation needs dead zones around 0 N and within the limits, got thrusts at their edges of "
                f"{start.tolist()} and {end.tolist()}."
            )
        if not ((self._left >= 0.0) & (self._left <= 1.0)).all():
            raise ValueError(f"Allocation needs shares left between 0 (lost) and 1 (whole), got {self._left.tolist()}.")
        unknown = [name for name in self.counts if name not in AXES]
        if unknown:
            raise ValueError(f"Allocation knows the axes {', '.join(AXES)}, got {', '.join(unknown)}.")
        if self.axis_weights is not None and not (self.axis_weights.shape == (6,) and (self.axis_weights >= 0.0).all()):
            raise ValueError(f"Allocation needs 6 axis_weights of at least 0, got {self.axis_weights!r}.")

    def inverse(self, wrench: np.ndarray) -> np.ndarray:
        """The thrusts of least effort, without limits and dead zones, (n,): a weighted pseudo-inverse."""
        return self._inverse @ wrench

    def share(self, wrench: np.ndarray) -> Shared:
        """The thrusts within limits and outside dead zones that come closest to a wrench, (6,), and the wrench reached.

        If `inverse` is feasible, it is the answer. Otherwise a quadratic program decides; thrusters that it puts inside
        their dead zone are switched off or moved to its edge, one after another, whichever leaves the smaller error
        after the others have compensated.
        """
        wanted = np.asarray(wrench, dtype=float)
        if wanted.shape != (6,) or not np.isfinite(wanted).all():
            raise ValueError(f"An allocation needs a finite wrench of shape (6,), got {wanted.tolist()}.")
        ideal, (low, high) = self.inverse(wanted), self.limits
        if ((ideal >= low) & (ideal <= high) & ~self._inside(ideal)).all():
            thrusts = ideal
        else:
            thrusts = self._solve(wanted, ideal, low, high)
            while (inside := self._inside(thrusts)).any():
                i = self._farthest(thrusts, inside)
                tries = [(low.copy(), high.copy()) for _ in range(2)]
                tries[0][0][i] = tries[0][1][i] = 0.0
                at, edge = (0, self._dead_left[1]) if thrusts[i] > 0.0 else (1, self._dead_left[0])
                tries[1][at][i] = edge[i]
                solved = [self._solve(wanted, ideal, *bounds) for bounds in tries]
                costs = [self._cost(wanted, ideal, each) for each in solved]
                better = int(costs[1] < costs[0])
                (low, high), thrusts = tries[better], solved[better]
        reached = self.matrix @ thrusts
        error = self.weights * (reached - wanted)
        return Shared(thrusts, reached, bool(np.abs(error).max() < _RANK))

    def commandable(self, thrusts: np.ndarray) -> np.ndarray:
        """The thrusts that intact thrusters would give at the commands for these thrusts of degraded ones, (n,), N."""
        return np.divide(thrusts, self._left, out=np.zeros_like(thrusts), where=self._left > 0.0)

    @cached_property
    def _left(self) -> np.ndarray:
        return np.ones(self.matrix.shape[1]) if self.left is None else self.left

    @cached_property
    def _dead(self) -> tuple[np.ndarray, np.ndarray]:
        none = np.zeros(self.matrix.shape[1])
        return (none if self.dead_low is None else self.dead_low), (none if self.dead_high is None else self.dead_high)

    @cached_property
    def _dead_left(self) -> tuple[np.ndarray, np.ndarray]:
        return self._left * self._dead[0], self._left * self._dead[1]

    @cached_property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and the highest remaining thrust of each thruster, (n,) each, N."""
        return self._left * self.lowest, self._left * self.highest

    @cached_property
    def weights(self) -> np.ndarray:
        """The weights of the errors in each axis; zero for an axis that does not count or that nothing moves."""
        low, high = self.limits
        most = np.maximum(self.matrix * high, self.matrix * low).sum(axis=1)
        least = np.minimum(self.matrix * high, self.matrix * low).sum(axis=1)
        half = 0.5 * (most - least)
        counted = np.array([name in self.counts for name in AXES]) & (half > _RANK * max(half.max(initial=0.0), 1.0))
        given = np.divide(1.0, half, out=np.zeros(6), where=counted) if self.axis_weights is None else self.axis_weights
        return np.where(counted, given, 0.0)

    @cached_property
    def _scale(self) -> np.ndarray:
        """Half the remaining range of each thruster, (n,), N."""
        low, high = self.limits
        return 0.5 * (high - low)

    @cached_property
    def _inverse(self) -> np.ndarray:
        scaled = self.weights[:, None] * self.matrix * self._scale
        return self._scale[:, None] * np.linalg.pinv(scaled, rcond=_RANK) * self.weights

    def _inside(self, thrusts: np.ndarray) -> np.ndarray:
        """Which thrusts are strictly inside a dead zone, and not 0."""
        start, end = self._dead_left
        slack = _RANK * self._scale
        return (thrusts > start + slack) & (thrusts < end - slack) & (np.abs(thrusts) > slack)

    def _cost(self, wanted: np.ndarray, ideal: np.ndarray, thrusts: np.ndarray) -> float:
        error = self.weights * (self.matrix @ thrusts - wanted)
        away = np.divide(thrusts - ideal, self._scale, out=np.zeros_like(ideal), where=self._scale > 0.0)
        return float(error @ error + _EFFORT * (away @ away))

    def _farthest(self, thrusts: np.ndarray, inside: np.ndarray) -> int:
        """The thruster inside its dead zone that is farthest from a possible thrust."""
        start, end = self._dead_left
        edges = np.where(thrusts > 0.0, end, start)
        return int(np.argmax(np.where(inside, np.minimum(np.abs(thrusts), np.abs(edges - thrusts)), -1.0)))

    def _solve(self, wanted: np.ndarray, ideal: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """The best thrusts within bounds; effort is measured from the unlimited solution.

        For thrusts with the same wrench, this equals the effort itself, so that the program is continuous with
        `inverse` at the limits.
        """
        thrusts, free = low.copy(), high > low
        if not free.any():
            return thrusts
        thrusts[free] = 0.0
        scale = self._scale[free]
        reach = (self.weights[:, None] * self.matrix)[:, free] * scale
        gap = self.weights * (self.matrix @ thrusts - wanted)
        hessian = 2.0 * (reach.T @ reach + _EFFORT * np.eye(scale.size))
        linear = 2.0 * (reach.T @ gap - _EFFORT * ideal[free] / scale)
        upper, lower = high[free] / scale, low[free] / scale
        x, _, status, _ = solver().solve(hessian, linear, np.zeros((0, scale.size)), upper, lower, primal_tol=1e-10)
        if status <= 0:  # the program is strictly convex and its bounds are not empty, so numbers must be badly scaled
            raise ValueError(f"The allocation of the wrench {wanted.tolist()} failed: give one in N and N m.")
        thrusts[free] = np.clip(scale * x, low[free], high[free])
        return thrusts


def allocation_of(plant: Plant, lost: Mapping[str, float] | None = None) -> tuple[Allocation, Thrusters]:
    """The allocation to a vehicle's thrusters in the axes that they serve independently, and the thrusters.

    lost: by a thruster's name, the share of its thrust that is known to be lost, 1 for all of it.
    Raises ValueError for vehicles without thrusters, and for names of other things.
    """
    thrusters = find_thrusters(plant)
    names = [part.name for part in plant.family.body.thrusters]
    left = np.ones(len(names))
    for name, share in (lost or {}).items():
        if name not in names:
            raise ValueError(
                f"{plant.name!r} has no thruster {name!r} that could be lost. {did_you_mean(name, names)}"
                f"Thrusters: {', '.join(names)}."
            )
        if not 0.0 <= share <= 1.0:
            raise ValueError(f"The lost share of {name} is between 0 and 1 (all of it), got {share!r}.")
        left[names.index(name)] = 1.0 - share
    edges = np.array([_edges(curve) for curve in thrusters.curves])
    units: dict[str, str] = dict(zip((name.rpartition("_")[0] for name in AXES), AXES))
    found = Allocation(
        thrusters.wrench,
        thrusters.least,
        thrusters.most,
        dead_low=edges[:, 0],
        dead_high=edges[:, 1],
        left=left,
        counts=tuple(units[name] for name in served_axes(thrusters.wrench * left)),
    )
    return found, thrusters


def _edges(curve: np.ndarray) -> tuple[float, float]:
    """The thrusts just outside a dead zone, on both sides.

    At the edge itself, the command still gives no thrust.
    """
    thrusts, commands = curve.T
    at_rest = commands[thrusts == 0.0]
    if not at_rest.size:
        return 0.0, 0.0
    low, high = thrusts[commands == at_rest.min()].min(), thrusts[commands == at_rest.max()].max()
    beyond = 1.0 + _BEYOND
    return beyond * float(min(low, 0.0)), beyond * float(max(high, 0.0))
