"""Tests of bad records: all methods refuse those without a possible fit with a clear message, and fit unusual ones."""

import re
import warnings

import numpy as np
import pytest

from auv_gym.model import simulate
from auv_gym.models.linear import Polynomial
from auv_gym.records.record import Record
from identification.estimator import make_estimator
from identification.linear.fit import is_linear
from tests.identification.linear.known_systems import record_of

METHODS = {
    "arx": {},
    "els": {},
    "armax": {},
    "output_error": {},
    "n4sid": {"order": 4},
    "n4sid refined": {"order": 4, "refine": True},
    "pbsid": {"order": 4},
    "pbsid refined": {"order": 4, "refine": True},
}
INPUTS, OUTPUTS, N = ("rudder_rad",), ("heading_rad", "r_radps"), 300
TRUTH = Polynomial.from_coefficients(
    {"heading_rad": [-1.5, 0.56], "r_radps": [-1.2, 0.4]},
    {"heading_rad": {"rudder_rad": [0.5, 0.2]}, "r_radps": {"rudder_rad": [0.3, 0.1]}},
    0.5,
)
GOOD = record_of(TRUTH, N, np.random.default_rng(0), noise=0.01)
COLUMNS = {name: GOOD[name] for name in GOOD.names}
WAVE = np.outer([0.1, 0.5, 0.3], np.ones(N)) * np.sin(0.3 * GOOD.time - np.array([[0.0], [0.4], [0.9]]))


def having(**columns):
    return GOOD.with_channels(columns)


# what is wrong, the record, and the words of the refusal: what was needed, what came, what to do
HOPELESS = {
    "an input that rests": (
        having(rudder_rad=np.full(N, 0.1)),
        "every input to move, got rudder_rad constant throughout: use a record in which it moves",
    ),
    "an input of one frequency": (
        Record.from_arrays(GOOD.time, dict(zip((*INPUTS, *OUTPUTS), WAVE, strict=True))),
        "(does not tell .* apart. Ask for fewer lags|inputs that excite .* use a record with more frequencies)",
    ),
    "an output that rests": (
        having(heading_rad=np.full(N, 1.0)),
        "every output to move, got heading_rad constant throughout: use a record in which it moves",
    ),
    "an output of zeros": (having(r_radps=np.zeros(N)), "every output to move, got r_radps constant throughout"),
    "an output that is the input": (
        having(heading_rad=GOOD["rudder_rad"]),
        "not tell .* apart.*excite .*more frequencies",
    ),
    "an output that is a multiple of the input": (
        having(r_radps=-2.0 * GOOD["rudder_rad"]),
        "not tell .* apart.*excite .*more frequencies",
    ),
    "fewer samples than coefficients": (GOOD.between(0.0, 6.0), r"needs at least \d+ .*, got \d+.*: record longer"),
    "segments shorter than the lags": (
        Record.from_arrays(GOOD.time, COLUMNS, segment=np.arange(N) // 2),
        r"needs at least \d+ .*, got 0.*: record longer",
    ),
    "samples at uneven times": (
        Record.from_arrays(np.cumsum(np.random.default_rng(0).uniform(0.4, 0.6, N)), COLUMNS),
        r"even samples, got intervals that differ .*: call record\.resample",
    ),
    "no rudder": (GOOD.without(["rudder_rad"]), "no channel 'rudder_rad'; it has"),
}


def fit_of(method, *records, **given):
    settings = {**METHODS[method], **given}
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # what numpy has to say is said in our words, or is no matter
        return make_estimator(method.split()[0], settings, inputs=INPUTS, outputs=OUTPUTS).fit(*records)


@pytest.fixture(params=METHODS)
def method(request):
    return request.param


@pytest.mark.parametrize("what", HOPELESS)
@pytest.mark.parametrize("method", [method for method in METHODS if "refined" not in method])  # it begins with the same
def test_what_cannot_be_fitted_is_refused_in_words(method, what):
    record, words = HOPELESS[what]
    with pytest.raises(ValueError, match=words) as refusal:
        fit_of(method, record)
    assert len(str(refusal.value)) < 400
    assert not re.search(r"nan|inf\b|SVD|singular|array\(", str(refusal.value))


def test_missing_values_and_other_intervals_are_refused_in_words(method):
    altitude = np.where(np.arange(N) == 7, np.nan, GOOD["heading_rad"])
    holed = having(altitude_m=altitude)
    estimator = make_estimator(method.split()[0], METHODS[method], inputs=INPUTS, outputs=("altitude_m",))
    with pytest.raises(ValueError, match=r"value of altitude_m in every sample, got none in 1 of 300, first at 3\.5 s"):
        estimator.fit(holed)
    with pytest.raises(
        ValueError, match=r"one sample interval in all records, got 0\.5 and 1 s: call record\.resample"
    ):
        fit_of(method, GOOD, GOOD.resample(1.0))
    with pytest.raises(ValueError, match="at least one record"):
        fit_of(method)


def test_a_model_of_another_interval_is_not_run(method):
    model = fit_of(method, GOOD).model
    with pytest.raises(ValueError, match=r"steps 0\.5 s at a time, got samples 1 to 1 s apart: call record\.resample"):
        simulate(model, GOOD.resample(1.0))


def test_holes_of_needed_channels_cut_the_record_and_single_samples_go(method):
    heading = np.where((np.arange(N) >= 100) & (np.arange(N) < 110), np.nan, GOOD["heading_rad"])
    heading[111:121] = np.nan  # which leaves a sample by itself
    cut = Record.from_arrays(GOOD.time, {**COLUMNS, "heading_rad": heading})
    assert [part.stop - part.start for part in cut.segments] == [100, 179]
    fit = fit_of(method, cut)
    assert is_linear(fit)
    assert np.sqrt(fit.loss) == pytest.approx(np.sqrt(fit_of(method, GOOD).loss), rel=0.3)


def test_headings_that_pass_the_turn_are_those_that_do_not(method):
    far = having(heading_rad=GOOD["heading_rad"] + 3.1)
    turned = np.angle(np.exp(1j * far["heading_rad"]))
    assert np.abs(np.diff(turned)).max() > 6.0
    one, other = (fit_of(method, record) for record in (far, having(heading_rad=turned)))
    np.testing.assert_allclose(other.loss, one.loss, rtol=1e-3)  # a descent stops where it stops
    run, same = simulate(one.model, far), simulate(other.model, far)
    np.testing.assert_allclose(same["heading_rad"], run["heading_rad"], atol=1e-2)


@pytest.mark.parametrize("size", [1e-9, 1e9])
def test_units_do_not_matter(method, size):
    other = having(r_radps=size * GOOD["r_radps"])
    np.testing.assert_allclose(fit_of(method, other).loss, fit_of(method, GOOD).loss * [1.0, size**2], rtol=1e-3)
