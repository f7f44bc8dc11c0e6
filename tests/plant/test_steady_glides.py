"""Steady glides of a body that its volume and masses move, against the published equations solved apart."""

import numpy as np
import pytest

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.plant.gliding import engine_half, find_masses, neutral_volume, steady_glide, usual_glide
from tests.vehicles.body.test_seawing import steady

SEAWING = load_vehicle("seawing")
DEPTH = 30.0  # m


@pytest.mark.parametrize(
    "volume, pitch, turned",
    [(-4.878e-4, -0.5, 0.0), (4e-4, 0.5, 0.0), (-3e-4, -0.7, 0.6), (3e-4, 0.6, -0.2), (-4.878e-4, -0.4, -1.2)],
)
def test_a_glide_is_that_of_the_published_equations(volume, pitch, turned):
    glide = steady_glide(SEAWING, volume, pitch, DEPTH, turned)
    expected = steady(volume, glide.commands[1], turned, glide.state[[0, 1, 2, 3, 4, 5, 9, 10]])
    np.testing.assert_allclose(glide.state[[0, 1, 2, 3, 4, 5, 9, 10]], expected, atol=1e-7)
    u, v, w = expected[:3]
    assert glide.speed == pytest.approx(np.sqrt(u * u + v * v + w * w))
    assert glide.attack == pytest.approx(np.arctan2(w, u))
    assert glide.pitch == pitch
    # turn about the vertical: the rates are its components in body axes
    assert abs(glide.turn) == pytest.approx(np.linalg.norm(expected[3:6]), abs=1e-7)


def test_it_stays_in_its_glide_and_sinks_by_its_path():
    for side in (-1.0, 1.0):
        glide = usual_glide(SEAWING, side, DEPTH)
        x = SEAWING.settled(glide.state, glide.commands)
        for _ in range(20):
            x = SEAWING.step(x, glide.commands)
        np.testing.assert_allclose(x[[0, 1, 2, 3, 4, 5, 9, 10]], glide.state[[0, 1, 2, 3, 4, 5, 9, 10]], atol=1e-9)
        assert DEPTH - x[8] == pytest.approx(20.0 * glide.speed * np.sin(glide.path), rel=1e-6)
        assert np.sign(glide.path) == side


def test_a_turn_is_mirrored_with_the_mass():
    port, starboard = (steady_glide(SEAWING, -4e-4, -0.5, DEPTH, side) for side in (-0.5, 0.5))
    mirrored = starboard.state * np.array([1, -1, 1, -1, 1, -1, 1, 1, 1, -1, 1, 1, 1])
    np.testing.assert_allclose(port.state, mirrored, atol=1e-9)
    assert port.turn == pytest.approx(-starboard.turn, rel=1e-7)
    assert abs(port.turn) > 5e-3


def test_the_neutral_volume_carries_what_weighs_more_than_the_water_displaced():
    assert neutral_volume(SEAWING, DEPTH) == pytest.approx(0.0, abs=1e-12)  # 54.28 + 11 kg float in 65.28 kg of water
    heavier = replace_at(SEAWING, "hull.mass", 54.28 + 0.1)
    assert neutral_volume(heavier, DEPTH) == pytest.approx(0.1 / 1025.0, rel=1e-6)
    assert engine_half(heavier, DEPTH) == pytest.approx(0.000487804878 - 0.1 / 1025.0, rel=1e-6)


def test_effects_do_not_change_the_glide():
    changed = replace_at(
        SEAWING, {"effects.load.payload": 0.2, "effects.ballast.offset": 1e-4, "effects.wings.lost": 0.3}
    )
    one, other = (usual_glide(plant, -1.0) for plant in (SEAWING, changed))
    np.testing.assert_array_equal(one.state, other.state)


def test_its_inputs_are_found_by_what_they_move():
    masses = find_masses(SEAWING)
    found = [SEAWING.inputs[k] for k in (masses.volume, masses.slide, masses.turn)]
    assert found == ["ballast_m3", "battery_m", "battery_rad"]


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: usual_glide(load_vehicle("remus100"), -1.0), "needs a part that changes its volume, which 'remus100'"),
        (lambda: usual_glide(load_vehicle("slocum"), -1.0), "needs a part that changes its volume, which 'slocum'"),
        (lambda: neutral_volume(replace_at(SEAWING, "hull.mass", 60.0), DEPTH), "cannot take it down and up at 30 m"),
        (lambda: steady_glide(SEAWING, -4e-4, -1.4, DEPTH), "no steady glide at a pitch of -1.4 rad .* battery_m goes"),
        # it would need 12 mm forward
        (
            lambda: usual_glide(replace_at(SEAWING, "parts.battery.forth", 0.01), -1.0),
            "battery_m goes from -0.05 to 0.01",
        ),
        (lambda: steady_glide(SEAWING, -4e-4, 0.5, DEPTH), "no steady glide at a pitch of 0.5 rad"),
    ],
)
def test_what_has_no_glide_is_refused_in_words(make, words):
    with pytest.raises(ValueError, match=words):
        make()
