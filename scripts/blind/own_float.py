"""A profiling float by independent code: equation (5) of Zhong et al. 2024, with causes outside the library.

Only the coefficients' numbers are shared with the family that it replaces: no compiled physics, no effects.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import ceil, sqrt

from auv_gym.plant import Plant
from scripts.blind.disturbances import Around, lopsided

_STEP = 0.1  # s; a float without inertia takes `_SLOW_STEP`
_SLOW_STEP = 10.0
_GRAVITY = 9.81


@dataclass(frozen=True, eq=False)
class OwnSwim:
    """A float under way, as the simulated experiments need it; piston: m, None before the first command."""

    given: Plant
    around: Around
    depth: float
    rate: float
    volume: float
    piston: float | None = None
    told: float = 0.0
    tripped: bool = False
    time: float = 0.0

    @property
    def measured(self) -> float:
        return self.depth

    def onward(self, inputs: Mapping[str, float], duration: float) -> OwnSwim:
        """The float `duration` s later; its piston starts at its first command."""
        a, around = self.given.hull, self.around
        command = inputs.get("piston_m", a.piston_neutral)
        told = command if self.piston is None else self.told
        piston = command if self.piston is None else self.piston
        quasi = a.quasi_steady != 0.0
        count = max(ceil(duration / (_SLOW_STEP if quasi else _STEP)), 1)
        h, fastest = duration / count, 1.0 / a.piston_slowness if a.piston_slowness > 0.0 else float("inf")
        z, w, tripped = self.depth, self.rate, self.tripped
        oil = inputs.get("oil_volume_m3", 0.0)
        for k in range(count):
            t = self.time + k * h
            told = command if around.sticking is None else around.sticking.position(told, command, t)
            aim = a.piston_neutral + lopsided(told - a.piston_neutral, around.side)
            moved = piston + min(max(aim - piston, -fastest * h), fastest * h)
            if around.tripping is not None:
                tripped = around.tripping.tripped(tripped, abs(w))
            drag = 1.0 if around.tripping is None else around.tripping.factor(tripped)
            middle = 0.5 * (piston + moved)
            if quasi:
                k1 = self._steady(z, middle, oil, drag)
                k2 = self._steady(z + 0.5 * h * k1, middle, oil, drag)
                k3 = self._steady(z + 0.5 * h * k2, middle, oil, drag)
                k4 = self._steady(z + h * k3, middle, oil, drag)
                z, w = z + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4), k4
            else:
                a1 = self._acceleration(z, w, piston, oil, drag)
                z2, w2 = z + 0.5 * h * w, w + 0.5 * h * a1
                a2 = self._acceleration(z2, w2, middle, oil, drag)
                z3, w3 = z + 0.5 * h * w2, w + 0.5 * h * a2
                a3 = self._acceleration(z3, w3, middle, oil, drag)
                z4, w4 = z + h * w3, w + h * a3
                a4 = self._acceleration(z4, w4, moved, oil, drag)
                z, w = z + h / 6.0 * (w + 2.0 * w2 + 2.0 * w3 + w4), w + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            piston = moved
        return replace(self, depth=z, rate=w, piston=piston, told=told, tripped=tripped, time=self.time + duration)

    def _force(self, z: float, piston: float, oil: float) -> float:
        """Downward, N."""
        a = self.given.hull
        square = a.piston_square * (piston * abs(piston) - a.piston_neutral * abs(a.piston_neutral))
        lift = a.piston_area * (piston - a.piston_neutral) + oil + self.volume - a.waterplane * max(-z, 0.0)
        pull = self.around.tether.pull(z) if self.around.tether is not None else 0.0
        return -a.density * _GRAVITY * lift - square - pull

    def _acceleration(self, z: float, w: float, piston: float, oil: float, drag: float) -> float:
        a = self.given.hull
        resistance = drag * (a.drag_linear + a.drag_quadratic * abs(w)) * w
        return (self._force(z, piston, oil) - resistance) / (a.mass + a.added_mass)

    def _steady(self, z: float, piston: float, oil: float, drag: float) -> float:
        """The speed, m/s, at which drag balances the force."""
        a, force = self.given.hull, self._force(z, piston, oil)
        linear, quadratic = drag * a.drag_linear, drag * a.drag_quadratic
        through = (sqrt(linear**2 + 4.0 * quadratic * abs(force)) - linear) / (2.0 * quadratic)
        speed = through if force >= 0.0 else -through
        return max(speed, 0.0) if z <= 0.0 else speed
