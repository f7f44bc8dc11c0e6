"""Tests of recovery: effects of thrusters, battery, IMU and load are found again in logs simulated with them."""

import numpy as np
import pytest

from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import load_vehicle
from identification.deciding import REACH
from identification.experiments.hovering import hover
from identification.fit.parameters import Parameters
from identification.fit.prediction_errors import PredictionErrors

QUICK = [("effects.t1.astern", 0.3), ("effects.mount.pitch", -0.07)]
REST = [
    ("effects.t1.lost", 0.3),
    ("effects.t2.gain", 1.15),
    ("effects.t5.deadband", 0.08),
    ("effects.t1.lag", 0.15),
    ("effects.t2.dead_time", 0.1),
    ("effects.t5.inflow", 6.0),
    ("effects.t6.shift_z", -0.03),
    ("effects.t1.shift_x", 0.03),
    ("effects.t5.turn_y", 0.3),
    ("effects.t1.turn_x", -0.2),
    ("effects.mount.roll", 0.07),
    ("effects.mount.yaw", 0.1),
    ("effects.supply.sag", 0.02),
    ("effects.gyros.bias_q", 0.02),
    ("effects.compass.deviation_sin", 0.1),
    ("effects.load.x_g", 0.004),
    ("effects.load.z_g", 0.01),
]
WITH_DEPTH = [("effects.load.net_buoyancy", 1.0), ("effects.load.tether_drag", 8.0)]


def recovered(path: str, value: float, measured: str) -> None:
    """Fit an effect alone, from one probe off neutral, and compare it with the truth by its standard error."""
    plant = load_vehicle("bluerov")
    rng = np.random.default_rng(4)
    log = hover(replace_at(plant, path, value), rng=rng, duration=40.0, measured=measured, loop="open", amplitude=0.4)
    spec = spec_at(plant, path)
    near = replace_at(plant, path, spec.neutral + np.copysign(spec.probe, value - spec.neutral))
    problem = PredictionErrors(plant, log, log.segments, doubt=0.0)
    point = problem.solve(near, [path])
    fitted = problem.plant_at(point, [path])
    error = problem.standard_errors(fitted, [path], problem.noise_at(point))[path]
    assert abs(value_at(fitted, path) - value) < 3.3 * error  # 0.1 % by chance
    assert error < 0.25 * abs(value - spec.neutral)


@pytest.mark.slow
@pytest.mark.parametrize("path, value", QUICK)
def test_an_effect_is_found_again_by_rates_and_attitude_alone(path, value):
    recovered(path, value, "attitude")


@pytest.mark.slow
@pytest.mark.parametrize("path, value", REST)
def test_each_effect_is_found_again_by_rates_and_attitude_alone(path, value):
    recovered(path, value, "attitude")


@pytest.mark.slow
@pytest.mark.parametrize("path, value", WITH_DEPTH)
def test_what_lifts_or_holds_a_vehicle_is_found_again_with_its_place(path, value):
    recovered(path, value, "all")


def test_drag_of_which_little_is_known_stays_drag():
    plant = load_vehicle("bluerov")
    problem = Parameters(plant, 0.1)
    assert plant.deviations["hull.roll.p"] > 1.0 == -value_at(plant, "hull.roll.p")
    assert problem.bounds("hull.roll.p") == (-1.0 - REACH * plant.deviations["hull.roll.p"], 0.0)
    assert problem.bounds("hull.z_b")[1] > 0.0
    torpedo = load_vehicle("heu_torpedo")
    assert torpedo.family.dissipating == frozenset()
