"""A mass that moves in the hull: along an axis, about the vehicle's long axis, or both, like a battery pack.

Centre of gravity and inertia follow it. A start or a stop is a jump of momentum inside the vehicle that conserves the
total momentum and the common centre of mass.  Source of the equations: Graver 2005, Underwater Gliders: Dynamics,
Control and Design, PhD thesis, Princeton, ch. 3 (a point mass); here with an inertia of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin
from typing import Any

from auv_gym.compiled import compiled
from auv_gym.effects import effects_on_commands
from auv_gym.param import param, part
from auv_gym.physics.actuators import command_within
from auv_gym.vehicles.body.kinds import Block, Command, PartKind, Sketch, force_at
from auv_gym.vehicles.body.parts.surface import placed


@dataclass(frozen=True)
class MovingMass:
    """A mass in addition to the hull's, not included in the hull's mass, weight and inertia.

    x, y, z: its axis of rotation, at rest. Its centre is `eccentricity` below that axis, and moves to port with a
    positive angle, by the right-hand rule about the forward axis.
    """

    mass: float = param(1.0, "kg", "mass of the {}", bounds=(1e-6, 1e7))
    x: float = param(0.0, "m", "{} at rest, forward", bounds=(-50.0, 50.0))
    y: float = param(0.0, "m", "{} at rest, starboard", bounds=(-10.0, 10.0))
    z: float = param(0.0, "m", "{} at rest, down", bounds=(-10.0, 10.0))
    eccentricity: float = param(0.0, "m", "centre of the {} below its axis", bounds=(0.0, 10.0))
    axis_x: float = param(1.0, "1", "direction in which the {} slides, forward", bounds=(-1.0, 1.0))
    axis_y: float = param(0.0, "1", "direction in which the {} slides, starboard", bounds=(-1.0, 1.0))
    axis_z: float = param(0.0, "1", "direction in which the {} slides, down", bounds=(-1.0, 1.0))
    i_xx: float = param(0.0, "kg m^2", "roll inertia of the {} about its own centre", bounds=(0.0, 1e8))
    i_yy: float = param(0.0, "kg m^2", "pitch inertia of the {} about its own centre", bounds=(0.0, 1e8))
    i_zz: float = param(0.0, "kg m^2", "yaw inertia of the {} about its own centre", bounds=(0.0, 1e8))
    back: float = param(0.0, "m", "{} slides back, by at most", bounds=(0.0, 50.0))
    forth: float = param(0.0, "m", "{} slides forth, by at most", bounds=(0.0, 50.0))
    lag: float = param(0.0, "s", "time constant of the {} as it slides", bounds=(0.0, 600.0))
    slowness: float = param(0.0, "s/m", "rate limit of the {} as it slides, as time per way", bounds=(0.0, 1e6))
    turn: float = param(0.0, "rad", "{} turns to either side, by at most", bounds=(0.0, 6.3))
    turn_lag: float = param(0.0, "s", "time constant of the {} as it turns", bounds=(0.0, 600.0))
    turn_slowness: float = param(0.0, "s/rad", "rate limit of the {} as it turns, as time per angle", bounds=(0.0, 1e6))


SlideEffects = effects_on_commands(
    "SlideEffects",
    __name__,
    "m",
    {
        "offset": 1e-3,
        "gain": 0.1,
        "deadband": 1e-3,
        "backlash": 2e-3,
        "stiction": 2e-3,
        "dead_time": 2.0,
        "lost_travel": 2e-3,
        "lag": 2.0,
        "slowness": 100.0,
        "stuck": 0.1,
        "stuck_at": 0.0,
    },
    slowest=1e6,
    titles={"slowness": "{} slower than given, as time per way", "stuck_at": "where the {} is stuck"},
)
TurnEffects = effects_on_commands(
    "TurnEffects",
    __name__,
    "rad",
    {
        "offset": 0.01,
        "gain": 0.1,
        "deadband": 0.02,
        "backlash": 0.04,
        "stiction": 0.04,
        "dead_time": 2.0,
        "lost_travel": 0.05,
        "lag": 2.0,
        "slowness": 2.0,
        "stuck": 0.1,
        "stuck_at": 0.0,
    },
    slowest=1e6,
    titles={"slowness": "{} slower than given, as time per angle"},
)


@dataclass(frozen=True)
class BothEffects:
    """The effects on the two commands of a mass that slides and turns."""

    slide: Any = part(SlideEffects, "{} slide")
    turn: Any = part(TurnEffects, "{} turn")


@compiled
def _shaped(command, memory, low, high, e):
    return command_within(
        command, memory, 0.0, low, high, e.gain, e.offset, e.deadband, e.backlash, e.stiction, e.lost_travel
    )


@compiled
def shape_slide(command, memory, part, effects, index):
    """The sliding command after its effects, m, and the memory."""
    return _shaped(command, memory, -part.back, part.forth, effects)


@compiled
def shape_turn(command, memory, part, effects, index):
    """The turning command after its effects, rad, and the memory."""
    return _shaped(command, memory, -part.turn, part.turn, effects)


@compiled
def shape_both(command, memory, part, effects, index):
    """The command of that index, 0 to slide and 1 to turn, after its effects, and the memory."""
    if index == 0:
        return _shaped(command, memory, -part.back, part.forth, effects.slide)
    return _shaped(command, memory, -part.turn, part.turn, effects.turn)


@compiled
def times_slide(part, effects, index):
    """Dead time s, lag s and slowness s/m of sliding."""
    return effects.dead_time, part.lag + effects.lag, part.slowness + effects.slowness


@compiled
def times_turn(part, effects, index):
    """Dead time s, lag s and slowness s/rad of turning."""
    return effects.dead_time, part.turn_lag + effects.lag, part.turn_slowness + effects.slowness


@compiled
def times_both(part, effects, index):
    """Dead time s, lag s and slowness s per unit of the command of that index."""
    if index == 0:
        return times_slide(part, effects.slide, index)
    return times_turn(part, effects.turn, index)


@compiled
def moved_block(way, rate, angle, spin, part):
    """The mass after sliding by `way`, m, and turning by an angle, rad, at these rates."""
    c, s = cos(angle), sin(angle)
    e = part.eccentricity
    y, z = -e * s, e * c
    return Block(
        part.mass,
        part.x + way * part.axis_x,
        part.y + way * part.axis_y + y,
        part.z + way * part.axis_z + z,
        rate * part.axis_x,
        rate * part.axis_y - spin * z,
        rate * part.axis_z + spin * y,
        -spin * spin * y,
        -spin * spin * z,
        spin,
        part.i_xx,
        c * c * part.i_yy + s * s * part.i_zz,
        s * s * part.i_yy + c * c * part.i_zz,
        c * s * (part.i_yy - part.i_zz),
    )


@compiled
def block_slide(at, rates_at, actuators, part, effects):
    """The mass at its sliding position."""
    free = 1.0 - effects.stuck
    return moved_block(placed(actuators[at], effects), free * actuators[rates_at], 0.0, 0.0, part)


@compiled
def block_turn(at, rates_at, actuators, part, effects):
    """The mass at its turning angle."""
    free = 1.0 - effects.stuck
    return moved_block(0.0, 0.0, placed(actuators[at], effects), free * actuators[rates_at], part)


@compiled
def block_both(at, rates_at, actuators, part, effects):
    """The mass at its sliding position and turning angle."""
    slide, turn = effects.slide, effects.turn
    way, rate = placed(actuators[at], slide), (1.0 - slide.stuck) * actuators[rates_at]
    angle, spin = placed(actuators[at + 1], turn), (1.0 - turn.stuck) * actuators[rates_at + 1]
    return moved_block(way, rate, angle, spin, part)


@compiled
def moving_mass_weight(block, motion):
    """The weight of a mass at its position, in body axes."""
    weight = block.mass * motion.gravity
    x, y, z = weight * motion.r31, weight * motion.r32, weight * motion.r33
    return force_at(x, y, z, block.x, block.y, block.z)


@compiled
def force_slide(at, actuators, inputs, shared, motion, part, effects, derived):
    """The weight of a mass that slides."""
    return moving_mass_weight(moved_block(placed(actuators[at], effects), 0.0, 0.0, 0.0, part), motion)


@compiled
def force_turn(at, actuators, inputs, shared, motion, part, effects, derived):
    """The weight of a mass that turns."""
    return moving_mass_weight(moved_block(0.0, 0.0, placed(actuators[at], effects), 0.0, part), motion)


@compiled
def force_both(at, actuators, inputs, shared, motion, part, effects, derived):
    """The weight of a mass that slides and turns."""
    way, angle = placed(actuators[at], effects.slide), placed(actuators[at + 1], effects.turn)
    return moving_mass_weight(moved_block(way, 0.0, angle, 0.0, part), motion)


def _problem(mass: MovingMass) -> str:
    size = (mass.axis_x**2 + mass.axis_y**2 + mass.axis_z**2) ** 0.5
    if abs(size - 1.0) > 1e-6:
        return f": axis_x, axis_y and axis_z need the length 1, got {size:.6g}: divide them by it"
    return ""


def _sketch(mass: MovingMass) -> tuple[Sketch, ...]:
    half = 0.03 + 0.5 * (mass.back + mass.forth)
    x, y = mass.x + 0.5 * (mass.forth - mass.back), mass.y
    return (Sketch(((x - half, y, mass.z), (x + half, y, mass.z))),)


_SLIDES = Command("m", lambda mass: (-mass.back, mass.forth), required=False, inside="slide", quantity="position")
_TURNS = Command("rad", lambda mass: (-mass.turn, mass.turn), required=False, inside="turn", quantity="angle")


def _form(motion: str, effects: type, commands: tuple[Command, ...], functions: tuple[Any, Any, Any, Any]) -> PartKind:
    force, shape, times, block = functions
    return PartKind(
        name="moving_mass",
        title="moving mass, such as a battery",
        parameters=MovingMass,
        effects=effects,
        order=60,
        slot=f"moving_mass_{motion}",
        choice="motion",
        commands=commands,
        force=force,
        shape=shape,
        times=times,
        block=block,
        problem=_problem,
        sketch=_sketch,
        place=("x", "y", "z"),
    )


KIND = PartKind(
    name="moving_mass",
    title="moving mass, such as a battery",
    parameters=MovingMass,
    effects=SlideEffects,
    order=60,
    choice="motion",
    variants={
        "slides": _form("slides", SlideEffects, (_SLIDES,), (force_slide, shape_slide, times_slide, block_slide)),
        "turns": _form("turns", TurnEffects, (_TURNS,), (force_turn, shape_turn, times_turn, block_turn)),
        "both": _form("both", BothEffects, (_SLIDES, _TURNS), (force_both, shape_both, times_both, block_both)),
    },
)
