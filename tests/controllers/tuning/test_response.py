"""Margins measured on a simulated vehicle, against the linear form; what does not settle; known margins."""

import numpy as np
import pytest

from auv_gym import linearise, load_vehicle
from controllers.autopilots import autopilot
from controllers.gains import gains_for
from controllers.tuning.bench import bench_of
from controllers.tuning.response import UNSETTLED, loop_response, margins_of


def test_the_response_of_a_simulated_loop_is_that_of_its_linear_form():
    plant = load_vehicle("heu_torpedo")
    gains = gains_for(plant.name, plant.dt)
    response = loop_response(bench_of(plant, 0), 0, autopilot(plant, gains=gains), "heading_rad")
    heading, rate = (
        linearise(plant, ("rudder_rad",), ("heading_rad", "r_radps")).frequency_response(response.omega).T[0]
    )
    law = gains.law("pid", "heading")
    held = plant.dt / (np.exp(1j * response.omega * plant.dt) - 1.0)
    loop = (law["proportional"] + law["integral"] * held) * heading + law["derivative"] * rate
    assert response.settled
    # the vehicle is turned by some degrees, so that its damping is not quite that of straight flight
    assert np.abs(response.loop / loop - 1.0).max() < 0.05
    wanted = margins_of(response.omega, loop)
    assert response.margins().sensitivity_peak == pytest.approx(wanted.sensitivity_peak, rel=0.01)
    assert response.margins().phase_margin_deg == pytest.approx(wanted.phase_margin_deg, abs=1.5)


def test_a_loop_that_does_not_settle_has_no_margins():
    plant = load_vehicle("heu_torpedo")
    gains = gains_for(plant.name, plant.dt)
    law = {name: 60.0 * value for name, value in gains.loops["pid"]["heading"].items()}
    steep = type(gains)(plant.name, plant.dt, 0.0, {"pid": {**gains.loops["pid"], "heading": law}})
    response = loop_response(bench_of(plant, 0), 0, autopilot(plant, gains=steep), "heading_rad")
    assert not response.settled
    assert response.margins() == UNSETTLED


@pytest.mark.parametrize("gain", [0.5, 4.0])
def test_margins_of_a_loop_whose_margins_are_known(gain):
    # gain / (s (s + 1)^2): -180 deg at 1 rad/s, where its size is gain / 2
    s = 1j * np.geomspace(0.02, 50.0, 400)
    found = margins_of(s.imag, gain / (s * (s + 1.0) ** 2))
    assert found.gain_margin_db == pytest.approx(abs(20.0 * np.log10(gain / 2.0)), abs=0.01)
    if gain == 0.5:
        omega = 0.4236  # the root of w (w^2 + 1) = 0.5
        left = np.pi / 2.0 - 2.0 * np.arctan(omega)
        assert found.phase_margin_deg == pytest.approx(np.rad2deg(left), abs=0.2)
        assert found.delay_margin_s == pytest.approx(left / omega, rel=0.01)
        assert found.sensitivity_peak == pytest.approx(
            (1.0 / np.abs(1.0 + gain / (s * (s + 1.0) ** 2))).max(), rel=1e-3
        )
