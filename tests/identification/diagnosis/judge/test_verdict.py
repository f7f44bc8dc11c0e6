"""What a diagnosis says of noises, and of sizes that no log could show."""

from types import SimpleNamespace

import numpy as np
import pytest

from identification.diagnosis.judge.findings import detectable_effects
from identification.diagnosis.judge.verdict import noise_sentence
from identification.diagnosis.search.candidates import Candidate, Screening
from identification.fit.noises import Noise
from tests.identification.diagnosis.stand_ins import PLANT


@pytest.mark.parametrize(
    "process, words",
    [
        ({}, ""),
        ({"r_radps": (0.01, 12.0)}, "Random accelerations push the vehicle (RMS and correlation time): yaw rate 0.573"),
        ({"north_m": (0.02, 30.0)}, "Random drifts push the vehicle (RMS and correlation time): north 0.02 m/s over"),
        ({"r_radps": (0.01, 12.0), "east_m": (0.02, 30.0)}, "Random accelerations and drifts push"),
    ],
)
def test_what_pushes_at_random_is_said_in_units_for_people(process, words):
    said = noise_sentence(SimpleNamespace(noise=Noise({"heading_rad": 0.01}, process)))  # type: ignore[arg-type]
    assert said.startswith(words)
    assert ("deg/s^2 over 12 s" in said) == ("r_radps" in process)
    assert bool(said) == bool(process)


def test_a_size_beyond_what_is_possible_is_none_that_the_record_shows():
    bias = Candidate("compass bias", ("effects.compass.bias",))  # within half a turn
    screened = [Screening(bias, np.zeros(1), 0.0, 1.0, np.array([size])) for size in (3.1, 11.5, np.inf)]
    found = detectable_effects(PLANT, screened, (), set())
    assert [d.size for d in found] == [3.1, np.inf, np.inf]
    assert [d.reason for d in found] == [
        "",
        "changes too little of what was measured",
        "changes nothing that was measured",
    ]
    assert detectable_effects(PLANT, screened, (), {"effects.compass.bias"}) == ()
