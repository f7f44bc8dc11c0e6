"""A propeller, by shaft speed, by voltage or for a desired speed, with its torque and its wake."""

from __future__ import annotations

from dataclasses import dataclass, make_dataclass
from typing import Any

from auv_gym.compiled import compiled
from auv_gym.effects import effects_on_commands
from auv_gym.param import param, part
from auv_gym.physics.actuators import shaped_command
from auv_gym.physics.propulsion import (
    COLUMNS,
    INFLOWS,
    RADPS_PER_RPM,
    ROWS,
    VOLTAGES,
    shaft_law,
    slipstream_speed,
    table_thrust,
)
from auv_gym.vehicles.body.kinds import NONE, Command, PartKind


@dataclass(frozen=True)
class HullInWake:
    """The wake of the NPS form, and the hull coefficients that it multiplies; each name ends in the variable.

    eps = -1 + sign(n)/sign(u) (sqrt(C_t + 1) - 1)/(sqrt(C_t1 + 1) - 1), C_t = C_t1 eta|eta|, eta = pitch n/u.
    Source: Healey and Lienard 1993, IEEE J. Oceanic Eng. 18(3).
    """

    c_t1: float = param(0.0, "1", "thrust loading C_t1 at self propulsion; 0 for no wake", bounds=(0.0, 10.0))
    pitch: float = param(0.0, "m/rad", "speed per shaft speed at self propulsion", bounds=(0.0, 10.0))
    z_uq: float = param(0.0, "kg", "heave force from u q, in the wake")
    z_uw: float = param(0.0, "kg/m", "heave force from u w, in the wake")
    k_up: float = param(0.0, "kg m", "roll moment from u p, in the wake")
    m_uq: float = param(0.0, "kg m", "pitch moment from u q, in the wake")
    m_uw: float = param(0.0, "kg", "pitch moment from u w, in the wake")


def _thrust_row(voltage: float) -> type:
    fields = []
    for speed in INFLOWS:
        name = f"at_{'m' if speed < 0.0 else ''}{abs(round(100.0 * speed))}"
        title = f"thrust at {voltage:g} V and {speed:g} m/s inflow"
        fields.append((name, float, param(0.0, "N", title, bounds=(-1e5, 1e5))))
    namespace = {"__module__": __name__, "__doc__": f"Thrust at {voltage:g} V over INFLOWS (cm/s in the names), N."}
    return make_dataclass(f"ThrustAt{voltage:g}V", fields, frozen=True, namespace=namespace)


_THRUST_ROWS = {voltage: _thrust_row(voltage) for voltage in VOLTAGES}
globals().update({row.__name__: row for row in _THRUST_ROWS.values()})  # pickle looks for them here
ThrustTable = make_dataclass(
    "ThrustTable",
    [(f"v{voltage:g}", row, part(row)) for voltage, row in _THRUST_ROWS.items()],
    frozen=True,
    namespace={
        "__module__": __name__,
        "__doc__": "Thrust over voltage and axial inflow, N; astern, T(-V, u) = -T(V, -u).",
        "as_array": True,
    },
)


@dataclass(frozen=True)
class Propeller:
    """Thrust and torque from the propulsion command c: shaft speed, voltage or desired speed, depending on the variant.

    Shaft speed n in rad/s (the channel is in rpm): T = t_nn n|n| + t_nu |n| u, Q = q_nn n|n| + q_nu |n| u, which is
    also the advance-number form K_T(J) linear in J = u/(n D).  Desired speed: T = t_cc c|c|.  Voltage: the table.
    limit, lag, slowness: of the command, in its channel's unit.
    """

    t_nn: float = param(0.0, "N s^2/rad^2", "thrust per shaft speed squared", bounds=(0.0, 1e4))
    t_nu: float = param(0.0, "N s^2/(rad m)", "thrust per shaft speed and advance speed", bounds=(-1e4, 0.0))
    q_nn: float = param(0.0, "N m s^2/rad^2", "hull torque per shaft speed squared", bounds=(-1e3, 1e3))
    q_nu: float = param(0.0, "N s^2/rad", "hull torque per shaft speed and advance speed", bounds=(-1e3, 1e3))
    t_cc: float = param(0.0, "kg/m", "thrust per desired speed squared", bounds=(0.0, 1e5))
    torque_arm: float = param(0.0, "m", "hull torque per thrust", bounds=(-1.0, 1.0))
    design: float = param(0.0, "channel's", "command of the {} at the design speed", bounds=(0.0, 1e5))
    limit: float = param(1.0, "channel's", "largest command of the {}", bounds=(1e-6, 1e5))
    lag: float = param(0.0, "s", "{} time constant", bounds=(0.0, 60.0))
    slowness: float = param(0.0, "s", "{} rate limit, as time from zero to full", bounds=(0.0, 600.0))
    table: Any = part(ThrustTable)
    wake: Any = part(HullInWake)


PropellerEffects = effects_on_commands(
    "PropellerEffects",
    __name__,
    "1",
    {
        "offset": 0.03,
        "gain": 0.05,
        "deadband": 0.03,
        "dead_time": 0.5,
        "lost_travel": 0.05,
        "lag": 0.5,
        "slowness": 2.0,
        "lost": 0.03,
    },
    titles={"slowness": "{} rate limit, as time to full", "lost": "share of the thrust lost"},
    more={
        "torque": param(0.0, "m", "propeller torque on the hull per thrust", bounds=(-1.0, 1.0), probe=0.003),
    },
)


@compiled
def shape(command, memory, part, effects, index):
    """The command after the actuator's effects, whose sizes are shares of the largest command, and the memory."""
    limit = part.limit
    return shaped_command(
        command,
        memory,
        effects.gain,
        effects.offset * limit,
        effects.deadband * limit,
        0.0,
        0.0,
        limit - effects.lost_travel * limit,
    )


@compiled
def times(part, effects, index):
    """Dead time s, lag s and slowness s per unit of the command, the sums of the vehicle's own and the effects'."""
    return effects.dead_time, part.lag + effects.lag, (part.slowness + effects.slowness) / part.limit


@compiled
def thrust_and_torque(command, u, density, part, effects, derived):
    """Thrust, N, and roll moment, N m, at a command in its channel's unit; density: over that of the coefficients."""
    n = RADPS_PER_RPM * command
    thrust = shaft_law(n, u, part.t_nn, part.t_nu) + part.t_cc * command * abs(command)
    torque = shaft_law(n, u, part.q_nn, part.q_nu)
    if derived.has_table != 0.0:
        thrust += table_thrust(command, u, part.table)
    working = density * (1.0 - effects.lost)
    thrust *= working
    return thrust, working * torque + (part.torque_arm + effects.torque) * thrust


@compiled
def force(at, actuators, inputs, shared, motion, part, effects, derived):
    """Thrust along the hull's axis, and torque about it."""
    thrust, torque = thrust_and_torque(actuators[at], motion.u, motion.density, part, effects, derived)
    return thrust, NONE, NONE, torque, NONE, NONE


@compiled
def in_wake(at, actuators, wake, motion, part, effects):
    """The hull's force in the wake."""
    stream, law = motion.density * wake, part.wake
    heave = stream * (law.z_uq * motion.q + law.z_uw * motion.w)
    pitch = stream * (law.m_uq * motion.q + law.m_uw * motion.w)
    return NONE, NONE, heave, stream * law.k_up * motion.p, pitch, NONE


@compiled
def wake(at, actuators, u, part, effects):
    """The speed that the propeller adds to the flow at the surfaces, m/s."""
    if part.wake.c_t1 == 0.0:
        return 0.0
    return slipstream_speed(RADPS_PER_RPM * actuators[at], u, part.wake.pitch, part.wake.c_t1)


@compiled
def derive(part, effects, hull, derived):
    """Set whether there is a thrust table."""
    derived.has_table = 0.0
    for i in range(ROWS * COLUMNS):
        if part.table[i] != 0.0:
            derived.has_table = 1.0


def _limits(propeller: Propeller) -> tuple[float, float]:
    return -propeller.limit, propeller.limit


def _form(suffix: str, channel: str = "") -> PartKind:
    return PartKind(
        name="propeller",
        title="propeller",
        parameters=Propeller,
        effects=PropellerEffects,
        order=30,
        slot="propeller",
        choice="command",
        commands=(Command(suffix, _limits, role="surge", design="design", channel=channel),),
        force=force,
        shape=shape,
        times=times,
        derive=derive,
        wake=wake,
        in_wake=in_wake,
        numbers=("has_table",),
        doubted=("t_nn", "t_nu", "q_nn", "q_nu", "t_cc", "torque_arm"),
        same={"torque": ("torque_arm", lambda given, size: given + size)},
    )


KIND = PartKind(
    name="propeller",
    title="propeller",
    parameters=Propeller,
    effects=PropellerEffects,
    order=30,
    choice="command",
    variants={"shaft_speed": _form("rpm"), "voltage": _form("V"), "speed": _form("mps", "speed_cmd_mps")},
)
