"""Lift, drag and side force by angles of attack and sideslip, for wings or a whole vehicle, such as a glider."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, sin, sqrt

from auv_gym.compiled import compiled
from auv_gym.effects import effects_on_commands
from auv_gym.param import list_paths, param, value_at
from auv_gym.physics.polar import polar_drag, polar_lift
from auv_gym.vehicles.body.hull import Hull
from auv_gym.vehicles.body.kinds import NONE, PartKind, Sketch

AT_REST = 1e-9  # m/s; below this, the flow has no direction


@dataclass(frozen=True)
class Wings:
    """Forces and moments in flow axes, all times the square of the speed: drag = (drag_0 + drag_2 alpha^2) V^2.

    alpha = atan2(w, u), beta = asin(v/V), of the flow at x, y, z. Drag acts against the flow, lift across it and up,
    the side force across it and to starboard; the moments are about the flow axes, the first of which is the flow's
    direction. covers: 1 if the set is for the whole vehicle, whose hull must then have no coefficients of its own; 0
    for wings alone.
    Source: Graver 2005, Underwater Gliders: Dynamics, Control and Design, PhD thesis, Princeton, sec. 3.1.4; Zhang, Yu,
    Zhang and Zhang 2013, Ocean Engineering 60 (terms in p, q, r).
    """

    drag_0: float = param(0.0, "kg/m", "drag of the {} at no angle of attack", bounds=(0.0, 1e5))
    drag_2: float = param(0.0, "kg/(m rad^2)", "drag of the {} per angle of attack squared", bounds=(0.0, 1e6))
    lift_0: float = param(0.0, "kg/m", "lift of the {} at no angle of attack", bounds=(-1e5, 1e5))
    lift_1: float = param(0.0, "kg/(m rad)", "lift of the {} per angle of attack", bounds=(0.0, 1e6))
    side: float = param(0.0, "kg/(m rad)", "side force of the {} per angle of sideslip", bounds=(-1e6, 1e6))
    roll: float = param(0.0, "kg/rad", "roll moment of the {} per angle of sideslip", bounds=(-1e6, 1e6))
    roll_rate: float = param(0.0, "kg s", "roll moment of the {} per roll rate", bounds=(-1e6, 0.0))
    pitch_0: float = param(0.0, "kg", "pitch moment of the {} at no angle of attack", bounds=(-1e5, 1e5))
    pitch: float = param(0.0, "kg/rad", "pitch moment of the {} per angle of attack", bounds=(-1e6, 1e6))
    pitch_rate: float = param(0.0, "kg s", "pitch moment of the {} per pitch rate", bounds=(-1e6, 0.0))
    yaw: float = param(0.0, "kg/rad", "yaw moment of the {} per angle of sideslip", bounds=(-1e6, 1e6))
    yaw_rate: float = param(0.0, "kg s", "yaw moment of the {} per yaw rate", bounds=(-1e6, 0.0))
    stall: float = param(1.5708, "rad", "angle of attack at which the {} stall", bounds=(0.01, 1.5708))
    covers: float = param(1.0, "1", "1 where the {} stand for the whole vehicle, 0 for wings alone", bounds=(0.0, 1.0))
    x: float = param(0.0, "m", "where the flow at the {} is taken, forward", bounds=(-50.0, 50.0))
    y: float = param(0.0, "m", "where the flow at the {} is taken, starboard", bounds=(-10.0, 10.0))
    z: float = param(0.0, "m", "where the flow at the {} is taken, down", bounds=(-10.0, 10.0))


WingsEffects = effects_on_commands(
    "WingsEffects", __name__, "1", {"lost": 0.05}, titles={"lost": "share of the lift lost"}
)


@compiled
def force(at, actuators, inputs, shared, motion, part, effects, derived):
    """Forces and moments about the origin; zero if the flow has no direction."""
    u = motion.u + motion.q * part.z - motion.r * part.y
    v = motion.v + motion.r * part.x - motion.p * part.z
    w = motion.w + motion.p * part.y - motion.q * part.x
    square = u * u + v * v + w * w
    if square < AT_REST * AT_REST:
        return NONE, NONE, NONE, NONE, NONE, NONE
    speed = sqrt(square)
    alpha, beta = atan2(w, u), atan2(v, sqrt(u * u + w * w))
    scale = motion.density * square
    lifting = min(max(alpha, -part.stall), part.stall)
    drag = scale * polar_drag(lifting, part.drag_0, part.drag_2)
    lift = scale * (1.0 - effects.lost) * polar_lift(lifting, part.lift_0, part.lift_1)
    side = scale * part.side * beta
    roll = scale * (part.roll * beta + part.roll_rate * motion.p)
    pitch = scale * (part.pitch_0 + part.pitch * lifting + part.pitch_rate * motion.q)
    yaw = scale * (part.yaw * beta + part.yaw_rate * motion.r)
    # from flow axes to body axes, Fossen 2021, eqs. (2.139), (2.141)
    ca, sa, cb, sb = cos(alpha), sin(alpha), cos(beta), v / speed
    x = ca * cb * -drag - ca * sb * side - sa * -lift
    y = sb * -drag + cb * side
    z = sa * cb * -drag - sa * sb * side + ca * -lift
    k = ca * cb * roll - ca * sb * pitch - sa * yaw
    m = sb * roll + cb * pitch
    n = sa * cb * roll - sa * sb * pitch + ca * yaw
    return x, y, z, k + part.y * z - part.z * y, m + part.z * x - part.x * z, n + part.x * y - part.y * x


@compiled
def damping(part, effects, derived, water, inverse_mass, rates):
    """Damping of the velocities, 1/s."""
    rates[0, 1] += 2.0 * abs(inverse_mass[0, 0]) * part.drag_0
    rates[1, 1] += abs(inverse_mass[1, 1]) * (abs(part.side) + part.drag_0)
    rates[2, 1] += abs(inverse_mass[2, 2]) * (part.lift_1 + part.drag_0)
    rates[3, 3] += abs(inverse_mass[3, 3] * part.roll_rate)
    rates[4, 3] += abs(inverse_mass[4, 4] * part.pitch_rate)
    rates[5, 3] += abs(inverse_mass[5, 5] * part.yaw_rate)


def _alone(wings: Wings, hull: Hull) -> str:
    """A warning about a hull whose coefficients would count twice beside a set for the whole vehicle."""
    axes = ("surge", "sway", "heave", "roll", "pitch", "yaw", "cross_flow")
    own = [p for p in list_paths(hull) if p.partition(".")[0] in axes and value_at(hull, p) != 0.0]
    own = [p for p in own if p not in ("cross_flow.height", "cross_flow.breadth")]
    if wings.covers < 0.5 or not own:
        return ""
    named = ", ".join(f"hull.{p}" for p in own[:3]) + (" and others" if len(own) > 3 else "")
    return (
        f" stands for the whole vehicle, but the hull has coefficients of its own, {named}, which would count twice: "
        "leave them out, or give {}.covers = 0"
    )


def _sketch(wings: Wings) -> tuple[Sketch, ...]:
    x, y = wings.x, wings.y
    corners = ((x + 0.05, 0.1), (x - 0.15, 0.5), (x - 0.25, 0.5), (x - 0.15, 0.1))
    return tuple(Sketch(tuple((a, y + side * b, wings.z) for a, b in corners)) for side in (-1.0, 1.0))


def _polar(wings: Wings) -> tuple[float, float, float, float] | None:
    """The polar of the vehicle, for `auv_gym.records.gliding.glide_attack`; None for wings alone."""
    if wings.covers < 0.5 or not (wings.drag_0 > 0.0 and wings.drag_2 > 0.0 and wings.lift_1 > 0.0):
        return None
    return wings.drag_0, wings.drag_2, wings.lift_1, wings.lift_0


KIND = PartKind(
    name="wings",
    title="lift, drag and side force by the angles of the flow",
    parameters=Wings,
    effects=WingsEffects,
    order=20,
    force=force,
    damping=damping,
    problem_with_hull=_alone,
    with_hull=True,
    coefficients=("drag_0", "lift_1", "pitch"),
    doubted=("drag_2", "side", "roll", "roll_rate", "pitch_rate", "yaw", "yaw_rate"),
    sketch=_sketch,
    place=("x", "y", "z"),
    polar=_polar,
)
