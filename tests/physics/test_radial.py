"""Sums of Gaussian bells against numpy's exponential, compiled and plain, for any number of inputs and outputs."""

import sys

import numpy as np
import pytest

from auv_gym.physics.radial import BITS, LANES, radial_blocks, radial_distance, radial_sums
from tests.plain_python import run_plain

SHAPES = ((1, 1, 1), (3, 2, LANES), (6, 6, LANES + 1), (10, 1, 300), (4, 7, 2 * LANES - 1))  # inputs, outputs, centres


def case(d, m, n):
    """Five points, centres, rate and coefficients; the last point is one of the centres."""
    rng = np.random.default_rng(d + 10 * m)
    centres, coefficients = rng.normal(size=(n, d)), rng.normal(size=(n, m))
    return np.vstack([1.5 * rng.normal(size=(4, d)), centres[:1]]), centres, rng.uniform(0.2, 1.0, d), coefficients


def sums_and_distances(x, centres, rate, coefficients):
    """What the functions give, shape (points, outputs + 1)."""
    blocks, room = radial_blocks(centres, rate, coefficients), np.empty((2 + coefficients.shape[1], LANES))
    found = np.empty((len(x), coefficients.shape[1] + 1))
    for row, point in zip(found, x * (rate * BITS)):
        out = np.empty(coefficients.shape[1])
        radial_sums(point, blocks, room, out)
        row[:-1], row[-1] = out, radial_distance(point, blocks, room)
    return found


@pytest.mark.parametrize("shape", SHAPES)
def test_sums_and_distances_are_those_of_numpy(shape):
    x, centres, rate, coefficients = case(*shape)
    square = np.sum(((x[:, None] - centres[None]) * rate) ** 2, axis=2)
    found = sums_and_distances(x, centres, rate, coefficients)
    # some hundred terms of unit size, with exponents of some ten, each rounded at 1e-16
    np.testing.assert_allclose(found[:, :-1], np.exp(-square) @ coefficients, rtol=0.0, atol=1e-13 * shape[2])
    np.testing.assert_allclose(found[:, -1], np.sqrt(square.min(axis=1)), rtol=1e-9, atol=1e-7)


def test_exponential_is_exact_over_its_range():
    distances = np.concatenate([np.linspace(0.0, 6.0, 2001), [10.0, 20.0, 25.0]])
    rate, found = np.ones(1), []
    for distance in distances:
        found.append(sums_and_distances(np.array([[distance]]), np.zeros((1, 1)), rate, np.ones((1, 1)))[0, 0])
    expected = np.exp(-(distances**2))
    # the exponent is rounded at 1e-16 of itself, and 2^f by a few bits
    np.testing.assert_allclose(found, expected, rtol=4e-16 * (4.0 + distances.max() ** 2))


@pytest.mark.parametrize("away", [27.0, 1e3, 1e8, 1e150])
def test_far_centres_give_nothing(away):
    x, centres = np.array([[0.3, -0.2]]), np.array([[away, 0.0], [-away, away]])
    found = sums_and_distances(x, centres, np.ones(2), np.full((2, 3), 5.0))
    assert np.all(np.abs(found[0, :-1]) < 1e-290)
    assert found[0, -1] == pytest.approx(np.hypot(away - 0.3, 0.2), rel=1e-9)
    near = np.vstack([centres, x])  # nothing is lost of a near centre beside them
    assert sums_and_distances(x, near, np.ones(2), np.full((3, 1), 5.0))[0, 0] == pytest.approx(5.0, rel=1e-14)


def test_blocks_hold_any_number_of_centres():
    assert radial_blocks(np.zeros((1, 2)), np.ones(2), np.zeros((1, 3))).shape == (1, 6, LANES)
    assert radial_blocks(np.zeros((LANES, 2)), np.ones(2), np.zeros((LANES, 3))).shape == (1, 6, LANES)
    assert radial_blocks(np.zeros((LANES + 1, 2)), np.ones(2), np.zeros((LANES + 1, 0))).shape == (2, 3, LANES)


def test_plain_python_agrees_with_compiled_code(tmp_path):
    out = tmp_path / "plain.npz"
    run_plain("-W", "error", __file__, out)
    with np.load(out) as plain:
        assert not plain["numba_imported"]
        for number, shape in enumerate(SHAPES):
            compiled = sums_and_distances(*case(*shape))
            np.testing.assert_allclose(plain[f"case_{number}"][:, :-1], compiled[:, :-1], rtol=1e-12, atol=1e-13)
            np.testing.assert_allclose(plain[f"case_{number}"][:, -1], compiled[:, -1], rtol=1e-12, atol=1e-7)


if __name__ == "__main__":
    found = {f"case_{number}": sums_and_distances(*case(*shape)) for number, shape in enumerate(SHAPES)}
    np.savez(sys.argv[1], numba_imported="numba" in sys.modules, **found)
