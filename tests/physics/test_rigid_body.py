"""Inertia and Coriolis forces against bodies made of point masses, and the power that Coriolis forces must not have."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from auv_gym.physics.rigid_body import coriolis_forces, fill_rigid_body_mass, invert

numbers = st.floats(-3.0, 3.0)
velocities = arrays(float, 6, elements=numbers)
squares = arrays(float, (6, 6), elements=numbers)
clouds = arrays(float, (5, 4), elements=st.floats(-1.0, 1.0))
INERTIA = np.dtype([(name, float) for name in ("i_xx", "i_yy", "i_zz", "i_xy", "i_yz", "i_xz")])


def points(cloud: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Five point masses of 0.5 to 2.5 kg and where they are, m."""
    return [(1.5 + row[0], row[1:]) for row in cloud]


def mass_matrix(cloud: np.ndarray) -> np.ndarray:
    """M_RB of the points by way of their mass, centre of gravity and moments of inertia."""
    mass = sum(m for m, _ in points(cloud))
    centre = sum(m * at for m, at in points(cloud)) / mass
    xx, yy, zz = sum(m * at**2 for m, at in points(cloud))
    xy, yz, xz = (sum(m * at[i] * at[j] for m, at in points(cloud)) for i, j in ((0, 1), (1, 2), (0, 2)))
    inertia = np.array([(yy + zz, xx + zz, xx + yy, xy, yz, xz)], dtype=INERTIA).view(np.recarray)[0]
    matrix = np.full((6, 6), np.nan)
    fill_rigid_body_mass(mass, *centre, inertia, matrix)
    return matrix


def cross(a: np.ndarray) -> np.ndarray:
    return np.cross(a, np.eye(3)).T


@given(cloud=clouds)
def test_inertia_is_that_of_the_points(cloud):
    # the velocity of a point at r is [I, -r x] nu
    expected = sum(m * jacobian.T @ jacobian for m, at in points(cloud) for jacobian in [np.c_[np.eye(3), -cross(at)]])
    assert mass_matrix(cloud) == pytest.approx(expected, abs=1e-13)


@given(cloud=clouds, nu=velocities)
def test_coriolis_forces_are_those_on_the_points(cloud, nu):
    expected = np.zeros(6)
    for m, at in points(cloud):
        force = -m * np.cross(nu[3:], nu[:3] + np.cross(nu[3:], at))
        expected += np.r_[force, np.cross(at, force)]
    # products of three numbers of up to 3, and moments of those
    assert np.array(coriolis_forces(mass_matrix(cloud), *nu)) == pytest.approx(expected, abs=1e-12)


@given(root=squares, nu=velocities)
def test_coriolis_forces_have_no_power(root, nu):
    inertia = root @ root.T
    forces = np.array(coriolis_forces(inertia, *nu))
    # to rounding of the terms that cancel, of which there are some hundred
    assert abs(nu @ forces) <= 1e-14 * np.abs(inertia).max() * np.abs(nu).max() ** 3


@given(root=squares, nu=velocities)
def test_momentum_in_fixed_axes_is_kept(root, nu):
    """The rates of R P and of R H + x R P are zero under Coriolis forces alone."""
    inertia = root @ root.T + np.eye(6)
    forces = np.array(coriolis_forces(inertia, *nu))
    momentum = inertia @ nu
    linear = forces[:3] + np.cross(nu[3:], momentum[:3])
    angular = forces[3:] + np.cross(nu[3:], momentum[3:]) + np.cross(nu[:3], momentum[:3])
    assert np.r_[linear, angular] == pytest.approx(np.zeros(6), abs=1e-11)


def test_the_munk_moment_turns_a_slender_hull_broadside_on():
    # more added mass across than along: drifting to starboard turns the bow to port, sinking lifts it
    inertia = np.diag([10.0, 30.0, 40.0, 1.0, 5.0, 5.0])
    yaw, pitch = (
        coriolis_forces(inertia, 2.0, 0.5, 0.0, 0.0, 0.0, 0.0)[5],
        coriolis_forces(inertia, 2.0, 0, 0.5, 0, 0, 0)[4],
    )
    assert yaw == (10.0 - 30.0) * 2.0 * 0.5
    assert pitch == (40.0 - 10.0) * 2.0 * 0.5


@given(matrix=squares)
def test_the_inverse_is_numpys(matrix):
    matrix = matrix + 10.0 * np.eye(6)[::-1]  # the diagonal may be zero: rows must be exchanged
    if np.linalg.cond(matrix) > 1e4:
        return
    inverse = np.empty((6, 6))
    invert(matrix.copy(), inverse)
    assert inverse == pytest.approx(
        np.linalg.inv(matrix), abs=1e-11
    )  # 1e-16 times the square of the condition, over 10


def test_the_inverse_of_a_singular_matrix_is_not_finite_and_does_not_raise():
    inverse = np.empty((6, 6))
    with np.errstate(all="ignore"):  # plain Python warns where compiled code goes on
        invert(np.zeros((6, 6)), inverse)
    assert not np.isfinite(inverse).any()
