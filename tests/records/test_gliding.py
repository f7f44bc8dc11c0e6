"""The speed of a glider from its depth rate and pitch, and the angle of attack of a steady glide."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, strategies as st

from auv_gym.records.gliding import glide_attack, glide_speed

POLAR = {"drag_0": 2.15, "drag_2": 25.0, "lift_1": 132.5}  # of a small glider: 3 degrees at 25 degrees of pitch


@given(speed=st.floats(0.1, 0.9), slope=st.floats(0.2, 0.6))
def test_the_speed_of_a_made_dive_is_found(speed, slope):
    t = np.arange(0, 2000, 4.0)
    pitch = np.where(t < 1000, -slope, slope)
    depth = 5 + np.concatenate([[0], np.cumsum(-speed * np.sin(pitch[:-1]) * 4.0)])
    found = glide_speed(t, depth, pitch)
    assert found is not None
    away = np.abs(t - 1000) > 20  # the 30 s around the inflexion mix both slopes
    assert found[away] == pytest.approx(speed, rel=1e-6)
    assert np.all((found >= 0.05) & (found <= 1.0))


def test_the_angle_of_attack_makes_the_path_steeper_than_the_pitch():
    t = np.arange(0, 2000, 4.0)
    attack = partial(glide_attack, **POLAR)
    pitch = np.where(t < 1000, -0.4, 0.4)
    depth = 5 + np.concatenate([[0], np.cumsum(-0.3 * np.sin(pitch - attack(pitch))[:-1] * 4.0)])
    away = np.abs(t - 1000) > 20
    found, neglected = glide_speed(t, depth, pitch, attack), glide_speed(t, depth, pitch)
    assert found is not None
    assert neglected is not None
    assert found[away] == pytest.approx(0.3, rel=1e-6)
    assert np.all(neglected[away] > 1.05 * 0.3)


def test_nothing_glides_at_a_level_pitch_or_without_values():
    t = np.arange(0, 400, 4.0)
    assert glide_speed(t, np.zeros(100), np.zeros(100)) is None
    assert glide_speed(t, np.full(100, np.nan), np.full(100, 0.4)) is None


@given(
    pitch=st.floats(0.3, 1.4) | st.floats(-1.4, -0.3),
    drag_0=st.floats(0.5, 10.0),
    drag_2=st.floats(1.0, 100.0),
    lift_1=st.floats(50.0, 500.0),
    lift_0=st.floats(-1.0, 1.0),
)
def test_the_forces_of_a_steady_glide_balance(pitch, drag_0, drag_2, lift_1, lift_0):
    attack = float(glide_attack(pitch, drag_0, drag_2, lift_1, lift_0))
    if np.isnan(attack):  # then even the best glide ratio makes the path too steep; lift_0 moves both by up to 0.02
        attack = np.sqrt(drag_0 / drag_2)
        assert abs(pitch) < np.arctan(2.0 * drag_0 / (lift_1 * attack)) - attack + 0.04
        return
    path = pitch - attack
    drag, lift = drag_0 + drag_2 * attack**2, lift_0 + lift_1 * attack
    # weight and buoyancy are vertical: along the horizontal, drag and lift cancel; 1e-9 is rounding after 60 halvings
    assert drag * np.cos(path) + lift * np.sin(path) == pytest.approx(0.0, abs=1e-9 * (drag + abs(lift)))
    assert np.sign(lift) == -np.sign(path)  # lift is up going down, and down going up


def test_a_glide_up_mirrors_one_down_and_needs_some_pitch():
    pitch = np.array([-0.8, -0.4, 0.4, 0.8])
    attack = glide_attack(pitch, **POLAR)
    assert attack == pytest.approx(-attack[::-1], abs=1e-15)
    assert np.degrees(attack[1]) == pytest.approx(2.0, abs=0.5)
    draggy = glide_attack(pitch, drag_0=50.0, drag_2=200.0, lift_1=50.0)
    assert np.isnan(draggy[1:3]).all()
    # the faster of the two glides: below the attack of the best glide ratio
    assert np.all(np.abs(attack) < np.sqrt(POLAR["drag_0"] / POLAR["drag_2"]))
    with pytest.raises(ValueError, match=r"above zero, got 0, 25 and 132\.5"):
        glide_attack(pitch, 0.0, 25.0, 132.5)
