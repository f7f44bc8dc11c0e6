"""ARX: known systems found again, intervals that hold, and what it refuses."""

import numpy as np
import pytest

from auv_gym.models.linear import Polynomial
from auv_gym.records.record import Record
from identification.linear.polynomials.arx import Arx
from tests.identification.linear.known_systems import INPUTS, MOVED, OUTPUTS, TRUTH, record_of


def test_without_noise_the_coefficients_come_back_to_rounding():
    fit = Arx(INPUTS, OUTPUTS, n_a=(3, 2), offset=False).fit(record_of(TRUTH, 200, np.random.default_rng(0)))
    np.testing.assert_allclose(fit.model.a, TRUTH.a, atol=1e-8)
    np.testing.assert_allclose(fit.model.b, TRUTH.b, atol=1e-8)
    assert fit.model.inputs == INPUTS
    assert fit.model.outputs == OUTPUTS
    assert fit.model.dt == 4.0
    assert fit["b1[depth_m, stern_plane_rad]"].value == pytest.approx(0.5)
    assert fit["b1[depth_m, stern_plane_rad]"].unit == "m/rad"
    assert fit["a2[pitch_rad]"].unit == "1"
    with pytest.raises(KeyError, match="a1"):
        fit["a9[depth_m]"]


def test_the_truth_lies_in_the_intervals_as_often_as_they_say():
    inside = []
    truth = {f"a{j}[{o}]": TRUTH.a[j, i, i] for i, o in enumerate(OUTPUTS) for j in range(1, 4 - i)}
    truth |= {
        f"b{j}[{o}, {c}]": TRUTH.b[j, i, m] for i, o in enumerate(OUTPUTS) for m, c in enumerate(INPUTS) for j in (1, 2)
    }
    for seed in range(60):
        record = record_of(TRUTH, 300, np.random.default_rng(seed), noise=0.02)
        fit = Arx(INPUTS, OUTPUTS, n_a=(3, 2)).fit(record)
        for name, value in truth.items():
            low, high = fit[name].ci95
            inside.append(low <= value <= high)
    # 780 trials of which those of one fit go together: three standard deviations of 60 independent fits at 0.95
    assert 0.90 < np.mean(inside) < 0.985


def test_noise_of_the_equation_is_found():
    record = record_of(TRUTH, 2000, np.random.default_rng(3), noise=0.05)
    fit = Arx(INPUTS, OUTPUTS, n_a=(3, 2)).fit(record)
    np.testing.assert_allclose(np.sqrt(np.diag(fit.noise)), 0.05, rtol=0.06)  # 3 / sqrt(2 * 2000)
    np.testing.assert_allclose(fit.loss, 0.05**2, rtol=0.12)
    assert abs(fit.noise[0, 1]) < 3.0 * 0.05**2 / np.sqrt(2000)
    assert (fit.samples, fit.freedom, fit.parameters) == (1997 + 1998, 1997 - 8, 13)
    assert fit.covariance.shape == (15, 15)
    assert np.sqrt(fit.covariance[0, 0]) == pytest.approx(fit["a1[depth_m]"].error)


def test_segments_and_records_keep_their_lags_apart():
    rng = np.random.default_rng(1)
    parts = [record_of(TRUTH, 120, rng, segments=3, start=3.0) for _ in range(2)]
    fit = Arx(INPUTS, OUTPUTS, n_a=(3, 2), offset=False).fit(*parts)
    np.testing.assert_allclose(fit.model.a, TRUTH.a, atol=1e-8)  # across a cut no equation holds
    assert fit.samples == 2 * 3 * (40 - 3 + 40 - 2)


def test_the_operating_point_is_found_beside_an_integrator():
    record = record_of(MOVED, 300, np.random.default_rng(2))
    fit = Arx(INPUTS, OUTPUTS, n_a=(3, 2)).fit(record)
    np.testing.assert_allclose(fit.model.a, TRUTH.a, atol=1e-7)
    # many offsets are one equation; its constant is what the data tell
    np.testing.assert_allclose(constant_of(fit.model), constant_of(MOVED), atol=1e-6)
    assert np.all(np.abs(fit.model.input_offset) < 0.1)  # near the data, although the depth integrates


def constant_of(model):
    return model.a.sum(axis=0) @ model.output_offset - model.b.sum(axis=0) @ model.input_offset


def test_delay_and_counts_of_one_input_each():
    truth = Polynomial.from_coefficients(
        a={"heading_rad": [-1.8, 0.81]}, b={"heading_rad": {"rudder_rad": [0.0, 0.3]}}, dt=1.0
    )
    record = record_of(truth, 120, np.random.default_rng(0))
    fit = Arx(("rudder_rad",), ("heading_rad",), n_a=2, n_b=1, delay=2, offset=False).fit(record)
    assert fit.model.b.shape == (3, 1, 1)
    assert fit["b2[heading_rad, rudder_rad]"].value == pytest.approx(0.3)
    idle = Arx(INPUTS, OUTPUTS, n_a=(3, 2), n_b=[[2, 0], [0, 2]]).fit(record_of(TRUTH, 200, np.random.default_rng(0)))
    assert not idle.model.b[:, 0, 1].any()
    assert not idle.model.b[:, 1, 0].any()


def test_headings_are_continuous_wherever_their_segments_begin():
    truth = Polynomial.from_coefficients(
        a={"heading_rad": [-1.8, 0.8]}, b={"heading_rad": {"rudder_rad": [0.3, 0.1]}}, dt=1.0
    )
    rng = np.random.default_rng(5)
    record = record_of(truth, 200, rng, segments=2, start=1.0)
    turned = record.with_channels(
        {"heading_rad": np.angle(np.exp(1j * record["heading_rad"])) + 2.0 * np.pi * (record.time > 99.5)}
    )
    fit = Arx(("rudder_rad",), ("heading_rad",)).fit(turned)
    np.testing.assert_allclose(fit.model.a[:, 0, 0], [1.0, -1.8, 0.8], atol=1e-7)


def test_the_sample_time_is_free_of_the_rounding_of_times():
    record = record_of(TRUTH, 200, np.random.default_rng(0), noise=0.01)
    columns = {name: record[name] for name in record.names}
    for dt in (0.1, 1.0 / 3.0):
        late = Record.from_arrays(86400.0 + dt * np.arange(200), columns)
        assert Arx(INPUTS, OUTPUTS).fit(late).model.dt == pytest.approx(dt, rel=1e-9)
    assert Arx(INPUTS, OUTPUTS).fit(Record.from_arrays(86400.0 + 0.1 * np.arange(200), columns)).model.dt == 0.1


def test_noise_on_the_output_biases_the_coefficients():
    rng = np.random.default_rng(0)
    clean = record_of(TRUTH, 3000, rng, segments=1)
    noisy = clean.with_channels({"pitch_rad": clean["pitch_rad"] + 0.05 * rng.standard_normal(3000)})
    fit = Arx(INPUTS, ("pitch_rad",)).fit(noisy)
    low, high = fit["a1[pitch_rad]"].ci95
    assert not low <= -1.5 <= high  # the interval does not hold the bias, as the docstring says


def test_what_cannot_be_fitted_is_refused_in_words():
    record = record_of(TRUTH, 200, np.random.default_rng(0), noise=0.01)
    still = record.with_channels({"bow_plane_rad": np.full(200, 0.1)})
    with pytest.raises(ValueError, match="got bow_plane_rad constant throughout"):
        Arx(INPUTS, OUTPUTS).fit(still)
    twice = record.with_channels({"bow_plane_rad": -record["stern_plane_rad"]})
    with pytest.raises(ValueError, match=r"bow_plane_rad at lags 1 and 2 and stern_plane_rad at lags 1 and 2 apart"):
        Arx(INPUTS, OUTPUTS).fit(twice)
    with pytest.raises(ValueError, match="at least 4 samples per coefficient"):
        Arx(INPUTS, OUTPUTS).fit(record.between(0.0, 80.0))
    with pytest.raises(ValueError, match="no channel 'pitch_rad'"):
        Arx(INPUTS, OUTPUTS).fit(record.without(["pitch_rad"]))
    with pytest.raises(ValueError, match="at least one record"):
        Arx(INPUTS, OUTPUTS).fit()
    uneven = Record.from_arrays(np.cumsum(np.random.default_rng(0).uniform(1, 2, 50)), {"rudder_rad": np.arange(50.0)})
    with pytest.raises(ValueError, match=r"record\.resample"):
        Arx(("rudder_rad",), ("depth_m",)).fit(uneven.with_channels({"depth_m": np.arange(50.0)}))
    with pytest.raises(ValueError, match="one sample interval"):
        Arx(INPUTS, OUTPUTS).fit(record, record.resample(8.0))
    holed = record["pitch_rad"].copy()
    auxiliary = record.with_channels({"altitude_m": np.where(np.arange(200) == 7, np.nan, holed)})
    with pytest.raises(ValueError, match="altitude_m in every sample"):
        Arx(INPUTS, ("altitude_m",)).fit(auxiliary)


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"n_a": (1, 2, 3)}, "n_a"),
        ({"n_a": -1}, "n_a"),
        ({"n_a": 1.5}, "n_a"),
        ({"n_b": [[2, 1, 1], [1, 1, 1]]}, "n_b"),
        ({"n_b": 0}, "n_b of at least 1"),
        ({"delay": 0}, "delay >= 1"),
        ({"n_b": True}, "n_b"),
        ({"outputs": ()}, "outputs"),
        ({"outputs": ("bow_plane_rad",)}, "as input and as output"),
        ({"outputs": "depth_m"}, "list of different channel names"),
        ({"outputs": ("depth_deg",)}, "depth_deg"),
    ],
)
def test_settings_are_checked_when_given(settings, words):
    with pytest.raises(ValueError, match=words):
        Arx(**{"inputs": INPUTS, "outputs": OUTPUTS, **settings})
