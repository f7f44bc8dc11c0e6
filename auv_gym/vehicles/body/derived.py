"""Numbers that depend only on a body's parameters, computed once instead of in every step.

The compiled functions of the family read parameters and derived numbers as one record, `view(derived)`; its parts
differ between vehicles, see `compose`. `derive` and `hand_on` are templates, see `compiled.bind`.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from auv_gym.compiled import compiled, outlined
from auv_gym.physics.polynomials import ENVIRONMENT_TERMS, TERMS
from auv_gym.physics.rigid_body import fill_rigid_body_mass, invert

# Placeholders in the template, bound by `compose`.
N_PARAMETERS = N_DERIVED = ACTUATORS = 0
writable_view: Any
derive_parts: Any
damp_by_parts: Any
wakes: Any

N_TERMS = len(TERMS)
# Terms scaled by damping errors: linear terms, a|a|, and lift and damping proportional to u; not a b, which are
# inertial.
_DAMPING = tuple(1.0 if len(t) == 1 or "_" in t or t[0] == "u" else 0.0 for t in TERMS)
DAMPING_TERMS = tuple(term for term, scales in zip(TERMS, _DAMPING, strict=True) if scales)
# Terms scaled by fouling: drag proper, without lift.
_DRAG = tuple(1.0 if len(t) == 1 or "_" in t else 0.0 for t in TERMS)

COMPUTED = np.dtype(
    (
        np.record,
        [
            ("mass", np.float64, (6, 6)),
            ("inverse_mass", np.float64, (6, 6)),
            ("momentum", np.float64, (6, 6)),  # M_RB and the part of M_A whose Coriolis forces are added
            ("rigid_mass", np.float64, (6, 6)),
            ("coefficients", np.float64, (6 * N_TERMS,)),  # the nonzero polynomial coefficients, axis by axis
            ("terms", np.uint64, (6 * N_TERMS,)),  # for each, the index in the result of `fill_terms`
            ("ends", np.uint64, (7,)),  # where the coefficients begin, and where those of each axis end
            ("environment", np.float64, (len(ENVIRONMENT_TERMS), 6)),
            (
                "damping",
                np.float64,
                (6, 4),
            ),  # rates, 1/s: constant, per |u|, per own speed, per u^2; for the stable step
            ("cross_y", np.float64),
            ("cross_z", np.float64),
            ("density", np.float64),  # relative to that of the coefficients
            ("weight", np.float64),
            ("buoyancy", np.float64),
            ("x_g", np.float64),
            ("y_g", np.float64),
            ("z_g", np.float64),
            ("has_environment", np.float64),
            ("has_cross_flow", np.float64),
            ("has_lag", np.float64),
            ("has_moving_water", np.float64),
            ("has_waves", np.float64),
            ("has_tether", np.float64),
            ("has_wake", np.float64),
            ("learned", np.float64),  # length of a learned hull's table, which follows in the vector, or 0
        ],
    )
)


@outlined
def fill_added_mass(added, matrix):
    """Write M_A = -[derivatives] into matrix, shape (6, 6); zero where the tree has no such derivative."""
    for i in range(6):
        for j in range(6):
            matrix[i, j] = 0.0
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = -added.x_udot, -added.x_vdot, -added.x_wdot
    matrix[0, 4], matrix[0, 5] = -added.x_qdot, -added.x_rdot
    matrix[1, 1], matrix[1, 3], matrix[1, 5] = -added.y_vdot, -added.y_pdot, -added.y_rdot
    matrix[2, 2], matrix[2, 4] = -added.z_wdot, -added.z_qdot
    matrix[3, 1], matrix[3, 3], matrix[3, 5] = -added.k_vdot, -added.k_pdot, -added.k_rdot
    matrix[4, 2], matrix[4, 4] = -added.m_wdot, -added.m_qdot
    matrix[5, 1], matrix[5, 3], matrix[5, 5] = -added.n_vdot, -added.n_pdot, -added.n_rdot


@compiled
def added_mass_factor(effects, i):
    """1 and the relative error of the added mass on axis i."""
    errors = (
        effects.added_mass_surge,
        effects.added_mass_sway,
        effects.added_mass_heave,
        effects.added_mass_roll,
        effects.added_mass_pitch,
        effects.added_mass_yaw,
    )
    return 1.0 + errors[i]


@compiled
def damping_error(effects, i):
    """The relative error of the damping on axis i."""
    errors = (
        effects.damping_surge,
        effects.damping_sway,
        effects.damping_heave,
        effects.damping_roll,
        effects.damping_pitch,
        effects.damping_yaw,
    )
    return errors[i]


@compiled
def hull_coefficient(hull, i, k):
    """Coefficient of term k in the polynomial of axis i."""
    if i == 0:
        return hull.surge[k]
    if i == 1:
        return hull.sway[k]
    if i == 2:
        return hull.heave[k]
    if i == 3:
        return hull.roll[k]
    if i == 4:
        return hull.pitch[k]
    return hull.yaw[k]


@outlined
def fill_mass(p, matrix, rigid, momentum):
    """Write M_RB + M_A into matrix, M_RB into rigid, and M_RB plus the M_A with added Coriolis forces into momentum."""
    hull, load = p.hull, p.effects.load
    density = 1.0 + p.effects.water.density
    mass = hull.mass + load.payload
    x, y, z = hull.x_g + load.x_g, hull.y_g + load.y_g, hull.z_g + load.z_g
    fill_rigid_body_mass(mass, x, y, z, hull, rigid)
    # keep the inertia about the centre of gravity: if it were fixed about the origin, a shift of a few centimetres
    # would leave a slender hull without roll inertia
    xx = mass * x * x - hull.mass * hull.x_g * hull.x_g
    yy = mass * y * y - hull.mass * hull.y_g * hull.y_g
    zz = mass * z * z - hull.mass * hull.z_g * hull.z_g
    xy = mass * x * y - hull.mass * hull.x_g * hull.y_g
    yz = mass * y * z - hull.mass * hull.y_g * hull.z_g
    xz = mass * x * z - hull.mass * hull.x_g * hull.z_g
    rigid[3, 3] += yy + zz
    rigid[4, 4] += xx + zz
    rigid[5, 5] += xx + yy
    rigid[3, 4] -= xy
    rigid[4, 3] -= xy
    rigid[4, 5] -= yz
    rigid[5, 4] -= yz
    rigid[3, 5] -= xz
    rigid[5, 3] -= xz
    added = np.empty((6, 6))
    fill_added_mass(hull.added_mass, added)
    for i in range(6):
        added[i, i] *= added_mass_factor(p.effects.hull, i)
    for i in range(6):
        for j in range(6):
            matrix[i, j] = rigid[i, j] + density * added[i, j]
            half = 0.5 * density * hull.coriolis_of_added_mass
            momentum[i, j] = rigid[i, j] + half * (added[i, j] + added[j, i])


@outlined
def without_given_momentum(hull, momentum):
    """Subtract the momentum without effects from momentum, in place."""
    added, rigid = np.empty((6, 6)), np.empty((6, 6))
    fill_rigid_body_mass(hull.mass, hull.x_g, hull.y_g, hull.z_g, hull, rigid)
    fill_added_mass(hull.added_mass, added)
    half = 0.5 * hull.coriolis_of_added_mass
    for i in range(6):
        for j in range(6):
            momentum[i, j] -= rigid[i, j] + half * (added[i, j] + added[j, i])


def hand_on(vector, derived):
    """Call `derive`; Python and compiled code would otherwise each compile it completely."""
    derive(vector, derived)


def derive(vector, derived):
    """Write the parameters and their consequences (masses, active terms, flags) into derived, shape (N_DERIVED,).

    If vector is longer than the parameters, the rest is a learned hull's table, and derived is longer by the same.
    Effects then change the learned forces by their change of the given hull's forces, including Coriolis forces.
    """
    for i in range(N_PARAMETERS):
        derived[i] = vector[i]
    p = writable_view(derived)
    hull, effects, computed = p.hull, p.effects, p.computed
    load = effects.load
    density = 1.0 + effects.water.density
    fill_mass(p, computed.mass, computed.rigid_mass, computed.momentum)
    computed.learned = vector.shape[0] - N_PARAMETERS
    kept = 0.0 if computed.learned == 0.0 else 1.0
    for i in range(N_PARAMETERS, vector.shape[0]):
        derived[N_DERIVED + i - N_PARAMETERS] = vector[i]
    if kept != 0.0:
        without_given_momentum(hull, computed.momentum)
    invert(computed.mass.copy(), computed.inverse_mass)
    count = 0
    computed.ends[0] = 0
    for i in range(6):
        for j in range(4):
            computed.damping[i, j] = 0.0
    for i in range(6):
        for k in range(N_TERMS):
            factor = 1.0 + _DAMPING[k] * damping_error(effects.hull, i)
            factor *= 1.0 + _DRAG[k] * effects.hull.fouling
            given = hull_coefficient(hull, i, k)
            value = density * factor * given + hull_coefficient(effects.discovered, i, k)
            acting = value - kept * given
            if acting != 0.0:
                computed.coefficients[count] = acting
                # published for u > 0: damping of the axis's own velocity uses |u|; otherwise it would drive it astern
                computed.terms[count] = N_TERMS + i - 1 if i > 0 and k == 16 + i else k
                count += 1
            own = abs(computed.inverse_mass[i, i] * value)
            if k == i:
                computed.damping[i, 0] += own
            if k == 6 + i:
                computed.damping[i, 2] += 2.0 * own
            if i > 0 and k == 16 + i:  # u times the axis's own velocity
                computed.damping[i, 1] += own
        computed.ends[i + 1] = count
    computed.has_environment = 0.0
    for k in range(len(ENVIRONMENT_TERMS)):
        for i in range(6):
            value = hull_coefficient(effects.discovered, i, N_TERMS + k)
            computed.environment[k, i] = value
            if value != 0.0:
                computed.has_environment = 1.0
    computed.density = density
    fouling = 1.0 + effects.hull.fouling
    flow = hull.cross_flow
    # the damping errors of sway and heave apply to C_dy and C_dz, which both enter both forces
    computed.cross_y = (fouling * (1.0 + effects.hull.damping_sway) - kept / density) * flow.drag_y * flow.height
    computed.cross_z = (fouling * (1.0 + effects.hull.damping_heave) - kept / density) * flow.drag_z * flow.breadth
    computed.has_cross_flow = 1.0 if computed.cross_y != 0.0 or computed.cross_z != 0.0 else 0.0
    strip = hull.density * density * hull.length  # the slope of a v|v| law in both its speeds
    computed.damping[1, 2] += strip * computed.cross_y * computed.inverse_mass[1, 1]
    computed.damping[2, 2] += strip * computed.cross_z * computed.inverse_mass[2, 2]
    lever = hull.length**3 / 32.0
    computed.damping[4, 2] += strip * computed.cross_z * computed.inverse_mass[4, 4] * lever
    computed.damping[5, 2] += strip * computed.cross_y * computed.inverse_mass[5, 5] * lever
    computed.weight = (hull.mass + load.payload) * hull.gravity
    computed.buoyancy = hull.buoyancy * density + load.net_buoyancy
    computed.x_g, computed.y_g, computed.z_g = hull.x_g + load.x_g, hull.y_g + load.y_g, hull.z_g + load.z_g
    stiffness = computed.weight * computed.z_g - computed.buoyancy * hull.z_b
    computed.damping[3, 0] += 0.5 * sqrt(abs(computed.inverse_mass[3, 3] * stiffness))
    lags = effects.depth.lag + effects.compass.lag + effects.gyros.lag
    computed.has_lag = 1.0 if lags + effects.dvl_ground.lag + effects.dvl_water.lag > 0.0 else 0.0
    waves, current = effects.waves, effects.current
    computed.has_waves = 1.0 if waves.amplitude_cos != 0.0 or waves.amplitude_sin != 0.0 else 0.0
    sheared = current.shear_north != 0.0 or current.shear_east != 0.0
    computed.has_moving_water = 1.0 if sheared or computed.has_waves != 0.0 else 0.0
    pulled = load.tether_north != 0.0 or load.tether_east != 0.0 or load.tether_down != 0.0
    computed.has_tether = 1.0 if pulled or load.tether_drag != 0.0 else 0.0
    derive_parts(p)
    damp_by_parts(p)
    computed.has_wake = 1.0 if wakes(np.zeros(ACTUATORS), 1.0, p) != 0.0 else 0.0
