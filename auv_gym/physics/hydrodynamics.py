"""Hydrodynamic and gravity forces on hull and fins, in body axes."""

from math import atan2, sqrt

from auv_gym.compiled import compiled

STRIPS = 11
AT_REST = 1e-300  # m/s, for a strip without flow, so that its drag is 0, not 0/0


@compiled
def cross_flow_drag(v, w, q, r, drag_y, drag_z, density, length):
    """Sway and heave force, N, pitch and yaw moment, N m, of the flow across a hull of constant section, by strips.

    drag_y, drag_z: drag coefficient times height, and times breadth, m.  The drag of a strip is along its cross flow,
    [drag_y (v+xr)^2 + drag_z (w-xq)^2]/U_cf times the flow, U_cf its speed: both coefficients weigh in both forces.
    Eleven strips from -L/2 to L/2, each of weight L/10.
    Source: Healey and Lienard 1993, IEEE J. Oceanic Eng. 18(3), cross-flow integrals; heave by w - x q in both.
    """
    sway = heave = pitch = yaw = 0.0
    spacing = length / (STRIPS - 1)
    for i in range(STRIPS):
        x = (i - (STRIPS - 1) // 2) * spacing
        across, down = v + x * r, w - x * q
        across_2, down_2 = across * across, down * down
        drag = (drag_y * across_2 + drag_z * down_2) / max(sqrt(across_2 + down_2), AT_REST)
        side, lift = drag * across, drag * down
        sway -= side
        heave -= lift
        pitch += x * lift
        yaw -= x * side
    scale = 0.5 * density * spacing
    return scale * sway, scale * heave, scale * pitch, scale * yaw


@compiled
def angle_of_attack(angle, u, cross, turn, fin):
    """The angle of attack of a pair of fins, without the part that the hull's own terms include, rad, up to stall.

    cross: v at a rudder, w at a plane; turn: r, or -q.  With `fin.inflow` 0, usual for captive tests, the fin's angle.
    """
    if fin.inflow != 0.0:
        flow = atan2(cross + fin.station * turn, abs(u))
        # the force is proportional to u|u|: astern, the flow's part must change sign, or a fin would drive what it
        # damps ahead
        angle -= fin.inflow * flow if fin.lift * u > 0.0 else -fin.inflow * flow
    return min(max(angle, -fin.stall), fin.stall)


@compiled
def righting(weight, buoyancy, x_g, y_g, z_g, x_b, y_b, z_b, down_x, down_y, down_z):
    """Force, N, and moment, N m, of weight and buoyancy; down: the downward direction in body axes.

    Source: Fossen 2021, eq. (4.6), there with the opposite sign, g(eta).
    """
    net = weight - buoyancy
    x, y, z = weight * x_g - buoyancy * x_b, weight * y_g - buoyancy * y_b, weight * z_g - buoyancy * z_b
    return (
        net * down_x,
        net * down_y,
        net * down_z,
        y * down_z - z * down_y,
        z * down_x - x * down_z,
        x * down_y - y * down_x,
    )
