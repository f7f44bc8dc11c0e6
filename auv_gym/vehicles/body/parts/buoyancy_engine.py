"""A buoyancy engine, which changes the displaced volume with oil or water, at its position."""

from __future__ import annotations

from dataclasses import dataclass

from auv_gym.compiled import compiled
from auv_gym.effects import effects_on_commands
from auv_gym.param import param
from auv_gym.physics.actuators import command_within
from auv_gym.vehicles.body.kinds import Command, PartKind, Sketch, force_at


@dataclass(frozen=True)
class BuoyancyEngine:
    """A volume between low and high, whose excess over `neutral` lifts; the hull's buoyancy is that at neutral.

    The vehicle's mass is constant: oil moves in and out of a bladder outside the hull.
    """

    low: float = param(0.0, "m^3", "smallest volume of the {}", bounds=(-1.0, 10.0))
    neutral: float = param(0.0, "m^3", "volume of the {} at rest", bounds=(-1.0, 10.0))
    high: float = param(0.0, "m^3", "largest volume of the {}", bounds=(-1.0, 10.0))
    x: float = param(0.0, "m", "where the {} acts, forward", bounds=(-50.0, 50.0))
    y: float = param(0.0, "m", "where the {} acts, starboard", bounds=(-10.0, 10.0))
    z: float = param(0.0, "m", "where the {} acts, down", bounds=(-10.0, 10.0))
    lag: float = param(0.0, "s", "{} time constant", bounds=(0.0, 600.0))
    slowness: float = param(0.0, "s/m^3", "{} rate limit, as time per volume", bounds=(0.0, 1e9))


BuoyancyEngineEffects = effects_on_commands(
    "BuoyancyEngineEffects",
    __name__,
    "m^3",
    {
        "offset": 2e-5,
        "gain": 0.05,
        "deadband": 2e-5,
        "dead_time": 2.0,
        "lost_travel": 4e-5,
        "lag": 2.0,
        "slowness": 3e4,
        "stuck": 0.1,
        "stuck_at": 0.0,
    },
    span=0.01,
    slowest=1e9,
    titles={
        "offset": "{} volume bias",
        "slowness": "{} slower than given, as time per volume",
        "stuck_at": "volume at which the {} is stuck",
    },
)


@compiled
def shape(command, memory, part, effects, index):
    """The commanded volume after the engine's effects, m^3, and the memory."""
    rest, lost = part.neutral, effects.lost_travel
    # the bias applies to the volume itself, so that it also acts at a stop
    return command_within(
        command, memory, rest, part.low, part.high, effects.gain, 0.0, effects.deadband, 0.0, 0.0, lost
    )


@compiled
def times(part, effects, index):
    """Dead time s, lag s and slowness s/m^3, the sums of the vehicle's own and the effects'."""
    return effects.dead_time, part.lag + effects.lag, part.slowness + effects.slowness


@compiled
def force(at, actuators, inputs, shared, motion, part, effects, derived):
    """The lift of the volume above neutral, and its moment, in body axes.  Source: Fossen 2021, eq. (4.6)."""
    volume = (1.0 - effects.stuck) * actuators[at] + effects.stuck * effects.stuck_at
    lift = motion.water * motion.gravity * (volume - part.neutral + effects.offset)
    x, y, z = -lift * motion.r31, -lift * motion.r32, -lift * motion.r33
    return force_at(x, y, z, part.x, part.y, part.z)


def _problem(engine: BuoyancyEngine) -> str:
    if engine.low <= engine.neutral <= engine.high and engine.low < engine.high:
        return ""
    return (
        f": low, neutral and high need to rise, low below high, got {engine.low:g}, {engine.neutral:g} and "
        f"{engine.high:g} m^3"
    )


def _sketch(engine: BuoyancyEngine) -> tuple[Sketch, ...]:
    half = 0.5 * abs(engine.high - engine.low) ** (1.0 / 3.0)
    x, y = engine.x, engine.y
    return (Sketch(tuple((x + i * half, y + j * half, engine.z) for i, j in _SQUARE)),)


_SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))

KIND = PartKind(
    name="buoyancy_engine",
    title="buoyancy engine: displaced volume by command",
    parameters=BuoyancyEngine,
    effects=BuoyancyEngineEffects,
    order=50,
    commands=(
        Command("m3", lambda engine: (engine.low, engine.high), rest="neutral", required=False, inside="volume"),
    ),
    force=force,
    shape=shape,
    times=times,
    problem=_problem,
    sketch=_sketch,
    place=("x", "y", "z"),
)
