"""A thruster at its position: thrust along its direction by a curve of its command, with supply voltage and lag."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, make_dataclass
from math import cos, sin, sqrt
from typing import Any

import numpy as np

from auv_gym.compiled import compiled
from auv_gym.effects import effects_on_commands
from auv_gym.param import did_you_mean, param, part
from auv_gym.physics.actuators import shaped_command
from auv_gym.vehicles.body.kinds import Command, PartKind, Sketch

POINTS = 41  # of a curve, evenly spaced from the command -1 to 1
PULSE_MIDDLE, PULSE_HALF = 1500.0, 400.0  # microseconds, of a pulse-width command
COMMANDS = np.arange(-(POINTS // 2), POINTS // 2 + 1) / (POINTS // 2)


def _name(command: float) -> str:
    return f"{'m' if command < 0.0 else 'p'}{abs(round(100.0 * command)):03d}"


ThrustCurve = make_dataclass(
    "ThrustCurve",
    [
        (_name(c), float, param(0.0, "N", f"thrust of the {{}} at command {c:g}", bounds=(-1e5, 1e5)))
        for c in COMMANDS.tolist()
    ],
    frozen=True,
    namespace={
        "__module__": __name__,
        "__doc__": "Thrust at commands from -1 to 1, in hundredths in the names, N; linear between.",
        "as_array": True,
    },
)


@dataclass(frozen=True)
class Thruster:
    """Thrust T(c) (V / voltage)^power along its direction, in body axes, and torque_arm T about it.

    The curve is for the supply `voltage`; power 0 ignores the supply. A command c within dead_zone of zero gives no
    thrust. limit: largest c.
    """

    x: float = param(0.0, "m", "place of the {}, forward", bounds=(-50.0, 50.0))
    y: float = param(0.0, "m", "place of the {}, to starboard", bounds=(-10.0, 10.0))
    z: float = param(0.0, "m", "place of the {}, down", bounds=(-10.0, 10.0))
    to_x: float = param(1.0, "1", "direction of the {}, forward", bounds=(-1.0, 1.0))
    to_y: float = param(0.0, "1", "direction of the {}, starboard", bounds=(-1.0, 1.0))
    to_z: float = param(0.0, "1", "direction of the {}, down", bounds=(-1.0, 1.0))
    torque_arm: float = param(0.0, "m", "torque of the {} about its direction per thrust", bounds=(-1.0, 1.0))
    dead_zone: float = param(0.0, "1", "largest command at which the {} gives no thrust", bounds=(0.0, 0.9))
    limit: float = param(1.0, "1", "largest command of the {}", bounds=(0.01, 1.0))
    voltage: float = param(16.0, "V", "supply voltage of the curve of the {}", bounds=(0.1, 1e4))
    power: float = param(0.0, "1", "power of the supply voltage in the thrust of the {}", bounds=(0.0, 4.0))
    lag: float = param(0.0, "s", "{} time constant", bounds=(0.0, 60.0))
    slowness: float = param(0.0, "s", "{} rate limit, as time from zero to full", bounds=(0.0, 600.0))
    curve: Any = part(ThrustCurve, "{}")


_BOTH_WAYS = "commands of the {} both ways, of one size"
_MOVING = "commands of the {} at rest and under way"
_ALONE = "commands of the {} alone"
ThrusterEffects = effects_on_commands(
    "ThrusterEffects",
    __name__,
    "1",
    {
        "offset": 0.02,
        "gain": 0.05,
        "deadband": 0.03,
        "dead_time": 0.2,
        "lost_travel": 0.05,
        "lag": 0.2,
        "slowness": 1.0,
        "lost": 0.05,
    },
    titles={"slowness": "{} rate limit, as time to full", "lost": "share of the thrust of {} lost"},
    more={
        "astern": param(
            0.0, "1", "share of the thrust of {} lost astern", bounds=(-1.0, 1.0), probe=0.05, apart=_BOTH_WAYS
        ),
        "inflow": param(
            0.0, "N s/m", "thrust of {} lost to the flow along it", bounds=(0.0, 200.0), probe=1.0, apart=_MOVING
        ),
        **{
            f"shift_{axis}": param(
                0.0, "m", f"displacement of {{}} {way}", bounds=(-1.0, 1.0), probe=0.01, apart=_ALONE
            )
            for axis, way in (("x", "forward"), ("y", "to starboard"), ("z", "down"))
        },
        **{
            f"turn_{axis}": param(
                0.0, "rad", f"{{}} turned about the {way} axis", bounds=(-1.5, 1.5), probe=0.05, apart=_ALONE
            )
            for axis, way in (("x", "forward"), ("y", "starboard"), ("z", "downward"))
        },
    },
)


@compiled
def share_of_pulse(command):
    """A pulse width, microseconds, as a share of full thrust."""
    return (command - PULSE_MIDDLE) / PULSE_HALF


@compiled
def _shaped(share, memory, part, e):
    return shaped_command(share, memory, e.gain, e.offset, e.deadband, 0.0, 0.0, part.limit - e.lost_travel)


@compiled
def thruster_pulse_command(command, memory, part, effects, index):
    """The command, from a pulse width in microseconds, after its effects, as a share, and the memory."""
    return _shaped(share_of_pulse(command), memory, part, effects)


@compiled
def thruster_share_command(command, memory, part, effects, index):
    """The command, a share of full thrust, after its effects, and the memory."""
    return _shaped(command, memory, part, effects)


@compiled
def times(part, effects, index):
    """Dead time s, lag s and slowness s, the sums of the vehicle's own and the effects'."""
    return effects.dead_time, part.lag + effects.lag, part.slowness + effects.slowness


@compiled
def curve_thrust(share, curve):
    """Thrust, N, at a share of the command: linear between a curve's points, (POINTS,), constant beyond."""
    at = min(max(0.5 * (share + 1.0) * (POINTS - 1), 0.0), POINTS - 1.0)
    i = min(int(at), POINTS - 2)
    return curve[i] + (at - i) * (curve[i + 1] - curve[i])


@compiled
def force(at, actuators, inputs, shared, motion, part, effects, derived):
    """Thrust along the thruster's direction, its moment about the origin, and its torque."""
    share = actuators[at]
    left = 1.0 - effects.lost
    if share < 0.0:
        left -= effects.astern
    thrust = left * curve_thrust(share, part.curve) if abs(share) > part.dead_zone else 0.0
    supply = inputs[shared] - motion.sag
    if part.power != 0.0 and supply != part.voltage:  # if they are equal, the factor is 1
        thrust *= (max(supply, 0.0) / part.voltage) ** part.power
    k, m, n = derived.k, derived.m, derived.n
    if effects.inflow != 0.0:
        along = derived.x * motion.u + derived.y * motion.v + derived.z * motion.w
        along += derived.p * motion.p + derived.q * motion.q + derived.r * motion.r
        thrust -= effects.inflow * abs(share) * along
    return thrust * derived.x, thrust * derived.y, thrust * derived.z, thrust * k, thrust * m, thrust * n


@compiled
def derive(part, effects, hull, derived):
    """Compute the unit direction, the moment of a thrust of 1 N, p q r without and k m n with its torque."""
    size = sqrt(part.to_x * part.to_x + part.to_y * part.to_y + part.to_z * part.to_z)
    x, y, z = part.to_x / size, part.to_y / size, part.to_z / size
    turn = sqrt(effects.turn_x * effects.turn_x + effects.turn_y * effects.turn_y + effects.turn_z * effects.turn_z)
    if turn != 0.0:
        x, y, z = turned(x, y, z, effects.turn_x / turn, effects.turn_y / turn, effects.turn_z / turn, turn)
    derived.x, derived.y, derived.z = x, y, z
    at_x, at_y, at_z = part.x + effects.shift_x, part.y + effects.shift_y, part.z + effects.shift_z
    derived.p, derived.q, derived.r = at_y * z - at_z * y, at_z * x - at_x * z, at_x * y - at_y * x
    derived.k = derived.p + part.torque_arm * x
    derived.m = derived.q + part.torque_arm * y
    derived.n = derived.r + part.torque_arm * z


@compiled
def turned(x, y, z, a, b, c, angle):
    """A vector rotated about the unit vector a, b, c by an angle, rad.  Source: Fossen 2021, eq. (2.13)."""
    cosine, sine = cos(angle), sin(angle)
    along = (1.0 - cosine) * (a * x + b * y + c * z)
    return (
        cosine * x + sine * (b * z - c * y) + along * a,
        cosine * y + sine * (c * x - a * z) + along * b,
        cosine * z + sine * (a * y - b * x) + along * c,
    )


@compiled
def damping(part, effects, derived, water, inverse_mass, rates):
    """Damping by the inflow of a thruster at full command, 1/s."""
    if effects.inflow != 0.0:
        own = (derived.x, derived.y, derived.z, derived.p, derived.q, derived.r)
        for i in range(6):
            rates[i, 0] += effects.inflow * abs(inverse_mass[i, i]) * own[i] * own[i]


def _polynomial_t200() -> tuple[tuple[float, float], ...]:
    c = COMMANDS
    thrusts = -140.3 * c**9 + 389.9 * c**7 - 404.1 * c**5 + 176.0 * c**3 + 8.9 * c
    thrusts[0], thrusts[-1] = thrusts[1], thrusts[-2]  # the polynomial falls by 0.1 N beyond 0.95; keep it constant
    return tuple(zip(c.tolist(), thrusts.tolist(), strict=True))


# Sources of the curves.
SOURCES: Mapping[str, str] = {
    "t200": "Blue Robotics T200 at 16 V: measurements of MrEkelund/ExjobbROV (BlueROV of 2016), measuredthrust.txt",
    "t200_von_benzon": "von Benzon et al. 2022, JMSE 10(12):1898, eq. (18): a T200 of the BlueROV2 Heavy",
}
# Curves that a vehicle file can name: command, thrust in N.
CURVES: Mapping[str, tuple[tuple[float, float], ...]] = {
    # at every twentieth of the command; zero within 0.05
    "t200": (
        *((-1.0, -40.1), (-0.95, -40.0), (-0.9, -36.6), (-0.85, -33.8), (-0.8, -31.2), (-0.75, -28.5), (-0.7, -26.6)),
        *((-0.65, -23.2), (-0.6, -21.4), (-0.55, -18.5), (-0.5, -16.1), (-0.45, -13.1), (-0.4, -11.0), (-0.35, -8.9)),
        *((-0.3, -6.8), (-0.25, -5.1), (-0.2, -3.5), (-0.15, -1.9), (-0.1, -0.5), (-0.05, 0.0), (0.0, 0.0)),
        *((0.05, 0.0), (0.1, 1.1), (0.15, 2.6), (0.2, 4.1), (0.25, 6.2), (0.3, 8.3), (0.35, 10.8)),
        *((0.4, 13.7), (0.45, 16.5), (0.5, 19.2), (0.55, 21.8), (0.6, 24.7), (0.65, 27.7), (0.7, 31.3)),
        *((0.75, 33.8), (0.8, 37.1), (0.85, 39.3), (0.9, 42.9), (0.95, 47.1), (1.0, 50.0)),
    ),
    "t200_von_benzon": _polynomial_t200(),
}


def read_curve(given: Any) -> dict[str, float]:
    """A vehicle file's curve at POINTS commands: given by name, or as rows of command, -1 to 1, and thrust in N.

    Raises ValueError for anything else, and if it does not span -1 to 1 or does not rise.
    """
    if isinstance(given, str):
        if given not in CURVES:
            raise ValueError(
                f"curve has no name {given!r}. {did_you_mean(given, CURVES)}Known: {', '.join(CURVES)}; or give "
                "rows of command, -1 to 1, and thrust in N"
            )
        given = CURVES[given]
    try:
        rows = np.array([[float(c), float(t)] for c, t in given])
    except (TypeError, ValueError):
        raise ValueError(
            f"curve needs rows of command and thrust, N, such as [[-1, -40], [0, 0], [1, 50]], got {given!r}"
        ) from None
    if len(rows) < 2 or not np.isfinite(rows).all() or rows[0, 0] != -1.0 or rows[-1, 0] != 1.0:
        raise ValueError("curve needs finite rows from command -1 to command 1")
    if not (np.diff(rows[:, 0]) > 0.0).all() or not (np.diff(rows[:, 1]) >= 0.0).all():
        at = int(np.argmin(np.minimum(np.diff(rows[:, 0]) > 0.0, np.diff(rows[:, 1]) >= 0.0)))
        raise ValueError(
            f"curve needs commands that rise and thrusts that do not fall, got {rows[at].tolist()} before "
            f"{rows[at + 1].tolist()}: sort its rows, or turn the thruster's direction round"
        )
    return dict(zip(map(_name, COMMANDS.tolist()), np.interp(COMMANDS, rows[:, 0], rows[:, 1]).tolist(), strict=True))


def _curve_entries(given: Any) -> Mapping[str, Any]:
    """A curve as entries of a vehicle file; a named curve includes its source."""
    thrusts = read_curve(given)
    if not isinstance(given, str):
        return thrusts
    return {name: {"value": thrust, "source": SOURCES[given]} for name, thrust in thrusts.items()}


def _problem(thruster: Thruster) -> str:
    if not any((thruster.to_x, thruster.to_y, thruster.to_z)):
        return ": to_x, to_y, to_z is a direction of length 0: say where its thrust points, such as to_x = 1"
    thrusts = np.array([getattr(thruster.curve, _name(c)) for c in COMMANDS.tolist()])
    if not (np.diff(thrusts) >= 0.0).all():
        at = _name(float(COMMANDS[int(np.argmin(np.diff(thrusts)))]))
        return f".curve falls after {at}: thrust must rise with the command, or turn the thruster's direction round"
    return ""


def _sketch(thruster: Thruster) -> tuple[Sketch, ...]:
    tail = (thruster.x, thruster.y, thruster.z)
    head = (thruster.x + 0.1 * thruster.to_x, thruster.y + 0.1 * thruster.to_y, thruster.z + 0.1 * thruster.to_z)
    return (Sketch((tail, head)),)


def _limits_of_pulse(thruster: Thruster) -> tuple[float, float]:
    return PULSE_MIDDLE - PULSE_HALF * thruster.limit, PULSE_MIDDLE + PULSE_HALF * thruster.limit


def _limits_of_share(thruster: Thruster) -> tuple[float, float]:
    return -thruster.limit, thruster.limit


def _table(thruster: Thruster) -> tuple[np.ndarray, np.ndarray]:
    """Shares of the command from -limit to limit, rising, and thrusts; both edges of the dead zone appear twice."""
    edge, limit = thruster.dead_zone, thruster.limit
    pushes = np.array([getattr(thruster.curve, _name(c)) for c in COMMANDS.tolist()])
    inner = [c for c in COMMANDS.tolist() if edge < c < limit]
    ahead = np.unique([edge, *inner, max(limit, edge)])
    astern = -ahead[::-1]
    shares = np.concatenate([astern, [-edge, edge], ahead]) if edge > 0.0 else np.concatenate([astern[:-1], ahead])
    thrusts = np.interp(shares, COMMANDS, pushes)
    if edge > 0.0:
        thrusts[astern.size : astern.size + 2] = 0.0
    return shares, thrusts


def _table_of_pulses(thruster: Thruster) -> tuple[np.ndarray, np.ndarray]:
    shares, thrusts = _table(thruster)
    return PULSE_MIDDLE + PULSE_HALF * shares, thrusts


def _share_at(thruster: Thruster, shared: Mapping[str, float]) -> float:
    return (max(shared["supply_V"], 0.0) / thruster.voltage) ** thruster.power


def _added(given: float, size: float) -> float:
    return given + size


def _form(suffix: str, shape: Any, limits: Any, table: Any = _table, idle: float = 0.0) -> PartKind:
    return PartKind(
        name="thruster",
        title="thruster at a position",
        parameters=Thruster,
        effects=ThrusterEffects,
        order=40,
        slot=f"thruster_{suffix}",
        choice="command",
        commands=(Command(suffix, limits, idle=idle),),
        force=force,
        shape=shape,
        times=times,
        derive=derive,
        damping=damping,
        numbers=("x", "y", "z", "k", "m", "n", "p", "q", "r"),
        same={f"shift_{axis}": (axis, _added) for axis in "xyz"},
        shared={"supply_V": "voltage", "elapsed_s": ""},
        texts={"curve": _curve_entries},
        problem=_problem,
        sketch=_sketch,
        place=("x", "y", "z"),
        thrusts=table,
        thrust_share=_share_at,
    )


KIND = PartKind(
    name="thruster",
    title="thruster at a position",
    parameters=Thruster,
    effects=ThrusterEffects,
    order=40,
    choice="command",
    variants={
        "share": _form("share", thruster_share_command, _limits_of_share),
        "pulse": _form("us", thruster_pulse_command, _limits_of_pulse, _table_of_pulses, PULSE_MIDDLE),
    },
)
