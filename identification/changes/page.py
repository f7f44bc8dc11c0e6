"""The page of a comparison of missions, and the files that it leaves."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym import __version__
from auv_gym.writing import replacing, writable_folder
from identification.changes.missions import Comparison
from identification.changes.wording import as_json, named, size_of, summary
from identification.pages.drawing import AFTER, BEFORE, QUIET, WIDTH
from identification.pages.model_page import Section
from identification.pages.page import Table, amount, drawn, page, span

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ROW = 0.42  # inches of a picture for a parameter


def write_comparison(found: Comparison, folder: str | os.PathLike) -> dict[str, Path]:
    """Write changes.json and report.html; their paths by name.

    Raises ValueError if the folder cannot be written, ImportError without the extra `render`.
    """
    out = writable_folder(folder)
    texts = {
        "changes.json": json.dumps(as_json(found), indent=2) + "\n",
        "report.html": comparison_page(found),
    }
    for name, text in texts.items():
        with replacing(out / name) as new:
            new.write_text(text, encoding="utf-8")
    return {name: out / name for name in texts}


def comparison_page(found: Comparison) -> str:
    """The report as the text of one HTML page, which needs no other file and no network."""
    before, after = found.missions
    sections = [
        Section("What has changed", tables=[_changes(found)] if found.changed else (), texts=_texts(found)),
        Section(
            "What has not",
            [
                "The estimate of a change of each, if it alone had changed, and the change that would have been found "
                "with 95 % probability."
            ],
            [_steady(found)],
            [
                drawn(
                    lambda: change_figure(found),
                    "changes",
                    "Estimated change of each parameter with its 95 % interval, over the change that would be found.",
                    "Changes with their 95 % intervals, over the change of each that would have been found with 95 % "
                    "probability. Blue: changed.",
                )
            ],
        ),
        Section("The logs", found.notes or ("Nothing was left out, mended or cut.",)),
    ]
    content: dict[str, Any] = {
        "title": f"{found.plant.name}: what has changed",
        "eyebrow": f"before: {', '.join(before)}; after: {', '.join(after)}",
        "found": summary(found),
        "sections": sections,
        "version": __version__,
    }
    return page("models.html", content)


def _texts(found: Comparison) -> list[str]:
    if not found.changed:
        return [f"Nothing, of {found.candidates} forms of effects and coefficients that were tried."]
    return [
        "Each side has its own value, all else is common. A change is named as an effect of a diagnosis is: by "
        f"evidence beyond the bar for {found.candidates} candidates, which each part of the missions foretells from "
        "the others."
    ]


def _changes(found: Comparison) -> Table:
    rows = [
        (
            c.title,
            *((amount(s.value, c.unit), span(s.ci95, c.unit)) for s in (c.before, c.after, c.change)),
            f"{c.evidence:.0f}",
            ", ".join(c.tied),
        )
        for c in found.changed
    ]
    for c in found.common:
        same = (amount(c.size.value, c.unit), span(c.size.ci95, c.unit))
        rows.append((c.title, same, same, "–", f"{c.evidence:.0f}", ", ".join(c.tied)))
    return Table(("what", "before", "after", "change", "evidence", "could also be"), rows)


def _steady(found: Comparison) -> Table:
    rows = [
        (
            u.title,
            amount(u.value, u.unit),
            (size_of(u.change.value, u), f"{size_of(u.change.ci95[0], u)} to {size_of(u.change.ci95[1], u)}")
            if np.isfinite(u.detectable)
            else "–",
            size_of(u.detectable, u) if np.isfinite(u.detectable) else u.reason or "not seen",
        )
        for u in found.unchanged
    ]
    return Table(("what", "value", "change", "would have been found"), rows)


def change_figure(found: Comparison) -> Figure:
    """Changes with their intervals, each over the change that would have been found."""
    from matplotlib.figure import Figure

    steady = [u for u in found.unchanged if np.isfinite(u.detectable)]
    figure = Figure(figsize=(WIDTH, 1.1 + _ROW * max(len(steady) + len(found.changed), 1)), layout="constrained")
    axes = figure.add_subplot()
    names = []
    for c in found.changed:
        size = abs(c.change.value)
        axes.errorbar(*_bar(c.change.value, c.change.ci95, size or 1.0, len(names)), fmt="o", color=AFTER, capsize=3)
        names.append(f"{named(c)}, over itself")
    for u in steady:
        axes.errorbar(*_bar(u.change.value, u.change.ci95, u.detectable, len(names)), fmt="o", color=BEFORE, capsize=3)
        names.append(named(u))
    for limit in (-1.0, 1.0):
        axes.axvline(limit, color=QUIET, linewidth=0.8, linestyle="--")
    axes.axvline(0.0, color=QUIET, linewidth=0.8)
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel("change, over what would have been found")
    return figure


def _bar(value: float, limits: tuple[float, float], scale: float, row: int) -> tuple[list[float], list[int], None, Any]:
    """What a bar of an interval is drawn from: place, row, and lengths to either side."""
    low, high = limits
    return [value / scale], [row], None, [[(value - low) / scale], [(high - value) / scale]]
