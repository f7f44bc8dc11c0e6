"""Steady glides by a polar, against the published laws solved another way, and what holds for all of them."""

from math import atan, cos, degrees, pi, radians, sin, sqrt, tan

import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import brentq

from auv_gym.physics.polar import polar_drag, polar_lift, steady_glide

# SG561 in 2016: length 1.8 m, hd_a per deg, hd_b, hd_c per deg^2, hd_s
LENGTH, HD_A, HD_B, HD_C, HD_S = 1.8, 8.91e-4, 0.0224, 5.7e-6, -0.25
SEAGLIDER = (LENGTH**2, HD_B, HD_S, HD_C * degrees(1.0) ** 2, degrees(HD_A))
# defaults of gliderflight: S, C_D0, C_D1, and a_h with the wings' slope
S, C_D0, C_D1 = 0.1, 0.15, 10.0
A_W = 2.0 * pi * 7.0 / (2.0 + sqrt(49.0 * (1.0 + tan(radians(43.0)) ** 2) + 4.0))
SLOCUM = (S, C_D0, 0.0, C_D1, 3.8 + A_W)
DENSITY = 1027.0
TEN = [(0.4, 16.0), (0.7, 20.0), (1.0, 25.0), (1.4, 30.0), (1.8, 40.0)]
TEN += [(-force, -pitch) for force, pitch in TEN]


def seagliders_speed(force, pitch):
    """Speed and path angle, deg, by the operators' own iteration on the dynamic pressure.

    Source: Eriksen et al. 2001, eqs. (6), (7), as in the basestation's hydro_model; angles of attack in degrees.
    """
    q, path = 20.0, radians(60.0 if pitch > 0.0 else -60.0)
    for _ in range(2000):
        discriminant = 1.0 - 4.0 * HD_B * HD_C * q**HD_S / (HD_A * tan(path)) ** 2
        attack = -HD_A * tan(path) / (2.0 * HD_C) * (1.0 - sqrt(discriminant))
        drag = HD_B * q**HD_S + HD_C * attack**2
        q += 0.3 * (force * sin(path) / (LENGTH**2 * drag) - q)
        path += 0.3 * (radians(pitch - attack) - path)
    return sqrt(2.0 * q / DENSITY), degrees(path)


def slocums_speed(force, pitch):
    """Speed and path angle, deg, from the drag along and the lift across the path.

    Source: Merckelbach, Smeed and Griffiths 2010, eqs. (6) to (9), for a climb; the dive is its mirror.
    """
    up, side = radians(abs(pitch)), 1.0 if force > 0.0 else -1.0
    slope = 3.8 + A_W

    def imbalance(attack):  # tan(path) = drag / lift
        return atan((C_D0 + C_D1 * attack**2) / (slope * attack)) - (up + attack)

    attack = brentq(imbalance, 1e-4, sqrt(C_D0 / C_D1), xtol=1e-14)
    path = up + attack
    square = abs(force) * sin(path) / (0.5 * DENSITY * S * (C_D0 + C_D1 * attack**2))
    return sqrt(square), side * degrees(path)


@pytest.mark.parametrize("force, pitch", TEN)
@pytest.mark.parametrize("polar, published", [(SEAGLIDER, seagliders_speed), (SLOCUM, slocums_speed)])
def test_steady_glides_are_the_published_ones(polar, published, force, pitch):
    speed, path, attack = steady_glide(force, radians(pitch), DENSITY, *polar)
    assert (speed, degrees(path)) == pytest.approx(published(force, pitch), rel=1e-6)  # asked: 1 %
    assert path == pytest.approx(radians(pitch) - attack, abs=1e-12)


@settings(max_examples=200, deadline=None)
@given(
    force=st.floats(-20.0, 20.0).filter(lambda f: abs(f) > 1e-3),
    pitch=st.floats(-1.4, 1.4),
    polar=st.sampled_from([SEAGLIDER, SLOCUM]),
)
def test_lift_and_drag_balance_the_buoyancy_at_any_pitch(force, pitch, polar):
    area, drag_0, power, drag_2, lift_1 = polar
    speed, path, attack = steady_glide(force, pitch, DENSITY, *polar)
    q = 0.5 * DENSITY * speed**2
    drag = area * q * polar_drag(attack, drag_0 * q**power, drag_2)
    lift = area * q * polar_lift(attack, 0.0, lift_1)
    # drag against the flow, lift across it: nothing is left, along or across.  1e-6: a step of 1e-7 rad ends the search
    assert force * sin(path) == pytest.approx(drag, abs=1e-6 * abs(force))
    assert force * cos(path) + lift == pytest.approx(0.0, abs=1e-6 * abs(force))
    assert force * speed * sin(path) >= 0.0  # buoyancy does the work that drag takes


@settings(max_examples=50, deadline=None)
@given(force=st.floats(0.01, 5.0), pitch=st.floats(-1.0, 1.0), polar=st.sampled_from([SEAGLIDER, SLOCUM]))
def test_going_down_mirrors_going_up(force, pitch, polar):
    up, down = steady_glide(force, pitch, DENSITY, *polar), steady_glide(-force, -pitch, DENSITY, *polar)
    assert down == (up[0], -up[1], -up[2])


def test_without_net_buoyancy_it_rests():
    assert steady_glide(0.0, 0.3, DENSITY, *SEAGLIDER) == (0.0, 0.3, 0.0)
