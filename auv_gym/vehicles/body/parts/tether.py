"""A tether: a steady pull at its attachment, and the drag of the part in the water."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from auv_gym.compiled import compiled
from auv_gym.effects import effects_on_commands
from auv_gym.param import param
from auv_gym.vehicles.body.kinds import PartKind, Sketch, force_at


@dataclass(frozen=True)
class Tether:
    """A pull, constant over ground in direction and size, and quadratic drag, at x, y, z."""

    x: float = param(0.0, "m", "where the {} is tied, forward", bounds=(-50.0, 50.0))
    y: float = param(0.0, "m", "where the {} is tied, starboard", bounds=(-10.0, 10.0))
    z: float = param(0.0, "m", "where the {} is tied, down", bounds=(-10.0, 10.0))
    drag: float = param(0.0, "kg/m", "drag of the {}", bounds=(0.0, 1e4))
    north: float = param(0.0, "N", "pull of the {} to the north", bounds=(-1e5, 1e5))
    east: float = param(0.0, "N", "pull of the {} to the east", bounds=(-1e5, 1e5))
    down: float = param(0.0, "N", "pull of the {} down", bounds=(-1e5, 1e5))


TetherEffects = effects_on_commands(
    "TetherEffects", __name__, "1", {"lost": 0.1}, titles={"lost": "share of the {} lost"}
)


@compiled
def force(at, actuators, inputs, shared, motion, part, effects, derived):
    """Pull and drag, and their moment about the origin, in body axes."""
    there = 1.0 - effects.lost
    drag = part.drag * motion.density * sqrt(motion.u * motion.u + motion.v * motion.v + motion.w * motion.w)
    north, east, down = part.north, part.east, part.down
    x = there * (motion.r11 * north + motion.r21 * east + motion.r31 * down - drag * motion.u)
    y = there * (motion.r12 * north + motion.r22 * east + motion.r32 * down - drag * motion.v)
    z = there * (motion.r13 * north + motion.r23 * east + motion.r33 * down - drag * motion.w)
    return force_at(x, y, z, part.x, part.y, part.z)


@compiled
def damping(part, effects, derived, water, inverse_mass, rates):
    """Damping by the tether, 1/s per |u|."""
    for i in range(3):
        rates[i, 1] += 2.0 * abs(inverse_mass[i, i]) * part.drag
        rates[i, 2] += 2.0 * abs(inverse_mass[i, i]) * part.drag


def _sketch(tether: Tether) -> tuple[Sketch, ...]:
    return (Sketch(((tether.x, tether.y, tether.z), (tether.x - 0.3, tether.y, tether.z - 0.3))),)


KIND = PartKind(
    name="tether",
    title="tether: its pull and its drag",
    parameters=Tether,
    effects=TetherEffects,
    order=70,
    force=force,
    damping=damping,
    sketch=_sketch,
    place=("x", "y", "z"),
)
