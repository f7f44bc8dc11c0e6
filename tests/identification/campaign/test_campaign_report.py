"""The page of a campaign: complete, self-contained, well-formed, with the numbers of the files beside it."""

import json
import re
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest

from auv_gym.records.record import Record
from identification.campaign.index import read_index, write_index
from identification.campaign.report import figures, write_report
from identification.campaign.report.focus import representative_runs
from identification.pages import page as pages
from identification.pages.drawn_channels import excited_set_point
from identification.pages.page import percent
from tests.identification.outline import Outline

pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
pytest.importorskip("jinja2", reason="the extra `render` is not installed")

SECTIONS = ["experiment", "spectra", "models", "open-loop", "closed-loop", "residuals", "runs", "method"]


@pytest.fixture(scope="module")
def page(study):
    path = write_report(study.campaign, study.folder)
    assert path == study.folder / "report.html"
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def outline(page):
    return Outline(page)


@pytest.fixture
def no_figures(monkeypatch):
    monkeypatch.setattr(pages, "svg", lambda draw, name, label: f'<svg role="img" aria-label="{name}"></svg>')


def test_the_page_is_well_formed_and_loads_nothing(page, outline):
    assert page.startswith("<!doctype html>")
    assert outline.faults == []
    ids = [attrs["id"] for _, attrs in outline.tags if "id" in attrs]
    assert len(ids) == len(set(ids))
    assert all(reference in ids for reference in re.findall(r'(?:url\(|href=")#([^")]+)', page))
    assert not re.search(r"https?:|@import", page)
    for tag, attrs in outline.tags:
        assert tag not in {"script", "iframe", "object", "embed"}
        assert "src" not in attrs
        assert attrs.get("href", "#").startswith(("#", "data:"))


def test_the_sections_stand_in_order_and_can_be_reached(outline):
    assert [attrs["id"] for tag, attrs in outline.tags if tag == "section"] == SECTIONS
    assert [attrs["href"].removeprefix("#") for tag, attrs in outline.tags if tag == "a"] == SECTIONS


def test_every_figure_has_words_for_who_cannot_see_it(outline):
    drawings = [attrs for tag, attrs in outline.tags if tag == "svg"]
    assert len(drawings) >= 10
    assert all(attrs["role"] == "img" and len(attrs["aria-label"]) > 20 for attrs in drawings)
    assert sum(tag == "figcaption" for tag, _ in outline.tags) == len(drawings)


def test_the_page_has_the_numbers_of_the_fits_and_the_rollouts(study, outline):
    assert "6 runs, all finished" in outline.text
    assert "A rudder <straight> or 3 deg off" in outline.text
    for fit in study.fits:
        assert fit["name"] in outline.text
        for scores in fit["scores"].values():
            assert percent(scores["heading_rad"]["fit_percent"]) in outline.text
        for parameter in fit["parameters"]:
            assert parameter["name"] in outline.text
            assert parameter["title"] in outline.text
    assert study.fits[-1]["reason"] in outline.text
    for row in read_index(study.folder):
        assert row.id in outline.text
    for of in (of for r in study.rollouts for of in r["models"].values()):  # one run in each cell, so no median
        assert percent(of["scores"]["heading_rad"]["percent"]) in outline.text


def test_a_parameter_of_a_vehicle_has_its_title(study):
    parameters = {p["name"]: p["title"] for fit in study.fits for p in fit["parameters"]}
    assert parameters["effects.rudder.offset"] == "rudder offset"
    assert "" in parameters.values()  # those of a linear model


def test_a_campaign_without_fits_has_its_page(study, tmp_path, no_figures):
    (tmp_path / "runs").symlink_to(study.folder / "runs")
    rows = read_index(study.folder)
    broken = replace(rows[-1], status="failed", reason="out <of> order", sha256="")
    write_index([*rows[:-1], broken], tmp_path)
    found = Outline(write_report(replace(study.campaign, fit=(), compare=None), tmp_path).read_text(encoding="utf-8"))
    assert found.faults == []
    assert [a["id"] for tag, a in found.tags if tag == "section"] == ["experiment", "spectra", "runs", "method"]
    assert "6 runs, of which 1 failed" in found.text
    assert "failed: out <of> order" in found.text


def test_a_campaign_of_which_nothing_ran_says_so(study, tmp_path, no_figures):
    rows = [replace(row, status="failed", reason="no water", sha256="") for row in read_index(study.folder)]
    write_index(rows, tmp_path)
    found = Outline(write_report(replace(study.campaign, fit=(), compare=None), tmp_path).read_text(encoding="utf-8"))
    assert found.faults == []
    assert "6 runs, of which 6 failed" in found.text


def test_a_model_that_leaves_its_envelope_is_marked_with_its_reason(study, tmp_path, no_figures):
    for name in ("runs", "models", "rollouts"):
        shutil.copytree(study.folder / name, tmp_path / name)
    write_index(read_index(study.folder), tmp_path)
    entry = next(r for r in study.rollouts if r["kind"] == "closed" and "offset" in r["models"])
    file = tmp_path / "rollouts" / f"closed-{entry['run']}.json"
    told = json.loads(file.read_text())
    told["models"]["offset"]["reason"] = "too <deep> at 12 s"
    file.write_text(json.dumps(told))
    found = Outline(write_report(study.campaign, tmp_path).read_text(encoding="utf-8"))
    assert found.faults == []
    assert f"offset in run {entry['run']} ended early: too <deep> at 12 s" in found.text
    assert "1 rollout of models cut short" in found.text
    assert "1 cut short" in found.text
    assert (
        "offset is off by" not in found.text.partition("Closed loop:")[2].partition("Residual")[0]
    )  # the other is best


def test_excitation_of_a_set_point_is_part_of_what_was_asked():
    time = np.arange(0.0, 40.0, 4.0)
    signals = {"depth_m": np.sin(time), "depth_cmd_m": np.full(time.size, 50.0), "excitation_depth_m": np.cos(time)}
    np.testing.assert_array_equal(excited_set_point(Record.from_arrays(time, signals), "depth_m"), 50.0 + np.cos(time))


def test_percentages_have_no_more_digits_than_they_are_worth():
    assert [percent(v) for v in (0.0276, -0.5, 1.637, 94.87, 2846.2)] == [
        "0.03 %",
        "−0.50 %",
        "1.64 %",
        "94.9 %",
        "2846 %",
    ]


def test_without_the_extra_the_error_names_it_and_the_old_page_stays(study, page, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(ImportError, match=r"jinja2 is not installed; .*: pip install '\.\[render\]'"):
        write_report(study.campaign, study.folder)
    assert (study.folder / "report.html").read_text(encoding="utf-8") == page


def test_featured_runs_differ_in_their_settings(study):
    rows = read_index(study.folder)
    picked = representative_runs(rows, 2)
    assert {json.dumps(dict(row.cell)) for row in picked} == {json.dumps(dict(row.cell)) for row in rows}
    assert len(representative_runs(rows[:1])) == 1
    assert len({row.id for row in representative_runs(rows, 5)}) == 5


def test_spectra_have_the_power_of_the_signals():
    rng, dt = np.random.default_rng(0), 0.5
    time = dt * np.arange(4000)
    tone = np.sqrt(2.0) * np.sin(0.9 * time)
    records = [
        Record.from_arrays(time, {"depth_m": tone, "rudder_rad": 0.1 * rng.standard_normal(time.size)})
        for _ in range(4)
    ]
    frequency, powers = figures.spectra(records, "depth_m")
    step = frequency[1] - frequency[0]
    assert powers.shape == (4, frequency.size)
    assert np.sum(powers[0]) * step == pytest.approx(1.0, rel=0.02)  # a tone of unit power
    assert abs(frequency[np.argmax(powers[0])] - 0.9) < step
    _, flat = figures.spectra(records, "rudder_rad")
    level = 0.01 / (np.pi / dt)  # variance over all frequencies up to half the sampling rate
    assert np.mean(flat) == pytest.approx(level, rel=0.05)
    assert figures.spectra(records, "pitch_rad")[0].size == 0


def test_shaded_times_are_those_at_which_the_guard_acted():
    from matplotlib.colors import to_hex

    time = np.arange(0.0, 200.0, 4.0)
    acted = (time >= 40.0) & (time < 80.0)
    values = {"depth_m": np.sin(time / 20.0), "stern_plane_rad": np.cos(time), "envelope_flag": acted.astype(float)}
    figure = figures.signals_figure(Record.from_arrays(time, values))
    shades = [p for p in figure.axes[0].patches if to_hex(p.get_facecolor()) == figures.GUARD_SHADE]
    assert [(p.get_x(), p.get_x() + p.get_width()) for p in shades] == [(40.0, 80.0)]
