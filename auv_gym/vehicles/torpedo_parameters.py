"""The parameter tree of the six-degree-of-freedom vehicles: hull, fins, propulsion and effects.

Symbols are SNAME's: X, Y, Z forces and K, M, N moments in body axes forward, starboard, down; `x_udot` is dX/du'.
Hydrodynamic coefficients are those at `density`. In a vehicle file they may be given as printed in the prime system
(unit = "prime", made nondimensional by density and length); reading converts them.
"""

from __future__ import annotations

from dataclasses import dataclass, make_dataclass
from typing import Any

from auv_gym.effects import TorpedoEffects
from auv_gym.param import param, part
from auv_gym.physics.polynomials import ForceTerms, MomentTerms
from auv_gym.physics.propulsion import INFLOWS, VOLTAGES


@dataclass(frozen=True)
class AddedMass:
    """The hydrodynamic derivatives in acceleration; measured sets need not be symmetric."""

    x_udot: float = param(0.0, "kg", "added mass X_udot", bounds=(-1e7, 0.0))
    x_vdot: float = param(0.0, "kg", "added mass X_vdot", bounds=(-1e7, 1e7))
    x_wdot: float = param(0.0, "kg", "added mass X_wdot", bounds=(-1e7, 1e7))
    x_qdot: float = param(0.0, "kg m", "added mass X_qdot", bounds=(-1e7, 1e7))
    x_rdot: float = param(0.0, "kg m", "added mass X_rdot", bounds=(-1e7, 1e7))
    y_vdot: float = param(0.0, "kg", "added mass Y_vdot", bounds=(-1e7, 0.0))
    y_pdot: float = param(0.0, "kg m", "added mass Y_pdot", bounds=(-1e7, 1e7))
    y_rdot: float = param(0.0, "kg m", "added mass Y_rdot", bounds=(-1e7, 1e7))
    z_wdot: float = param(0.0, "kg", "added mass Z_wdot", bounds=(-1e7, 0.0))
    z_qdot: float = param(0.0, "kg m", "added mass Z_qdot", bounds=(-1e7, 1e7))
    k_vdot: float = param(0.0, "kg m", "added mass K_vdot", bounds=(-1e7, 1e7))
    k_pdot: float = param(0.0, "kg m^2", "added inertia K_pdot", bounds=(-1e7, 0.0))
    k_rdot: float = param(0.0, "kg m^2", "added inertia K_rdot", bounds=(-1e7, 1e7))
    m_wdot: float = param(0.0, "kg m", "added mass M_wdot", bounds=(-1e7, 1e7))
    m_qdot: float = param(0.0, "kg m^2", "added inertia M_qdot", bounds=(-1e7, 0.0))
    n_vdot: float = param(0.0, "kg m", "added mass N_vdot", bounds=(-1e7, 1e7))
    n_pdot: float = param(0.0, "kg m^2", "added inertia N_pdot", bounds=(-1e7, 1e7))
    n_rdot: float = param(0.0, "kg m^2", "added inertia N_rdot", bounds=(-1e7, 0.0))


@dataclass(frozen=True)
class CrossFlow:
    """Cross-flow drag of a hull of constant section, integrated over strips; both coefficients zero: none.

    Where the flow has both parts, both coefficients weigh in both forces, by the squares of the flow's parts.
    """

    drag_y: float = param(0.0, "1", "cross-flow drag coefficient, sway", bounds=(0.0, 5.0))
    drag_z: float = param(0.0, "1", "cross-flow drag coefficient, heave", bounds=(0.0, 5.0))
    height: float = param(0.0, "m", "height of the hull", bounds=(0.0, 50.0))
    breadth: float = param(0.0, "m", "breadth of the hull", bounds=(0.0, 50.0))


@dataclass(frozen=True)
class Fins:
    """A pair of fins that move together; force = u|u| lift angle, moment = u|u| moment angle, drag = u|u| drag angle^2.

    lift is Y_uudr of a rudder and Z_uuds of a plane, moment N_uudr and M_uuds; the vehicle's own sign convention of the
    angle is in these signs. The hull's polynomials usually hold what the undeflected fins do; where they do not,
    `inflow` 1 adds the angle of the flow at `station` to the fin's angle of attack.
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


@dataclass(frozen=True)
class Slipstream:
    """Terms that multiply the propeller's slipstream eps of the NPS form; each name ends in what eps multiplies.

    eps = -1 + sign(n)/sign(u) (sqrt(C_t + 1) - 1)/(sqrt(C_t1 + 1) - 1), C_t = C_t1 eta|eta|, eta = pitch n/u.
    Source: Healey and Lienard 1993, IEEE J. Oceanic Eng. 18(3).
    """

    c_t1: float = param(
        0.0, "1", "thrust loading C_t1 at self propulsion; 0 for no slipstream terms", bounds=(0.0, 10.0)
    )
    pitch: float = param(0.0, "m/rad", "speed per shaft speed at self propulsion", bounds=(0.0, 10.0))
    x_uq_stern: float = param(0.0, "kg", "surge force from u q stern plane, slipstream")
    x_uw_stern: float = param(0.0, "kg/m", "surge force from u w stern plane, slipstream")
    x_uu_stern: float = param(0.0, "kg/m", "surge force from u u stern plane squared, slipstream")
    z_uq: float = param(0.0, "kg", "heave force from u q, slipstream")
    z_uw: float = param(0.0, "kg/m", "heave force from u w, slipstream")
    z_uu_stern: float = param(0.0, "kg/m", "heave force from u u stern plane, slipstream")
    k_up: float = param(0.0, "kg m", "roll moment from u p, slipstream")
    m_uq: float = param(0.0, "kg m", "pitch moment from u q, slipstream")
    m_uw: float = param(0.0, "kg", "pitch moment from u w, slipstream")
    m_uu_stern: float = param(0.0, "kg", "pitch moment from u u stern plane, slipstream")


def _thrust_row(voltage: float) -> type:
    fields = []
    for speed in INFLOWS:
        name = f"at_{'m' if speed < 0.0 else ''}{abs(round(100.0 * speed))}"
        title = f"thrust at {voltage:g} V and {speed:g} m/s inflow"
        fields.append((name, float, param(0.0, "N", title, bounds=(-1e5, 1e5))))
    namespace = {"__module__": __name__, "__doc__": f"Thrust at {voltage:g} V over INFLOWS (cm/s in the names), N."}
    return make_dataclass(f"ThrustAt{voltage:g}V", fields, frozen=True, namespace=namespace)


_THRUST_ROWS = {voltage: _thrust_row(voltage) for voltage in VOLTAGES}
globals().update({row.__name__: row for row in _THRUST_ROWS.values()})  # where pickle looks for them
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
class Propulsion:
    """Thrust and torque from the propulsion command c: shaft speed, voltage or desired speed, as the family says.

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
    design: float = param(0.0, "channel's", "command at the design speed", bounds=(0.0, 1e5))
    limit: float = param(1.0, "channel's", "largest command", bounds=(1e-6, 1e5))
    lag: float = param(0.0, "s", "propulsion time constant", bounds=(0.0, 60.0))
    slowness: float = param(0.0, "s", "propulsion rate limit, as time from zero to full", bounds=(0.0, 600.0))
    table: Any = part(ThrustTable)


@dataclass(frozen=True)
class TorpedoHull:
    """Mass, geometry and hydrodynamic coefficients of a vehicle in six degrees of freedom, about the body origin.

    i_xy, i_yz, i_xz are the products of inertia, integrals of x y dm: they enter the inertia tensor with a minus.
    coriolis_of_added_mass: 1 adds C_A(v) v built from the symmetric part of the added mass; 0 where the polynomials,
    reduced from captive tests or from a table that lists these terms, hold it already.
    """

    density: float = param(1025.0, "kg/m^3", "water density of the coefficients", bounds=(900.0, 1100.0))
    gravity: float = param(9.81, "m/s^2", "acceleration of gravity", bounds=(9.7, 9.9))
    length: float = param(2.0, "m", "length", bounds=(0.1, 100.0))
    diameter: float = param(0.2, "m", "diameter", bounds=(0.01, 20.0))
    mass: float = param(50.0, "kg", "mass, with the water inside", bounds=(0.1, 1e7))
    buoyancy: float = param(490.5, "N", "buoyancy", bounds=(0.1, 1e8))
    x_g: float = param(0.0, "m", "centre of gravity, forward", bounds=(-10.0, 10.0))
    y_g: float = param(0.0, "m", "centre of gravity, starboard", bounds=(-5.0, 5.0))
    z_g: float = param(0.0, "m", "centre of gravity, down", bounds=(-5.0, 5.0))
    x_b: float = param(0.0, "m", "centre of buoyancy, forward", bounds=(-10.0, 10.0))
    y_b: float = param(0.0, "m", "centre of buoyancy, starboard", bounds=(-5.0, 5.0))
    z_b: float = param(0.0, "m", "centre of buoyancy, down", bounds=(-5.0, 5.0))
    i_xx: float = param(1.0, "kg m^2", "roll inertia", bounds=(1e-6, 1e8))
    i_yy: float = param(1.0, "kg m^2", "pitch inertia", bounds=(1e-6, 1e8))
    i_zz: float = param(1.0, "kg m^2", "yaw inertia", bounds=(1e-6, 1e8))
    i_xy: float = param(0.0, "kg m^2", "product of inertia I_xy", bounds=(-1e8, 1e8))
    i_yz: float = param(0.0, "kg m^2", "product of inertia I_yz", bounds=(-1e8, 1e8))
    i_xz: float = param(0.0, "kg m^2", "product of inertia I_xz", bounds=(-1e8, 1e8))
    coriolis_of_added_mass: float = param(1.0, "1", "share of C_A(v) v that is added", bounds=(0.0, 1.0))
    added_mass: AddedMass = part(AddedMass)
    surge: Any = part(ForceTerms, "surge")
    sway: Any = part(ForceTerms, "sway")
    heave: Any = part(ForceTerms, "heave")
    roll: Any = part(MomentTerms, "roll")
    pitch: Any = part(MomentTerms, "pitch")
    yaw: Any = part(MomentTerms, "yaw")
    cross_flow: CrossFlow = part(CrossFlow)
    rudder: Fins = part(Fins, "rudder")
    stern_plane: Fins = part(Fins, "stern plane")
    bow_plane: Fins = part(Fins, "bow plane")
    slipstream: Slipstream = part(Slipstream)
    propulsion: Propulsion = part(Propulsion)


@dataclass(frozen=True)
class TorpedoParameters:
    """The parameter tree of a six-degree-of-freedom vehicle."""

    hull: TorpedoHull = part(TorpedoHull)
    effects: TorpedoEffects = part(TorpedoEffects)
