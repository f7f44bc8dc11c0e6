"""Lift and drag by the angle of attack, and the steady glide of a vehicle of which no more is known."""

from __future__ import annotations

from math import cos, pi, sin, sqrt, tan

from auv_gym.compiled import compiled

_LEAST = 1e-9  # N, below which a net buoyancy moves nothing
_EDGE = 1e-9  # rad, from the ends of the interval in which the attack lies
_CLOSE = 1e-13  # rad, a change of the attack that ends the search
_TURNS = 60  # of the search; halving alone would take fifty


@compiled
def polar_drag(attack, drag_0, drag_2):
    """Drag, in the unit of drag_0: drag_0 + drag_2 attack^2.  attack: rad."""
    return drag_0 + drag_2 * attack * attack


@compiled
def polar_lift(attack, lift_0, lift_1):
    """Lift across the flow and up, in the unit of lift_0: lift_0 + lift_1 attack.  attack: rad."""
    return lift_0 + lift_1 * attack


@compiled
def steady_glide(force, pitch, density, area, drag_0, drag_power, drag_2, lift_1):
    """Speed, m/s, path angle and angle of attack, rad, at which lift and drag balance a net buoyancy.

    force: N, up.  pitch: rad, nose up.  density: kg/m^3.  With q = density speed^2 / 2 in Pa, drag is
    area q (drag_0 q^drag_power + drag_2 attack^2) and lift area q lift_1 attack.  The path angle is positive up, pitch
    less attack.  Of several balances, the one of the least attack, which is the fastest.
    Source: Eriksen et al. 2001, IEEE J. Oceanic Eng. 26(4), eqs. (3) to (7), solved for the angle of attack.
    """
    side = 1.0 if force >= 0.0 else -1.0
    lifting = abs(force)
    nose = side * pitch
    if lifting < _LEAST:
        return 0.0, pitch, 0.0
    # beyond = -side attack > 0, and the path is nose + beyond, between level and vertical
    low, high = max(0.0, -nose) + _EDGE, 0.5 * pi - nose - _EDGE
    pressure = max(lifting * sin(max(nose, 0.05)) / (area * drag_0), 1e-6)
    beyond = drag_0 * pressure**drag_power / (lift_1 * tan(min(max(nose, 0.05), 1.2)))
    if not low < beyond < high:
        beyond = 0.5 * (low + high)
    for _ in range(_TURNS):
        path = nose + beyond
        s, c = sin(path), cos(path)
        # across the path, lift balances the buoyancy's part: this is the pressure
        pressure = lifting * c / (area * polar_lift(beyond, 0.0, lift_1))
        skin = drag_0 * pressure**drag_power if drag_power != 0.0 else drag_0
        slope = s / c
        left = polar_drag(beyond, skin, drag_2) - lift_1 * beyond * slope
        if left > 0.0:
            low = beyond
        else:
            high = beyond
        falls = (
            drag_power * skin * (-slope - 1.0 / beyond)
            + 2.0 * drag_2 * beyond
            - lift_1 * slope
            - lift_1 * beyond / (c * c)
        )
        following = beyond - left / falls if falls != 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        moved = abs(following - beyond)
        beyond = following
        if moved < _CLOSE:
            break
    path = nose + beyond
    pressure = lifting * cos(path) / (area * polar_lift(beyond, 0.0, lift_1))
    return sqrt(2.0 * pressure / density), side * path, -side * beyond
