"""Lift and drag as functions of the angle of attack, and the resulting steady glide."""

from __future__ import annotations

from math import cos, pi, sin, sqrt, tan

from auv_gym.compiled import compiled

_LEAST = 1e-9  # N, below which a net buoyancy causes no motion
_EDGE = 1e-9  # rad, margin at the ends of the interval of the attack
_CLOSE = 1e-7  # rad, the last step of Newton's method; its error is of the order of the square
_FLAT, _STEEP = 0.05, 1.2  # rad, limits of the pitch in the first guess
_TURNS = 60  # most iterations of the search; bisection alone would take fifty


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

    force: N, up.  pitch: rad, nose up.  density: kg/m^3.  With q = density speed^2 / 2 in Pa, drag is area q (drag_0
    q^drag_power + drag_2 attack^2) and lift area q lift_1 attack.  The path angle is positive up, pitch minus attack.
    Of several balances, the one with the smallest attack, which is the fastest.
    Source: Eriksen et al. 2001, IEEE J. Oceanic Eng. 26(4), eqs. (3) to (7), solved for the angle of attack.
    """
    side = 1.0 if force >= 0.0 else -1.0
    lifting = abs(force)
    nose = side * pitch
    if lifting < _LEAST:
        return 0.0, pitch, 0.0
    # beyond = -side attack > 0, and the path is nose + beyond, between level and vertical
    low, high = max(0.0, -nose) + _EDGE, 0.5 * pi - nose - _EDGE
    # first guess: tangent linear in the attack, drag_0 at the speed of a path as steep as the nose
    steep = tan(min(max(nose, _FLAT), _STEEP))
    pressure = lifting * steep / (sqrt(1.0 + steep * steep) * area * drag_0)
    skin = drag_0 * pressure**drag_power if drag_power != 0.0 else drag_0
    under = (lift_1 * steep) ** 2 + 4.0 * skin * (lift_1 * (1.0 + steep * steep) - drag_2)
    beyond = 2.0 * skin / (lift_1 * steep + sqrt(max(under, 0.0)))
    if not low < beyond < high:
        beyond = 0.5 * (low + high)
    for _ in range(_TURNS):
        path = nose + beyond
        s, c = sin(path), cos(path)
        # across the path, lift balances the component of the buoyancy; this gives the dynamic pressure
        pressure = lifting * c / (area * polar_lift(beyond, 0.0, lift_1))
        skin = drag_0 * pressure**drag_power if drag_power != 0.0 else drag_0
        slope = s / c
        left = polar_drag(beyond, skin, drag_2) - lift_1 * beyond * slope
        grows = 2.0 * drag_2 * beyond - drag_power * skin * (slope + 1.0 / beyond) - lift_1 * (slope + beyond / (c * c))
        step = left / grows if grows != 0.0 else high
        if abs(step) < _CLOSE:
            beyond = min(max(beyond - step, low), high)
            break
        if left > 0.0:
            low = beyond
        else:
            high = beyond
        beyond -= step
        if not low < beyond < high:
            beyond = 0.5 * (low + high)
    path = nose + beyond
    pressure = lifting * cos(path) / (area * polar_lift(beyond, 0.0, lift_1))
    return sqrt(2.0 * pressure / density), side * path, -side * beyond
