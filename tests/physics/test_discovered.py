"""Terms found in data: each alone is its coefficient times what its name says."""

import numpy as np
import pytest

from auv_gym.physics.discovered import (
    HEAVE_TERMS,
    YAW_TERMS,
    any_term,
    discovered_heave_damping,
    discovered_heave_force,
    discovered_yaw_moment,
)

PSI, R, RUDDER, U, W, PITCH, ROLL = 0.7, -0.03, 0.2, 0.4, -0.1, 0.3, -0.2
INPUTS = np.array([0.1, 0.0, 0.0, U, W, 0.0, PITCH, ROLL])
YAW = {
    "r": R, "u": U, "w": W, "pitch": PITCH, "rudder": RUDDER, "sin_heading": np.sin(PSI), "cos_heading": np.cos(PSI),
    "ur": U * R, "wr": W * R, "r_r": R * abs(R), "uu": U**2, "uw": U * W, "u_roll": U * ROLL, "u_rudder": U * RUDDER,
    "uu_rudder": U**2 * RUDDER, "rudder_rudder": RUDDER * abs(RUDDER), "sin_2heading": np.sin(2 * PSI),
    "cos_2heading": np.cos(2 * PSI),
}  # fmt: skip
DEPTH, V, PISTON, WARMER, TIME = 40.0, -0.2, 0.01, -3.0, 900.0
HEAVE = {
    "depth": DEPTH, "w": V, "temperature": WARMER, "elapsed": TIME, "piston": PISTON, "depth_squared": DEPTH**2,
    "w_w": V * abs(V), "ww": V**2, "root_w": -np.sqrt(0.2), "depth_w": DEPTH * V, "piston_w": PISTON * V,
    "piston_squared": PISTON**2, "www": V**3, "root_depth": np.sqrt(DEPTH),
}  # fmt: skip


@pytest.mark.parametrize("name", YAW_TERMS)
def test_a_yaw_moment_is_its_coefficient_times_its_term(name):
    c = 1.5 * (np.array(list(YAW_TERMS)) == name)
    assert discovered_yaw_moment(c, PSI, R, RUDDER, INPUTS) == pytest.approx(1.5 * YAW[name], rel=1e-14)
    assert any_term(c, c.size)


@pytest.mark.parametrize("name", HEAVE_TERMS)
def test_a_force_down_is_its_coefficient_times_its_term(name):
    c = 1.5 * (np.array(list(HEAVE_TERMS)) == name)
    assert discovered_heave_force(c, DEPTH, V, PISTON, WARMER, TIME) == pytest.approx(1.5 * HEAVE[name], rel=1e-14)
    assert any_term(c, c.size)


def test_without_coefficients_there_is_no_term():
    assert not any_term(np.zeros(18), 18)
    assert discovered_heave_damping(np.zeros(14), 0.3) == 0.0


def test_the_damping_of_the_terms_is_their_slope():
    c = np.zeros(14)
    c[list(HEAVE_TERMS).index("w")], c[list(HEAVE_TERMS).index("w_w")] = -3.0, -5.0
    near = [discovered_heave_force(c, DEPTH, 0.3 + step, PISTON, WARMER, TIME) for step in (-1e-5, 1e-5)]
    assert discovered_heave_damping(c, 0.3) == pytest.approx((near[0] - near[1]) / 2e-5, rel=1e-6)
