"""Yaw of a glider: the paper's numbers, steady turns, symmetry, energy, and the moving frame of a current."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from auv_gym.model import simulate
from auv_gym.param import replace_at, value_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from auv_gym.vehicles.glider import GRAVITY, derivative, linear_yaw_coefficients, yaw_inertia

INPUTS = ("rudder_rad", "bow_thruster_N", "stern_thruster_N", "u_mps", "w_mps", "q_radps", "pitch_rad", "roll_rad")
MIRRORED = np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0, -1.0])


def inputs(plant: Plant, **given_inputs: float) -> np.ndarray:
    assert plant.inputs == INPUTS
    return np.array([given_inputs.get(name, plant.constants.get(name, 0.0)) for name in INPUTS])


def parameters(plant: Plant):
    return plant.family.view(plant.vector)


def rates(plant: Plant, psi=0.0, r=0.0, rudder=0.0, **given_inputs: float) -> np.ndarray:
    dx = np.empty(4)
    x = np.array([psi, r, 0.0, 0.0])
    derivative(x, np.array([rudder]), inputs(plant, **given_inputs), parameters(plant), dx, np.empty(0))
    return dx


def final(plant: Plant, u: np.ndarray, samples: int, y0=(0.0, 0.0, 0.0, 0.0)) -> np.ndarray:
    x = plant.initial(np.array(y0))
    for _ in range(samples):
        x = plant.step(x, u)
    return plant.output(x)


def test_linear_form_has_the_papers_coefficients():
    # equation (14), printed to three decimals
    damping, rudder = linear_yaw_coefficients(parameters(load_vehicle("ganeshblue")).hull)
    assert damping == pytest.approx(-2.732, abs=5e-4)
    assert rudder == pytest.approx(-0.381, abs=5e-4)


def test_inertia_keeps_the_sign_that_the_paper_prints():
    # 26.574 - 16000 x 7.275e-4
    assert yaw_inertia(parameters(load_vehicle("ganeshblue")).hull) == pytest.approx(14.934, abs=1e-12)


@pytest.mark.parametrize("name", ["ganeshblue", "slocum"])
@pytest.mark.parametrize("rudder", [-0.2, 0.1, 0.5])
def test_steady_turn_balances_rudder_and_damping(name, rudder):
    plant = load_vehicle(name)
    damping, effect = linear_yaw_coefficients(parameters(plant).hull)
    # after 18 time constants, what is left of the start is below 1e-7
    turning = final(plant, inputs(plant, rudder_rad=rudder), math.ceil(-18.0 / damping / plant.dt))
    assert turning[1] == pytest.approx(-effect / damping * rudder, rel=1e-6)


def test_the_measured_speed_acts_as_far_as_the_scaling_says():
    plant = load_vehicle("ganeshblue")
    fast = rates(plant, r=0.1, rudder=0.2, u_mps=0.6)
    damping, effect = linear_yaw_coefficients(parameters(plant).hull)
    assert fast[1] == pytest.approx(2.0 * damping * 0.1 + 4.0 * effect * 0.2, rel=1e-14)
    fixed = replace_at(plant, "hull.speed_scaling", 0.0)
    assert rates(fixed, r=0.1, rudder=0.2, u_mps=0.6)[1] == rates(fixed, r=0.1, rudder=0.2, u_mps=0.3)[1]


def test_rudder_effectiveness_with_speed_squared():
    plant = replace_at(load_vehicle("slocum"), "effects.yaw.speed_squared", 1.0)
    nominal = rates(plant, rudder=0.2)[1]
    assert rates(plant, rudder=0.2, u_mps=0.70)[1] == pytest.approx(4.0 * nominal, rel=1e-14)


@given(
    psi=st.floats(-3.0, 3.0),
    r=st.floats(-0.5, 0.5),
    values=st.tuples(*[st.floats(-0.5, 0.5)] * 3, *[st.floats(-1.0, 1.0)] * 5),
)
def test_the_mirror_image_of_a_motion_is_a_motion(psi, r, values):
    plant = replace_at(
        load_vehicle("ganeshblue"),
        {
            "effects.yaw.roll_moment": 0.3,
            "effects.yaw.quadratic_damping": 50.0,
            "effects.yaw.speed_squared": 0.2,
            "effects.rudder.deadband": 0.02,
            "hull.heading_stiffness": 0.01,
            "hull.rudder_heading_rate": 0.02,
        },
    )
    u = np.array(values)
    x = plant.initial(np.array([psi, r, 2.0, 3.0]))
    mirrored = plant.initial(np.array([-psi, -r, 2.0, -3.0]))
    for _ in range(3):
        x, mirrored = plant.step(x, u), plant.step(mirrored, MIRRORED * u)
    # every operation is odd or even, so that no rounding differs
    assert np.array_equal(plant.output(mirrored), plant.output(x) * [-1.0, -1.0, 1.0, -1.0])


@given(r=st.floats(-2.0, 2.0), quadratic=st.floats(0.0, 1e4), speed=st.floats(0.0, 2.0))
def test_damping_never_adds_energy(r, quadratic, speed):
    plant = replace_at(load_vehicle("ganeshblue"), "effects.yaw.quadratic_damping", quadratic)
    assert rates(plant, r=r, u_mps=speed)[1] * r <= 0.0


def test_thruster_moments_are_force_times_lever():
    plant = load_vehicle("ganeshblue")
    inertia = yaw_inertia(parameters(plant).hull)
    assert rates(plant, bow_thruster_N=2.0)[1] == pytest.approx(0.917 * 2.0 / inertia, rel=1e-14)
    assert rates(plant, stern_thruster_N=-2.0)[1] == pytest.approx(-0.748 * 2.0 / inertia, rel=1e-14)


def test_yaw_moment_of_a_weight_off_the_centre_plane():
    plant = replace_at(load_vehicle("ganeshblue"), "hull.y_g", 0.01)
    expected = GRAVITY * 0.01 * 92.8 * math.sin(-0.4) / yaw_inertia(parameters(plant).hull)
    assert rates(plant, pitch_rad=-0.4)[1] == pytest.approx(expected, rel=1e-14)
    assert rates(plant, pitch_rad=0.0)[1] == 0.0


@pytest.mark.parametrize(
    "path, size, given_inputs, moment",
    [
        ("effects.yaw.moment", 0.2, {}, 0.2),
        ("effects.yaw.roll_moment", 0.5, {"roll_rad": 0.1}, 0.05),
        ("effects.yaw.quadratic_damping", 30.0, {"r": -0.1}, 0.3),
        ("hull.i_xy", 2.0, {"q_radps": 0.1}, -0.02),
        ("hull.n_wr", -0.01, {"r": 0.1, "w_mps": 0.2}, 8000.0 * -0.01 * 0.2 * 0.1),
    ],
)
def test_a_yaw_moment_divided_by_the_inertia_is_an_acceleration(path, size, given_inputs, moment):
    plant = load_vehicle("ganeshblue")
    added = replace_at(plant, path, size)
    change = rates(added, **given_inputs)[1] - rates(plant, **given_inputs)[1]
    # the difference of two accelerations of up to 0.3 rad/s^2
    assert change == pytest.approx(moment / yaw_inertia(parameters(plant).hull), abs=1e-15)


def test_equation_15_scales_the_analytic_model():
    analytic, corrected = load_vehicle("ganeshblue"), load_vehicle("ganeshblue_corrected")
    damping, effect = linear_yaw_coefficients(parameters(analytic).hull)
    change = rates(corrected, psi=0.5, r=0.1, rudder=0.2)
    expected = 1.866e-8 * 0.5 + 1.75704 * damping * 0.1 - 2.8594e-8 * effect * 0.2
    assert change[1] == pytest.approx(expected, rel=1e-12)
    assert change[0] == pytest.approx(0.1 - 0.02086 * 0.2, rel=1e-14)


def test_the_analytic_model_turns_6_7_times_faster_than_the_corrected_one():
    rudder = math.radians(-15.0)
    rates_of_turn = [
        final(plant, inputs(plant, rudder_rad=rudder), 60)[1]
        for plant in (load_vehicle("ganeshblue"), load_vehicle("ganeshblue_corrected"))
    ]
    # the paper's one decimal
    assert rates_of_turn[0] / rates_of_turn[1] == pytest.approx(6.7, abs=0.05)


@given(north=st.floats(-1.0, 1.0), east=st.floats(-1.0, 1.0))
def test_a_steady_current_is_a_moving_frame(north, east):
    plant = load_vehicle("slocum")
    drifting = replace_at(plant, {"effects.current.north": north, "effects.current.east": east})
    u, samples = inputs(plant, rudder_rad=0.1), 30
    still, drifted = final(plant, u, samples), final(drifting, u, samples)
    elapsed = samples * plant.dt
    assert np.array_equal(drifted[:2], still[:2])
    # some hundred additions of metres
    assert drifted[2:] - still[2:] == pytest.approx(np.array([north, east]) * elapsed, abs=1e-11)


def test_a_straight_track_follows_the_heading():
    plant = load_vehicle("slocum")
    end = final(plant, inputs(plant, u_mps=0.5), 25, y0=(math.pi / 3, 0.0, 10.0, 20.0))
    assert end == pytest.approx([math.pi / 3, 0.0, 10.0 + 25.0, 20.0 + 50.0 * math.sin(math.pi / 3)], abs=1e-11)


def test_a_pitched_and_rolled_glider_moves_and_turns_by_the_full_rotation():
    plant, psi, r, u, w, q, pitch, roll = load_vehicle("slocum"), 0.7, 0.05, 0.4, 0.03, 0.02, -0.45, 0.2
    turning, _, north, east = rates(plant, psi, r, u_mps=u, w_mps=w, q_radps=q, pitch_rad=pitch, roll_rad=roll)
    ahead = Rotation.from_euler("ZYX", [psi, pitch, roll]).apply([u, 0.0, w])
    assert [north, east] == pytest.approx(ahead[:2], abs=1e-15)
    assert turning == pytest.approx((q * math.sin(roll) + r * math.cos(roll)) / math.cos(pitch), rel=1e-14)


def test_compass_effects_in_a_steady_turn():
    plant = load_vehicle("slocum")
    damping, effect = linear_yaw_coefficients(parameters(plant).hull)
    rate = -effect / damping * 0.2
    u, start = inputs(plant, rudder_rad=0.2), np.array([0.3, rate, 0.0, 0.0])
    true = final(plant, u, 50, start)[0]

    def read(**effects):
        changed = replace_at(plant, {f"effects.compass.{name}": value for name, value in effects.items()})
        x = np.append(start, np.zeros(len(changed.states) - 4))  # the true state, whatever the compass reads of it
        for _ in range(50):
            x = changed.step(x, u)
        return changed.output(x)[0]

    assert value_at(plant, "effects.compass.lag") == 0.0
    assert read(bias=0.1) == pytest.approx(true + 0.1, abs=1e-14)
    assert read(deviation_sin=0.1) == pytest.approx(true + 0.1 * math.sin(true), abs=1e-14)
    assert read(deviation_cos=0.1) == pytest.approx(true + 0.1 * math.cos(true), abs=1e-14)
    # a ramp is followed at a distance of rate times lag; the transient is exp(-200/5)
    assert read(lag=5.0) == pytest.approx(true - 5.0 * rate, abs=1e-12)


def test_a_yaw_rate_too_quick_for_the_step_stays_stable():
    plant = replace_at(load_vehicle("ganeshblue"), "hull.n_r", -0.1)  # 16 1/s, with a step of 0.25 s
    n = 200
    record = Record.from_arrays(np.arange(float(n)), {"rudder_rad": np.full(n, 0.2), "heading_rad": np.zeros(n)})
    rate = np.diff(simulate(plant, record)["heading_rad"])
    damping, rudder = linear_yaw_coefficients(plant.family.view(plant.vector).hull)
    # settled after the first seconds: the turn is the steady one, a fixed point that every stable step keeps
    np.testing.assert_allclose(rate[3:], -0.2 * rudder / damping, rtol=1e-9)
