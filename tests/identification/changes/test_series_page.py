"""Tests of the page and the sentences of a series of missions."""

from dataclasses import replace

import pytest

from auv_gym.plant import load_vehicle
from identification.changes.forms import Sized
from identification.changes.page import series_page
from identification.changes.series import Series, Trend, _paths_tied
from identification.changes.wording import scatter_of, series_summary

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
