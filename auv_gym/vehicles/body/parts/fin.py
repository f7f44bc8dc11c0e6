"""A control surface defined by its geometry: area, position, lift slope and stall; needs no captive tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import atan2, sin, sqrt
from typing import Any

from auv_gym.compiled import compiled
from auv_gym.param import param
from auv_gym.vehicles.body.kinds import NONE, Command, PartKind, Role, Sketch, blades
from auv_gym.vehicles.body.parts.surface import SurfaceEffects, fin_angle_limits, placed, shape, times

AT_REST = 1e-9  # m/s; below this, the flow has no direction


@dataclass(frozen=True)
class Fin:
    """A fin with lift rho/2 A C_L V^2 across the local flow and drag rho/2 A C_D V^2 against it, at its position.

    The flow is the vehicle's, including its rotation, at x, y, z, without the component along the fin's span. C_L is
    lift_slope times the angle of attack up to stall; beyond, it follows a flat plate, sin(2 angle), down to zero at 90
    deg.  C_D = drag + induced C_L^2, plus plate (sin^2 angle - sin^2 stall) beyond stall. Two fins that move together
    are one of twice the area.  A positive angle of a fin with axis "yaw" turns its nose to starboard, of one with axis
    "pitch" up: behind the centre the former turns the vehicle to port, the latter pitches it down.
    Source: Fossen 2021, sec. 9.7; the lift of a plate beyond stall: Beard and McLain 2012, Small Unmanned Aircraft, eq.
    (4.9), in form.
    """

    area: float = param(0.0, "m^2", "area of the {}", bounds=(0.0, 100.0))
    lift_slope: float = param(0.0, "1/rad", "lift slope of the {}", bounds=(0.0, 10.0))
    drag: float = param(0.0, "1", "drag coefficient of the {} without lift", bounds=(0.0, 1.0))
    induced: float = param(0.0, "1", "drag of the {} per lift coefficient squared", bounds=(0.0, 2.0))
    plate: float = param(0.0, "1", "drag coefficient of the {} across the flow", bounds=(0.0, 3.0))
    stall: float = param(0.35, "rad", "angle of attack at which the {} stalls", bounds=(0.01, 1.5))
    x: float = param(0.0, "m", "place of the {}, forward", bounds=(-50.0, 50.0))
    y: float = param(0.0, "m", "place of the {}, to starboard", bounds=(-10.0, 10.0))
    z: float = param(0.0, "m", "place of the {}, down", bounds=(-10.0, 10.0))
    limit: float = param(0.349066, "rad", "{} stop", bounds=(0.0, 1.5708))
    lag: float = param(0.0, "s", "{} actuator time constant", bounds=(0.0, 10.0))
    slowness: float = param(0.0, "s/rad", "{} actuator rate limit, as time per angle", bounds=(0.0, 100.0))


@compiled
def lift_and_drag(angle, part):
    """C_L and C_D at an angle of attack, rad, of any size."""
    edge, c, s = sin(part.stall), sin(2.0 * part.stall), sin(angle)
    if abs(angle) <= part.stall:
        lift, beyond = part.lift_slope * angle, 0.0
    else:
        lift, beyond = part.lift_slope * part.stall * sin(2.0 * angle) / c, s * s - edge * edge
    return lift, part.drag + part.induced * lift * lift + part.plate * max(beyond, 0.0)


@compiled
def fin_force(position, forward, across, water, part, effects):
    """Force along the chord and across it, N, in a flow, m/s; position: of the actuator, rad."""
    square = forward * forward + across * across
    if square < AT_REST * AT_REST:
        return NONE, NONE
    lift, drag = lift_and_drag(placed(position, effects) - atan2(across, forward), part)
    push = 0.5 * water * part.area * (1.0 - effects.lost) * sqrt(square)
    return -push * (drag * forward + lift * across), push * (lift * forward - drag * across)


@compiled
def yaw_force(at, actuators, inputs, shared, motion, part, effects, derived):
    """Forces of a vertical fin."""
    u = motion.u + motion.q * part.z - motion.r * part.y
    v = motion.v + motion.r * part.x - motion.p * part.z
    x, y = fin_force(actuators[at], u, v, motion.water, part, effects)
    return x, y, NONE, -part.z * y, part.z * x, part.x * y - part.y * x


@compiled
def pitch_force(at, actuators, inputs, shared, motion, part, effects, derived):
    """Forces of a horizontal fin."""
    u = motion.u + motion.q * part.z - motion.r * part.y
    w = motion.w + motion.p * part.y - motion.q * part.x
    x, up = fin_force(actuators[at], u, -w, motion.water, part, effects)
    return x, NONE, -up, -part.y * up, part.z * x + part.x * up, -part.y * x


@compiled
def yaw_damping(part, effects, derived, water, inverse_mass, rates):
    """Damping of sway and yaw by a vertical fin, 1/s per |u|."""
    slope = 0.5 * water * part.area * (part.lift_slope + part.drag + part.plate)
    rates[1, 1] += abs(inverse_mass[1, 1]) * slope
    rates[5, 1] += abs(inverse_mass[5, 5]) * slope * part.x * part.x


@compiled
def pitch_damping(part, effects, derived, water, inverse_mass, rates):
    """Damping of heave and pitch by a horizontal fin, 1/s per |u|."""
    slope = 0.5 * water * part.area * (part.lift_slope + part.drag + part.plate)
    rates[2, 1] += abs(inverse_mass[2, 2]) * slope
    rates[4, 1] += abs(inverse_mass[4, 4]) * slope * part.x * part.x


def _sketch(axis: Role) -> Callable[[Fin], tuple[Sketch, ...]]:
    def sketch(fin: Fin) -> tuple[Sketch, ...]:
        """Two square blades of the fin's area, to port and starboard or up and down."""
        half = sqrt(fin.area / 8.0)
        return (blades(fin.x, fin.y, fin.z, half, 2.0 * half, axis),)

    return sketch


def _form(axis: Role, force: Any, damping: Any) -> PartKind:
    return PartKind(
        name="fin",
        title="control surface given by its geometry",
        parameters=Fin,
        effects=SurfaceEffects,
        order=12 if axis == "yaw" else 13,
        slot=f"fin_{axis}",
        choice="axis",
        commands=(Command("rad", fin_angle_limits, role=axis),),
        force=force,
        shape=shape,
        times=times,
        damping=damping,
        with_hull=True,
        coefficients=("lift_slope",),
        doubted=("lift_slope", "drag", "induced"),
        same={"lost": ("area", lambda given, size: given * (1.0 - size))},
        sketch=_sketch(axis),
        place=("x", "y", "z"),
    )


KIND = PartKind(
    name="fin",
    title="control surface given by its geometry",
    parameters=Fin,
    effects=SurfaceEffects,
    order=12,
    choice="axis",
    variants={
        "yaw": _form("yaw", yaw_force, yaw_damping),
        "pitch": _form("pitch", pitch_force, pitch_damping),
    },
)
