"""The study of intervals: records of known systems, shares that are counted right, and coverage at full length."""

import numpy as np
import pytest

from auv_gym.model import predict
from scripts.benchmarks.systems import ARMAX, STATE_SPACE
from scripts.studies.coverage import (
    CASES,
    COUPLED,
    NOISE,
    OUTPUTS,
    STUDY,
    coefficients,
    disturbed,
    outside,
    responses,
    shares_of,
)
from scripts.studies.harness import Found


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


def test_most_intervals_of_a_record_hold_the_truth_and_those_of_least_squares_as_stated():
    found = STUDY.find(range(3, 4), samples=1000)
    assert list(found.runs) == list(CASES)
    for case in CASES:
        (held,) = found.of(case)
        assert np.mean(list(held.values())) > 0.6
        assert set(held) <= set(CASES[case].true)
    (row,) = STUDY.sheets(STUDY.find(range(40), ["arx"], samples=600))[0].rows
    assert row[:4] == ["arx", "40", "0", "8"]
    assert 88.0 < float(row[6]) < 99.5


def test_shares_outside_are_named():
    held = [{"a1": seed % 20 != 0, "a2[q_radps]": seed % 2 == 0} for seed in range(40)]
    found = Found({"arx": dict(enumerate([*held, None]))}, {"samples": 1000})
    assert shares_of(held) == {"a1": 95.0, "a2[q_radps]": 50.0}
    assert outside(found) == {("arx", "a2[q_radps]"): 50.0}
    assert STUDY.remarks(found) == ["arx: the interval of a2[q_radps] holds the truth in 50.0 % of records"]
    assert not STUDY.good(found)
    assert STUDY.sheets(found)[0].rows == [["arx", "40", "1", "2", "50.0", "a2[q_radps]", "72.5", "95.0", "1"]]


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_all_intervals_cover_as_stated(case):
    found = STUDY.find(range(500), [case], samples=1000, jobs=2)
    assert sum(of is not None for of in found.of(case)) >= 495
    assert STUDY.good(found)
