"""A control surface defined by its coefficients from captive tests: a rudder or a plane."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from auv_gym.compiled import compiled
from auv_gym.effects import FIN_PROBES, effects_on_commands
from auv_gym.param import param, part
from auv_gym.physics.actuators import shaped_command
from auv_gym.physics.hydrodynamics import angle_of_attack
from auv_gym.vehicles.body.kinds import NONE, Command, PartKind, Role, Sketch, blades


@dataclass(frozen=True)
class SurfaceInWake:
    """Coefficients multiplied by a propeller's wake, m/s, in place of a factor u of the surface's own.

    Source: Healey and Lienard 1993, IEEE J. Oceanic Eng. 18(3), the terms with eps.
    """

    lift: float = param(0.0, "kg/m", "{} force per angle and u, in the wake", bounds=(-1e6, 1e6))
    moment: float = param(0.0, "kg", "{} moment per angle and u, in the wake", bounds=(-1e6, 1e6))
    drag: float = param(0.0, "kg/m", "{} axial force per angle squared and u, in the wake", bounds=(-1e6, 1e6))
    drag_rate: float = param(0.0, "kg", "{} axial force per angle and turn rate, in the wake", bounds=(-1e6, 1e6))
    drag_slip: float = param(0.0, "kg/m", "{} axial force per angle and cross speed, in the wake", bounds=(-1e6, 1e6))


@dataclass(frozen=True)
class Surface:
    """A pair of fins that move together; force = u|u| lift angle, moment = u|u| moment angle, drag = u|u| drag angle^2.

    lift is Y_uudr of a rudder or Z_uuds of a plane, moment N_uudr or M_uuds; their signs contain the vehicle's sign
    convention of the angle. The hull's polynomials usually include the undeflected fins; if they do not, `inflow` 1
    adds the angle of the flow at `station` to the fin's angle of attack.
    """

    lift: float = param(0.0, "kg/m", "{} force per angle", bounds=(-1e6, 1e6))
    moment: float = param(0.0, "kg", "{} moment per angle", bounds=(-1e6, 1e6))
    drag: float = param(0.0, "kg/m", "{} axial force per angle squared", bounds=(-1e6, 1e6))
    drag_rate: float = param(0.0, "kg", "{} axial force per angle, u and turn rate", bounds=(-1e6, 1e6))
    drag_slip: float = param(0.0, "kg/m", "{} axial force per angle, u and cross speed", bounds=(-1e6, 1e6))
    inflow: float = param(0.0, "1", "share of the flow angle that the {} sees", bounds=(-2.0, 2.0))
    station: float = param(0.0, "m", "where the flow angle at the {} is taken, forward", bounds=(-50.0, 50.0))
    stall: float = param(1.5708, "rad", "angle of attack at which the {} stalls", bounds=(0.01, 1.5708))
    limit: float = param(0.349066, "rad", "{} stop", bounds=(0.0, 1.5708))
    lag: float = param(0.0, "s", "{} actuator time constant", bounds=(0.0, 10.0))
    slowness: float = param(0.0, "s/rad", "{} actuator rate limit, as time per angle", bounds=(0.0, 100.0))
    wake: Any = part(SurfaceInWake, "{}")


SurfaceEffects = effects_on_commands(
    "SurfaceEffects", __name__, "rad", {**FIN_PROBES, "lost": 0.1, "stuck": 0.1, "stuck_at": 0.0}
)


@compiled
def shape(command, memory, part, effects, index):
    """The commanded angle after the actuator's effects, and the new memory, rad."""
    e = effects  # number by number: the records of two kinds must not be mixed up
    stop = part.limit - e.lost_travel
    return shaped_command(command, memory, e.gain, e.offset, e.deadband, e.backlash, e.stiction, stop)


@compiled
def times(part, effects, index):
    """Dead time s, lag s and slowness s/rad, the sums of the vehicle's own and the effects'."""
    return effects.dead_time, part.lag + effects.lag, part.slowness + effects.slowness


@compiled
def placed(position, effects):
    """The angle of a fin, in the unit of its command, for the position of its actuator."""
    return (1.0 - effects.stuck) * position + effects.stuck * effects.stuck_at


@compiled
def angle_and_share(position, motion, cross, turn, part, effects):
    """The angle of attack, rad, and the share of the surface that remains; cross: v or w; turn: r or -q.

    position: of the actuator, rad.
    """
    return angle_of_attack(placed(position, effects), motion.u, cross, turn, part), 1.0 - effects.lost


@compiled
def surface_force(position, motion, cross, turn, rate, part, effects):
    """Axial and cross force, N, and moment, N m, of a surface; rate: r or q; others as above."""
    angle, there = angle_and_share(position, motion, cross, turn, part, effects)
    push = motion.density * motion.u
    square = push * abs(motion.u)
    axial = there * drag_force(angle, square, push, rate, cross, part)
    return axial, there * (square * (part.lift * angle)), there * (square * (part.moment * angle))


@compiled
def drag_force(angle, square, push, rate, slip, fin):
    """Axial force of a pair of fins, N; square: u|u|, push: u, both times the relative density."""
    return angle * (square * (fin.drag * angle) + push * (fin.drag_rate * rate + fin.drag_slip * slip))


@compiled
def force_in_wake(position, wake, motion, cross, turn, rate, part, effects):
    """The axial and cross force, N, and the moment, N m, that a wake, m/s, adds."""
    angle, there = angle_and_share(position, motion, cross, turn, part, effects)
    stream, law = motion.density * wake * there, part.wake
    along = law.drag_rate * rate + law.drag_slip * cross + law.drag * motion.u * angle
    return stream * angle * along, stream * (law.lift * motion.u * angle), stream * (law.moment * motion.u * angle)


@compiled
def yaw_force(at, actuators, inputs, shared, motion, part, effects, derived):
    """Forces of a rudder."""
    x, y, n = surface_force(actuators[at], motion, motion.v, motion.r, motion.r, part, effects)
    return x, y, NONE, NONE, NONE, n


@compiled
def yaw_in_wake(at, actuators, wake, motion, part, effects):
    """The force that a wake adds to a rudder."""
    x, y, n = force_in_wake(actuators[at], wake, motion, motion.v, motion.r, motion.r, part, effects)
    return x, y, NONE, NONE, NONE, n


@compiled
def pitch_force(at, actuators, inputs, shared, motion, part, effects, derived):
    """Forces of a plane."""
    x, z, m = surface_force(actuators[at], motion, motion.w, -motion.q, motion.q, part, effects)
    return x, NONE, z, NONE, m, NONE


@compiled
def pitch_in_wake(at, actuators, wake, motion, part, effects):
    """The force that a wake adds to a plane."""
    x, z, m = force_in_wake(actuators[at], wake, motion, motion.w, -motion.q, motion.q, part, effects)
    return x, NONE, z, NONE, m, NONE


def fin_angle_limits(fin: Any) -> tuple[float, float]:
    """The smallest and the largest angle of a fin, rad."""
    return -fin.limit, fin.limit


def _sketch(axis: Role) -> Callable[[Surface], tuple[Sketch, ...]]:
    def sketch(surface: Surface) -> tuple[Sketch, ...]:
        """Blades of unknown size at the position that the lever of the moment implies."""
        lever = surface.moment / surface.lift if surface.lift else surface.station
        return (blades(lever if axis == "yaw" else -lever, 0.0, 0.0, 0.05, 0.15, axis),)

    return sketch


def _form(axis: Role, force: Any, in_wake: Any) -> PartKind:
    return PartKind(
        name="surface",
        title="control surface given by its coefficients",
        parameters=Surface,
        effects=SurfaceEffects,
        order=10 if axis == "yaw" else 11,
        slot=f"surface_{axis}",
        choice="axis",
        commands=(Command("rad", fin_angle_limits, role=axis),),
        force=force,
        in_wake=in_wake,
        shape=shape,
        times=times,
        with_hull=True,
        coefficients=("moment",),
        doubted=("lift", "moment", "drag", "drag_rate", "drag_slip"),
        sketch=_sketch(axis),
    )


KIND = PartKind(
    name="surface",
    title="control surface given by its coefficients",
    parameters=Surface,
    effects=SurfaceEffects,
    order=10,
    choice="axis",
    variants={
        "yaw": _form("yaw", yaw_force, yaw_in_wake),
        "pitch": _form("pitch", pitch_force, pitch_in_wake),
    },
)
