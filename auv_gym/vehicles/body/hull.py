"""The hull of a vehicle in six degrees of freedom: mass, geometry and hydrodynamic coefficients.

Symbols are SNAME's: X, Y, Z forces and K, M, N moments in body axes forward, starboard, down; `x_udot` is dX/du'.
Hydrodynamic coefficients are those at `density`. In a vehicle file they may be given as printed in the prime system
(unit = "prime", made nondimensional by density and length); reading converts them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from auv_gym.param import param, part
from auv_gym.physics.polynomials import ForceTerms, MomentTerms


@dataclass(frozen=True)
class AddedMass:
    """The hydrodynamic derivatives with respect to acceleration; measured sets need not be symmetric."""

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

    In oblique cross flow, both coefficients enter both forces, weighted by the squares of the flow's components.
    """

    drag_y: float = param(0.0, "1", "cross-flow drag coefficient, sway", bounds=(0.0, 5.0))
    drag_z: float = param(0.0, "1", "cross-flow drag coefficient, heave", bounds=(0.0, 5.0))
    height: float = param(0.0, "m", "height of the hull", bounds=(0.0, 50.0))
    breadth: float = param(0.0, "m", "breadth of the hull", bounds=(0.0, 50.0))


@dataclass(frozen=True)
class Hull:
    """Mass, geometry and hydrodynamic coefficients of a vehicle in six degrees of freedom, about the body origin.

    i_xy, i_yz, i_xz are the products of inertia, integrals of x y dm: they enter the inertia tensor with a minus sign.
    coriolis_of_added_mass: 1 adds C_A(v) v built from the symmetric part of the added mass; 0 if the polynomials
    already include it, as when they come from captive tests or from a table that lists these terms.
    """

    density: float = param(1025.0, "kg/m^3", "water density of the coefficients", bounds=(900.0, 1100.0))
    gravity: float = param(9.81, "m/s^2", "acceleration of gravity", bounds=(9.7, 9.9))
    length: float = param(2.0, "m", "length", bounds=(0.1, 100.0))
    diameter: float = param(0.2, "m", "diameter", bounds=(0.01, 20.0))
    mass: float = param(50.0, "kg", "mass, with the water inside", bounds=(0.1, 1e7))
    buoyancy: float = param(490.5, "N", "buoyancy", bounds=(0.0, 1e8))
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
