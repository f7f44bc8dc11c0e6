"""Reports and files of a comparison of missions, of a series of missions, and of the search in time."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym import __version__
from auv_gym.writing import writable_folder, write_text
from identification.changes.missions import Comparison, Unchanged, detectable_beside
from identification.changes.onset import Timed, Timeline
from identification.changes.series import Series
from identification.changes.spans import OUTSIDE
from identification.changes.timed_forms import GROWING, UNTIL
from identification.changes.wording import (
    as_json,
    moment_words,
    named,
    rate_of,
    scatter_of,
    series_json,
    series_summary,
    since_words,
    size_of,
    summary,
    tied_words,
    timeline_json,
    timeline_summary,
    when_words,
)
from identification.deciding import BLOCKS
from identification.diagnosis.wording import for_people, inside, interval, typeset
from identification.pages.drawing import AFTER, BEFORE, QUIET, WIDTH
from identification.pages.model_page import Section
from identification.pages.page import Table, amount, drawn, page, span

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NAMED = 8  # missions; with more of them, their names do not fit below a picture
_ROW = 0.42  # inches of picture height per parameter
_BESIDE = 2.0  # times the largest change, as the end of a logarithmic axis: its dot is drawn whole
_FAR = 20.0  # smallest detectable changes; a picture whose changes exceed this has a logarithmic axis


def write_comparison(found: Comparison, folder: str | os.PathLike) -> dict[str, Path]:
    """Write changes.json and report.html; returns their paths by name.

    Raises ValueError if the folder cannot be written, ImportError without the extra `render`.
    """
    texts = {
        "changes.json": json.dumps(as_json(found), indent=2) + "\n",
        "report.html": comparison_page(found),
    }
    return _written(texts, folder)


def _written(texts: Mapping[str, str], folder: str | os.PathLike) -> dict[str, Path]:
    """Write these texts to files in a folder; returns their paths by name."""
    out = writable_folder(folder)
    for name, text in texts.items():
        write_text(out / name, text)
    return {name: out / name for name in texts}


def write_series(found: Series, folder: str | os.PathLike) -> dict[str, Path]:
    """Write series.json and series.html, as `write_comparison` does."""
    texts = {"series.json": json.dumps(series_json(found), indent=2) + "\n", "series.html": series_page(found)}
    return _written(texts, folder)


def write_timeline(found: Timeline, folder: str | os.PathLike) -> dict[str, Path]:
    """Write onset.json and onset.html, as `write_comparison` does."""
    return _written(
        {"onset.json": json.dumps(timeline_json(found), indent=2) + "\n", "onset.html": timeline_page(found)}, folder
    )


def timeline_page(found: Timeline) -> str:
    """The report on when each effect acts: the text of one HTML page with one picture."""
    rows = [
        (
            t.title if t.path.startswith("effects.") else f"change of {t.title}",
            (_typed(inside(t.size.value, t.size.ci95, t.unit)), _typed(interval(t.size.ci95, t.unit))),
            when_words(t),
            f"{t.evidence:.0f}",
            tied_words(t.tied, found.plant, t.form) or "–",
        )
        for t in found.found
    ]
    pictures = [
        drawn(
            lambda: timeline_figure(found),
            "onset",
            "Size of each effect over the log, with its 95 % interval and those of the times at which it changes.",
            "The size of each effect over the log. Blue band: its 95 % interval. Orange: the 95 % intervals of the "
            "times at which it begins or ends.",
        )
        for _ in found.found[:1]
    ]
    text = (
        f"Each effect is tried throughout the log, from and until each of {BLOCKS - 1} times, between and except "
        f"between every two of them, and growing: {found.candidates} candidates in all. "
        "An effect is named by the rules of a diagnosis, with a threshold for all of them."
    )
    content: dict[str, Any] = {
        "title": f"{found.plant.name}: when effects act",
        "eyebrow": f"a log of {found.span[1] - found.span[0]:.0f} s",
        "found": timeline_summary(found),
        "sections": [
            Section(
                "What is missing, and when",
                [text],
                [Table(("what", "size", "when", "evidence", "alternatives"), rows, closing=1)] if rows else (),
                pictures,
            ),
            Section("The log", found.notes or ("Nothing was left out, repaired or cut.",)),
        ],
        "version": __version__,
    }
    return page("models.html", content)


def timeline_figure(found: Timeline) -> Figure:
    """The size of each effect over the time of the log, one panel each."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 1.7 * len(found.found) + 0.4), layout="constrained")
    panels = figure.subplots(len(found.found), 1, sharex=True, squeeze=False)[:, 0]
    for axes, t in zip(panels, found.found, strict=True):
        scale, unit = for_people(t.unit)
        times, shares = _course(t, found.span)
        axes.plot(times, scale * t.size.value * shares, color=AFTER)
        low, high = (scale * limit * shares for limit in t.size.ci95)
        axes.fill_between(times, low, high, color=AFTER, alpha=0.2, linewidth=0.0)
        for one in (t.time, t.second):
            if one is not None:
                axes.axvspan(*one.ci95, color=BEFORE, alpha=0.25, linewidth=0.0)
        axes.axhline(0.0, color=QUIET, linewidth=0.8)
        axes.set_title(f"{t.title}{'' if unit == '1' else f', {typeset(unit)}'}", loc="left")
    panels[-1].set_xlabel("time, s")
    panels[-1].set_xlim(*found.span)
    return figure


def _course(t: Timed, over: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Times, s, and the share of an effect's size that acts then, for drawing a line with steps."""
    begin, end = over
    if t.form == GROWING:
        return np.array(over), np.array([0.0, 1.0])
    edges = [one.value for one in (t.time, t.second) if one is not None]
    first = float(t.form in (UNTIL, OUTSIDE) or not edges)
    shares = [first if k % 2 == 0 else 1.0 - first for k in range(len(edges) + 1)]
    times = np.array([begin, *np.repeat(edges, 2), end])
    return times, np.repeat(shares, 2)


def series_page(found: Series) -> str:
    """The trends over missions: the text of one HTML page with one picture."""
    rows = [
        (
            t.title,
            (rate.replace("-", "−"), limits.replace("-", "−")),
            t.per,
            scatter_of(t),
            "–" if t.step is None else (amount(t.step.change.value, t.unit), since_words(t.step)),
            tied_words(t.tied, found.plant) or "–",
        )
        for t in found.trends
        for rate, limits in [rate_of(t)]
    ]
    texts = [f"Mission {name} gives no estimates: {why}" for name, why in found.failed.items()]
    pictures = [
        drawn(
            lambda: series_figure(found),
            "series",
            "Size of each followed parameter in every mission, with its 95 % interval and the line through them.",
            "The estimate from each mission with its 95 % interval, and the line through them. It is grey if one step "
            "explains the missions better.",
        )
        for _ in found.trends[:1]
    ]
    section = Section(
        "Trends",
        [
            "Scatter is the standard deviation of the missions about the line, beyond their own intervals. The 95 % "
            "interval of a trend allows for it. A step between two missions is stated if it certainly explains them "
            "better than one value, and better than a line.",
            *texts,
        ],
        [Table(("what", "trend", "per", "scatter", "step", "alternatives"), rows, closing=2)],
        pictures,
    )
    content: dict[str, Any] = {
        "title": f"{found.plant.name}: {len(found.missions)} missions",
        "eyebrow": ", ".join(found.missions),
        "found": series_summary(found),
        "sections": [section],
        "version": __version__,
    }
    return page("models.html", content)


def series_figure(found: Series) -> Figure:
    """The sizes of each parameter over the missions, one panel each."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 1.9 * len(found.trends) + 0.4), layout="constrained")
    for axes, t in zip(figure.subplots(len(found.trends), 1, sharex=True, squeeze=False)[:, 0], found.trends):
        scale, unit = for_people(t.unit)
        at, values = np.array(t.at), scale * np.array([s.value for s in t.sizes])
        limits = scale * np.array([s.ci95 for s in t.sizes])
        axes.errorbar(at, values, [values - limits[:, 0], limits[:, 1] - values], fmt="o", color=BEFORE, capsize=3)
        ends = np.array([at.min(), at.max()])
        axes.plot(ends, scale * (t.level + t.rate.value * (ends - at.mean())), color=QUIET if t.step else AFTER)
        if t.step is not None:
            axes.plot(
                [ends[0], t.step.at, t.step.at, ends[1]],
                scale * np.repeat([t.step.before.value, t.step.after.value], 2),
                color=AFTER,
            )
        axes.set_title(f"{named(t)}{'' if unit == '1' else f', {typeset(unit)}'}", loc="left")
        axes.set_xlabel(t.per if t is found.trends[-1] else "")
        if t.per == "mission" and len(found.missions) <= _NAMED:
            axes.set_xticks(range(len(found.missions)), found.missions)
    return figure


def comparison_page(found: Comparison) -> str:
    """The report as the text of one self-contained HTML page."""
    before, after = found.missions
    sections = [
        Section(
            "What changed", tables=[_changes(found), *_by_log(found)] if found.changed else (), texts=_texts(found)
        ),
        Section(
            "What did not change",
            [
                "For each parameter: the estimated change if it alone had changed, and the change that would have been "
                "found with 95 % probability."
            ],
            [_steady(found)],
            [
                drawn(
                    lambda: change_figure(found),
                    "changes",
                    "Estimated change of each parameter with its 95 % interval, relative to its detectable change.",
                    "Estimated changes with their 95 % intervals, in units of the smallest change that would have been "
                    "found with 95 % probability (dashed lines). Blue: parameters that changed.",
                )
            ],
        ),
        Section("The logs", found.notes or ("Nothing was left out, repaired or cut.",)),
    ]
    content: dict[str, Any] = {
        "title": f"{found.plant.name}: what changed",
        "eyebrow": f"before: {', '.join(before)}; after: {', '.join(after)}",
        "found": summary(found),
        "sections": sections,
        "version": __version__,
    }
    return page("models.html", content)


def _texts(found: Comparison) -> list[str]:
    if not found.changed:
        return [f"None of {found.candidates} candidate changes of effects and coefficients was found."]
    return [
        "All missions are fitted together. A changed parameter has one value before and one after; all others have the "
        "same value throughout. A change is named by the rules for an effect in a diagnosis: its evidence (gain in "
        f"log-likelihood) must exceed the threshold for {found.candidates} candidates, and each part of the missions, "
        "predicted from the others, must confirm it.",
        "Another time than between the two sides is stated if a step at that time certainly explains the logs better, "
        "by the threshold for the beginnings of all logs and 23 equally spaced times. The values before and after are "
        "then those on both sides of the step.",
    ]


def _changes(found: Comparison) -> Table:
    rows = [
        (
            c.title,
            *((amount(s.value, c.unit), span(s.ci95, c.unit)) for s in (c.before, c.after, c.change)),
            f"{c.evidence:.0f}",
            "–" if c.moment is None else moment_words(c.moment),
            tied_words(c.tied, found.plant) or "–",
        )
        for c in found.changed
    ]
    for c in found.common:
        same = (amount(c.size.value, c.unit), span(c.size.ci95, c.unit))
        rows.append((c.title, same, same, ("–", ""), f"{c.evidence:.0f}", "–", tied_words(c.tied, found.plant) or "–"))
    return Table(("what", "before", "after", "change", "evidence", "when", "alternatives"), rows, closing=2)


def _by_log(found: Comparison) -> list[Table]:
    """The size of each changed parameter in each log, if there are more than two logs."""
    return [
        Table((f"{named(c)} in", "size"), [(s.log, (amount(s.value, c.unit), span(s.ci95, c.unit))) for s in c.sizes])
        for c in found.changed
        if c.sizes
    ]


def _steady(found: Comparison) -> Table:
    rows = [
        (
            u.title,
            amount(u.value, u.unit),
            (_size(u.change.value, u), f"{_size(u.change.ci95[0], u)} to {_size(u.change.ci95[1], u)}")
            if np.isfinite(u.detectable)
            else "–",
            _size(u.detectable, u) if np.isfinite(u.detectable) else u.reason or "not detectable",
        )
        for u in found.unchanged
    ]
    return Table(("what", "value", "change", "smallest detectable change"), rows)


def _size(value: float, u: Unchanged) -> str:
    """A change with a true minus sign, as pages print numbers."""
    return _typed(size_of(value, u))


def _typed(text: str) -> str:
    """The text with true minus signs."""
    return text.replace("-", "−")


def change_figure(found: Comparison) -> Figure:
    """Changes with their intervals, each relative to its smallest detectable change."""
    from matplotlib.figure import Figure

    steady = [u for u in found.unchanged if np.isfinite(u.detectable)]
    figure = Figure(figsize=(WIDTH, 1.1 + _ROW * max(len(steady) + len(found.changed), 1)), layout="constrained")
    axes = figure.add_subplot()
    names = []
    for c in found.changed:
        scale = detectable_beside(c.change, found.candidates) or 1.0
        axes.errorbar(*_bar(c.change.value, c.change.ci95, scale, len(names)), fmt="o", color=AFTER, capsize=3)
        names.append(f"{named(c)} (changed)")
    for u in steady:
        axes.errorbar(*_bar(u.change.value, u.change.ci95, u.detectable, len(names)), fmt="o", color=BEFORE, capsize=3)
        names.append(named(u))
    for limit in (-1.0, 1.0):
        axes.axvline(limit, color=QUIET, linewidth=0.8, linestyle="--")
    axes.axvline(0.0, color=QUIET, linewidth=0.8)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    label = "change, relative to the smallest detectable change"
    low, high = axes.dataLim.intervalx
    if max(-low, high) > _FAR:  # on a linear axis, one large change would squeeze all others
        axes.set_xscale("symlog", linthresh=1.0)
        axes.set_xlim(_BESIDE * low, _BESIDE * high)
        label += "; logarithmic beyond 1"
    axes.set_xlabel(label)
    return figure


def _bar(value: float, limits: tuple[float, float], scale: float, row: int) -> tuple[list[float], list[int], None, Any]:
    """The arguments that draw an interval as an error bar: position, row, and the lengths to either side."""
    low, high = limits
    return [value / scale], [row], None, [[(value - low) / scale], [(high - value) / scale]]
