"""The page of a diagnosis: complete, self-contained, well-formed, and with the diagnosis's own numbers."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from auv_gym.channels import channel
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record, concat
from identification.diagnosis import as_json, diagnose
from identification.diagnosis.judge.effects import Detectable
from identification.diagnosis.judge.result import RARE
from identification.diagnosis.log.kinematics import Kinematics
from identification.diagnosis.log.plausibility import Doubt
from identification.diagnosis.search.discovery import Discovery
from identification.diagnosis.search.remainder import Left
from identification.diagnosis.wording import short
from identification.experiments.heading_control import closed_loop
from identification.fit.noises import Noise
from identification.fit.validation import FreeRuns
from identification.pages import diagnosis_figures as figures
from identification.pages.diagnosis_page import MEANINGS, diagnosis_page
from identification.pages.drawing import nearest_turns, new_figure, svg
from identification.pages.page import amount, number, span
from tests.identification.outline import Outline

pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
pytest.importorskip("jinja2", reason="the extra `render` is not installed")

SECTIONS = ("the-log", "before-after", "remains", "sensors", "loop", "candidates", "effects", "detectable", "method")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="module")
def diagnosis():
    vehicle = load_vehicle("slocum")
    truth = replace_at(vehicle, {"effects.current.north": 0.08, "effects.yaw.moment": 0.02})
    record = closed_loop(truth, rng=np.random.default_rng(4), duration=600.0)
    return diagnose(record, vehicle, source="dive 7 <west>.csv")


@pytest.fixture(scope="module")
def page(diagnosis):
    return diagnosis_page(diagnosis)


@pytest.fixture(scope="module")
def outline(page):
    return Outline(page)


@pytest.fixture
def no_figures(monkeypatch):
    monkeypatch.setattr(figures, "svg", lambda draw, d, name, label: f'<svg role="img" aria-label="{name}"></svg>')


def test_the_page_is_well_formed(page, outline):
    assert page.startswith("<!doctype html>")
    assert outline.faults == []
    ids = [attrs["id"] for _, attrs in outline.tags if "id" in attrs]
    assert len(ids) == len(set(ids))
    for reference in re.findall(r'(?:url\(|href=")#([^")]+)', page):
        assert reference in ids


def test_the_page_loads_nothing(page, outline):
    assert "http:" not in page
    assert "https:" not in page
    assert "@import" not in page
    for tag, attrs in outline.tags:
        assert tag not in {"script", "iframe", "object", "embed"}
        assert "src" not in attrs
        assert attrs.get("href", "#").startswith(("#", "data:"))
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", page))


def test_the_page_says_which_logs_the_vehicle_has_seen(diagnosis, outline):
    assert diagnosis.given.plant.fitted_to in outline.text
    assert "coefficients fitted to" in outline.text


def test_the_sections_stand_in_order_and_can_be_reached(outline):
    ids = [attrs["id"] for tag, attrs in outline.tags if tag == "section" and "id" in attrs]
    links = [attrs["href"].removeprefix("#") for tag, attrs in outline.tags if tag == "a"]
    assert tuple(ids) == SECTIONS
    assert tuple(links) == SECTIONS


def test_every_figure_has_words_for_who_cannot_see_it(outline):
    drawings = [attrs for tag, attrs in outline.tags if tag == "svg"]
    assert len(drawings) >= 9
    assert all(attrs["role"] == "img" and len(attrs["aria-label"]) > 20 for attrs in drawings)
    assert sum(tag == "figcaption" for tag, _ in outline.tags) == len(drawings)


def test_the_page_shows_the_numbers_of_the_diagnosis(diagnosis, outline):
    text = outline.text
    assert len(diagnosis.effects) >= 2
    for e in diagnosis.effects:
        assert amount(e.value, e.unit, sign=True) in text
        assert span(e.ci95, e.unit) in text
        assert e.path in text
    for name in ("heading_rad", "north_m", "east_m"):
        for stage in (diagnosis.given, diagnosis.refitted, diagnosis.after):
            assert amount(stage.scores[name].rmse, channel(name).unit) in text
    assert f"in {len(diagnosis.windows)} parts of the log" in text
    assert f"over {sum(map(len, diagnosis.windows))} windows of" in text
    for e in diagnosis.effects:
        assert f"chosen by {100.0 * e.frequency:.0f} % of the halves of the log" in text
    assert f"{100.0 * diagnosis.explained:.0f} %" in text
    for c in diagnosis.coefficients:
        assert amount(c.value, c.unit) in text
    for x in diagnosis.detectable:
        assert x.title in text
        assert not np.isfinite(x.size) or amount(x.size, x.unit) in text
    for r in diagnosis.rounds:
        for trial in r.trials:
            assert trial.candidate.title in text
            assert trial.state is None or abs(trial.train) < 1.0 or number(trial.train) in text


def test_names_of_logs_are_text_not_markup(page, outline):
    assert "dive 7 <west>.csv" in outline.text
    assert "<west>" not in page


@pytest.mark.slow
def test_the_same_diagnosis_gives_the_same_page(diagnosis, page):
    assert diagnosis_page(diagnosis) == page


@pytest.mark.parametrize("verdict", list(MEANINGS))
def test_each_verdict_has_its_page(diagnosis, no_figures, verdict):
    group = (diagnosis.effects[0].path, "effects.rudder.offset")
    changed = {
        "none": {"effects": (), "tied": (), "after": diagnosis.before},
        "doubted": {
            "effects": (),
            "tied": (),
            "doubts": (Doubt("the rudder is mirrored", ("rudder_rad",), 9.0, "turn it"),),
        },
        "coefficients": {"effects": (), "tied": (), "coefficients": (replace(diagnosis.coefficients[0], wrong=True),)},
        "named": {"tied": ()},
        "tied": {"tied": (group,), "effects": (replace(diagnosis.effects[0], tied_with=group[1:]),)},
        "unexplained": {"effects": (), "tied": (), "after": diagnosis.before},
    }[verdict]
    found = Outline(diagnosis_page(replace(diagnosis, verdict=verdict, **changed)))
    assert found.faults == []
    assert MEANINGS[verdict] in found.text
    assert ("section", {"class": f"verdict {verdict}", "aria-label": "Verdict"}) in found.tags
    assert ("cannot tell apart" in found.text) == (verdict == "tied")
    assert ("No effect was named." in found.text) == (verdict in ("none", "coefficients", "unexplained", "doubted"))


def test_a_coefficient_that_moved_is_compared_with_the_vehicle_as_given(diagnosis, no_figures):
    moved = replace(
        diagnosis.effects[0], path="effects.rudder.gain", title="rudder gain", unit="1", neutral=1.0,
        value=0.7, ci95=(0.6, 0.8), tied_with=("hull.n_delta",),
    )  # fmt: skip
    d = replace(
        diagnosis, before=diagnosis.given, effects=(moved,), tied=((moved.path, "hull.n_delta"),), verdict="tied"
    )
    text = Outline(diagnosis_page(d)).text
    assert "Before is the vehicle as given." in text
    assert "as given → after" in text
    assert "rudder gain has exactly the same effect as rudder effectiveness" in text
    c = next(c for c in d.coefficients if c.path == "hull.n_delta")
    assert f"{amount(c.value, c.unit)} instead of {amount(c.given, c.unit)}" in text


def test_wrong_coefficients_are_shown_with_the_errors_of_both_models(diagnosis, no_figures):
    c = replace(diagnosis.coefficients[0], wrong=True)
    d = replace(
        diagnosis, verdict="coefficients", before=diagnosis.given, after=diagnosis.refitted, effects=(), tied=(),
        coefficients=(c,), rounds=(),
    )  # fmt: skip
    text = Outline(diagnosis_page(d)).text
    assert list(d.stages) == ["as given", "refitted"]
    for label, stage in (("as given", d.given), ("coefficients refitted", d.refitted)):
        assert f"{label}{amount(stage.scores['heading_rad'].rmse, 'rad')}" in text.replace("\n", "")
    assert [label for label, *_ in figures.series(d)] == ["refitted model"]
    legend = [words.get_text() for words in figures.growth_figure(d).legends[0].get_texts()]
    assert "vehicle as given" in legend


def test_the_model_of_a_log_that_it_explains_is_not_said_to_miss_anything(diagnosis, no_figures):
    remains = {name: r | {"whiteness_p": 0.0, "rms": 9.0} for name, r in diagnosis.remains.items()}
    d = replace(
        diagnosis, verdict="none", effects=(), tied=(), before=diagnosis.refitted, after=diagnosis.refitted,
        left=Left(), discovery=None, remains=remains,
    )  # fmt: skip
    text = Outline(diagnosis_page(d)).text
    assert "missing something" not in text
    assert "no effect describes it" not in text
    assert "The error varies slowly, but one-step predictions leave only noise." in text
    unexplained = Outline(diagnosis_page(replace(d, verdict="unexplained", left=Left(("heading_rad",))))).text
    assert "missing something" in unexplained
    assert "The error varies slowly: no effect describes it." in unexplained


def test_depth_is_not_said_to_agree_with_a_speed_that_was_derived_from_it(diagnosis, no_figures):
    own = "depth against speed through the water"
    kinematics = Kinematics((), (), (own, "heading against gyros"))
    d = replace(diagnosis, kinematics=kinematics)
    assert own in Outline(diagnosis_page(d)).text
    attrs = {"derived": "depth_m: pressure; u_mps: depth rate over sine of pitch, both averaged over 30 s"}
    values = {name: d.record[name] for name in d.record.names}
    d = replace(d, record=Record.from_arrays(d.record.time, values, attrs=attrs))
    text = Outline(diagnosis_page(d)).text
    assert own not in text
    assert "independent of forces: heading against gyros." in text
    assert as_json(d)["kinematics"]["compared"] == ["heading against gyros"]
    assert (
        "Sensors against each other"
        not in Outline(diagnosis_page(replace(d, kinematics=replace(kinematics, equations=(own,))))).text
    )


def test_an_effect_that_acts_as_a_refitted_coefficient_refers_to_it(diagnosis, no_figures):
    gain = Detectable("effects.rudder.gain", "rudder gain", "1", np.inf, "rudder effectiveness has the same effect")
    bias = Detectable("effects.compass.bias", "compass bias", "rad", np.inf, "the initial states do the same")
    text = Outline(diagnosis_page(replace(diagnosis, detectable=(gain, bias)))).text
    assert "would change the refitted coefficient rudder effectiveness N_dr; see its interval" in text
    assert "not detectable in this log: the initial states do the same" in text


def test_commands_are_named_without_marks_that_a_page_does_not_know(diagnosis, no_figures):
    alike = (replace(diagnosis.effects[0], steady=1e-6),)
    page = diagnosis_page(replace(diagnosis, verdict="unexplained", effects=(), tied=(), alike=alike))
    assert "auv-gym onset looks for when the effect begins or ends" in page
    assert "`" not in page


def test_an_effect_is_compared_with_a_coefficient_that_a_first_fit_does_not_have(diagnosis, no_figures):
    """Added masses and inertia are fitted in a second step; an effect that acts as one was a KeyError here."""
    path = "effects.yaw.moment"  # a path with a title that is no coefficient of the vehicle, and nothing else's here
    c = replace(diagnosis.coefficients[0], path=path, title="a moment")
    moved = replace(diagnosis.effects[0], path="effects.rudder.gain", title="rudder gain", tied_with=(path,))
    d = replace(
        diagnosis, effects=(moved,), rounds=(), detectable=(), coefficients=(c,), verdict="tied",
        tied=((moved.path, path),),
    )  # fmt: skip
    assert "rudder gain has exactly the same effect as constant yaw moment" in Outline(diagnosis_page(d)).text


def test_what_was_filled_in_is_said(diagnosis, no_figures):
    blank = np.where(np.arange(len(diagnosis.record)) == 5, np.nan, diagnosis.record["heading_rad"])
    values = {name: diagnosis.record[name] for name in diagnosis.record.names} | {"heading_rad": blank}
    record = Record.from_arrays(diagnosis.record.time, values)
    text = Outline(diagnosis_page(replace(diagnosis, record=record))).text
    assert "Missing samples were filled in: 1 of heading; fits count none of them." in text


def test_random_pushes_are_said_and_what_they_leave_coloured(diagnosis, no_figures):
    pushed = Noise({"heading_rad": 0.01}, {"r_radps": (0.001, 20.0)})
    text = Outline(diagnosis_page(replace(diagnosis, noise=pushed, left=Left(("heading_rad",), ("heading_rad",))))).text
    assert (
        "Random accelerations push the vehicle (process noise): yaw rate 0.0573 deg/s² RMS with a correlation time of "
        "20 s." in text
    )
    assert "One-step prediction errors are correlated in time (heading) and come in bursts (heading)." in text
    still = Outline(diagnosis_page(replace(diagnosis, noise=Noise({"heading_rad": 0.01}, {}), left=Left()))).text
    assert "Random" not in still
    assert "One-step prediction errors" not in still


def test_what_most_halves_of_the_log_do_not_choose_is_said(diagnosis, no_figures):
    text = Outline(diagnosis_page(diagnosis)).text
    assert "The search also found" not in text
    chosen = [r.chosen.candidate for r in diagnosis.rounds if r.chosen]
    rare = replace(diagnosis.effects[0], frequency=0.55)
    d = replace(diagnosis, effects=(rare,), dropped={chosen[-1].paths[0]: RARE})
    text = Outline(diagnosis_page(d)).text
    assert f"The search also found {chosen[-1].title}, but most halves of the log do not choose it." in text
    assert "It was not kept: most halves of the log do not choose it." in text
    assert "chosen, but not kept" in text
    assert "chosen by 55 % of the halves of the log" in text
    assert f"only 55 % of the halves that were tried choose {short(rare.title)}." in d.summary()
    assert f"The search also found {chosen[-1].title}, but most halves of the log do not choose it." in d.summary()
    assert as_json(d)["dropped"] == [{"path": chosen[-1].paths[0], "why": RARE.format(it="it")}]
    assert as_json(d)["effects"][0]["frequency"] == 0.55


def test_what_the_difference_acts_like_is_shown_and_not_called_named(diagnosis, no_figures):
    first, *others = diagnosis.effects
    alike = (replace(first, steady=1e-6), *others)
    text = Outline(diagnosis_page(replace(diagnosis, verdict="unexplained", effects=(), tied=(), alike=alike))).text
    assert "No effect was named." in text
    assert "Part of the difference acts like the effects below." in text
    assert f"The size of {short(first.name)} differs between parts of the log" in text
    assert first.title in text
    assert "named effects" not in text
    assert "acts like the effects below" not in Outline(diagnosis_page(diagnosis)).text


def test_shades_alternate_by_part(diagnosis):
    figure = figures.log_figure(diagnosis)
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(words) == 2
    assert words[0].startswith("windows of parts 1, 3")
    assert words[1].startswith("windows of parts 2, 4")


@pytest.mark.parametrize("missing", ["matplotlib", "jinja2"])
def test_without_the_extra_the_error_says_what_to_install(diagnosis, monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(ImportError, match=rf"{missing} is not installed; .*: pip install '\.\[render\]'"):
        diagnosis_page(diagnosis)


@pytest.mark.parametrize(
    "value, text",
    [
        (0.0, "0"),
        (1234.5, "1234"),
        (0.99951, "1.00"),
        (-0.27335, "−0.273"),
        (0.00055139, "0.000551"),
        (1.28e-7, "1.28e−07"),
        (float("inf"), "–"),
    ],
)
def test_numbers_for_people(value, text):
    assert number(value) == text


def test_angles_are_in_degrees_and_units_in_print():
    assert amount(np.pi / 6.0, "rad", sign=True) == "+30.0 deg"
    assert amount(12.0, "N m s^2/rad^2") == "12.0 N m s²/rad²"
    assert amount(2.03e-7, "m^3") == "0.203 mL"
    assert amount(-1e-9, "m^3/s") == "−0.00100 mL/s"
    assert amount(0.1, "rad/s^2") == "5.73 deg/s²"
    assert span((-np.pi, np.pi), "rad/s") == "−180 to 180 deg/s"
    assert span((1.7187, 1.7213), "m") == "1.719 to 1.721 m"  # a narrow one has a digit more
    assert span((1027.041, 1027.042), "kg") == "1027.041 to 1027.042 kg"
    assert span((2.0, 2.0), "m") == "2.00 to 2.00 m"


@pytest.mark.parametrize(
    "share, left, told",
    [
        (0.997, Discovery(load_vehicle("slocum"), (), None), "> 99 %"),
        (0.997, None, "100 %"),
        (0.987, Discovery(load_vehicle("slocum"), (), None), "99 %"),
    ],
)
def test_not_all_of_the_error_is_said_to_be_explained_where_something_is_left(
    diagnosis, no_figures, monkeypatch, share, left, told
):
    monkeypatch.setattr("identification.pages.diagnosis_page._rest", lambda d: [])
    text = Outline(diagnosis_page(replace(diagnosis, explained=share, discovery=left, verdict="named"))).text
    assert f"explained{told}of the squared error of free runs above the sensors' noise" in text


def test_units_of_a_term_from_the_data_have_raised_powers(diagnosis, no_figures):
    words = "a moment of 2 N m s^2, times r |r|"
    term: Any = SimpleNamespace(holds=True, terms=[SimpleNamespace(words=words)], summary=lambda: words)
    d = replace(diagnosis, discovery=term)
    assert "explains part of it: a moment of 2 N m s², times r |r|." in d.summary()
    assert "^2" not in Outline(diagnosis_page(d)).text


def test_labels_beside_the_close_up_are_not_longer_than_its_panels(diagnosis, monkeypatch):
    assert figures.quantity_label("t1_share") == channel("t1_share").label  # no unit to name
    monkeypatch.setattr(figures, "quantity_label", lambda name: "volume of the buoyancy engine, mL")
    labels = [axes.get_ylabel() for axes in figures.zoom_figure(diagnosis).axes]
    assert "volume of the buoyancy engine, mL" in labels  # the panel above is taller
    assert "volume of the\nbuoyancy engine,\nmL" in labels


def test_the_log_is_drawn_with_all_that_drives_the_vehicle():
    glider, steered = load_vehicle("slocum_flight"), load_vehicle("slocum")
    for plant, wanted in ((glider, ["buoyancy_volume_m3"]), (steered, ["rudder_rad", "bow_thruster_N"])):
        drawn = [n for n in plant.inputs if figures.drives(n, plant.family.required)]
        assert drawn[: len(wanted)] == wanted
        assert not {"pitch_rad", "temperature_C", "heading_rad"} & set(drawn)


def test_thinning_keeps_extremes_ends_and_breaks():
    values = np.cumsum(np.random.default_rng(0).standard_normal(20_000))
    cuts = [5000, 12_345]
    kept = figures.thinned(values, 1000, cuts)
    assert kept.size <= 1000 + 3 * (len(cuts) + 1)
    assert {int(np.argmin(values)), int(np.argmax(values)), 0, 4999, 5000, 12_344, 12_345, 19_999} <= set(kept.tolist())
    assert np.count_nonzero(kept == values.size) == 3
    lines = np.split(kept, np.flatnonzero(kept == values.size) + 1)
    assert all(np.all(np.diff(line[:-1]) > 0) for line in lines if line.size > 1)


def test_error_growth_is_the_root_mean_square_at_each_time_into_the_windows():
    time = np.arange(0.0, 240.0, 4.0)
    record = Record.from_arrays(time, {"heading_rad": np.zeros(time.size)})
    window = np.repeat([0, 1], 30)
    since = np.tile(4.0 * np.arange(30), 2)
    residual = since * np.where(window == 0, 3.0, 4.0)
    runs = FreeRuns(("heading_rad",), np.arange(60), window, residual[:, None], residual[:, None], since >= 20.0)
    seconds, error = figures.error_growth(runs, record, 120.0, 0)
    one_sample = np.isclose(seconds % 4.0, 0.0)  # bins of 5 s hold one or two samples of a window
    assert one_sample.sum() > 15
    np.testing.assert_allclose(error[one_sample], seconds[one_sample] * np.sqrt(12.5))


def test_segments_that_start_their_clock_again_are_drawn_one_after_another():
    part = Record.from_arrays(np.arange(0.0, 100.0, 4.0), {"heading_rad": np.zeros(25)})
    clock = figures.Clock(concat([part, part]))
    assert clock.closed_up
    assert list(clock.cuts) == [25]
    assert np.all(np.diff(clock.times) > 0.0)
    assert "one after another" in clock.label


def test_set_points_are_drawn_within_half_a_turn_of_the_heading():
    heading = np.array([0.1, 6.2, 10.0, np.nan])
    command = np.array([0.2, -0.1, 10.0 - 4.0 * np.pi, 1.0])
    np.testing.assert_allclose(nearest_turns(command, heading), [0.2, 2.0 * np.pi - 0.1, 10.0, 1.0])


def test_candidates_that_were_not_fitted_are_folded_away(diagnosis, page):
    unfitted = [[t.candidate.title for t in r.trials if t.state is None] for r in diagnosis.rounds]
    assert any(unfitted)
    candidates = page[page.index('id="candidates"') : page.index('id="effects"')]
    folded = re.findall(r"<details><summary>(\d+) candidates? w.*?</details>", candidates, re.DOTALL)
    assert [int(count) for count in folded] == [len(titles) for titles in unfitted if titles]
    assert 'class="unseen"' not in re.sub(r"<details>.*?</details>", "", candidates, flags=re.DOTALL)


def test_the_examples_are_the_worst_windows_and_a_typical_one(diagnosis):
    runs = diagnosis.before.unseen
    output = runs.channels.index(figures.most_improved(diagnosis))
    keep = runs.scored
    sizes = {w: np.mean(runs.residual[keep & (runs.window == w), output] ** 2) for w in np.unique(runs.window)}
    examples = dict(figures.example_windows(diagnosis))
    worst = next(number for title, number in examples.items() if title.startswith("Largest error before"))
    assert worst == max(sizes, key=lambda w: sizes[w])
    assert len(set(examples.values())) == len(examples) >= 2


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_a_browser_draws_the_page_without_a_console_message(page, tmp_path):
    assert not console_messages(page, tmp_path)
    picture = tmp_path / "page.png"
    assert picture.stat().st_size > 50_000
    # the same look at a page that does complain, to know that complaints are seen
    assert console_messages("<!doctype html><title>x</title><script>console.error('seen')</script>", tmp_path)


def console_messages(page: str, folder: Path) -> list[str]:
    """What a browser writes to its console while it draws a page."""
    (folder / "page.html").write_text(page, encoding="utf-8")
    assert CHROMIUM is not None
    done = subprocess.run(
        [
            CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run",
            "--disable-background-networking", "--disable-component-update", "--disable-sync",
            "--enable-logging=stderr", "--v=0", f"--user-data-dir={folder / 'profile'}", "--window-size=1100,6000",
            f"--screenshot={folder / 'page.png'}", (folder / "page.html").as_uri(),
        ],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    return [line for line in done.stderr.splitlines() if "CONSOLE" in line]


def test_axes_write_whole_numbers_instead_of_an_offset():
    def draw():
        figure = new_figure(2.0)
        figure.add_subplot().plot([1027.66, 1027.78], [0.0, 1.0])
        return figure

    drawn = svg(draw, "density", "water density")
    assert "1027.7" in drawn
    assert "e3" not in re.sub(r'(id|clip-path|href|d)="[^"]*"', "", drawn)
