"""What Python prints for a result at the prompt is one line that says what it is."""

import numpy as np
import pytest

from auv_gym import load_vehicle, replace_at
from identification import diagnose, identify, make_estimator
from identification.experiments.missions import run_mission
from tests.identification.gliders import QUICK


@pytest.fixture(scope="module")
def record():
    return run_mission(replace_at(QUICK, "effects.rudder.offset", 0.05), np.random.default_rng(0), duration=800.0)


def test_a_plant_is_shown_by_its_name_and_its_effects():
    plant = load_vehicle("slocum")
    assert repr(plant) == f"Plant('slocum': {plant.title}; effects: none)"
    assert repr(replace_at(plant, "effects.rudder.offset", 0.03)).endswith("effects: effects.rudder.offset = 0.03)")
    assert repr(plant.family) == "Family('glider': heading of an underwater glider)"


def test_a_diagnosis_is_shown_by_its_verdict_and_effects(record):
    shown = repr(diagnose(record, QUICK))
    assert shown == "Diagnosis(slocum: named; effects: effects.rudder.offset = 0.05 rad; summary() says more)"


def test_an_identified_model_is_shown_by_its_errors(record):
    estimator = make_estimator("arx", inputs=("rudder_rad",), outputs=("heading_rad",))
    shown = repr(identify(estimator, [record]))
    assert shown.startswith("Identified(Polynomial: free runs over the last third err by heading_rad ")
    assert shown.endswith(" (RMS))")
