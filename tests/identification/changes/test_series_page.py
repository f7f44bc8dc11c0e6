"""Tests of the page and the sentences of a series of missions."""

from dataclasses import replace

import pytest

from auv_gym.plant import load_vehicle
from identification.changes.forms import Sized
from identification.changes.page import series_figure, series_page
from identification.changes.series import MissionStep, Series, Trend, _paths_tied
from identification.changes.wording import scatter_of, series_json, series_summary

SIZES = tuple(Sized(value, (value - 0.001, value + 0.001)) for value in (0.0, 0.0, 0.03, 0.03))
OFFSET = Trend(
    "effects.rudder.offset", "rudder offset", "rad", "mission",
    Sized(0.012, (-0.006, 0.03)), 0.0095, 0.015, (0.0, 1.0, 2.0, 3.0), SIZES,
)  # fmt: skip


def series(*trends):
    return Series(load_vehicle("slocum"), tuple(f"dive{k}.nc" for k in range(4)), trends, {})


def test_a_step_between_missions_is_no_trend_and_is_said_to_be_more_than_noise():
    (line,) = series_summary(series(OFFSET))
    assert line.startswith("Rudder offset shows no trend: 0.688 deg a mission")
    assert line.endswith("The missions differ by far more than their own intervals, but not along a line.")
    assert series_summary(series(replace(OFFSET, scatter=0.001)))[0].endswith("deg).")


STEP = MissionStep(
    "dive2.nc", ("dive2.nc", "dive2.nc"), 1.5,
    Sized(0.0, (-0.001, 0.001)), Sized(0.03, (0.029, 0.031)), Sized(0.03, (0.028, 0.032)), 40.0,
)  # fmt: skip


def test_a_step_that_explains_the_missions_better_is_said_drawn_and_in_the_file(tmp_path):
    found = series(replace(OFFSET, step=STEP))
    (line,) = series_summary(found)
    assert line.endswith(
        " One step explains the missions better than a line: from 0 deg to 1.72 deg, by 1.72 deg "
        "(95 % interval 1.6 to 1.83 deg), from dive2.nc on."
    )
    wide = series_summary(series(replace(OFFSET, step=replace(STEP, ci95=("dive1.nc", "dive3.nc")))))[0]
    assert wide.endswith("from dive2.nc on (95 % interval dive1.nc to dive3.nc).")
    assert series_json(found)["trends"][0]["step"]["mission"] == "dive2.nc"
    assert series_json(series(OFFSET))["trends"][0]["step"] is None
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    assert "from dive2.nc on" in series_page(found).split("<table")[1]
    (axes,) = series_figure(found).axes
    drawn = [line.get_xydata().tolist() for line in axes.lines if len(line.get_xydata()) == 4]
    assert [[0.0, 0.0], [1.5, 0.0], [1.5, pytest.approx(1.7189, abs=1e-4)]] in [own[:3] for own in drawn]


def test_what_else_would_explain_a_trend_is_said_and_on_the_page():
    tied = replace(OFFSET, tied=("effects.yaw.moment",))
    assert " The missions cannot tell this from: constant yaw moment." in series_summary(series(tied))[0]
    assert "cannot tell" not in series_summary(series(OFFSET))[0]


def test_a_trend_has_no_sides_and_is_no_alternative_to_itself():
    tied = ("before effects.rudder.offset", "after effects.yaw.moment", "effects.yaw.moment")
    assert _paths_tied("effects.rudder.offset", tied) == ["effects.yaw.moment"]


def test_scatter_has_the_unit_of_the_trend():
    assert scatter_of(OFFSET) == "0.544 deg"
    damping = replace(OFFSET, path="hull.n_r", unit="1", sizes=(Sized(-0.001, (-0.0011, -0.0009)),) * 4, scatter=1e-5)
    assert scatter_of(damping) == "1 %"


def test_the_page_names_few_missions_and_stands_without_a_trend():
    pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
    assert series_page(series(OFFSET)).count("<svg") == 1
    assert (
        "constant yaw moment" in series_page(series(replace(OFFSET, tied=("effects.yaw.moment",)))).split("<table")[1]
    )
    text = series_page(series())
    assert "Too few of the missions show any parameter" in text
    assert "<svg" not in text
