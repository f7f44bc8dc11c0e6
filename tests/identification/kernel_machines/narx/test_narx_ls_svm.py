"""Tests of NARX LS-SVM: recovery, its linear part, its description, and refusals."""

import numpy as np
import pytest

from auv_gym.model import simulate
from auv_gym.records.record import Record, concat
from identification.compare.comparison import compare_open
from identification.compare.model_tests import predicts
from identification.estimator import make_estimator, summary
from identification.identified import identify
from identification.kernel_machines.cells import Cells
from identification.kernel_machines.narx.narx import NarxLsSvm
from identification.pages.model_page import identified_page

DT = 0.5


def turning(seed, samples=400, noise=0.0, bend=1.0, start=0.0) -> Record:
    """A rudder that saturates on a yaw whose damping grows with the rate; bend 0: the same without either."""
    rng = np.random.default_rng(seed)
    rudder = np.repeat(rng.uniform(-1.0, 1.0, samples // 5 + 1), 5)[:samples]
    rate, heading = np.zeros(samples), np.full(samples, start)
    for k in range(1, samples):
        moved = (1.0 - bend) * rudder[k - 1] + bend * np.tanh(3.0 * rudder[k - 1])
        rate[k] = 0.8 * rate[k - 1] - bend * 0.4 * rate[k - 1] * abs(rate[k - 1]) + 0.2 * moved
        heading[k] = heading[k - 1] + DT * rate[k - 1]
    added = noise * rng.standard_normal((2, samples))
    columns = {"rudder_rad": rudder, "r_radps": rate + added[0], "heading_rad": heading + added[1]}
    return Record.from_arrays(DT * np.arange(samples), columns)


def fitted_percent(fit, record) -> float:
    of = compare_open({"model": fit.model}, record).scores["model"]
    return min(score.fit_percent for score in of.values())


def linear_percent(record, held, output, **settings) -> float:
    return fitted_percent(make_estimator("arx", settings, inputs=["rudder_rad"], outputs=[output]).fit(record), held)


@pytest.mark.parametrize("noise, least, n", [(0.0, 99.0, 1), (0.02, 94.0, 3)])
def test_it_recovers_what_a_linear_model_cannot(noise, least, n):
    train, held = turning(1, noise=noise), turning(2)
    fit = NarxLsSvm(["rudder_rad"], ["r_radps"], n_a=n, n_b=n).fit(train)
    assert fitted_percent(fit, held) > least
    assert linear_percent(train, held, "r_radps", n_a=n, n_b=n) < 85.0
    assert fit.model.outside(train) <= 0.01
    assert fit.model.outside(held.with_channels({"r_radps": held["r_radps"] + 3.0})) > 0.9


@pytest.mark.parametrize("noise, tuning", [(0.0, "free_run"), (0.02, "free_run"), (0.0, "leave_one_out")])
def test_a_linear_truth_is_left_to_the_linear_part(noise, tuning):
    train, held = turning(1, noise=noise, bend=0.0), turning(2, bend=0.0)
    fit = NarxLsSvm(["rudder_rad"], ["r_radps"], n_a=1, n_b=1, samples=150, tuning=tuning).fit(train)
    assert fit.choices == (None,)
    assert not fit.model.coefficients.any()
    assert fitted_percent(fit, held) == pytest.approx(linear_percent(train, held, "r_radps", n_a=1, n_b=1), abs=0.5)
    assert any("linear part alone" in note for note in fit.notes)


def test_a_heading_is_modelled_by_its_increments_wherever_it_is():
    train, held = turning(1), turning(2, start=300.0)
    fit = NarxLsSvm(["rudder_rad"], ["heading_rad", "r_radps"], samples=200).fit(train)
    assert fit.model.integrating == ("heading_rad",)
    assert fitted_percent(fit, held) > 90.0
    assert NarxLsSvm(["rudder_rad"], ["heading_rad"], integrating=()).lags.integrating == ()


def test_segments_and_records_are_one_fit_each_with_its_own_lags():
    parts = [turning(seed, 160, start=40.0 * seed) for seed in (1, 2, 3)]
    apart, joined = (
        NarxLsSvm(["rudder_rad"], ["heading_rad"], penalty=1e4, sigma=3.0, samples=1000).fit(*records)
        for records in (parts, [concat(parts)])
    )
    assert np.array_equal(apart.model.coefficients, joined.model.coefficients)
    assert len(apart.model.support) == 3 * (160 - 2)
    assert fitted_percent(apart, turning(4)) > 97.0


@pytest.mark.parametrize("tuning", ["free_run", "leave_one_out"])
def test_many_samples_are_joined_to_cells(tuning):
    train, held = turning(1, 1200, noise=0.01), turning(2)
    fit = NarxLsSvm(["rudder_rad"], ["r_radps"], n_a=2, n_b=2, samples=150, tuning=tuning).fit(train)
    assert len(fit.model.support) == 150
    assert fitted_percent(fit, held) > 90.0
    assert "1198 samples in 150 cells" in fit.notes[0]


def test_cells_hold_every_sample_once_and_keep_its_mean():
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(500, 3)), rng.normal(size=(500, 2))
    cells = Cells.of(x, y, 40)
    assert len(cells.x) == 40
    assert cells.weights.sum() == 500
    np.testing.assert_allclose(cells.weights @ cells.x, x.sum(axis=0), atol=1e-10)
    np.testing.assert_allclose(cells.weights @ cells.y, y.sum(axis=0), atol=1e-10)
    nearest = np.linalg.norm(x[:, None] - cells.x, axis=2).min(axis=1)
    even = np.linalg.norm(x[:, None] - x[::13], axis=2).min(axis=1)
    assert nearest.max() < 0.8 * even.max()  # rare samples are not left out
    repeated = Cells.of(np.repeat(x[:20], 5, axis=0), np.zeros((100, 1)), 40)
    np.testing.assert_allclose(np.sort(repeated.x, axis=0), np.sort(x[:20], axis=0), rtol=1e-12)
    assert (repeated.weights == 5.0).all()


def test_it_is_judged_and_reported_as_other_methods_are():
    train, held = turning(1, noise=0.005), turning(2, noise=0.005)
    estimator = make_estimator("narx_ls_svm", {"n_a": 2, "samples": 200}, inputs=["rudder_rad"], outputs=["r_radps"])
    done = identify(estimator, [train], [held])
    assert done.problem == ""
    assert predicts(done.fit.model)
    assert done.sweep is not None
    assert done.sweep["r_radps"][DT] < 0.01
    assert done.tests is not None
    assert done.tests["r_radps"]["ahead"]
    page = identified_page("yaw", done, "narx_ls_svm")
    assert "Yaw rate: C " in page
    assert "Poles" not in page
    assert "% of the held-out samples are outside" in page
    assert "chosen by free run errors" in summary(done.fit)


def test_a_fit_whose_free_run_fails_says_so():
    grows = Record.from_arrays(
        DT * np.arange(120),
        {"rudder_rad": np.sin(np.arange(120.0)), "r_radps": 1.3 ** np.arange(120) * np.cos(2.0 * np.arange(120))},
    )
    fit = NarxLsSvm(["rudder_rad"], ["r_radps"], penalty=1e-3, sigma=0.5, trend=False).fit(grows)
    assert any("free run" in note for note in fit.notes)
    assert np.isfinite(simulate(fit.model, turning(1))["r_radps"]).all()


RECORD = turning(1, 120)


@pytest.mark.parametrize(
    "settings, record, words",
    [
        ({}, turning(1, 20), "at least 20 samples for 4 regressors, got 18 that have all their lags"),
        ({}, turning(1, 40), "at least 50 samples to choose by free runs, got 38"),
        ({}, RECORD.with_channels({"rudder_rad": np.full(120, 0.1)}), "needs every input to move, got rudder_rad"),
        ({}, RECORD.with_channels({"r_radps": np.zeros(120)}), "needs every output to move, got r_radps"),
        ({}, RECORD.without(["rudder_rad"]), "no channel 'rudder_rad'"),
        ({"penalty": 1e3, "sigma": 1e-9}, RECORD, "needs sigma from .* no sample tells of another"),
        ({"penalty": -1.0}, RECORD, r"NarxLsSvm needs penalty > 0, or none to have it tuned, got -1\.0"),
        ({"n_a": -1}, RECORD, "NarxLsSvm: n_a needs a whole number of at least 0, got -1"),
        ({"integrating": ["depth_m"]}, RECORD, "integrating needs outputs"),
        ({"tuning": "luck"}, RECORD, "free_run or leave_one_out, got 'luck'"),
        ({"tuning": "leave_one_out", "sigma": 2.0}, RECORD, "give both, or none"),
        ({"samples": 3}, RECORD, "samples of at least 10, got 3"),
    ],
)
def test_what_it_cannot_do_is_refused_in_words(settings, record, words):
    with pytest.raises(ValueError, match=words):
        NarxLsSvm(["rudder_rad"], ["r_radps"], **settings).fit(record)
