"""Rigid-body inertia, and the forces that it causes in rotating axes.

Velocities nu = [u v w p q r] and forces in body axes about the body origin.
"""

from auv_gym.compiled import compiled, outlined


@outlined
def fill_rigid_body_mass(mass, x_g, y_g, z_g, hull, matrix):
    """Write M_RB into matrix, shape (6, 6), for any centre of gravity.  Source: Fossen 2021, eq. (3.49).

    hull: record with i_xx ... i_xz about the body origin; the products have a minus sign in the matrix.
    """
    for i in range(6):
        for j in range(6):
            matrix[i, j] = 0.0
    for i in range(3):
        matrix[i, i] = mass
    matrix[0, 4] = matrix[4, 0] = mass * z_g
    matrix[0, 5] = matrix[5, 0] = -mass * y_g
    matrix[1, 3] = matrix[3, 1] = -mass * z_g
    matrix[1, 5] = matrix[5, 1] = mass * x_g
    matrix[2, 3] = matrix[3, 2] = mass * y_g
    matrix[2, 4] = matrix[4, 2] = -mass * x_g
    matrix[3, 3] = hull.i_xx
    matrix[4, 4] = hull.i_yy
    matrix[5, 5] = hull.i_zz
    matrix[3, 4] = matrix[4, 3] = -hull.i_xy
    matrix[3, 5] = matrix[5, 3] = -hull.i_xz
    matrix[4, 5] = matrix[5, 4] = -hull.i_yz


@compiled
def coriolis_forces(momentum, u, v, w, p, q, r):
    """-C(nu) nu for a constant symmetric inertia matrix, six numbers; their power nu . f is zero to rounding.

    momentum: (6, 6), M_RB or M_RB + M_A.  Linear momentum P and angular momentum H about the moving origin obey
    dP/dt = -omega x P and dH/dt = -omega x H - v x P (Kirchhoff); with M_A the last term is the Munk moment.
    Source: Fossen 2021, theorem 3.2.
    """
    m = momentum  # sums of three plus three: a processor adds them in parallel
    p1 = (m[0, 0] * u + m[0, 1] * v + m[0, 2] * w) + (m[0, 3] * p + m[0, 4] * q + m[0, 5] * r)
    p2 = (m[1, 0] * u + m[1, 1] * v + m[1, 2] * w) + (m[1, 3] * p + m[1, 4] * q + m[1, 5] * r)
    p3 = (m[2, 0] * u + m[2, 1] * v + m[2, 2] * w) + (m[2, 3] * p + m[2, 4] * q + m[2, 5] * r)
    h1 = (m[3, 0] * u + m[3, 1] * v + m[3, 2] * w) + (m[3, 3] * p + m[3, 4] * q + m[3, 5] * r)
    h2 = (m[4, 0] * u + m[4, 1] * v + m[4, 2] * w) + (m[4, 3] * p + m[4, 4] * q + m[4, 5] * r)
    h3 = (m[5, 0] * u + m[5, 1] * v + m[5, 2] * w) + (m[5, 3] * p + m[5, 4] * q + m[5, 5] * r)
    return (
        r * p2 - q * p3,
        p * p3 - r * p1,
        q * p1 - p * p2,
        r * h2 - q * h3 + w * p2 - v * p3,
        p * h3 - r * h1 + u * p3 - w * p1,
        q * h1 - p * h2 + v * p1 - u * p2,
    )


@outlined
def invert(matrix, inverse):
    """Write the inverse of a square matrix into `inverse`; matrix is destroyed, and a singular one gives infinities.

    Gauss-Jordan with partial pivoting: numpy's own would raise inside compiled code, where a fit only has to step back.
    """
    n = matrix.shape[0]
    for i in range(n):
        for j in range(n):
            inverse[i, j] = 1.0 if i == j else 0.0
    for i in range(n):
        best = i
        for k in range(i + 1, n):
            if abs(matrix[k, i]) > abs(matrix[best, i]):
                best = k
        for j in range(n):
            matrix[i, j], matrix[best, j] = matrix[best, j], matrix[i, j]
            inverse[i, j], inverse[best, j] = inverse[best, j], inverse[i, j]
        scale = 1.0 / matrix[i, i]
        for j in range(n):
            matrix[i, j] *= scale
            inverse[i, j] *= scale
        for k in range(n):
            if k != i:
                factor = matrix[k, i]
                for j in range(n):
                    matrix[k, j] -= factor * matrix[i, j]
                    inverse[k, j] -= factor * inverse[i, j]
