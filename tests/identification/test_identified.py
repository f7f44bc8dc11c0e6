"""Tests of a judged fit: the held-out data, the statements, and the pages."""

import re
from dataclasses import replace

import numpy as np
import pytest

from auv_gym.models.linear import Polynomial
from auv_gym.records.record import Record
from identification.estimator import make_estimator
from identification.identified import identify, joined, split
from identification.linear.fit import Known
from identification.linear.poles import pole_intervals
from identification.linear.polynomials.orders import search_orders
from identification.linear.subspaces.n4sid import N4sid
from identification.pages.linear_tables import complex_words, full_pole_table, pole_table, zero_table
from identification.pages.model_figures import horizon_figure
from identification.pages.model_page import (
    Table,
    compared_page,
    horizon_table,
    identified_page,
    outputs_of_several_models,
    parameter_table,
    residual_table,
    score_table,
)
from tests.identification.linear.known_systems import INPUTS, OUTPUTS, TRUTH, record_of


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return [record_of(TRUTH, 300, np.random.default_rng(seed), noise=0.02) for seed in range(2)]


@pytest.fixture(scope="module")
def done(records):
    return identify(make_estimator("arx", {"n_a": [3, 2]}, inputs=INPUTS, outputs=OUTPUTS), records[:1], records[1:])


def headings(text: str) -> list[str]:
    return re.findall("<h2>(.*?)</h2>", text)


def test_the_last_third_is_held_out(records):
    fitted, held, told = split(records[:1])
    assert told == "the last third"
    assert [len(r) for r in fitted] == [200]
    assert [len(r) for r in held] == [100]
    assert fitted[0].time[-1] < held[0].time[0]
    fitted, held, told = split(records)
    assert told == "the last third of each segment"
    assert [len(r) for r in (*fitted, *held)] == [200, 200, 100, 100]
    dives = record_of(TRUTH, 300, np.random.default_rng(0), segments=5)
    fitted, held, told = split([dives])
    assert told == "the last 2 of 5 segments"
    assert [len(r) for r in (*fitted, *held)] == [60] * 5
    assert held[0].time[0] == dives.time[180]
    with pytest.raises(ValueError, match="too short to hold out"):
        split([records[0].between(0.0, 9.0)])


def test_a_true_structure_fits_data_that_it_has_not_seen(done, records):
    assert done.told == "1 record to validate on"
    assert not done.problem
    assert len(done.fitted) == len(done.held) == 300
    assert done.open_loop.scores["model"]["pitch_rad"].fit_percent > 50.0
    for test in done.tests.values():
        assert test["p_value"] > 1e-3
        assert test["rms"] == pytest.approx(0.02, rel=0.15)
    default = identify(make_estimator("arx", {"n_a": [3, 2]}, inputs=INPUTS, outputs=OUTPUTS), records[:1])
    assert default.told == "the last third"
    assert len(default.fitted) == 200
    assert default.fit.samples == 197 + 198


@pytest.mark.slow
def test_a_model_that_cannot_be_judged_is_returned_with_the_reason(records):
    method = make_estimator("arx", {"n_a": [3, 2]}, inputs=INPUTS, outputs=OUTPUTS)
    found = identify(method, records[:1], [records[1].resample(8.0)])
    assert found.open_loop is None
    assert found.tests is None
    assert "4 s at a time" in found.problem
    assert found.fit.model.dt == 4.0
    assert "could not be judged" in identified_page("model", found, "words")
    with pytest.raises(ValueError, match="at least one record"):
        identify(method, [])


def test_records_are_joined_by_the_channels_that_all_have(records):
    found = joined([records[0], records[1].without(["pitch_rad"])])
    assert set(found.names) == {*INPUTS, "depth_m"}
    assert len(found) == 600
    with pytest.raises(ValueError, match="share no motion"):
        joined([records[0].without(["pitch_rad", "depth_m", "bow_plane_rad"]), records[1].without(["stern_plane_rad"])])


def test_tables_hold_the_numbers_that_they_name(done):
    table = parameter_table(done.fit.estimates)
    assert len(table.rows) == len(done.fit.estimates) == 15
    assert table.rows[0][0] == "a1[depth_m]"
    assert float(table.rows[0][1].replace("−", "-")) == pytest.approx(done.fit.estimates[0].value, rel=5e-3)
    scores = score_table(done.open_loop)
    assert [row[0] for row in scores.rows] == ["depth_m", "pitch_rad"]
    assert scores.rows[1][2].endswith("deg")
    tests = residual_table(done.tests)
    assert {row[-1] for row in tests.rows} <= {"yes", "no"}
    assert tests.rows[0][1].split(" (")[0] in INPUTS
    sweeps = {"a": {"pitch_rad": {4.0: np.radians(1.5), 8.0: 0.1}}, "b": {"pitch_rad": {4.0: 0.2}}}
    assert horizon_table(sweeps) == Table(
        ("output", "model", "4 s", "8 s"), (("pitch, deg", "a", "1.50", "5.73"), ("pitch, deg", "b", "11.5", "–")), 2
    )
    assert outputs_of_several_models({"a": {"x": 1, "y": 2}, "b": {"y": 3}}) == ["y"]
    assert outputs_of_several_models({"a": {"x": 1, "y": 2}}) == ["x", "y"]


@pytest.mark.slow
def test_pages_are_whole_and_tell_what_was_found(done):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    text = identified_page("steering <1>", replace(done, doubts=("clocks differ",)), "arx, fitted to 300 samples.")
    assert text.startswith("<!doctype html>")
    assert "steering &lt;1&gt;" in text
    assert text.count("<svg") == 6
    assert headings(text) == [
        "Free runs over 1 record to validate on",
        "Prediction error by horizon",
        "Parameters",
        "Poles and zeros",
        "Frequency response",
        "Residual tests: 2 of 2 outputs white",
    ]
    assert "Check the data: clocks differ" in text
    assert "a1[depth_m]" in text
    assert "http://" not in text.replace("http://www.w3.org", "")
    sweeps = {"model": {"depth_m": {4.0: 0.1, 40.0: 0.4}}}
    page = compared_page("Models", done.open_loop, sweeps, "words")
    assert page.count("<svg") == 2
    assert "Depth: model fits best" in page


def test_a_linear_fit_is_judged_over_the_horizon_and_with_its_band(done, records):
    assert list(done.sweep["depth_m"]) == [4.0, 12.0, 40.0, 120.0, 400.0]
    assert done.sweep["pitch_rad"][4.0] == pytest.approx(0.02, rel=0.15)
    assert done.band.half.shape == done.open_loop.runs["model"].model.shape
    assert done.doubts == ()
    late = records[0].with_channels({name: np.roll(records[0][name], 5) for name in INPUTS})
    found = identify(make_estimator("arx", {"n_a": [3, 2]}, inputs=INPUTS, outputs=OUTPUTS), [late])
    assert any("stern_plane_rad" in doubt for doubt in found.doubts)


@pytest.mark.slow
def test_the_page_shows_where_orders_are_from(records):
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    search = search_orders("arx", records[:1], INPUTS, OUTPUTS[1:], n_a=[2, 3], n_b=[1, 2])
    text = identified_page("arx", identify(search.estimator(), records[:1], records[1:], search=search), "words")
    assert headings(text)[-1] == "Orders"
    assert "MDL, chosen" in text
    text = identified_page("n4sid", identify(N4sid(INPUTS, OUTPUTS[1:], order=2), records[:1], records[1:]), "words")
    assert headings(text)[-1] == "Order"
    assert "no interval" in text


def test_pole_tables_say_what_a_pole_means(done):
    brief, full = pole_table(pole_intervals(done.fit)), full_pole_table(pole_intervals(done.fit))
    assert [row[0] for row in brief.rows] == ["depth", "pitch", "depth", "depth"]
    assert brief.rows[1][1].startswith("0.7")
    assert "j" in brief.rows[1][1]
    assert "rad/s" in brief.rows[1][4]
    assert brief.rows[2][4] == ""
    assert full.rows[1][1][1].endswith("j")
    fixed = make_estimator("arx", {"n_a": [3, 2], "integrating": ["depth_m"]}, inputs=INPUTS, outputs=OUTPUTS)
    row = pole_table(pole_intervals(fixed.fit(done.fitted))).rows[0]
    assert row[1:4] == ("1.000", "integrates", "by construction")
    assert [row[:2] for row in zero_table(done.fit.model).rows][1] == ("depth", "stern plane")
    assert complex_words(0.5 - 0.0j) == "0.5000"
    grows = Known(Polynomial(np.reshape([1.0, -1.1], (2, 1, 1)), np.zeros((1, 1, 1)), INPUTS[:1], OUTPUTS[:1], 4.0))
    assert pole_table(pole_intervals(grows)).rows[0][1] == "grows in 42.0 s"


def test_the_horizon_figure_leaves_rounding_out():
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    figure = horizon_figure({"a": {"depth_m": {1.0: 0.1, 2.0: 1.0}}, "b": {"depth_m": {1.0: 1e-15, 2.0: 1e-15}}})
    (axes,) = figure.axes
    assert axes.get_ylim()[0] == pytest.approx(1e-5)
    assert len(axes.lines) == 2
