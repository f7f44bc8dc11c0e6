"""The study of intervals: records of known systems, shares that are counted right, and coverage at full length."""

import json

import numpy as np
import pytest

from auv_gym.model import predict
from scripts.coverage_study import (
    CASES,
    COUPLED,
    NOISE,
    OUTPUTS,
    Coverage,
    as_json,
    attempt,
    coefficients,
    disturbed,
    main,
    responses,
    study,
)
from scripts.identification_systems import ARMAX, STATE_SPACE


def test_the_true_predictor_leaves_white_noise():
    record = disturbed(COUPLED, 2, 2000, 5)
    predicted = predict(COUPLED, record)
    left = np.stack([record[name] - predicted[name] for name in OUTPUTS], axis=1)[50:]
    assert np.abs(np.corrcoef(left[1:].T, left[:-1].T)[:2, 2:]).max() < 0.08
    assert left.std(axis=0)[0] == pytest.approx(left.std(axis=0)[1], rel=0.1)
    assert left.std() < NOISE * record[OUTPUTS[0]].std()


def test_true_values_have_the_names_of_fits():
    named = coefficients(ARMAX)
    assert named["a1[q_radps]"] == pytest.approx(ARMAX.a[1, 0, 0])
    assert named["b2[q_radps, stern_plane_rad]"] == pytest.approx(0.12)
    assert coefficients(COUPLED)["a1[r_radps, q_radps]"] == pytest.approx(0.2)
    told = responses(STATE_SPACE)
    assert told["pole 1 (imaginary)"] == pytest.approx(np.imag(STATE_SPACE.poles()).max())
    gain = np.abs(STATE_SPACE.frequency_response(np.array([0.5])))[0, 1, 0]
    assert told["gain[q_radps, rudder_rad] at 0.5 rad/s"] == pytest.approx(gain)


@pytest.mark.parametrize("case", CASES)
def test_most_intervals_of_a_record_hold_the_truth(case):
    held = attempt(case, 3, 1000)
    assert held is not None
    assert np.mean(list(held.values())) > 0.6
    assert set(held) <= set(CASES[case].true)


def test_coverage_of_least_squares_is_as_stated():
    found = study(range(40), 600, ["arx"])["arx"]
    assert (found.seeds, found.refused) == (40, 0)
    assert 88.0 < np.mean(list(found.shares.values())) < 99.5


def test_shares_outside_are_named():
    found = {"arx": Coverage({"a1": 95.0, "a2": 82.0, "b1": 99.5}, 200, 1)}
    assert found["arx"].outside == {"a2": 82.0, "b1": 99.5}
    assert as_json(found, 1000)["cases"]["arx"]["outside"] == ["a2", "b1"]


def test_the_program_prints_a_table_or_json(monkeypatch, capsys):
    monkeypatch.setattr(
        "scripts.coverage_study.attempt",
        lambda case, seed, samples: {"a1": seed % 20 != 0, "a2[q_radps]": seed % 2 == 0},
    )
    assert main(["--seeds", "40", "--case", "arx"]) == 1
    printed = capsys.readouterr().out
    assert printed.count("a2[q_radps]") == 2
    assert "arx: the interval of a2[q_radps] holds the truth in 50.0 % of records" in printed
    assert main(["--seeds", "40", "--case", "arx", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["cases"]["arx"]["percent"] == {"a1": 95.0, "a2[q_radps]": 50.0}
    assert main(["--seeds", "0"]) == 1
    assert "at least 1, got 0" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_all_intervals_cover_as_stated(case):
    found = study(range(500), 1000, [case], jobs=2)[case]
    assert found.seeds >= 495
    assert not found.outside
